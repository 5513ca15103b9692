"""What is wrong with a run, why, and what to do.

INPUTS:  results/{scene}/dataset, samples, shading of the last two rounds, model, confidence and emitters of the last round, cache.npz,
         environment.npz, fused segments where there are some
OUTPUTS: results/{scene}/findings.json    findings, worst first, and all that was measured
         results/{scene}/findings/        their pictures
"""


rule findings:
    """Look for what went wrong; findings are no failure."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        prepare=ask("prepared"),
        images=ask("images", splits=["all"]),
        samples=sharded("results/{scene}/samples/{shard}.manifest.json", "train"),
        held_out=sharded("results/{scene}/samples/{shard}.manifest.json", "val"),
        shading=ask("last_shading"),
        earlier=ask("shading_before"),
        settled=ask("last_states"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        segments=ask("segmentation.fused"),
        model=ask("last_model"),
        confidence=ask("last_confidence"),
        emitters=ask("last_emitters"),
    output:
        findings="results/{scene}/findings.json",
        folder=directory("results/{scene}/findings"),
        stats="results/{scene}/stats/findings.json",
    log:
        "results/{scene}/logs/findings.log",
    benchmark:
        "results/{scene}/benchmarks/findings.jsonl"
    wildcard_constraints:
        scene=FITTED,
    threads: THREADS
    resources:
        mem_mb=memory("findings"),
        runtime=minutes("findings"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        held_out=folders_of("held_out"),
        shading=folders_of("shading"),
        earlier=folders_of("earlier"),
        settled=folders_of("settled"),
        confidence=option("--confidence", "confidence"),
        segments=option("--segments", "segments", "results/{scene}/segments/fused"),
        settings=settings("findings"),
        version=VERSIONS["findings"],
    shell:
        "fipt findings --dataset {params.dataset:q} --samples {params.samples:q} --shading {params.shading:q}"
        " --held-out={params.held_out:q} --earlier={params.earlier:q} {params.segments:q}"
        " --settled={params.settled:q}"
        " --cache {input.cache:q} --environment {input.environment:q}"
        " --model {input.model:q} {params.confidence:q} --emitters {input.emitters:q} --out {output.findings:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
