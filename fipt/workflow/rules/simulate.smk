"""A known room, photographed by a simulated camera (simulate_raw: true).

INPUTS:  settings of stage synthesize; of a modelled room the scene file and every file that it refers to
OUTPUTS: results/{scene}/room/                                    mesh, cameras and names of the room
         results/{scene}/raw.{calibration,{shard}}.manifest.json  lists raw/*.dng, raw/calibration/*/*.dng
         results/{scene}/dataset/truth.{shard}.manifest.json      lists truth/*.exr, segments/*/*.png of the dataset
"""


rule photographed_room:
    """Build a room in code or of a scene file and place its cameras, to be photographed."""
    input:
        ask("source.scene_files"),
    output:
        transforms="results/{scene}/room/transforms.json",
        views="results/{scene}/room/views.json",
        mesh="results/{scene}/room/mesh.ply",
        room="results/{scene}/room/room.json",
        parts="results/{scene}/room/segments/part.json",
        semantic="results/{scene}/room/segments/semantic.json",
        stats="results/{scene}/stats/synthesize.json",
    log:
        "results/{scene}/logs/synthesize.log",
    benchmark:
        "results/{scene}/benchmarks/synthesize.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.simulated"),
    threads: THREADS
    resources:
        mem_mb=memory("photographed_room"),
        runtime=minutes("photographed_room"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/room"),
        scene=ask("source.scene_options"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize-room --dataset {params.dataset:q} {params.scene:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule photograph_calibration:
    """Take the calibration frames of the simulated camera."""
    input:
        transforms="results/{scene}/room/transforms.json",
        views="results/{scene}/room/views.json",
        mesh="results/{scene}/room/mesh.ply",
        room="results/{scene}/room/room.json",
    output:
        manifest="results/{scene}/raw.calibration.manifest.json",
        stats="results/{scene}/stats/photograph.calibration.json",
    log:
        "results/{scene}/logs/photograph.calibration.log",
    benchmark:
        "results/{scene}/benchmarks/photograph.calibration.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("photograph_calibration"),
        runtime=minutes("photograph_calibration"),
    params:
        dataset=folder("results/{scene}/room"),
        raw=folder("results/{scene}/raw"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt photograph-calibration --dataset {params.dataset:q} --raw {params.raw:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule photograph_views:
    """Photograph a shard of a known room with the simulated camera."""
    input:
        ask("source.scene_files"),
        transforms="results/{scene}/room/transforms.json",
        views="results/{scene}/room/views.json",
        mesh="results/{scene}/room/mesh.ply",
        room="results/{scene}/room/room.json",
    output:
        manifest="results/{scene}/raw.{shard}.manifest.json",
        stats="results/{scene}/stats/photograph.{shard}.json",
    log:
        "results/{scene}/logs/photograph.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/photograph.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("photograph_views"),
        runtime=minutes("photograph_views"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/room"),
        raw=folder("results/{scene}/raw"),
        views=ask("views.listed"),
        scene=ask("source.scene_options"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt photograph --dataset {params.dataset:q} --raw {params.raw:q} --views {params.views:q} {params.scene:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_truth:
    """Look up ids and ground truth of a shard of developed photographs of a known room."""
    input:
        ask("source.scene_files"),
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        room="results/{scene}/dataset/images.manifest.json",
        cameras="results/{scene}/room/transforms.json",
    output:
        manifest="results/{scene}/dataset/truth.{shard}.manifest.json",
        stats="results/{scene}/stats/truth.{shard}.json",
    log:
        "results/{scene}/logs/truth.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/truth.{shard}.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.simulated"),
    threads: THREADS
    resources:
        mem_mb=memory("synthesize_truth"),
        runtime=minutes("synthesize_truth"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=ask("views.listed"),
        scene=ask("source.scene_options"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize-truth --dataset {params.dataset:q} --views {params.views:q} {params.scene:q}"
        " --cameras {input.cameras:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
