"""The dataset: every source brought to one form.

INPUTS:  source: dataset     cameras, pictures and mesh of another layout (path, format)
         source: procedural  settings of stage synthesize
         source: raw         what rules/capture.smk wrote, poses and mesh
OUTPUTS: results/{scene}/dataset/transforms.json   cameras, metres, OpenGL axes, with split
         results/{scene}/dataset/views.json        which views are accepted
         results/{scene}/dataset/mesh.ply          triangles, metres
         results/{scene}/dataset/images[.{shard}].manifest.json  lists images/*.exr (linear RGB radiance),
                                                   segments/*/*.png (16-bit ids) and truth/*.exr
         results/{scene}/dataset/relight_truth.{setup}.{shard}.manifest.json
                                                   lists relight_truth/{setup}/*.exr (procedural)
"""


rule import_dataset:
    """Bring posed HDR views of another layout, or developed photographs, into the dataset form."""
    input:
        source_files,
        developed,
    output:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        manifest="results/{scene}/dataset/images.manifest.json",
        stats="results/{scene}/stats/import.json",
    log:
        "results/{scene}/logs/import.log",
    benchmark:
        "results/{scene}/benchmarks/import.jsonl"
    wildcard_constraints:
        scene=scenes_that(lambda s: s.source == "dataset" or s.photographed),
    threads: workflow.cores
    resources:
        mem_mb=4000,
    params:
        source=import_options,
        dataset=folder("results/{scene}/dataset"),
        settings=settings("import"),
        version=VERSIONS["import"],
    shell:
        "fipt import {params.source:q}"
        " --dataset {params.dataset:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_room:
    """Build the procedural room and place its cameras."""
    output:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        room="results/{scene}/dataset/room.json",
        stats="results/{scene}/stats/synthesize.json",
    log:
        "results/{scene}/logs/synthesize.log",
    benchmark:
        "results/{scene}/benchmarks/synthesize.jsonl"
    wildcard_constraints:
        scene=scenes_that(lambda s: s.source == "procedural" and not s.simulated),
    threads: workflow.cores
    resources:
        mem_mb=4000,
    params:
        dataset=folder("results/{scene}/dataset"),
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize --dataset {params.dataset:q} --room"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_views:
    """Render pictures, segments and ground truth of a shard of the procedural room."""
    input:
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
        scene=scenes_that(lambda s: s.source == "procedural" and not s.simulated),
    threads: workflow.cores
    resources:
        mem_mb=4000,
        gpu=1,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=views,
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize --dataset {params.dataset:q} --views {params.views:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule synthesize_relit:
    """Render a shard of the procedural room under a relight setup, as the truth of relighting."""
    input:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        room=room,
        files=setup_files,
    output:
        manifest="results/{scene}/dataset/relight_truth.{setup}.{shard}.manifest.json",
        stats="results/{scene}/stats/synthesize.{setup}.{shard}.json",
    log:
        "results/{scene}/logs/synthesize.{setup}.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/synthesize.{setup}.{shard}.jsonl"
    wildcard_constraints:
        scene=scenes_that(lambda s: s.source == "procedural"),
    threads: workflow.cores
    resources:
        mem_mb=4000,
        gpu=1,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=views,
        setup=setup_json,
        settings=settings("synthesize"),
        version=VERSIONS["synthesize"],
    shell:
        "fipt synthesize --dataset {params.dataset:q} --views {params.views:q}"
        " --setup {params.setup:q} --setup-name {wildcards.setup:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
