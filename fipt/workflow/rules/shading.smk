"""Shading of the training samples: from the cache in round 0, path traced with the model afterwards.

INPUTS:  results/{scene}/samples/{shard}.manifest.json, cache.npz, environment.npz, mesh
         from round 1: model, emitters and shading of the round before, whether the loop settled in it, pictures
OUTPUTS: results/{scene}/round-{k}/shading/{shard}/shading.npy    (samples, 1 + levels) 32-bit words
         results/{scene}/round-{k}/shading/{shard}.manifest.json
"""


rule bake:
    """Round 0: integrate the shading of a shard from the radiance cache."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        samples=own("results/{scene}/samples/{shard}.manifest.json"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        true_samples=ask("true_samples"),
        true_images=ask("true_images"),
    output:
        shading=directory("results/{scene}/round-0/shading/{shard}"),
        manifest="results/{scene}/round-0/shading/{shard}.manifest.json",
        stats="results/{scene}/stats/bake.round-0.{shard}.json",
    log:
        "results/{scene}/logs/bake.round-0.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/bake.round-0.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("bake"),
        runtime=minutes("bake"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        true_samples=folders_of("true_samples", "--true-samples"),
        settings=settings("bake"),
        version=VERSIONS["bake"],
    shell:
        "fipt bake --dataset {params.dataset:q} --samples {params.samples:q} --cache {input.cache:q}"
        " --environment {input.environment:q} {params.true_samples:q} --out {output.shading:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule refine:
    """Round k: path-trace the shading of a shard with the model and emitters of round k-1."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=own("results/{scene}/samples/{shard}.manifest.json"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        model=previous("results/{scene}/round-{round}/model.safetensors"),
        emitters=ask("emitters_before"),
        shading=previous("results/{scene}/round-{round}/shading/{shard}.manifest.json"),
        settled=previous("results/{scene}/round-{round}/settled.json"),
    output:
        shading=directory("results/{scene}/round-{round}/shading/{shard}"),
        manifest="results/{scene}/round-{round}/shading/{shard}.manifest.json",
        stats="results/{scene}/stats/refine.round-{round}.{shard}.json",
    log:
        "results/{scene}/logs/refine.round-{round}.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/refine.round-{round}.{shard}.jsonl"
    wildcard_constraints:
        round=LATER_ROUNDS,
    threads: THREADS
    resources:
        mem_mb=memory("refine"),
        runtime=minutes("refine"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        previous=folders_of("shading"),
        settings=settings("refine"),
        version=VERSIONS["refine"],
    shell:
        "fipt refine --dataset {params.dataset:q} --samples {params.samples:q} --cache {input.cache:q}"
        " --environment {input.environment:q}"
        " --model {input.model:q} --emitters {input.emitters:q} --previous {params.previous:q}"
        " --settled {input.settled:q} --out {output.shading:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
