"""Segment ids of the training views, where the dataset's own are not used: each view, then all fused on the mesh.

INPUTS:  results/{scene}/samples/{shard}.manifest.json of the training shards, their pictures, mesh, check_poses.json
         given ids (segment.path), or the weights of a network (segment.model)
OUTPUTS: results/{scene}/segments/views.{shard}.manifest.json  lists views/{view}.npz (ids, classes) and classes.json
         results/{scene}/segments/fused.manifest.json          lists fused/{part,semantic}/{view}.png with their names
         results/{scene}/segments/fusion.npz, fusion.json      votes by triangle; the segments, for people
"""


rule segment:
    """Segment the views of a shard, each by itself."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=own("results/{scene}/samples/{shard}.manifest.json"),
        files=ask("segmentation.files"),
    output:
        manifest="results/{scene}/segments/views.{shard}.manifest.json",
        stats="results/{scene}/stats/segment.{shard}.json",
    log:
        "results/{scene}/logs/segment.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/segment.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("segment"),
        runtime=minutes("segment"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        out=folder("results/{scene}/segments/views"),
        settings=settings("segment"),
        version=VERSIONS["segment"],
    shell:
        "fipt segment --dataset {params.dataset:q} --samples {params.samples:q} --out {params.out:q}"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule fuse:
    """Fuse the ids of all training views on the mesh, or grow segments on it."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        segments=ask("segmentation.by_view"),
    output:
        manifest="results/{scene}/segments/fused.manifest.json",
        stats="results/{scene}/stats/fuse.json",
    log:
        "results/{scene}/logs/fuse.log",
    benchmark:
        "results/{scene}/benchmarks/fuse.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("fuse"),
        runtime=minutes("fuse"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        segments=folder("results/{scene}/segments"),
        grown=lambda wildcards, input: [] if input.segments else ["--geometry"],
        settings=settings("fuse"),
        version=VERSIONS["fuse"],
    shell:
        "fipt fuse --dataset {params.dataset:q} --segments {params.segments:q} {params.grown:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
