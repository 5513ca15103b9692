"""The page that shows everything.

INPUTS:  results/{scene}/metrics.json, material maps, renders, relit views, views with each lamp alone, emitters of the
         last round, the list of lamps, export/check.json where export.enabled, findings.json
         and its pictures, stats/
OUTPUTS: results/{scene}/report.html    one self-contained page
"""


rule scene_report:
    """Write the page of a scene."""
    input:
        metrics="results/{scene}/metrics.json",
        findings="results/{scene}/findings.json",
        shown="results/{scene}/findings",
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        checked="results/{scene}/dataset/check_poses.json",
        capture=ask("judged"),
        geometry=ask("made_mesh"),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "all"),
        images=ask("images", splits=["all"]),
        materials=sharded("results/{scene}/materials.{shard}.manifest.json", "all"),
        render=sharded("results/{scene}/render.{shard}.manifest.json", "val"),
        relight=ask("setups.relit"),
        truth=ask("setups.truth"),
        segments=ask("segmentation.by_view"),
        fused=ask("segmentation.fused"),
        frames=ask("setups.frames"),
        films=ask("setups.joined"),
        lamps=ask("olat"),
        emitters=ask("last_emitters"),
        listed="results/{scene}/emitters.manifest.json",
        export=ask("checked_export"),
    output:
        report="results/{scene}/report.html",
        stats="results/{scene}/stats/report.json",
    log:
        "results/{scene}/logs/report.log",
    benchmark:
        "results/{scene}/benchmarks/report.jsonl"
    resources:
        mem_mb=memory("scene_report"),
        runtime=minutes("scene_report"),
    params:
        results=folder("results/{scene}"),
        setups=listed("setups.of_views"),
        films=listed("setups.with_cameras"),
        olat_shards=listed("views.olat_shards"),
        sections=listed("sections"),
        settings=settings("report"),
        version=VERSIONS["report"],
    shell:
        "fipt report --results {params.results:q} --out {output.report:q}"
        " --setups={params.setups:q} --camera-setups={params.films:q}"
        " --olat-shards={params.olat_shards:q} --sections={params.sections:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
