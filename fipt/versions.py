"""Integer version of each stage, raised when its output changes meaning, so that the workflow reruns it."""

VERSIONS = {
    "synthesize": 1,
    "import": 1,
    "hits": 1,
    "background": 1,
    "cache": 1,
    "bake": 3,
    "fit": 2,
    "emitters": 1,
    "refine": 3,
    "materials": 2,
    "render": 2,
    "relight": 2,
    "metrics": 2,
    "report": 1,
}
