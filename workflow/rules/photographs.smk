"""Input and params functions of photographed scenes, true or simulated.

INPUTS:  the scenes' captures (path), poses, mesh
OUTPUTS: none; functions that turn wildcards into files and options
"""


def developed(wildcards):
    """Input function: the capture report and the developed views, of photographed scenes."""
    if not scene_of(wildcards).photographed:
        return []
    judged = "results/{scene}/capture/qa.json".format(**wildcards)
    manifest = "results/{scene}/capture/hdr.{shard}.manifest.json"
    return [judged, *sharded(manifest, "all")(wildcards)]


def photographs(wildcards):
    """Input function: the brackets of a shard; a simulated capture is one whole."""
    scene = scene_of(wildcards)
    if not scene.simulated:
        return readable(scene.photographs, shards_of(wildcards, "all")[wildcards.shard])
    return simulated(wildcards)


def simulated(wildcards):
    """Input function: manifests of a simulated capture."""
    frames = expand("results/{scene}/raw.calibration.manifest.json", **wildcards)
    manifest = "results/{scene}/raw.{shard}.manifest.json"
    return [*frames, *sharded(manifest, "all")({"scene": wildcards["scene"]})]


def calibrated_from(wildcards):
    """Input function: calibration frames, and the photographs of the first shard."""
    scene = scene_of(wildcards)
    if scene.simulated:
        return simulated(wildcards)
    first = next(iter(shards_of(wildcards, "all").values()))
    return [*readable(scene.calibration_files), *readable(scene.photographs, first)]


def room(wildcards):
    """Input function: the room in code, where the dataset is made of it."""
    made = "results/{scene}/dataset/room.json".format(**wildcards)
    return [] if scene_of(wildcards).simulated else made


def capture_path(wildcards):
    """Params function: the folder of the photographs."""
    return readable(scene_of(wildcards).capture_path)


def import_options(wildcards):
    """Params function: what is imported."""
    return readable(scene_of(wildcards).import_options)
