"""Integer version of each stage, raised when its output changes meaning, so that the workflow reruns it."""

VERSIONS = {
    "synthesize": 1,
    "capture": 1,
    "import": 1,
    "hits": 1,
    "cache": 1,
    "bake": 1,
    "fit": 1,
    "emitters": 1,
    "refine": 1,
    "materials": 1,
    "render": 1,
    "relight": 1,
    "metrics": 1,
    "report": 1,
}
