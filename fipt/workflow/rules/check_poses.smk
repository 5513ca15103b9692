"""Second check of the cameras, through the mesh.

INPUTS:  results/{scene}/dataset/transforms.json, views.json, mesh.ply, and the pictures where the check is on
OUTPUTS: results/{scene}/dataset/check_poses.json   verdict and figures of every view; all accepted where it is off
"""


rule check_poses:
    """Check through the mesh that every view shows what the others show."""
    input:
        ask("images_to_check"),
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
    output:
        checked="results/{scene}/dataset/check_poses.json",
        stats="results/{scene}/stats/check_poses.json",
    log:
        "results/{scene}/logs/check_poses.log",
    benchmark:
        "results/{scene}/benchmarks/check_poses.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("check_poses"),
        runtime=minutes("check_poses"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        settings=settings("check_poses"),
        version=VERSIONS["check_poses"],
    shell:
        "fipt check-poses {params.dataset:q} --reject"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
