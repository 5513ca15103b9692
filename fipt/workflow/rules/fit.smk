"""The fit: the material network, and the emission network if there is one, to the training pictures, given their shading.

INPUTS:  results/{scene}/round-{k}/shading/{shard}.manifest.json, samples/{shard}.manifest.json, pictures, cache.npz, environment.npz,
         segments of the dataset, results/{scene}/segments/fused.manifest.json or round-{k}/segments.manifest.json
         from round 1: the model of the round before, whether the loop settled in it, the shading of round 0
         round-{k}/emitters.npz where they are decided before the fit, and from round 1 those of the round before
OUTPUTS: results/{scene}/round-{k}/model.safetensors    networks, scene box, settings, stage version
         results/{scene}/round-{k}/confidence.npz       predicted errors of the material, by voxel and facing
         results/{scene}/round-{k}/settled.json         what the round changed, and whether the loop has settled

A killed fit goes on from round-{k}/model.checkpoint-HASH.safetensors, the hash being that of its
settings and inputs. The checkpoint is not an output here, since Snakemake deletes the outputs of jobs
that did not finish.
"""


rule fit:
    """Fit the networks of a round."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        shading=sharded(
            "results/{scene}/round-{round}/shading/{shard}.manifest.json", "train"
        ),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        segments=ask("segmentation.of_round"),
        previous=previous("results/{scene}/round-{round}/model.safetensors"),
        first_shading=first_shading,
        emitters=ask("emitters_of_fit"),
        emitters_before=ask("emitters_before_fit"),
        confidence=previous("results/{scene}/round-{round}/confidence.npz"),
        settled=previous("results/{scene}/round-{round}/settled.json"),
    output:
        model="results/{scene}/round-{round}/model.safetensors",
        confidence="results/{scene}/round-{round}/confidence.npz",
        settled="results/{scene}/round-{round}/settled.json",
        stats="results/{scene}/stats/fit.round-{round}.json",
    log:
        "results/{scene}/logs/fit.round-{round}.log",
    benchmark:
        "results/{scene}/benchmarks/fit.round-{round}.jsonl"
    wildcard_constraints:
        scene=FITTED,
    threads: THREADS
    resources:
        mem_mb=memory("fit"),
        runtime=minutes("fit"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        shading=folders_of("shading"),
        previous=option("--previous", "previous"),
        first_shading=folders_of("first_shading", "--first-shading"),
        emitters=option("--emitters", "emitters"),
        emitters_before=option("--emitters-before", "emitters_before"),
        settled=option("--settled", "settled"),
        segments=folders_of("segments", "--segments"),
        settings=settings("fit"),
        version=VERSIONS["fit"],
    shell:
        "fipt fit --dataset {params.dataset:q} --samples {params.samples:q} --shading {params.shading:q}"
        " {params.previous:q} {params.emitters:q} {params.emitters_before:q} {params.settled:q}"
        " {params.first_shading:q}"
        " --cache {input.cache:q} --environment {input.environment:q}"
        " {params.segments:q} --out {output.model:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
