"""Input and params functions of photographed scenes, true or simulated, and of scene files.

INPUTS:  the scenes' captures or scene files (path), poses, mesh
OUTPUTS: none; functions that turn wildcards into files and options
"""


def judged_capture(wildcards):
    """Input function: the capture report of photographed scenes."""
    photographed = scene_of(wildcards).photographed
    return (
        ["results/{scene}/capture/qa.json".format(**wildcards)] if photographed else []
    )


def developed(wildcards):
    """Input function: the capture report and the developed views, of photographed scenes."""
    if not scene_of(wildcards).photographed:
        return []
    manifest = "results/{scene}/capture/hdr.{shard}.manifest.json"
    return [*judged_capture(wildcards), *sharded(manifest, "all")(wildcards)]


def photographs(wildcards):
    """Input function: the brackets of a shard; of a simulated camera all, for frames are told apart together."""
    scene = scene_of(wildcards)
    if scene.simulated:
        return simulated(wildcards, shards_of(wildcards, "all"))
    return readable(scene.photographs, shards_of(wildcards, "all")[wildcards.shard])


def simulated(wildcards, shards):
    """Manifests of a simulated capture: calibration frames with the table of frames, and brackets of shards."""
    return [
        f"results/{wildcards.scene}/raw.{name}.manifest.json"
        for name in ("calibration", *shards)
    ]


def calibrated_from(wildcards):
    """Input function: calibration frames, and the photographs of the first shard; of a simulated camera all."""
    scene = scene_of(wildcards)
    if scene.simulated:
        return simulated(wildcards, shards_of(wildcards, "all"))
    first = next(iter(shards_of(wildcards, "all").values()))
    return [*readable(scene.calibration_files), *readable(scene.photographs, first)]


def room(wildcards):
    """Input function: what holds a known room, made here or imported with developed photographs."""
    scene = scene_of(wildcards)
    made = "images.manifest.json" if scene.simulated else "room.json"
    return [f"results/{scene.name}/dataset/{made}"] if scene.synthesized else []


def table_of_frames(wildcards):
    """Input function: what a simulated camera took; true photographs are no files of ours."""
    scene = scene_of(wildcards)
    return simulated(wildcards, shards_of(wildcards, "all")) if scene.simulated else []


def scene_files(wildcards):
    """Input function: the scene file of a modelled room, and every file that it refers to."""
    return readable(scene_of(wildcards).scene_files)


def scene_options(wildcards):
    """Params function: which room is synthesized."""
    return scene_of(wildcards).scene_options()


def reference_file(wildcards):
    """Input function: known positions that estimated poses are brought to, if the config names any."""
    path = readable(scene_of(wildcards).reference_path)
    return [path] if path else []


def held_out(wildcards):
    """Params function: the views that are for judging, comma-separated."""
    return ",".join(readable(lambda: scene_of(wildcards).views["val"]))


def pictures_to_check(wildcards):
    """Input function: every picture, where cameras are checked."""
    return images("all")(wildcards) if scene_of(wildcards).checks_poses else []


def capture_path(wildcards):
    """Params function: the folder of the photographs."""
    return readable(scene_of(wildcards).capture_path)


def import_options(wildcards):
    """Params function: what is imported."""
    return readable(scene_of(wildcards).import_options)
