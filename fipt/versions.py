"""Integer version of each stage, raised when its output changes meaning, so that the workflow reruns it."""

VERSIONS = {
    "synthesize": 2,
    "capture": 1,
    "poses": 1,
    "import": 1,
    "check_poses": 1,
    "hits": 1,
    "segment": 1,
    "fuse": 1,
    "background": 1,
    "cache": 2,
    "bake": 3,
    "fit": 3,
    "emitters": 2,
    "refine": 3,
    "materials": 2,
    "render": 2,
    "relight": 2,
    "export": 1,
    "metrics": 3,
    "report": 2,
}
