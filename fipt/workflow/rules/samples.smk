"""Footprint samples of every pixel, traced once.

INPUTS:  results/{scene}/dataset/transforms.json, views.json, mesh.ply, check_poses.json
OUTPUTS: results/{scene}/samples/{shard}/*.npy               flat arrays over samples
         results/{scene}/samples/{shard}.manifest.json       names, hashes, settings, stage version
"""


rule samples:
    """Trace the footprint samples of a shard."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
    output:
        samples=directory("results/{scene}/samples/{shard}"),
        manifest="results/{scene}/samples/{shard}.manifest.json",
        stats="results/{scene}/stats/samples.{shard}.json",
    log:
        "results/{scene}/logs/samples.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/samples.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("samples"),
        runtime=minutes("samples"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=ask("views.listed"),
        settings=settings("samples"),
        version=VERSIONS["samples"],
    shell:
        "fipt samples --dataset {params.dataset:q} --views {params.views:q} --out {output.samples:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
