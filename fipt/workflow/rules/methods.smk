"""Materials and emitters of methods that fit nothing; runs of other methods take the rules of the fit.

INPUTS:  samples and shading of round 0, pictures or truth, mesh and segments of the scene
OUTPUTS: results/{scene}/round-0/model.safetensors    materials of parts
         results/{scene}/round-0/emitters.npz, .json  what emits, where {scene} is SCENE/methods/METHOD
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
        mem_mb=4000,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        shading=folders_of("shading"),
        segments=folders_of("segments", "--segments"),
        settings=settings("irradiance"),
        version=VERSIONS["irradiance"],
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
        mem_mb=4000,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        segments=folders_of("segments", "--segments"),
        settings=settings("true_constants"),
        version=VERSIONS["true_constants"],
    shell:
        "fipt true-constants --dataset {params.dataset:q} --samples {params.samples:q} {params.segments:q}"
        " --out {output.model:q} --emitters-out {output.emitters:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
