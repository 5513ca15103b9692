"""Materials and emitters of methods that fit nothing, and what others estimated; runs of other methods take the
rules of the fit.

INPUTS:  samples and shading of round 0, pictures or truth, mesh and segments of the scene
OUTPUTS: results/{scene}/round-0/model.safetensors    materials of parts
         results/{scene}/round-0/emitters.npz, .json  what emits, where {scene} is SCENE/methods/METHOD
         results/{scene}/others.manifest.json         lists materials, render and relight of another program
"""


rule irradiance:
    """Divide radiance by irradiance."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        shading=sharded(
            "results/{scene}/round-0/shading/{shard}.manifest.json", "train"
        ),
        segments=ask("segmentation.fused"),
    output:
        model="results/{scene}/round-0/model.safetensors",
        emitters="results/{scene}/round-0/emitters.npz",
        listed="results/{scene}/round-0/emitters.json",
        stats="results/{scene}/stats/irradiance.json",
    log:
        "results/{scene}/logs/irradiance.log",
    benchmark:
        "results/{scene}/benchmarks/irradiance.jsonl"
    wildcard_constraints:
        scene=CONFIG.runs("irradiance"),
    resources:
        mem_mb=memory("irradiance"),
        runtime=minutes("irradiance"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        shading=folders_of("shading"),
        segments=folders_of("segments", "--segments"),
        settings=settings("irradiance"),
        version=VERSIONS["irradiance"],
        model_version=VERSIONS["fit"],
    shell:
        "fipt irradiance --dataset {params.dataset:q} --samples {params.samples:q}"
        " --shading {params.shading:q} {params.segments:q}"
        " --out {output.model:q} --emitters-out {output.emitters:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule true_constants:
    """Average the true materials of every part."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        segments=ask("segmentation.fused"),
    output:
        model="results/{scene}/round-0/model.safetensors",
        emitters="results/{scene}/round-0/emitters.npz",
        listed="results/{scene}/round-0/emitters.json",
        stats="results/{scene}/stats/true-constants.json",
    log:
        "results/{scene}/logs/true-constants.log",
    benchmark:
        "results/{scene}/benchmarks/true-constants.jsonl"
    wildcard_constraints:
        scene=CONFIG.runs("true-constants"),
    resources:
        mem_mb=memory("true_constants"),
        runtime=minutes("true_constants"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        segments=folders_of("segments", "--segments"),
        settings=settings("true_constants"),
        version=VERSIONS["true_constants"],
        model_version=VERSIONS["fit"],
    shell:
        "fipt true-constants --dataset {params.dataset:q} --samples {params.samples:q} {params.segments:q}"
        " --out {output.model:q} --emitters-out {output.emitters:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule inverse_trace:
    """Optimise one material and one radiance a part through the path tracer."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        images=ask("images", splits=["train"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        segments=ask("segmentation.fused"),
    output:
        model="results/{scene}/round-0/model.safetensors",
        emitters="results/{scene}/round-0/emitters.npz",
        listed="results/{scene}/round-0/emitters.json",
        stats="results/{scene}/stats/inverse-trace.json",
    log:
        "results/{scene}/logs/inverse-trace.log",
    benchmark:
        "results/{scene}/benchmarks/inverse-trace.jsonl"
    wildcard_constraints:
        scene=CONFIG.runs("inverse-trace"),
    threads: THREADS
    resources:
        mem_mb=memory("inverse_trace"),
        runtime=minutes("inverse_trace"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        segments=folders_of("segments", "--segments"),
        settings=settings("inverse_trace"),
        version=VERSIONS["inverse_trace"],
        model_version=VERSIONS["fit"],
    shell:
        "fipt inverse-trace --dataset {params.dataset:q} --samples {params.samples:q} {params.segments:q}"
        " --out {output.model:q} --emitters-out {output.emitters:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule import_results:
    """Bring what another program estimated to our layers."""
    input:
        given=ask("others.files"),
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        images=ask("images", splits=["all"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "all"),
        truth=ask("setups.truth"),
        photographs=ask("others.photographs"),
    output:
        manifest="results/{scene}/others.manifest.json",
        stats="results/{scene}/stats/import-results.json",
    log:
        "results/{scene}/logs/import-results.log",
    benchmark:
        "results/{scene}/benchmarks/import-results.jsonl"
    wildcard_constraints:
        scene=CONFIG.runs("imported"),
    resources:
        mem_mb=memory("import_results"),
        runtime=minutes("import_results"),
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        scene=ask("own_name"),
        reference=ask("others.compared"),
        out=folder("results/{scene}"),
        settings=settings("import_results"),
        version=VERSIONS["import_results"],
    shell:
        "fipt import-results --dataset {params.dataset:q} --samples {params.samples:q} --scene {params.scene:q}"
        " --out {params.out:q} --manifest {output.manifest:q} {params.reference:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule metrics_of_others:
    """Compare what another program estimated with the truth."""
    input:
        results="results/{scene}/others.manifest.json",
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        images=ask("images", splits=["all"]),
        truth=ask("setups.truth"),
        photographs=ask("others.photographs"),
    output:
        metrics="results/{scene}/metrics.json",
        stats="results/{scene}/stats/metrics.json",
    log:
        "results/{scene}/logs/metrics.log",
    benchmark:
        "results/{scene}/benchmarks/metrics.jsonl"
    wildcard_constraints:
        scene=CONFIG.runs("imported"),
    resources:
        mem_mb=memory("metrics_of_others"),
        runtime=minutes("metrics_of_others"),
    params:
        dataset=folder("results/{scene}/dataset"),
        materials=folder("results/{scene}/materials"),
        render=folder("results/{scene}/render"),
        relight=folder("results/{scene}/relight"),
        setups=listed("others.setups"),
        reference=ask("others.compared"),
        settings=settings("metrics"),
        version=VERSIONS["metrics"],
    shell:
        "fipt metrics --dataset {params.dataset:q} --materials {params.materials:q} --render {params.render:q}"
        " --relight {params.relight:q} --setups={params.setups:q} {params.reference:q} --partial"
        " --out {output.metrics:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule plant_errors:
    """Plant errors into the dataset of a scene."""
    input:
        room=ask("source.room_files"),
        dataset=ask("before_errors"),
        truth=ask("setups.truth"),
    output:
        transforms="results/{scene}/dataset/transforms.json",
        views="results/{scene}/dataset/views.json",
        mesh="results/{scene}/dataset/mesh.ply",
        manifest="results/{scene}/dataset/images.manifest.json",
        stats="results/{scene}/stats/plant-errors.json",
    log:
        "results/{scene}/logs/plant-errors.log",
    benchmark:
        "results/{scene}/benchmarks/plant-errors.jsonl"
    wildcard_constraints:
        scene=CONFIG.runs("fit"),
    resources:
        mem_mb=memory("plant_errors"),
        runtime=minutes("plant_errors"),
    params:
        dataset=ask("dataset_before_errors"),
        out=folder("results/{scene}/dataset"),
        settings=settings("plant_errors"),
        version=VERSIONS["plant_errors"],
    shell:
        "fipt plant-errors --dataset {params.dataset:q} --out {params.out:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
