"""Every path below results/{scene}: the contract between stages, in one place.

The rules write the same paths out, so that they can be read; a test holds both against each other.
"""

from __future__ import annotations

RESULTS = "results"
"""Folder of all results, in the working directory."""

TOGETHER = "compare"
OF_SEVERAL = (TOGETHER, "index.html", "summary.tsv")
"""Folder of what is of several scenes together, in that of all results."""


class Below:
    """A path below a scene's folder; wildcards stay in braces, for ``str.format``."""

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern

    def __get__(self, layout: Layout, owner: type) -> str:
        return f"{layout.root}/{self.pattern}" if self.pattern else layout.root


class Layout:
    """Paths of a scene; wildcards: ``{shard}``, ``{round}``, ``{setup}``, ``{method}``, ``{label}`` of a job.

    A manifest lists the files of a folder beside it, or of a shard's part of a folder.

    Parameters
    ----------
    scene
        Its name; the wildcard itself for the patterns of all scenes.
    """

    def __init__(self, scene: str = "{scene}") -> None:
        self.root = f"{RESULTS}/{scene}"

    # of every job
    stats = Below("stats/{label}.json")
    log = Below("logs/{label}.log")
    benchmark = Below("benchmarks/{label}.jsonl")

    # a known room that is photographed
    room_folder = Below("room")
    room_transforms = Below("room/transforms.json")
    room_views = Below("room/views.json")
    room_mesh = Below("room/mesh.ply")
    room = Below("room/room.json")
    room_parts = Below("room/segments/part.json")
    room_semantic = Below("room/segments/semantic.json")
    raw_folder = Below("raw")
    raw_calibration = Below("raw.calibration.manifest.json")
    raw = Below("raw.{shard}.manifest.json")

    # photographs
    capture_folder = Below("capture")
    calibration = Below("capture/calibration.json")
    developed = Below("capture/hdr.{shard}.manifest.json")
    capture_report = Below("capture/qa.json")
    poses_folder = Below("poses")
    poses_transforms = Below("poses/transforms.json")
    poses_views = Below("poses/views.json")
    poses_evidence = Below("poses/poses.json")
    poses_points = Below("poses/points.ply")
    poses_diagram = Below("poses/poses.png")

    # a mesh from the images
    posed = Below("geometry/views")
    posed_transforms = Below("geometry/views/transforms.json")
    posed_views = Below("geometry/views/views.json")
    posed_images = Below("geometry/views/images.manifest.json")
    depth_folder = Below("geometry/depth")
    depth = Below("geometry/depth.manifest.json")
    first_folder = Below("geometry/first")
    first_mesh = Below("geometry/first/mesh.ply")
    first_geometry = Below("geometry/first/geometry.json")
    first_planes = Below("geometry/first/planes.json")
    first_overview = Below("geometry/first/overview.png")
    checked_views = Below("geometry/check_poses.json")
    geometry_folder = Below("geometry")
    estimated_mesh = Below("geometry/mesh.ply")
    geometry = Below("geometry/geometry.json")
    geometry_planes = Below("geometry/planes.json")
    geometry_overview = Below("geometry/overview.png")

    # the dataset
    dataset = Below("dataset")
    transforms = Below("dataset/transforms.json")
    views = Below("dataset/views.json")
    mesh = Below("dataset/mesh.ply")
    prepared = Below("dataset/prepare.json")
    known_room = Below("dataset/room.json")
    parts = Below("dataset/segments/part.json")
    semantic = Below("dataset/segments/semantic.json")
    checked_poses = Below("dataset/check_poses.json")
    imported_images = Below("dataset/images.manifest.json")
    images = Below("dataset/images.{shard}.manifest.json")
    truth = Below("dataset/truth.{shard}.manifest.json")
    relight_truth = Below("dataset/relight_truth.{setup}.{shard}.manifest.json")

    # what is traced, gathered and segmented once
    samples_folder = Below("samples/{shard}")
    samples = Below("samples/{shard}.manifest.json")
    environment = Below("environment.npz")
    cache = Below("cache.npz")
    segments_folder = Below("segments")
    view_segments_folder = Below("segments/views")
    view_segments = Below("segments/views.{shard}.manifest.json")
    fused_folder = Below("segments/fused")
    fused = Below("segments/fused.manifest.json")
    fusion = Below("segments/fusion.npz")

    # the rounds
    shading_folder = Below("round-{round}/shading/{shard}")
    shading = Below("round-{round}/shading/{shard}.manifest.json")
    regrouped_folder = Below("round-{round}/segments")
    regrouped = Below("round-{round}/segments.manifest.json")
    model = Below("round-{round}/model.safetensors")
    confidence = Below("round-{round}/confidence.npz")
    settled = Below("round-{round}/settled.json")
    emitters = Below("round-{round}/emitters.npz")
    emitters_for_people = Below("round-{round}/emitters.json")

    # what is made of the last round
    review = Below("emitters_review.yaml")
    listed_emitters_folder = Below("emitters")
    listed_emitters = Below("emitters.manifest.json")
    emitter_names = Below("emitters/emitters.json")
    materials_folder = Below("materials")
    materials = Below("materials.{shard}.manifest.json")
    render_folder = Below("render")
    render = Below("render.{shard}.manifest.json")
    relight_folder = Below("relight")
    relit_folder = Below("relight/{setup}")
    relit = Below("relight/{setup}.{shard}.manifest.json")
    joined = Below("relight/{setup}.manifest.json")
    olat_folder = Below("olat")
    olat = Below("olat.{shard}.manifest.json")
    export_folder = Below("export")
    export = Below("export.manifest.json")
    export_check = Below("export/check.json")
    export_check_folder = Below("export/check")
    metrics = Below("metrics.json")
    findings = Below("findings.json")
    findings_folder = Below("findings")
    report = Below("report.html")

    # comparisons; a run of a method has the layout of a scene in methods/{method}
    results_of_others = Below("others.manifest.json")
    method = Below("methods/{method}/method.json")
    comparison = Below("compare/table.json")
    comparison_for_people = Below("compare/table.md")
    comparison_rows = Below("compare/table.csv")
    comparison_page = Below("compare.html")

    @staticmethod
    def together(file: str) -> str:
        """Path of what compares several scenes: ``table.json``, ``table.md``, ``table.csv`` or ``page.html``."""
        return f"{RESULTS}/{TOGETHER}/{file}"

    @classmethod
    def patterns(cls) -> dict[str, str]:
        """Name -> pattern of every path, with ``{scene}``."""
        names = [name for name, value in vars(cls).items() if isinstance(value, Below)]
        return {name: getattr(cls(), name) for name in names}
