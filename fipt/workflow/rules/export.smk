"""The room for other programs: textures, glTF, Mitsuba, USD, Blender, cameras; every file loaded back and compared.

INPUTS:  dataset, results/{scene}/samples/{shard}.manifest.json, environment.npz, model and emitters of the last round,
         the names of lamps;
         for the check render.{shard}.manifest.json of the val shards
OUTPUTS: results/{scene}/export.manifest.json     lists export/: scene.glb, scene.usdc, mitsuba/, textures/, cameras/, ...
         results/{scene}/export/check.json        PSNR of every format against render/{view}.exr
"""


rule export_room:
    """Write the room for other programs."""
    input:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        checked="results/{scene}/dataset/check_poses.json",
        mesh="results/{scene}/dataset/mesh.ply",
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        environment="results/{scene}/environment.npz",
        model=ask("last_model"),
        confidence=ask("last_confidence"),
        emitters=ask("last_emitters"),
        lamps="results/{scene}/emitters.manifest.json",
    output:
        manifest="results/{scene}/export.manifest.json",
        stats="results/{scene}/stats/export.json",
    log:
        "results/{scene}/logs/export.log",
    benchmark:
        "results/{scene}/benchmarks/export.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("export_room"),
        runtime=minutes("export_room"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        lamps=folder("results/{scene}/emitters/emitters.json"),
        out=folder("results/{scene}/export"),
        settings=settings("export"),
        version=VERSIONS["export"],
    shell:
        "fipt export --name {wildcards.scene:q} --dataset {params.dataset:q} --samples {params.samples:q}"
        " --model {input.model:q} --emitters {input.emitters:q} --confidence {input.confidence:q}"
        " --environment {input.environment:q} --emitter-names {params.lamps:q} --out {params.out:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule check_export:
    """Load every exported file back, render it, and compare with our own pictures."""
    input:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        checked="results/{scene}/dataset/check_poses.json",
        images=ask("images", splits=["val"]),
        export="results/{scene}/export.manifest.json",
        render=sharded("results/{scene}/render.{shard}.manifest.json", "val"),
    output:
        check="results/{scene}/export/check.json",
        images=directory("results/{scene}/export/check"),
        stats="results/{scene}/stats/check-export.json",
    log:
        "results/{scene}/logs/check-export.log",
    benchmark:
        "results/{scene}/benchmarks/check-export.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("check_export"),
        runtime=minutes("check_export"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        folder=folder("results/{scene}/export"),
        render=folder("results/{scene}/render"),
        rays_per_side=ask("rays_per_side"),
        settings=settings("export"),
        version=VERSIONS["export"],
    shell:
        "fipt check-export --dataset {params.dataset:q} --export {params.folder:q}"
        " --rays-per-side {params.rays_per_side:q} --render {params.render:q} --out {output.check:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
