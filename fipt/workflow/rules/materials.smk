"""Material maps of every view.

INPUTS:  results/{scene}/samples/{shard}.manifest.json, mesh, model, its confidence and emitters of the last round
OUTPUTS: results/{scene}/materials.{shard}.manifest.json    lists materials/{view}.exr: kd.RGB, base_color.RGB,
         reflectance.RGB, roughness.Y, metallic.Y, confidence.Y, emission.RGB, emission_mask.Y, hit.Y
"""


rule material_maps:
    """Write the material maps of a shard."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        samples=own("results/{scene}/samples/{shard}.manifest.json"),
        model=ask("last_model"),
        confidence=ask("last_confidence"),
        emitters=ask("last_emitters"),
    output:
        manifest="results/{scene}/materials.{shard}.manifest.json",
        stats="results/{scene}/stats/materials.{shard}.json",
    log:
        "results/{scene}/logs/materials.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/materials.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("material_maps"),
        runtime=minutes("material_maps"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        samples=folders_of("samples"),
        confidence=option("--confidence", "confidence"),
        out=folder("results/{scene}/materials"),
        settings=settings("materials"),
        version=VERSIONS["materials"],
    shell:
        "fipt materials --dataset {params.dataset:q} --samples {params.samples:q}"
        " --model {input.model:q} --emitters {input.emitters:q} {params.confidence:q}"
        " --out {params.out:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
