"""Entry point of the command line: ``fipt VERB [OPTIONS]``.

The verbs stand in a table here with their one-line help, in the order of the pipeline. A verb's
module is imported only when the verb is called, so ``fipt --help`` answers at once and
``fipt doctor`` works even where a heavy package is broken. The module of a verb holds a function
``command(...)`` with typer annotations; its docstring is the text of ``fipt VERB --help``.

Exit codes: 0 done, 1 a check of ``fipt doctor`` failed, 2 wrong usage or a `fipt.errors.FiptError`
(one line on stderr), 130 interrupted. Anything else keeps its traceback.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from fipt import __version__
from fipt.errors import EXIT_CODE, FiptError


@dataclass(frozen=True)
class Verb:
    """One line of the table: the module under `fipt.cli` and the help shown by ``fipt --help``."""

    module: str
    help: str


VERBS: dict[str, Verb] = {
    "synthesize": Verb("synthesize", "Make a dataset with ground truth from a room in code."),
    "calibrate": Verb("calibrate", "Calibrate a camera: lens, vignetting, black, white balance."),
    "develop": Verb("develop", "Merge bracketed photographs into calibrated HDR views."),
