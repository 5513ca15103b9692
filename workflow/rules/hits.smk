"""First hits of every pixel, traced once.

INPUTS:  results/{scene}/dataset/transforms.json, views.json, mesh.ply, check_poses.json
OUTPUTS: results/{scene}/hits/{shard}/*.npy               flat arrays over hits
         results/{scene}/hits/{shard}.manifest.json       names, hashes, settings, stage version
"""


rule hits:
    """Trace the first hits of a shard."""
    input:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        checked="results/{scene}/dataset/check_poses.json",
    output:
        hits=directory("results/{scene}/hits/{shard}"),
        manifest="results/{scene}/hits/{shard}.manifest.json",
        stats="results/{scene}/stats/hits.{shard}.json",
    log:
        "results/{scene}/logs/hits.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/hits.{shard}.jsonl"
    threads: workflow.cores
    resources:
        mem_mb=4000,
        gpu=1,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=views,
        settings=settings("hits"),
        version=VERSIONS["hits"],
    shell:
        "fipt hits --dataset {params.dataset:q} --views {params.views:q} --out {output.hits:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
