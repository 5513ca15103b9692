"""The mesh from the images, for scenes that bring none: rules/dataset.smk imports it like one that was given.

It is made in two steps: of all views, and once more without those whose camera the first mesh proves wrong.

INPUTS:  results/{scene}/geometry/views/, depth.manifest.json   cameras, images and depth of rules/geometry.smk
OUTPUTS: results/{scene}/geometry/first/            mesh of all views, and what is below
         results/{scene}/geometry/check_poses.json  verdict and figures of every view; all accepted where it is off
         results/{scene}/geometry/mesh.ply          triangles, metres
         results/{scene}/geometry/geometry.json     what was measured, and which views were left out
         results/{scene}/geometry/planes.json       planes, and what speaks for each region of the surface
         results/{scene}/geometry/overview.png      photographs, depth, and where it comes from
"""


rule first_mesh:
    """Make the room's mesh of the depth maps of all views, or bring a scan to the cameras."""
    input:
        ask("given_scan"),
        ask("given_prior"),
        transforms="results/{scene}/geometry/views/transforms.json",
        views="results/{scene}/geometry/views/views.json",
        images="results/{scene}/geometry/views/images.manifest.json",
        depth="results/{scene}/geometry/depth.manifest.json",
    output:
        mesh="results/{scene}/geometry/first/mesh.ply",
        about="results/{scene}/geometry/first/geometry.json",
        planes="results/{scene}/geometry/first/planes.json",
        overview="results/{scene}/geometry/first/overview.png",
        stats="results/{scene}/stats/first_mesh.json",
    log:
        "results/{scene}/logs/first_mesh.log",
    benchmark:
        "results/{scene}/benchmarks/first_mesh.jsonl"
    threads: THREADS
    resources:
        mem_mb=ask("memory_mb", section="geometry"),
        runtime=minutes("first_mesh"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/geometry/views"),
        depth=folder("results/{scene}/geometry/depth"),
        out=folder("results/{scene}/geometry/first"),
        settings=settings("geometry"),
        version=VERSIONS["geometry"],
    shell:
        "fipt mesh --dataset {params.dataset:q} --depth {params.depth:q} --out {params.out:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule check_views:
    """Check through the first mesh that every view shows what the others show."""
    input:
        transforms="results/{scene}/geometry/views/transforms.json",
        views="results/{scene}/geometry/views/views.json",
        images="results/{scene}/geometry/views/images.manifest.json",
        mesh="results/{scene}/geometry/first/mesh.ply",
    output:
        checked="results/{scene}/geometry/check_poses.json",
        stats="results/{scene}/stats/check_views.json",
    log:
        "results/{scene}/logs/check_views.log",
    benchmark:
        "results/{scene}/benchmarks/check_views.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("check_views"),
        runtime=minutes("check_views"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/geometry/views"),
        settings=settings("check_poses"),
        version=VERSIONS["check_poses"],
    shell:
        "fipt check-poses {params.dataset:q} --reject --mesh {input.mesh:q} --out {output.checked:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule mesh:
    """Make the mesh once more without views that the first one rejects; where there are none, take that over."""
    input:
        ask("given_scan"),
        ask("given_prior"),
        transforms="results/{scene}/geometry/views/transforms.json",
        views="results/{scene}/geometry/views/views.json",
        images="results/{scene}/geometry/views/images.manifest.json",
        depth="results/{scene}/geometry/depth.manifest.json",
        first="results/{scene}/geometry/first/mesh.ply",
        about_first="results/{scene}/geometry/first/geometry.json",
        planes_first="results/{scene}/geometry/first/planes.json",
        overview_first="results/{scene}/geometry/first/overview.png",
        checked="results/{scene}/geometry/check_poses.json",
    output:
        mesh="results/{scene}/geometry/mesh.ply",
        about="results/{scene}/geometry/geometry.json",
        planes="results/{scene}/geometry/planes.json",
        overview="results/{scene}/geometry/overview.png",
        stats="results/{scene}/stats/mesh.json",
    log:
        "results/{scene}/logs/mesh.log",
    benchmark:
        "results/{scene}/benchmarks/mesh.jsonl"
    threads: THREADS
    resources:
        mem_mb=ask("memory_mb", section="geometry"),
        runtime=minutes("mesh"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/geometry/views"),
        depth=folder("results/{scene}/geometry/depth"),
        made_first=folder("results/{scene}/geometry/first"),
        out=folder("results/{scene}/geometry"),
        settings=settings("geometry"),
        version=VERSIONS["geometry"],
    shell:
        "fipt mesh --dataset {params.dataset:q} --depth {params.depth:q} --out {params.out:q}"
        " --first {params.made_first:q} --checked {input.checked:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
