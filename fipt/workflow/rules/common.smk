"""Checks the configuration; input functions that the rules files share.

INPUTS:  config (config/config.yaml, --configfile, --config)
OUTPUTS: none; functions that turn wildcards into files

A scene's views are asked for only when a rule of that scene is reached, so that a scene nobody
asked for needs no data.
"""

import contextlib
import os
import re
import shlex
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.utils import validate

from fipt.config import load
from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.lock import locked
from fipt.registry import VERSIONS

# `fipt` is found beside the Python that runs Snakemake, even if its environment is not active. It takes the place of the
# shell and knows who called it: a job ends with the run that started it, even if that is killed.
shell.prefix(
    f'export PATH="$PATH":{shlex.quote(str(Path(sys.executable).parent))} FIPT_RUN={os.getpid()}; exec '
)

try:
    CONFIG = load(config)
    for name in CONFIG.only if config.get("only") else ():
        CONFIG.scenes[name].views  # what was asked for by name is looked at now
    # Snakemake would take an error of an input function for "nothing to do".
    for name in CONFIG.only:
        CONFIG.scenes[name].review
        CONFIG.scenes[name].check_setups()
        if path := CONFIG.scenes[name].environment_path():
            existing_file(path, "environment.file")
except FiptError as error:
    raise WorkflowError(f"fipt: error: {error}") from None
validate(CONFIG.plain, "../schemas/config.schema.yaml", set_default=False)


def one_of(names):
    """Regular expression that matches these names only; nothing where there are none."""
    return "|".join(map(re.escape, names)) or "(?!)"


def scenes_that(fit):
    """Regular expression of the scenes for which a function is true."""
    return one_of(scene.name for scene in CONFIG.scenes.values() if fit(scene))


LOCKS = contextlib.ExitStack()
LATER_ROUNDS = one_of(str(k) for k in range(1, CONFIG.rounds + 1))
LAST_MODEL = f"results/{{scene}}/round-{CONFIG.rounds}/model.safetensors"
LAST_CONFIDENCE = f"results/{{scene}}/round-{CONFIG.rounds}/confidence.npz"


wildcard_constraints:
    scene=one_of(CONFIG.scenes),
    shard=r"(train|val)-\d+",
    round=one_of(str(k) for k in range(CONFIG.rounds + 1)),
    setup=one_of(
        sorted({name for scene in CONFIG.scenes.values() for name in scene.setups})
    ),


def scene_of(wildcards):
    """The scene of a job."""
    return CONFIG.scenes[wildcards["scene"]]


def readable(function, *args):
    """Call a function; what the user can mend ends the run with one line."""
    try:
        return function(*args)
    except FiptError as error:
        raise WorkflowError(f"fipt: error: {error}") from None


def lock_scenes():
    """Keep other runs away from the scenes; unlike Snakemake's own lock, this one dies with the run."""
    for name in CONFIG.only:
        readable(LOCKS.enter_context, locked(Path("results", name)))


def shards_of(wildcards, *splits):
    """Shard -> its views, for the splits or "all"."""
    return readable(scene_of(wildcards).shards, *splits)


def sharded(pattern, *splits):
    """Input function: the pattern for every shard of the splits, or of "all"; in a job of a shard, for that one."""
    return lambda wildcards: expand(
        pattern, **{"shard": shards_of(wildcards, *splits), **wildcards}
    )


def images(*splits):
    """Input function: manifests of the pictures, ids and truth of the splits, of "all", or of the job's shard."""
    made = sharded("results/{scene}/dataset/images.{shard}.manifest.json", *splits)
    truth = sharded("results/{scene}/dataset/truth.{shard}.manifest.json", *splits)
    imported = "results/{scene}/dataset/images.manifest.json"

    def files(wildcards):
        scene = scene_of(wildcards)
        if scene.synthesized and not scene.simulated:
            return made(wildcards)
        known = truth(wildcards) if scene.simulated else []
        return [*expand(imported, **wildcards), *known]

    return files


def relit(pattern, known=False):
    """Input function: the pattern for every relit shard and setup; only setups with ``known`` truth if asked."""

    def files(wildcards):
        scene = scene_of(wildcards)
        setups = scene.true_setups if known else scene.relit
        return [file for setup in setups for file in of_shards(pattern, scene, setup)]

    return files


def of_shards(pattern, scene, setup):
    """The pattern for every shard of a setup."""
    shards = readable(scene.relit_shards, setup)
    return expand(pattern, scene=scene.name, setup=setup, shard=shards)


def seen_by_cameras(wildcards):
    """Input function: manifests of what a setup's own cameras see."""
    made = "results/{scene}/relight/{setup}.{shard}.manifest.json"
    return of_shards(made, scene_of(wildcards), wildcards.setup)


def films(wildcards):
    """Input function: manifests of the setups with cameras of their own."""
    scene = scene_of(wildcards)
    made = "results/{scene}/relight/{setup}.manifest.json"
    return expand(made, scene=scene.name, setup=scene.filmed)


def frames(wildcards):
    """Input function: manifests of what the cameras of all these setups see."""
    scene = scene_of(wildcards)
    made = "results/{scene}/relight/{setup}.{shard}.manifest.json"
    return [file for setup in scene.filmed for file in of_shards(made, scene, setup)]


def reference_files(wildcards):
    """Input function: photographs with which relit views are compared."""
    return readable(scene_of(wildcards).reference_files)


def lamps_of(wildcards):
    """Input function: manifests of the views with each lamp alone."""
    pattern = "results/{scene}/olat.{shard}.manifest.json"
    shards = readable(scene_of(wildcards).lamp_shards)
    return expand(pattern, shard=shards, **wildcards)


def emitters_of(wildcards, round):
    """The emitters that go with the model of a round."""
    scene = scene_of(wildcards)
    return f"results/{scene.name}/round-{scene.emitters_round(round)}/emitters.npz"


def last_emitters(wildcards):
    """Input function: the emitters that go with the last model."""
    return emitters_of(wildcards, CONFIG.rounds)


def previous_emitters(wildcards):
    """Input function: the emitters that go with the model of the round before."""
    return emitters_of(wildcards, int(wildcards.round) - 1)


def previous(pattern):
    """Input function: a file of the round before; nothing in round 0."""
    return lambda wildcards: [
        pattern.format(**{**wildcards, "round": round})
        for round in [int(wildcards.round) - 1]
        if round >= 0
    ]


def source_files(wildcards):
    """Input function: the files that an import reads."""
    return readable(scene_of(wildcards).source_files)


def segmentation(wildcards):
    """Where the segment ids of a scene come from."""
    return readable(lambda: scene_of(wildcards).segmentation)


def segmented(wildcards):
    """Input function: ids of the training views, where they are made view by view."""
    made = "results/{scene}/segments/views.{shard}.manifest.json"
    by_view = segmentation(wildcards) in ("mask2former", "given")
    return sharded(made, "train")(wildcards) if by_view else []


def segment_files(wildcards):
    """Input function: given ids, or the weights of a network in a folder."""
    return readable(scene_of(wildcards).segment_files)


def fused(wildcards):
    """Input function: the fused ids; nothing where the dataset's are used, or none."""
    made = "results/{scene}/segments/fused.manifest.json".format(**wildcards)
    return [] if segmentation(wildcards) in ("dataset", "none") else [made]


def fused_of_setup(wildcards):
    """Input function: the fused ids, where a relight setup names some."""
    return fused(wildcards) if scene_of(wildcards).names_fused(wildcards.setup) else []


def environment_file(wildcards):
    """Input function: the environment map that the config names, if any."""
    path = readable(scene_of(wildcards).environment_path)
    return [path] if path else []


def setup_files(wildcards):
    """Input function: the files that a relight setup names."""
    return readable(scene_of(wildcards).setup_files, wildcards.setup)


def listed_lamps(wildcards):
    """Input function: the list of lamps, where a relight setup names lamps as a person called them."""
    named = scene_of(wildcards).names_in(wildcards.setup)
    return (
        ["results/{scene}/emitters.manifest.json".format(**wildcards)] if named else []
    )


def checked_export(wildcards):
    """Input function: the export and its check, where every run makes one."""
    scene = scene_of(wildcards)
    made = "export.manifest.json", "export/check.json", "export/check"
    return [f"results/{scene.name}/{name}" for name in made] if scene.exported else []


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
