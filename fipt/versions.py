"""Integer version of each stage, raised when its output changes meaning, so that the workflow reruns it."""

VERSIONS = {
    "synthesize": 1,
    "capture": 1,
    "import": 1,
    "hits": 1,
    "background": 1,
    "cache": 2,
    "bake": 3,
    "fit": 3,
    "emitters": 2,
    "refine": 3,
    "materials": 2,
    "render": 2,
    "relight": 2,
    "lamps": 1,
    "metrics": 3,
    "report": 3,
}
