"""Poses: where the cameras of a photographed scene stood, with evidence for each.

INPUTS:  results/{scene}/capture/     developed views and qa.json; only with poses: colmap
         poses.align.reference        known positions, where the config names them
OUTPUTS: results/{scene}/poses/transforms.json   cameras that are believed, metres, OpenGL axes, with split
         results/{scene}/poses/views.json        which views are accepted, and why not
         results/{scene}/poses/poses.json        evidence of every view, view graph, runs, alignment
         results/{scene}/poses/points.ply        points that the views share
         results/{scene}/poses/poses.png         cameras and points from above and the side, links of views
         results/{scene}/poses/work/             features, matches and models, used again; not declared
"""


rule estimate_poses:
    """Estimate the poses of developed views."""
    input:
        ask("developed"),
        reference=ask("reference_files"),
    output:
        transforms="results/{scene}/poses/transforms.json",
        views="results/{scene}/poses/views.json",
        evidence="results/{scene}/poses/poses.json",
        points="results/{scene}/poses/points.ply",
        picture="results/{scene}/poses/poses.png",
        stats="results/{scene}/stats/pose.json",
    log:
        "results/{scene}/logs/pose.log",
    benchmark:
        "results/{scene}/benchmarks/pose.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.estimated"),
    threads: THREADS
    resources:
        mem_mb=memory("estimate_poses"),
        runtime=minutes("estimate_poses"),
    params:
        capture=folder("results/{scene}/capture"),
        held_out=ask("views.held_out"),
        out=folder("results/{scene}/poses"),
        settings=settings("poses"),
        version=VERSIONS["poses"],
    shell:
        "fipt pose --capture {params.capture:q} --held-out {params.held_out:q} --out {params.out:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
