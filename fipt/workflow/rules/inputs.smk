"""Functions that turn wildcards into inputs, params and resources, shared by the rules files.

INPUTS:  none
OUTPUTS: none

What a stage needs of a scene is known to fipt/config (`SceneConfig` and its parts): rules ask for it by name. A scene's
views are asked for only when a rule of that scene is reached, so that a scene nobody asked for needs no data.
"""

from functools import partial

from fipt.config.resources import memory_mb
from fipt.config.resources import minutes as most_minutes
from fipt.workflow.plans import planned


def own(pattern):
    """Input or params function: a path of the scene; runs of methods take over what they have in common with it."""
    return planned(lambda wildcards: located(pattern, wildcards))


folder = own  # as params call it: a path that is no input or output as it stands


def located(pattern, wildcards, **known):
    """Path of a file of the scene."""
    path = pattern.format(**{**wildcards, **known})
    return readable(scene_of(wildcards).where, path)


def ask(question, **known):
    """Input or params function: what `SceneConfig` answers, by the dotted name of an attribute or method.

    A method is given the wildcards that it takes, and what is ``known`` here.
    """
    return planned(
        lambda wildcards: readable(
            scene_of(wildcards).answer, question, **{**wildcards, **known}
        )
    )


def listed(question):
    """Params function: names that are the answer to a question, sorted, comma-separated."""
    answer = ask(question)
    return planned(lambda wildcards: ",".join(sorted(answer(wildcards))))


def settings(section):
    """Params function: the settings of a section as sorted JSON."""
    return ask("settings_json", section=section)


def sharded(pattern, *splits):
    """Input function: the pattern for every shard of the splits, or of "all"."""
    return planned(
        lambda wildcards: [
            located(pattern, wildcards, shard=shard)
            for shard in readable(scene_of(wildcards).views.shards, *splits)
        ]
    )


def previous(pattern):
    """Input function: a file of the round before; nothing in round 0."""
    return planned(
        lambda wildcards: [
            located(pattern, wildcards, round=round)
            for round in [int(wildcards.round) - 1]
            if round >= 0
        ]
    )


def option(flag, name, pattern=None):
    """Params function: a flag where there is an input ``name``; its value is that input, or a path of the scene."""

    def given(wildcards, input):
        if not input[name]:
            return []
        return [flag, *([located(pattern, wildcards)] if pattern else input[name])]

    return planned(given)


def folders_of(name, flag=None):
    """Params function: the folders that the manifests in input ``name`` describe, comma-separated.

    Other files stand for themselves. A ``flag`` comes first, where the input has any file.
    """

    def joined(wildcards, input):
        paths = [input[name]] if isinstance(input[name], str) else input[name]
        folders = ",".join(path.removesuffix(".manifest.json") for path in paths)
        return folders if flag is None else [flag, folders] if folders else []

    return planned(joined)


def first_shading(wildcards):
    """Input function: the training shading of round 0, in later rounds."""
    if int(wildcards.round) == 0:
        return []
    pattern = "results/{scene}/round-0/shading/{shard}.manifest.json"
    return sharded(pattern, "train")(wildcards)


def of_asked_scenes(*files):
    """Input function: patterns, and files of input functions, for every scene that was asked for."""
    return lambda _: [
        found
        for name in CONFIG.only
        for file in files
        for found in (
            file({"scene": name}) if callable(file) else expand(file, scene=name)
        )
    ]


def sized(needs, name):
    """Resource function: what a job of the named rule asks for by the size of its work, more when it is tried again."""
    return planned(
        lambda wildcards, attempt: needs(
            name,
            readable(scene_of(wildcards).work, wildcards.get("shard")),
            attempt,
        )
    )


memory = partial(sized, memory_mb)  # megabytes
minutes = partial(sized, most_minutes)  # that it may take
