"""Depth of the views, for scenes that bring no mesh: rules/mesh.smk makes one of it.

INPUTS:  what rules/dataset.smk imports, without a mesh
OUTPUTS: results/{scene}/geometry/views/transforms.json, views.json   cameras, as in dataset/
         results/{scene}/geometry/views/images.manifest.json          lists images/*.exr
         results/{scene}/geometry/depth.manifest.json                 lists depth/*.exr: depth, confidence, normal
"""


rule import_views:
    """Bring posed HDR views, or developed photographs, into the dataset form, without a mesh."""
    input:
        ask("source.view_files"),
        ask("developed"),
    output:
        transforms="results/{scene}/geometry/views/transforms.json",
        views="results/{scene}/geometry/views/views.json",
        manifest="results/{scene}/geometry/views/images.manifest.json",
        stats="results/{scene}/stats/import_views.json",
    log:
        "results/{scene}/logs/import_views.log",
    benchmark:
        "results/{scene}/benchmarks/import_views.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.imported"),
    threads: THREADS
    resources:
        mem_mb=memory("import_views"),
        runtime=minutes("import_views"),
    params:
        source=ask("source.view_options"),
        dataset=folder("results/{scene}/geometry/views"),
        settings=ask("source.view_settings"),
        version=VERSIONS["import"],
    shell:
        "fipt import {params.source:q}"
        " --dataset {params.dataset:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule depth:
    """Estimate the depth of every training view, or take over depth maps that exist."""
    input:
        ask("given_depth"),
        transforms="results/{scene}/geometry/views/transforms.json",
        views="results/{scene}/geometry/views/views.json",
        images="results/{scene}/geometry/views/images.manifest.json",
    output:
        manifest="results/{scene}/geometry/depth.manifest.json",
        stats="results/{scene}/stats/depth.json",
    log:
        "results/{scene}/logs/depth.log",
    benchmark:
        "results/{scene}/benchmarks/depth.jsonl"
    threads: THREADS
    resources:
        mem_mb=ask("memory_mb", section="depth"),
        runtime=minutes("depth"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/geometry/views"),
        out=folder("results/{scene}/geometry/depth"),
        given=ask("depth_options"),
        settings=settings("depth"),
        version=VERSIONS["depth"],
    shell:
        "fipt depth --dataset {params.dataset:q} {params.given:q} --out {params.out:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
