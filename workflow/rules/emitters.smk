"""Emitting triangles and their radiance.

INPUTS:  results/{scene}/round-{k}/model.safetensors, shading, hits and pictures of the training shards, mesh
OUTPUTS: results/{scene}/round-{k}/emitters.npz     triangles, radiance, area (m2), patches, views, confidence
         results/{scene}/round-{k}/emitters.json    the same by patch, for people
"""


rule emitters:
    """Extract the emitters of a round."""
    input:
        transforms="results/{scene}/dataset/transforms.json",
        mesh="results/{scene}/dataset/mesh.ply",
        images=images("train"),
        hits=sharded("results/{scene}/hits/{shard}.manifest.json", "train"),
        shading=sharded(
            "results/{scene}/round-{round}/shading/{shard}.manifest.json", "train"
        ),
        model="results/{scene}/round-{round}/model.safetensors",
    output:
        emitters="results/{scene}/round-{round}/emitters.npz",
        listed="results/{scene}/round-{round}/emitters.json",
        stats="results/{scene}/stats/emitters.round-{round}.json",
    log:
        "results/{scene}/logs/emitters.round-{round}.log",
    benchmark:
        "results/{scene}/benchmarks/emitters.round-{round}.jsonl"
    threads: workflow.cores
    resources:
        mem_mb=8000,
        gpu=1,
    params:
        dataset=folder("results/{scene}/dataset"),
        hits=folders_of("hits"),
        shading=folders_of("shading"),
        settings=settings("emitters"),
        version=VERSIONS["emitters"],
    shell:
        "fipt emitters --dataset {params.dataset:q} --hits {params.hits:q}"
        " --shading {params.shading:q} --model {input.model:q} --out {output.emitters:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
