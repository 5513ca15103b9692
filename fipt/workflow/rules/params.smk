"""Params functions: settings, views, folders and flags of the commands.

INPUTS:  the configuration that rules/common.smk checked
OUTPUTS: none; functions that turn wildcards into what stands in a command line
"""


def option(flag, name):
    """Params function: a flag with the input ``name``, where there is one."""
    return lambda wildcards, input: [flag, *input[name]] if input[name] else []


def where(name, flag, pattern):
    """Params function: a flag with a folder of the scene, where there is an input ``name``."""
    return lambda wildcards, input: (
        [flag, pattern.format(**wildcards)] if input[name] else []
    )


def settings(stage):
    """Params function: the settings of one stage as sorted JSON."""
    return lambda wildcards: scene_of(wildcards).json(stage)


def emission(wildcards):
    """Params function: what a person decided about lamps, as options of ``fipt emitters``."""
    return scene_of(wildcards).emission_options()


def listing(wildcards):
    """Params function: how a person named lamps, and which are rejected, as options of ``fipt review``."""
    return scene_of(wildcards).listing_options()


def setup_json(wildcards):
    """Params function: a relight setup as sorted JSON."""
    return scene_of(wildcards).setup_json(wildcards.setup)


def relit_views(wildcards):
    """Params function: the views of a shard under a setup, or those of its own cameras, comma-separated, as an option."""
    scene = scene_of(wildcards)
    flag = "--cameras" if wildcards.setup in scene.filmed else "--views"
    shards = readable(scene.relit_shards, wildcards.setup)
    return [flag, ",".join(shards[wildcards.shard])]


def rays_per_side(wildcards):
    """Params function: rays of a pixel along its side, as many as its samples have."""
    return scene_of(wildcards).settings["samples"].grid


def cameras_json(wildcards):
    """Params function: a setup's own cameras as sorted JSON."""
    return scene_of(wildcards).cameras_json(wildcards.setup)


def report_views(wildcards):
    """Params function: number of views that the report shows; their photographs set the exposure of videos."""
    return scene_of(wildcards).settings["report"].max_views


def true_setups(wildcards):
    """Params function: the relight setups with a truth, comma-separated."""
    return ",".join(sorted(readable(lambda: scene_of(wildcards).true_setups)))


def relit_setups(wildcards):
    """Params function: the relight setups that views of the dataset see, comma-separated."""
    return ",".join(sorted(scene_of(wildcards).relit))


def filmed_setups(wildcards):
    """Params function: the relight setups with cameras of their own, comma-separated."""
    return ",".join(sorted(scene_of(wildcards).filmed))


def references(wildcards):
    """Params function: flags with the folders of photographs under the setups' lights."""
    given = readable(lambda: scene_of(wildcards).references)
    return [
        text
        for setup, path in given.items()
        for text in ("--reference", f"{setup}={path}")
    ]


def views(wildcards):
    """Params function: the views of a shard, comma-separated."""
    return ",".join(shards_of(wildcards, "all")[wildcards.shard])


def lamp_views(wildcards):
    """Params function: the views of a shard that are rendered with each lamp alone, comma-separated."""
    return ",".join(readable(scene_of(wildcards).lamp_shards)[wildcards.shard])


def folder(pattern):
    """Params function: a folder of the scene that several rules write to or read."""
    return lambda wildcards: pattern.format(**wildcards)


def folders_of(name):
    """Params function: the folders that the manifests in input ``name`` describe, comma-separated."""

    def joined(wildcards, input):
        paths = [input[name]] if isinstance(input[name], str) else input[name]
        return ",".join(path.removesuffix(".manifest.json") for path in paths)

    return joined
