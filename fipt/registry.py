"""The table of stages: which settings each section of the config has, and the version of what it writes.

A new stage adds a line here. Nothing is imported until it is asked for, so that the workflow and ``fipt --help`` can
read the table at no cost.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from fipt.errors import FiptError


@dataclass(frozen=True)
class Section:
    """A section of the config.

    Attributes
    ----------
    model
        Class of its settings, ``module:class``.
    version
        Raised when what the stage writes changes meaning, so that the workflow runs it again.
    """

    model: str
    version: int


SECTIONS: dict[str, Section] = {
    "synthesize": Section("fipt.synthetic.settings:SynthesizeSettings", 2),
    "capture": Section("fipt.stages.capture.settings:CaptureSettings", 1),
    "poses": Section("fipt.stages.poses.settings:PosesSettings", 2),
    "import": Section("fipt.stages.importing.settings:ImportSettings", 1),
    "check_poses": Section("fipt.stages.check_poses.settings:CheckPosesSettings", 1),
    "samples": Section("fipt.stages.samples.settings:SamplesSettings", 2),
    "segment": Section("fipt.stages.segment.settings:SegmentSettings", 1),
    "fuse": Section("fipt.stages.segment.settings:FuseSettings", 1),
    "environment": Section("fipt.stages.environment.settings:EnvironmentSettings", 1),
    "cache": Section("fipt.stages.cache.settings:CacheSettings", 2),
    "bake": Section("fipt.stages.shade.settings:BakeSettings", 3),
    "fit": Section("fipt.stages.fit.settings:FitSettings", 3),
    "emitters": Section("fipt.stages.emitters.settings:EmittersSettings", 2),
    "review": Section("fipt.stages.emitters.settings:ReviewSettings", 1),
    "refine": Section("fipt.stages.shade.settings:RefineSettings", 3),
    "materials": Section("fipt.stages.render.settings:MaterialsSettings", 2),
    "render": Section("fipt.stages.render.settings:RenderSettings", 3),
    "relight": Section("fipt.stages.render.settings:RelightSettings", 3),
    "video": Section("fipt.stages.render.settings:VideoSettings", 1),
    "olat": Section("fipt.stages.render.settings:OlatSettings", 2),
    "export": Section("fipt.stages.export.settings:ExportSettings", 2),
    "metrics": Section("fipt.stages.evaluate.settings:MetricsSettings", 4),
    "report": Section("fipt.stages.report.settings:ReportSettings", 4),
}
"""Section of the config -> its settings and version, in the order of the pipeline."""

VERSIONS = {name: section.version for name, section in SECTIONS.items()}
"""Section -> version of what its stage writes."""


def settings_classes() -> dict[str, type[Any]]:
    """Every section with the class of its settings, in the order of the pipeline."""
    return {name: settings_class(name) for name in SECTIONS}


def settings_class(section: str) -> type[Any]:
    """Class of a section's settings."""
    module, _, name = SECTIONS[section].model.partition(":")
    return getattr(import_module(module), name)


def parse(section: str, text: str) -> Any:
    """Parse the JSON of ``--settings`` into the section's model.

    Raises
    ------
    FiptError
        If it is not JSON, has unknown keys or values out of range.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise FiptError(f"--settings must be JSON ({error})", "give for example '{}'") from error
    return validated(section, values)


def validated(section: str, values: Mapping[str, Any]) -> Any:
    """Check ``values`` against the section's model and return it."""
    from fipt.settings import validate

    return validate(settings_class(section), section, values)
