"""The dataset: every source brought to one form.

INPUTS:  source: dataset     cameras, pictures and mesh of another layout (path, format)
         source: procedural  settings of stage synthesize
         source: mitsuba     the same, a scene file (path) and every file that it refers to
         source: raw         what rules/capture.smk wrote, poses and mesh
OUTPUTS: results/{scene}/dataset/transforms.json   cameras, metres, OpenGL axes, with split
         results/{scene}/dataset/views.json        which views are accepted
         results/{scene}/dataset/mesh.ply          triangles, metres
         results/{scene}/dataset/prepare.json      what an import did to a noisy mesh
         results/{scene}/dataset/images[.{shard}].manifest.json  lists images/*.exr (linear RGB radiance),
                                                   segments/*/*.png (16-bit ids) and truth/*.exr
         results/{scene}/dataset/relight_truth.{setup}.{shard}.manifest.json
                                                   lists relight_truth/{setup}/*.exr (known rooms)
"""


rule import_dataset:
    """Bring posed HDR views of another layout, or developed photographs, into the dataset form."""
    input:
        ask("source.imported_files"),
        ask("source.mesh_origin"),
        ask("developed"),
    output:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        prepare="results/{scene}/dataset/prepare.json",
        manifest="results/{scene}/dataset/images.manifest.json",
        stats="results/{scene}/stats/import.json",
    log:
        "results/{scene}/logs/import.log",
    benchmark:
        "results/{scene}/benchmarks/import.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.imported"),
    threads: THREADS
    resources:
        mem_mb=memory("import_dataset"),
        runtime=minutes("import_dataset"),
    params:
        source=ask("source.import_options"),
        mesh=ask("source.mesh_options"),
        dataset=folder("results/{scene}/dataset"),
        settings=settings("import"),
        version=VERSIONS["import"],
    shell:
        "fipt import {params.source:q} {params.mesh:q}"
        " --dataset {params.dataset:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_room:
    """Build a room in code or of a scene file, and place its cameras."""
    input:
        ask("source.scene_files"),
    output:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        room="results/{scene}/dataset/room.json",
        parts="results/{scene}/dataset/segments/part.json",
        semantic="results/{scene}/dataset/segments/semantic.json",
        stats="results/{scene}/stats/synthesize.json",
    log:
        "results/{scene}/logs/synthesize.log",
    benchmark:
        "results/{scene}/benchmarks/synthesize.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.rendered"),
    threads: THREADS
    resources:
        mem_mb=memory("synthesize_room"),
        runtime=minutes("synthesize_room"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        scene=ask("source.scene_options"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize-room --dataset {params.dataset:q} {params.scene:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_views:
    """Render pictures, segments and ground truth of a shard of a known room."""
    input:
        ask("source.scene_files"),
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        room="results/{scene}/dataset/room.json",
    output:
        manifest="results/{scene}/dataset/images.{shard}.manifest.json",
        stats="results/{scene}/stats/synthesize.{shard}.json",
    log:
        "results/{scene}/logs/synthesize.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/synthesize.{shard}.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.rendered"),
    threads: THREADS
    resources:
        mem_mb=memory("synthesize_views"),
        runtime=minutes("synthesize_views"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=ask("views.listed"),
        scene=ask("source.scene_options"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize-views --dataset {params.dataset:q} --views {params.views:q} {params.scene:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_relit:
    """Render a shard of a known room under a relight setup, as the truth of relighting."""
    input:
        ask("source.scene_files"),
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        room=ask("source.room_files"),
        files=ask("setups.files"),
    output:
        manifest="results/{scene}/dataset/relight_truth.{setup}.{shard}.manifest.json",
        stats="results/{scene}/stats/synthesize.{setup}.{shard}.json",
    log:
        "results/{scene}/logs/synthesize.{setup}.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/synthesize.{setup}.{shard}.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.known"),
    threads: THREADS
    resources:
        mem_mb=memory("synthesize_relit"),
        runtime=minutes("synthesize_relit"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=ask("views.listed"),
        setup=ask("setups.json"),
        scene=ask("source.scene_options"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize-relit --dataset {params.dataset:q} --views {params.views:q}"
        " --setup {params.setup:q} --setup-name {wildcards.setup:q} {params.scene:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
