"""Integer version of each stage, raised when its output changes meaning, so that the workflow reruns it."""

VERSIONS = {
    "synthesize": 1,
    "capture": 1,
    "import": 1,
    "hits": 1,
    "cache": 2,
    "bake": 1,
    "fit": 2,
    "emitters": 2,
    "refine": 1,
    "materials": 1,
    "render": 1,
    "relight": 1,
    "metrics": 2,
    "report": 2,
}
