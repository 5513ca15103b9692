"""Light from outside: what the training pictures say about rays that leave the mesh.

INPUTS:  results/{scene}/samples/{shard}.manifest.json of the training shards, their pictures, mesh, cache.npz
         an environment map, where the config names one
OUTPUTS: results/{scene}/environment.npz    map over all directions; one zero where nothing is seen outside
"""


rule environment:
    """Find what light comes from outside the mesh."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        images=ask("images", splits=["train"]),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        cache=own("results/{scene}/cache.npz"),
        file=ask("environment_files"),
    output:
        environment="results/{scene}/environment.npz",
        stats="results/{scene}/stats/environment.json",
    log:
        "results/{scene}/logs/environment.log",
    benchmark:
        "results/{scene}/benchmarks/environment.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("environment"),
        runtime=minutes("environment"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        settings=settings("environment"),
        version=VERSIONS["environment"],
    shell:
        "fipt environment --dataset {params.dataset:q} --samples {params.samples:q} --cache {input.cache:q} --out {output.environment:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
