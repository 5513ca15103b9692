"""The room under other light, and with one light at a time.

INPUTS:  results/{scene}/dataset, cache.npz, environment.npz, model and emitters of the last round, a setup of the config,
         the files that it names, results/{scene}/segments/fusion.npz where it names fused segments;
         of a setup with its own cameras the photographs, which give their exposure
OUTPUTS: results/{scene}/relight/{setup}.{shard}.manifest.json    lists relight/{setup}/{view}.exr (linear RGB radiance)
         results/{scene}/relight/{setup}.manifest.json            of a setup with its own cameras: lists relight/{setup}/*.png,
                                                                  transforms.json, and of a path relight/{setup}.mp4
         results/{scene}/olat.{shard}.manifest.json              lists olat/{view}.exr (a layer for each light)
"""


rule relight_views:
    """Render a shard of views under a light setup, or of the setup's own cameras."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        model=ask("last_model"),
        emitters=ask("last_emitters"),
        files=ask("setups.files"),
        lamps=ask("decisions.names"),
        segments=ask("setups.fused"),
    output:
        manifest="results/{scene}/relight/{setup}.{shard}.manifest.json",
        stats="results/{scene}/stats/relight.{setup}.{shard}.json",
    log:
        "results/{scene}/logs/relight.{setup}.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/relight.{setup}.{shard}.jsonl"
    wildcard_constraints:
        shard=r"(train|val|camera)-\d+",
    threads: THREADS
    resources:
        mem_mb=memory("relight_views"),
        runtime=minutes("relight_views"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        out=folder("results/{scene}/relight/{setup}"),
        setup=ask("setups.json"),
        lamps=option(
            "--emitter-names", "lamps", "results/{scene}/emitters/emitters.json"
        ),
        seen=ask("setups.seen_options"),
        rays_per_side=ask("rays_per_side"),
        segments=option("--segments", "segments", "results/{scene}/segments/fusion.npz"),
        settings=settings("relight"),
        version=VERSIONS["relight"],
    shell:
        "fipt relight --dataset {params.dataset:q} --cache {input.cache:q}"
        " --environment {input.environment:q}"
        " --model {input.model:q} --emitters {input.emitters:q} --setup {params.setup:q}"
        " {params.lamps:q} {params.seen:q} {params.segments:q}"
        " --rays-per-side {params.rays_per_side:q} --out {params.out:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule join_images:
    """Show what a setup's own cameras see as PNG images, and join those of a path into a video."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        images=ask("images", splits=["all"]),
        seen=ask("setups.seen"),
    output:
        manifest="results/{scene}/relight/{setup}.manifest.json",
        stats="results/{scene}/stats/video.{setup}.json",
    log:
        "results/{scene}/logs/video.{setup}.log",
    benchmark:
        "results/{scene}/benchmarks/video.{setup}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("join_images"),
        runtime=minutes("join_images"),
    params:
        dataset=folder("results/{scene}/dataset"),
        cameras=ask("setups.cameras_json"),
        images=folder("results/{scene}/relight/{setup}"),
        max_views=ask("shown_views"),
        settings=settings("video"),
        version=VERSIONS["video"],
    shell:
        "fipt video --dataset {params.dataset:q} --cameras {params.cameras:q}"
        " --images {params.images:q} --max-views {params.max_views:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule olat_views:
    """Render views of a shard with one light at a time."""
    input:
        transforms=own("results/{scene}/dataset/transforms.json"),
        views=own("results/{scene}/dataset/views.json"),
        mesh=own("results/{scene}/dataset/mesh.ply"),
        checked=own("results/{scene}/dataset/check_poses.json"),
        cache=own("results/{scene}/cache.npz"),
        environment=own("results/{scene}/environment.npz"),
        model=ask("last_model"),
        emitters=ask("last_emitters"),
    output:
        manifest="results/{scene}/olat.{shard}.manifest.json",
        stats="results/{scene}/stats/olat.{shard}.json",
    log:
        "results/{scene}/logs/olat.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/olat.{shard}.jsonl"
    threads: THREADS
    resources:
        mem_mb=memory("olat_views"),
        runtime=minutes("olat_views"),
        gpu=GPUS,
    params:
        dataset=folder("results/{scene}/dataset"),
        out=folder("results/{scene}/olat"),
        views=ask("views.olat_listed"),
        rays_per_side=ask("rays_per_side"),
        settings=settings("olat"),
        version=VERSIONS["olat"],
    shell:
        "fipt olat --dataset {params.dataset:q} --cache {input.cache:q}"
        " --environment {input.environment:q}"
        " --model {input.model:q} --emitters {input.emitters:q} --views {params.views:q}"
        " --rays-per-side {params.rays_per_side:q} --out {params.out:q} --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
