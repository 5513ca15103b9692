"""Checks the configuration; what all rules files share, but for the functions of inputs.smk.

INPUTS:  config (config/config.yaml, --configfile, --config)
OUTPUTS: none
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
from fipt.config.failed import note_failures
from fipt.config.kept import check_files, check_kept
from fipt.config.machine import PlannedJob, check_machine
from fipt.config.reading import SCENE, load
from fipt.errors import FiptError
from fipt.lock import all_locked
from fipt.outcome import listed as listed_failures
from fipt.registry import VERSIONS
from fipt.workflow.machine import asked_gpus, bound_memory, share_processors
from fipt.workflow.plans import plan_quickly

plan_quickly()

# `fipt` is found beside the Python that runs Snakemake, even if its environment is not active. It takes the place of the
# shell and knows who called it: a job ends with the run that started it, even if that is killed. Matrices of numpy have
# one thread (fipt/cli/process.py); Snakemake would give them as many as the job asks for.
shell.prefix(
    f'export PATH="$PATH":{shlex.quote(str(Path(sys.executable).parent))} FIPT_RUN={os.getpid()}'
    " OPENBLAS_NUM_THREADS=1; exec "
)

try:
    BUCKET = None
    if workflow.storage_settings.default_storage_provider is not None:
        from fipt.workflow.storage import keep_rooms, keep_sheet, prefer_stored

        BUCKET = keep_rooms(workflow)
        if not workflow.output_settings.dryrun:
            keep_sheet(BUCKET, config.get("scenes"), workflow.remote_exec)
    for path in map(Path, workflow.configfiles):
        if (
            path.suffix != ".json"
        ):  # read once more: Snakemake keeps the last of equal keys
            read_yaml(path)
    CONFIG = load(config)
    check_files(CONFIG, workflow.configfiles)
    check_kept(CONFIG)
    # decisions of people, which are parameters
    if BUCKET and not workflow.output_settings.dryrun:
        BUCKET.share(CONFIG.scenes[name].layout.review for name in CONFIG.only)
    # Snakemake would take an error of an input function for "nothing to do". What was asked for by name is read now.
    CONFIG.check(read=bool(config.get("only") or CONFIG.sheet))
except FiptError as error:
    raise WorkflowError(f"fipt: error: {error}") from None
validate(CONFIG.plain, "../schemas/config.schema.json", set_default=False)


def one_of(names):
    """Regular expression that matches these names only; nothing where there are none."""
    return "|".join(map(re.escape, names)) or "(?!)"


# On a cluster there is no number of cores of all jobs together; the profile may give single rules another.
THREADS = workflow.resource_settings.cores or int(os.environ.get("FIPT_THREADS", "4"))
GPUS = asked_gpus(workflow)
bound_memory(workflow)
LOCKS = contextlib.ExitStack()
FOLDERS = [Path("results", name) for name in CONFIG.only]
LATER_ROUNDS = one_of(str(k) for k in range(1, CONFIG.rounds + 1))
RENDERED = f"{SCENE}|{CONFIG.runs('any', 'imported')}"
FITTED = f"{SCENE}|{CONFIG.runs('fit')}"


wildcard_constraints:
    scene=f"{SCENE}|{CONFIG.runs('any')}",
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
    return readable(CONFIG.scene, wildcards["scene"])


def readable(function, *args, **named):
    """Call a function; what the user can mend ends the run with one line."""
    try:
        return function(*args, **named)
    except FiptError as error:
        raise WorkflowError(f"fipt: error: {error}") from None
