"""The radiance cache: what the training pictures say about light that leaves the surface.

INPUTS:  results/{scene}/samples/{shard}.manifest.json of the training shards, their pictures
OUTPUTS: results/{scene}/cache.npz    sparse voxel records over the surface
"""


rule cache:
    """Gather the pictures' radiance in voxels on the surface."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
    output:
        cache="results/{scene}/cache.npz",
        stats="results/{scene}/stats/cache.json",
    log:
        "results/{scene}/logs/cache.log",
    benchmark:
        "results/{scene}/benchmarks/cache.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("cache"),
        runtime=minutes("cache"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        settings=settings("cache"),
        version=VERSIONS["cache"],
    shell:
        "fipt cache --dataset {params.dataset:q} --samples {params.samples:q} --out {output.cache:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
