"""Held-out views, path traced with the model.

INPUTS:  results/{scene}/dataset, cache.npz, environment.npz, model and emitters of the last round
OUTPUTS: results/{scene}/render.{shard}.manifest.json    lists render/{view}.exr (linear RGB radiance)
"""


rule render_views:
    """Render a held-out shard."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        model=ask("last_model"),
        emitters=ask("last_emitters"),
    output:
        manifest="results/{scene}/render.{shard}.manifest.json",
        stats="results/{scene}/stats/render.{shard}.json",
    log:
        "results/{scene}/logs/render.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/render.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("render_views"),
        runtime=minutes("render_views"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        views=ask("views.listed"),
        rays_per_side=ask("rays_per_side"),
        out=folder("results/{scene}/render"),
        settings=settings("render"),
        version=VERSIONS["render"],
    shell:
        "fipt render --dataset {params.dataset:q} --views {params.views:q} --cache {input.cache:q}"
        " --environment {input.environment:q}"
        " --model {input.model:q} --emitters {input.emitters:q}"
        " --rays-per-side {params.rays_per_side:q} --out {params.out:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
