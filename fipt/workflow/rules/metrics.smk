"""Figures against ground truth and pictures.

INPUTS:  material maps, renders and relit views of all shards, emitters of the last round, the dataset's pictures and truth
OUTPUTS: results/{scene}/metrics.json
"""


rule scene_metrics:
    """Compare materials, emitters and renderings with the truth."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        room=ask("source.room_files"),
        images=ask("images", splits=["all"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "all"),
        materials=sharded("results/{scene}/materials.{shard}.manifest.json", "all"),
        render=sharded("results/{scene}/render.{shard}.manifest.json", "val"),
        relight=ask("setups.relit"),
        truth=ask("setups.truth"),
        emitters=ask("last_emitters"),
        references=ask("setups.reference_files"),
    output:
        metrics="results/{scene}/metrics.json",
        stats="results/{scene}/stats/metrics.json",
    log:
        "results/{scene}/logs/metrics.log",
    benchmark:
        "results/{scene}/benchmarks/metrics.jsonl"
    wildcard_constraints:
        scene=RENDERED,
    resources:
        mem_mb=memory("scene_metrics"),
        runtime=minutes("scene_metrics"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        materials=folder("results/{scene}/materials"),
        render=folder("results/{scene}/render"),
        rendered=ask("views.held_out"),
        relight=folder("results/{scene}/relight"),
        setups=listed("setups.with_truth"),
        relit=listed("setups.views"),
        references=ask("setups.reference_options"),
        settings=settings("metrics"),
        version=VERSIONS["metrics"],
    shell:
        "fipt metrics --dataset {params.dataset:q} --samples {params.samples:q}"
        " --materials {params.materials:q} --render {params.render:q} --rendered={params.rendered:q}"
        " --relight {params.relight:q} --setups={params.setups:q} --relit={params.relit:q} {params.references:q}"
        " --emitters {input.emitters:q} --out {output.metrics:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
