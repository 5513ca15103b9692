"""Checks the configuration; functions that turn wildcards into inputs and params, shared by the rules files.

INPUTS:  config (config/config.yaml, --configfile, --config)
OUTPUTS: none

What a stage needs of a scene is known to fipt/config (`SceneConfig` and its parts): rules ask for it by name. A scene's
views are asked for only when a rule of that scene is reached, so that a scene nobody asked for needs no data.
"""

import contextlib
import os
import re
import shlex
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.utils import validate

from fipt.formats.yaml import read_yaml
from fipt.config.kept import check_kept
from fipt.config.reading import load
from fipt.errors import FiptError
from fipt.lock import locked
from fipt.registry import VERSIONS

# `fipt` is found beside the Python that runs Snakemake, even if its environment is not active. It takes the place of the
# shell and knows who called it: a job ends with the run that started it, even if that is killed.
shell.prefix(
    f'export PATH="$PATH":{shlex.quote(str(Path(sys.executable).parent))} FIPT_RUN={os.getpid()}; exec '
)

try:
    for path in map(Path, workflow.configfiles):
        if (
            path.suffix != ".json"
        ):  # read once more: Snakemake keeps the last of equal keys
            read_yaml(path)
    CONFIG = load(config)
    check_kept(CONFIG)
    for name in CONFIG.only if config.get("only") else ():
        CONFIG.scenes[name].source.views  # what was asked for by name is looked at now
    # Snakemake would take an error of an input function for "nothing to do".
    for name in CONFIG.only:
        CONFIG.scenes[name].check()
except FiptError as error:
    raise WorkflowError(f"fipt: error: {error}") from None
validate(CONFIG.plain, "../schemas/config.schema.yaml", set_default=False)


def one_of(names):
    """Regular expression that matches these names only; nothing where there are none."""
    return "|".join(map(re.escape, names)) or "(?!)"


def scenes_where(question):
    """Regular expression of the scenes whose answer to a question is yes."""
    return one_of(
        name for name, scene in CONFIG.scenes.items() if scene.answer(question)
    )


LOCKS = contextlib.ExitStack()
LATER_ROUNDS = one_of(str(k) for k in range(1, CONFIG.rounds + 1))
RENDERED = f"{one_of(CONFIG.scenes)}|{CONFIG.runs('any', 'imported')}"
FITTED = f"{one_of(CONFIG.scenes)}|{CONFIG.runs('fit')}"


wildcard_constraints:
    scene=f"{one_of(CONFIG.scenes)}|{CONFIG.runs('any')}",
    method=r"[\w.-]+",
    shard=r"(train|val)-\d+",
    round=one_of(str(k) for k in range(CONFIG.rounds + 1)),
    setup=one_of(
        sorted(
            {name for scene in CONFIG.scenes.values() for name in scene.given_setups}
        )
    ),


def scene_of(wildcards):
    """The scene of a job, or the run of a method on it."""
    return CONFIG.scene(wildcards["scene"])


def readable(function, *args, **named):
    """Call a function; what the user can mend ends the run with one line."""
    try:
        return function(*args, **named)
    except FiptError as error:
        raise WorkflowError(f"fipt: error: {error}") from None


def lock_scenes():
    """Keep other runs away from the scenes; unlike Snakemake's own lock, this one dies with the run."""
    for name in CONFIG.only:
        readable(LOCKS.enter_context, locked(Path("results", name)))


def own(pattern):
    """Input or params function: a path of the scene; runs of methods take over what they have in common with it."""
    return lambda wildcards: located(pattern, wildcards)


folder = own  # as params call it: a path that is no input or output as it stands


def located(pattern, wildcards, **known):
    """Path of a file of the scene."""
    path = pattern.format(**{**wildcards, **known})
    return readable(scene_of(wildcards).where, path)


def ask(question, **known):
    """Input or params function: what `SceneConfig` answers, by the dotted name of an attribute or method.

    A method is given the wildcards that it takes, and what is ``known`` here.
    """
    return lambda wildcards: readable(
        scene_of(wildcards).answer, question, **{**wildcards, **known}
    )


def listed(question):
    """Params function: names that are the answer to a question, sorted, comma-separated."""
    return lambda wildcards: ",".join(sorted(ask(question)(wildcards)))


def settings(section):
    """Params function: the settings of a section as sorted JSON."""
    return ask("settings_json", section=section)


def sharded(pattern, *splits):
    """Input function: the pattern for every shard of the splits, or of "all"."""
    return lambda wildcards: [
        located(pattern, wildcards, shard=shard)
        for shard in readable(scene_of(wildcards).views.shards, *splits)
    ]


def previous(pattern):
    """Input function: a file of the round before; nothing in round 0."""
    return lambda wildcards: [
        located(pattern, wildcards, round=round)
        for round in [int(wildcards.round) - 1]
        if round >= 0
    ]


def option(flag, name, pattern=None):
    """Params function: a flag where there is an input ``name``; its value is that input, or a path of the scene."""

    def given(wildcards, input):
        if not input[name]:
            return []
        return [flag, *([located(pattern, wildcards)] if pattern else input[name])]

    return given


def folders_of(name, flag=None):
    """Params function: the folders that the manifests in input ``name`` describe, comma-separated.

    Other files stand for themselves. A ``flag`` comes first, where the input has any file.
    """

    def joined(wildcards, input):
        paths = [input[name]] if isinstance(input[name], str) else input[name]
        folders = ",".join(path.removesuffix(".manifest.json") for path in paths)
        return folders if flag is None else [flag, folders] if folders else []

    return joined


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
