"""Comparisons of methods on a scene.

INPUTS:  metrics.json, stats and maps of the scene and of the runs in results/{scene}/methods
OUTPUTS: results/{scene}/methods/{method}/method.json    what a run reached, took and used
         results/{scene}/compare/table.json, .md, .csv   all of them
         results/{scene}/compare.html                    one self-contained page
         results/compare/table.json, .md, .csv           of all scenes that were asked for, with their mean
         results/compare/page.html                       one self-contained page
"""


rule score_method:
    """Say what a run of a method reached, took and used."""
    input:
        metrics=ask("methods.metrics"),
        stats=ask("methods.stats"),
    output:
        method="results/{scene}/methods/{method}/method.json",
        stats="results/{scene}/stats/score.{method}.json",
    log:
        "results/{scene}/logs/score.{method}.log",
    benchmark:
        "results/{scene}/benchmarks/score.{method}.jsonl"
    wildcard_constraints:
        scene=SCENE,
    resources:
        mem_mb=memory("score_method"),
        runtime=minutes("score_method"),
    params:
        card=ask("methods.card_json"),
        jobs=folders_of("stats"),
        settings=settings("compare"),
        version=VERSIONS["compare"],
    shell:
        "fipt score --card {params.card:q} --metrics {input.metrics:q} --jobs={params.jobs:q}"
        " --out {output.method:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule compare_methods:
    """Write the table that compares methods."""
    input:
        methods=ask("methods.files"),
    output:
        table="results/{scene}/compare/table.json",
        people="results/{scene}/compare/table.md",
        rows="results/{scene}/compare/table.csv",
        stats="results/{scene}/stats/compare.json",
    log:
        "results/{scene}/logs/compare.log",
    benchmark:
        "results/{scene}/benchmarks/compare.jsonl"
    wildcard_constraints:
        scene=SCENE,
    resources:
        mem_mb=memory("compare_methods"),
        runtime=minutes("compare_methods"),
    params:
        methods=folders_of("methods"),
        missing=ask("methods.options"),
        settings=settings("compare"),
        version=VERSIONS["compare"],
    shell:
        "fipt compare --methods {params.methods:q} {params.missing:q} --out {output.table:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule comparison_page:
    """Write the page that compares methods."""
    input:
        table="results/{scene}/compare/table.json",
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        checked="results/{scene}/dataset/check_poses.json",
        shown=ask("methods.shown"),
    output:
        page="results/{scene}/compare.html",
        stats="results/{scene}/stats/compare-page.json",
    log:
        "results/{scene}/logs/compare-page.log",
    benchmark:
        "results/{scene}/benchmarks/compare-page.jsonl"
    wildcard_constraints:
        scene=SCENE,
    resources:
        mem_mb=memory("comparison_page"),
        runtime=minutes("comparison_page"),
    params:
        results=folder("results/{scene}"),
        settings=settings("compare_page"),
        version=VERSIONS["compare_page"],
    shell:
        "fipt compare-page --results {params.results:q} --table {input.table:q} --out {output.page:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule compare_rooms:
    """Write the table that compares methods on all scenes that were asked for."""
    input:
        tables=of_asked_scenes("results/{scene}/compare/table.json"),
    output:
        table="results/compare/table.json",
        people="results/compare/table.md",
        rows="results/compare/table.csv",
        stats="results/compare/stats/compare-rooms.json",
    log:
        "results/compare/logs/compare-rooms.log",
    benchmark:
        "results/compare/benchmarks/compare-rooms.jsonl"
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        tables=folders_of("tables"),
        rooms=",".join(CONFIG.only),
        version=VERSIONS["compare"],
    shell:
        "fipt compare-rooms --tables {params.tables:q} --rooms {params.rooms:q} --out {output.table:q}"
        " --settings '{{}}' --stats {output.stats:q} > {log:q} 2>&1"


rule rooms_page:
    """Write the page that compares methods on all scenes that were asked for."""
    input:
        table="results/compare/table.json",
    output:
        page="results/compare/page.html",
        stats="results/compare/stats/rooms-page.json",
    log:
        "results/compare/logs/rooms-page.log",
    benchmark:
        "results/compare/benchmarks/rooms-page.jsonl"
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        version=VERSIONS["compare_page"],
    shell:
        "fipt compare-page --table {input.table:q} --out {output.page:q}"
        " --settings '{{}}' --stats {output.stats:q} > {log:q} 2>&1"
