"""Integer version of each stage, raised when its output changes meaning, so that the workflow reruns it."""

VERSIONS = {
    "synthesize": 1,
    "import": 1,
    "hits": 1,
    "background": 1,
    "cache": 1,
    "bake": 2,
    "fit": 2,
    "emitters": 1,
    "refine": 2,
    "materials": 2,
    "render": 1,
    "relight": 1,
    "metrics": 2,
    "report": 1,
}
