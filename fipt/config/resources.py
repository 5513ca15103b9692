"""What jobs ask a machine for: memory and time as functions of views, pixels and triangles, in one table.

Figures of memory are those of docs/scaling.json (`python -m benchmarks.scaling`: views, pixels and triangles doubled
three times, and 202 views of 640x320), which a test compares. It denoises nothing there: jobs that may have the network
on top. Rules that it does not run ask for a fixed size. All ask for twice as much whenever a job is tried again. Times
are bounds for a queue, not predictions: settings decide them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

_MARGIN, _SPARE = 1.3, 150.0
"""Factor on what was measured, and megabytes on top: of the system, and of what is mapped."""

WORKFLOW = 250.0
"""Megabytes of the workflow's own processes, which count as the job's on a cluster."""

_DENOISER = 190.0
"""Megabytes of the denoising network: a bake of a tiny room takes 427 MB with it."""

_MINUTES = 30.0
"""Minutes that every job may take, whatever its size."""

PIXELS = 400_000
"""Pixels of a view where nobody says."""

TRIANGLES = 1_000_000
"""Triangles of a mesh that does not exist yet."""


@dataclass(frozen=True)
class Work:
    """How large a job is.

    Attributes
    ----------
    view, shard, every
        Pixels of one view of the dataset, of its shard, of all training views.
    triangles
        Of the mesh.
    photograph
        Pixels of one view before `import.downscale`.
    """

    view: int
    shard: int
    every: int
    triangles: int
    photograph: int

    @property
    def photographs(self) -> int:
        """Pixels of all training views before `import.downscale`."""
        return self.every // self.view * self.photograph


@dataclass(frozen=True)
class Growth:
    """How the needs of a rule grow.

    Attributes
    ----------
    base
        Megabytes of a small room.
    pixel
        Bytes for each pixel that the job looks at.
    of
        Which pixels these are, an attribute of `Work`.
    triangle
        Bytes for each triangle.
    minutes
        For a million of these pixels.
    """

    base: float
    pixel: float = 0.0
    of: Literal["view", "shard", "every", "photograph", "photographs"] = "shard"
    triangle: float = 0.0
    minutes: float = 60.0


MEASURED: dict[str, Growth] = {
    "synthesize_room": Growth(235),
    "synthesize_views": Growth(260 + _DENOISER, pixel=200),
    "check_poses": Growth(250, pixel=100, of="every", triangle=400),
    "samples": Growth(220, pixel=500, triangle=450),
    "environment": Growth(310, pixel=120, of="every", triangle=450),
    "cache": Growth(380, pixel=45, of="every", triangle=350, minutes=10),
    "bake": Growth(235 + _DENOISER, pixel=250, triangle=450),
    "fit": Growth(1300, pixel=125, of="every", triangle=50, minutes=30),
    "emitters": Growth(520, pixel=64, of="every", triangle=200, minutes=10),
    "refine": Growth(545 + _DENOISER, pixel=330, triangle=520),
    "review": Growth(130, triangle=190),
    "material_maps": Growth(470, pixel=220, triangle=250),
    "render_views": Growth(545 + _DENOISER, pixel=450, of="view", triangle=340),
    "olat_views": Growth(556 + _DENOISER, pixel=2150, of="view", triangle=520, minutes=240),
    "scene_metrics": Growth(130, pixel=60, of="view", triangle=410),
    "scene_report": Growth(170, pixel=350, of="view", triangle=400),
}
"""Rule -> growth that was measured."""

FIXED: dict[str, Growth] = {
    "photographed_room": Growth(3000),
    "photograph_calibration": Growth(3000),
    "photograph_views": Growth(3000),
    "synthesize_truth": Growth(3000),
    "synthesize_relit": Growth(1000, pixel=200),
    "calibrate": Growth(1500),
    "develop": Growth(1500),
    "qa": Growth(1500),
    "estimate_poses": Growth(4500, minutes=120),
    "import_views": Growth(3000),
    "import_dataset": Growth(360, pixel=100, of="photograph", triangle=500),
    "depth": Growth(0, of="every", minutes=120),
    "first_mesh": Growth(0, of="every"),
    "check_views": Growth(250, pixel=100, of="photographs"),
    "mesh": Growth(0, of="every"),
    "segment": Growth(4500, minutes=120),
    "fuse": Growth(130, pixel=250, of="every", triangle=800),
    "regroup": Growth(450, pixel=140, of="every", triangle=200),
    "irradiance": Growth(1000, pixel=125, of="every"),
    "true_constants": Growth(1000, pixel=125, of="every"),
    "inverse_trace": Growth(3000, pixel=125, of="every", triangle=500, minutes=120),
    "import_results": Growth(1500),
    "plant_errors": Growth(1500, triangle=200),
    "metrics_of_others": Growth(1500),
    "relight_views": Growth(1000, pixel=450, of="view", triangle=500),
    "join_images": Growth(3000),
    "export_room": Growth(2000, pixel=450, of="view", triangle=1500),
    "check_export": Growth(2000, pixel=450, of="view", triangle=1500),
    "findings": Growth(1000, pixel=150, of="every", triangle=500),
    "score_method": Growth(700),
    "compare_methods": Growth(700),
    "comparison_page": Growth(3000),
}
"""Rule -> what it asks for, where scaling was not measured; imports, fuse and regroup by what they used in finished
rooms (`python -m benchmarks.asked`); depth and meshes ask for what their settings bound."""

WRITTEN = {
    "synthesize_views": 10,
    "samples": 80,
    "bake": 25,
    "refine": 50,
    "render_views": 10,
    "olat_views": 10,
}
"""Rule -> bytes on the disk for each pixel of its shard, at least; docs/robustness.md has what was measured."""

_RECORDS = 20_000
"""Bytes that every job writes at least: its log, figures and manifests."""


def growth(rule: str) -> Growth:
    """What is known of a rule."""
    return MEASURED.get(rule) or FIXED[rule]


def memory_mb(rule: str, work: Work, attempt: int = 1) -> int:
    """Megabytes that a job asks for, twice as many at every other attempt."""
    own = growth(rule)
    used = own.base + (own.pixel * getattr(work, own.of) + own.triangle * work.triangles) / 1e6
    return round((_MARGIN * used + _SPARE) * 2 ** (attempt - 1) + WORKFLOW)


def minutes(rule: str, work: Work, attempt: int = 1) -> int:
    """Minutes after which a queue may end a job, twice as many at every other attempt."""
    own = growth(rule)
    return round((_MINUTES + own.minutes * getattr(work, own.of) / 1e6) * 2 ** (attempt - 1))


def disk_bytes(rule: str, work: Work | None) -> int:
    """Bytes that a job writes at least; less where nobody knows how large its work is."""
    return _RECORDS + (0 if work is None else WRITTEN.get(rule, 0) * work.shard)
