"""Parts for the fit of a round: segments that the pictures show to be of one material, under its shading, are joined.

INPUTS:  results/{scene}/round-{k}/shading/{shard}.manifest.json, samples/{shard}.manifest.json, images,
         segments of the dataset or results/{scene}/segments/fused.manifest.json,
         round-{k}/emitters.npz where they are decided before the fit
         from round 1: whether the loop settled in the round before, and its parts, which stay then
OUTPUTS: results/{scene}/round-{k}/segments.manifest.json    lists segments/part/{view}.png of the training views
"""


rule regroup:
    """Join the segments of a round."""
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
        segments=ask("segmentation.fused"),
        emitters=ask("emitters_of_fit"),
        settled=previous("results/{scene}/round-{round}/settled.json"),
        previous=previous("results/{scene}/round-{round}/segments.manifest.json"),
    output:
        manifest="results/{scene}/round-{round}/segments.manifest.json",
        stats="results/{scene}/stats/regroup.round-{round}.json",
    log:
        "results/{scene}/logs/regroup.round-{round}.log",
    benchmark:
        "results/{scene}/benchmarks/regroup.round-{round}.jsonl"
    resources:
        mem_mb=memory("regroup"),
        runtime=minutes("regroup"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        shading=folders_of("shading"),
        out=folder("results/{scene}/round-{round}/segments"),
        segments=folders_of("segments", "--segments"),
        emitters=option("--emitters", "emitters"),
        settled=option("--settled", "settled"),
        previous=folders_of("previous", "--previous"),
        settings=settings("regroup"),
        version=VERSIONS["regroup"],
    shell:
        "fipt regroup --dataset {params.dataset:q} --samples {params.samples:q} --shading {params.shading:q}"
        " {params.segments:q} {params.emitters:q}"
        " {params.settled:q} {params.previous:q} --out {params.out:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
