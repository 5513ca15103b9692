"""A room that `fipt findings` judges, without files: a box with a lamp in its ceiling, and pixels that show its floor.

All is sound; a test spoils what its check is about.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from fipt.scene.cameras import Camera
from fipt.scene.confidence import Confidence, records
from fipt.scene.emitters import Emitters
from fipt.scene.environment import NOTHING
from fipt.scene.mesh import Mesh
from fipt.stages.findings.explained import ExplainedPixels
from fipt.stages.findings.retakes import Retake
from fipt.stages.findings.settings import FindingsSettings
from tests import scenes

SIDE = 4.0
"""Of the room, metres."""
GRID = 24
"""Pixels along each side of a view."""
VIEWS = 6


def mesh() -> Mesh:
    """A closed box; triangles 4 and 5 are the floor, 12 and 13 the lamp."""
    return scenes.joined(
        scenes.box((0, 0, 0), (SIDE, SIDE, SIDE)), scenes.emitter_quad((1.5, 2.5), SIDE - 0.01, (1.5, 2.5))
    )


def camera(number: int) -> Camera:
    """A camera below the ceiling that looks straight down."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    pose[:3, 3] = 1.5 + 0.2 * number, 3.0, 2.0
    half = GRID / 2
    return Camera(f"v{number}", "train", GRID, GRID, GRID, GRID, half, half, pose)


def emitters(triangle=(12, 13), **changed) -> Emitters:
    """The lamp, or other triangles, each with a number of its own in ``emitter`` if that is given."""
    count = len(triangle)
    known = Emitters(
        triangle=np.array(triangle, np.int32),
        radiance=np.full((count, 3), 8, np.float32),
        area=np.full(count, 0.5, np.float32),
        emitter=np.zeros(count, np.int32),
        views=np.full(count, 3, np.int32),
        confidence=np.ones(count, np.float32),
        clipped=np.zeros(count, np.float32),
        lower_bound=np.zeros(count, bool),
    )
    return replace(known, **changed)


def pixels(**changed) -> ExplainedPixels:
    """Pixels of all views on the floor, which is one part of one grey; explained but for noise of two percent."""
    rng = np.random.default_rng(0)
    view, row, column = (x.reshape(-1) for x in np.mgrid[:VIEWS, :GRID, :GRID])
    count = len(view)
    x, z = (column + 0.5) / GRID * SIDE, (row + 0.5) / GRID * SIDE
    grey = np.full((count, 3), 0.5)
    known = {
        "views": tuple(f"v{k}" for k in range(VIEWS)),
        "view": view,
        "row": row,
        "column": column,
        "photo": grey * np.exp(0.02 * rng.normal(size=(count, 1))),
        "predicted": grey,
        "diffuse": np.ones((count, 3)),
        "brightest": np.ones(count),
        "position": np.column_stack([x, np.zeros(count), z]),
        "normal": np.tile([0.0, 1.0, 0.0], (count, 1)),
        "base_color": grey,
        "roughness": np.ones(count),
        "metallic": np.zeros(count),
        "footprint": np.full(count, SIDE / GRID),
        "share": np.ones(count),
        "mixed": np.zeros(count, bool),
        "segment": np.ones(count, np.int64),
        "triangle": np.full(count, 4),
        "emits": np.zeros(count, bool),
        "use": np.ones(count, bool),
        "clipped": np.zeros(count, bool),
    }
    return ExplainedPixels(**known | changed)


def confidence(error=0.03, unsure=0.03) -> Confidence:
    """Predicted errors of the floor: of the half x < 2, and of the other."""
    x, z = (a.reshape(-1) for a in np.mgrid[:GRID, :GRID] / GRID * SIDE)
    place, up = np.column_stack([x, np.zeros(len(x)), z]), np.tile([0.0, 1.0, 0.0], (len(x), 1))
    center, resolution = np.full(3, SIDE / 2), GRID
    record, first = np.unique(records(place, up, center, SIDE, resolution), return_index=True)
    kd = np.where(x[first] < SIDE / 2, error, unsure).astype(np.float32)
    nothing = np.zeros(len(record), np.float32)
    return Confidence(center, SIDE, resolution, record, kd, nothing, nothing, nothing == 0, np.full(3, 0.03))


def retake(number: int, ratio=1.0) -> Retake:
    """A view of the floor, rendered ``ratio`` times as bright as its photograph but for noise of two percent."""
    rng = np.random.default_rng(number)
    row, column = np.mgrid[:GRID, :GRID]
    x, z = (column + 0.5) / GRID * SIDE, (row + 0.5) / GRID * SIDE
    photo = np.full((GRID, GRID, 3), 0.5)
    noise = np.exp(0.02 * rng.normal(size=(GRID, GRID, 1)))
    return Retake(
        camera(number),
        photo,
        photo * noise * np.broadcast_to(ratio, (GRID, GRID))[..., None],
        np.ones((GRID, GRID)),
        np.stack([x, 0 * x, z], axis=-1),
        np.broadcast_to([0.0, 1.0, 0.0], (GRID, GRID, 3)),
        np.full((GRID, GRID), 4),
        np.zeros((GRID, GRID), bool),
    )


def room(**changed) -> SimpleNamespace:
    """The room with everything that checks read."""
    cameras = [camera(k) for k in range(VIEWS)]
    by_name = {each.name: each for each in cameras}
    data = SimpleNamespace(
        camera=by_name.__getitem__,
        views=lambda split: list(by_name) if split == "train" else [],
        image=lambda view: (np.full((GRID, GRID, 3), 0.5, np.float32), np.ones((GRID, GRID))),
    )
    known = {
        "data": data,
        "mesh": mesh(),
        "fitted": SimpleNamespace(emitters=emitters(), environment=NOTHING),
        "explained": pixels(),
        "retakes": [retake(k) for k in range(VIEWS)],
        "exposure": 0.4,
        "settings": FindingsSettings(),
        "shards": [],
        "held_out": [],
        "earlier": None,
        "prepared": {},
        "rounds": (),
        "confidence": confidence(),
    }
    return SimpleNamespace(**known | changed)
