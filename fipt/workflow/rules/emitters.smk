"""Emitting triangles and their radiance; the list of lamps for people.

INPUTS:  results/{scene}/round-{k}/shading, samples and pictures of the training shards, mesh, cache.npz, environment.npz;
         round-{k}/model.safetensors where its mask decides; else the fit of the round comes after this
         from round 1: whether the loop settled in the round before, and its emitters, which stay then; its model,
         which tells what is a mirror
         the decisions in results/{scene}/emitters_review.yaml as parameters, that file itself never
OUTPUTS: results/{scene}/round-{k}/emitters.npz     triangles, radiance, area (m2), patches, views, confidence
         results/{scene}/round-{k}/emitters.json    the same by patch, for people
         results/{scene}/emitters/                  emitters.json of the last round with names and pictures
"""


rule emitters:
    """Extract the emitters of a round."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        shading=sharded(
            "results/{scene}/round-{round}/shading/{shard}.manifest.json", "train"
        ),
        model=ask("model_of_emitters"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        settled=previous("results/{scene}/round-{round}/settled.json"),
        previous=previous("results/{scene}/round-{round}/emitters.npz"),
        listed=previous("results/{scene}/round-{round}/emitters.json"),
        model_before=previous("results/{scene}/round-{round}/model.safetensors"),
    output:
        emitters="results/{scene}/round-{round}/emitters.npz",
        listed="results/{scene}/round-{round}/emitters.json",
        stats="results/{scene}/stats/emitters.round-{round}.json",
    log:
        "results/{scene}/logs/emitters.round-{round}.log",
    benchmark:
        "results/{scene}/benchmarks/emitters.round-{round}.jsonl"
    wildcard_constraints:
        scene=FITTED,
    threads: THREADS
    resources:
        mem_mb=memory("emitters"),
        runtime=minutes("emitters"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        shading=folders_of("shading"),
        model=option("--model", "model"),
        settled=option("--settled", "settled"),
        previous=option("--previous", "previous"),
        model_before=option("--model-before", "model_before"),
        decisions=ask("decisions.emission"),
        settings=settings("emitters"),
        version=VERSIONS["emitters"],
    shell:
        "fipt emitters --dataset {params.dataset:q} --samples {params.samples:q}"
        " --shading {params.shading:q} {params.model:q} --out {output.emitters:q}"
        " --cache {input.cache:q} --environment {input.environment:q} {params.decisions:q}"
        " {params.settled:q} {params.previous:q} {params.model_before:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule review:
    """List the lamps; bring emitters_review.yaml up to date, in which people decide about them."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        emitters=ask("last_emitters"),
    output:
        folder=directory("results/{scene}/emitters"),
        manifest="results/{scene}/emitters.manifest.json",
        stats="results/{scene}/stats/review.json",
    log:
        "results/{scene}/logs/review.log",
    benchmark:
        "results/{scene}/benchmarks/review.jsonl"
    resources:
        mem_mb=memory("review"),
        runtime=minutes("review"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        review=folder("results/{scene}/emitters_review.yaml"),
        decisions=ask("decisions.listing"),
        settings=settings("review"),
        version=VERSIONS["review"],
    shell:
        "fipt review --dataset {params.dataset:q} --samples {params.samples:q}"
        " --emitters {input.emitters:q} --out {output.folder:q} --review {params.review:q}"
        " {params.decisions:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
