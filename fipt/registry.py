"""The tables of stages: the settings and version of each section of the config, and the verbs of the command line.

A new stage adds a line to each. Nothing is imported until it is asked for, so that the workflow and ``fipt --help`` can
read the table at no cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from fipt.errors import FiptError
from fipt.strict_json import parse_json


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
    "synthesize": Section("fipt.synthetic.settings:SynthesizeSettings", 4),
    "capture": Section("fipt.stages.capture.settings:CaptureSettings", 3),
    "poses": Section("fipt.stages.poses.settings:PosesSettings", 6),
    "import": Section("fipt.stages.importing.settings:ImportSettings", 14),
    "depth": Section("fipt.stages.geometry.settings:DepthSettings", 6),
    "geometry": Section("fipt.stages.geometry.mesh_settings:GeometrySettings", 17),
    "check_poses": Section("fipt.stages.check_poses.settings:CheckPosesSettings", 6),
    "plant_errors": Section("fipt.stages.plant_errors.settings:PlantErrorsSettings", 3),
    "samples": Section("fipt.stages.samples.settings:SamplesSettings", 4),
    "segment": Section("fipt.stages.segment.settings:SegmentSettings", 3),
    "fuse": Section("fipt.stages.segment.settings:FuseSettings", 3),
    "cache": Section("fipt.stages.cache.settings:CacheSettings", 8),
    "environment": Section("fipt.stages.environment.settings:EnvironmentSettings", 8),
    "bake": Section("fipt.stages.shade.settings:BakeSettings", 6),
    "refine": Section("fipt.stages.shade.settings:RefineSettings", 11),
    "emitters": Section("fipt.stages.emitters.settings:EmittersSettings", 43),
    "regroup": Section("fipt.stages.segment.settings:RegroupSettings", 23),
    "fit": Section("fipt.stages.fit.settings:FitSettings", 25),
    "irradiance": Section("fipt.stages.irradiance.settings:IrradianceSettings", 2),
    "true_constants": Section("fipt.stages.true_constants.settings:TrueConstantsSettings", 2),
    "inverse_trace": Section("fipt.stages.inverse_trace.settings:InverseTraceSettings", 4),
    "import_results": Section("fipt.stages.import_results.settings:ImportResultsSettings", 3),
    "review": Section("fipt.stages.emitters.settings:ReviewSettings", 4),
    "materials": Section("fipt.stages.render.settings:MaterialsSettings", 3),
    "render": Section("fipt.stages.render.settings:RenderSettings", 6),
    "relight": Section("fipt.stages.render.settings:RelightSettings", 8),
    "video": Section("fipt.stages.render.settings:VideoSettings", 4),
    "olat": Section("fipt.stages.render.settings:OlatSettings", 5),
    "export": Section("fipt.stages.export.settings:ExportSettings", 8),
    "metrics": Section("fipt.stages.evaluate.settings:MetricsSettings", 9),
    "findings": Section("fipt.stages.findings.settings:FindingsSettings", 11),
    "report": Section("fipt.stages.report.settings:ReportSettings", 7),
    "compare": Section("fipt.stages.compare.settings:CompareSettings", 2),
    "compare_page": Section("fipt.stages.report.settings:ComparePageSettings", 2),
}
"""Section of the config -> its settings and version, in the order of the pipeline."""


@dataclass(frozen=True)
class Verb:
    """A verb of the command line.

    Attributes
    ----------
    help
        Its line in ``fipt --help``.
    module
        Of a stage: the module with ``run(inputs, settings)``, from which the verb is derived. Else the one with a
        function ``command`` with typer annotations.
    section
        Section of the config whose settings a stage takes; None: the verb is no stage.
    rays
        Whether it traces rays: the device is chosen before it runs.
    """

    help: str
    module: str
    section: str | None = None
    rays: bool = False


VERBS: dict[str, Verb] = {
    "init": Verb("Write the configuration of a new room, with comments.", "fipt.cli.init"),
    "synthesize-room": Verb(
        "Build a known room, in code or of a scene file; place its cameras.",
        "fipt.stages.synthesize.room_stage",
        "synthesize",
        rays=True,
    ),
    "synthesize-views": Verb(
        "Render images, segments and truth of views of a known room.",
        "fipt.stages.synthesize.views_stage",
        "synthesize",
        rays=True,
    ),
    "synthesize-relit": Verb(
        "Render views of a known room under a relight setup.",
        "fipt.stages.synthesize.relit_stage",
        "synthesize",
        rays=True,
    ),
    "photograph-calibration": Verb(
        "Take a simulated camera's calibration frames.",
        "fipt.stages.synthesize.photograph_calibration_stage",
        "synthesize",
    ),
    "photograph": Verb(
        "Photograph views of a known room with a simulated camera.",
        "fipt.stages.synthesize.photograph_stage",
        "synthesize",
        rays=True,
    ),
    "photograph-images": Verb(
        "Photograph the images of any dataset with a simulated camera.",
        "fipt.stages.synthesize.photograph_images_stage",
        "synthesize",
    ),
    "synthesize-truth": Verb(
        "Look up the truth of developed photographs of a known room.",
        "fipt.stages.synthesize.truth_stage",
        "synthesize",
        rays=True,
    ),
    "check-capture": Verb(
        "Say what is wrong with a folder of photographs, in the room.",
        "fipt.stages.capture.check_capture_stage",
        "capture",
    ),
    "calibrate": Verb(
        "Calibrate a camera: lens, vignetting, black, white balance.", "fipt.stages.capture.calibrate_stage", "capture"
    ),
    "develop": Verb(
        "Merge bracketed photographs into calibrated HDR views.", "fipt.stages.capture.develop_stage", "capture"
    ),
    "qa": Verb(
        "Judge a developed capture: figures, findings, rejected views.", "fipt.stages.capture.qa_stage", "capture"
    ),
    "pose": Verb("Estimate the poses of views, with evidence for every camera.", "fipt.stages.poses.stage", "poses"),
    "import": Verb(
        "Bring posed HDR views of another layout into the dataset form.", "fipt.stages.importing.stage", "import"
    ),
    "depth": Verb(
        "Estimate the depth of every training view from what the others show.",
        "fipt.stages.geometry.depth_stage",
        "depth",
        rays=True,
    ),
    "mesh": Verb(
        "Make the room's mesh of the depth maps of its views.", "fipt.stages.geometry.mesh_stage", "geometry", rays=True
    ),
    "check-poses": Verb(
        "Check through the mesh that every view shows what the others show.",
        "fipt.stages.check_poses.stage",
        "check_poses",
    ),
    "plant-errors": Verb(
        "Plant errors into a dataset: for comparisons.", "fipt.stages.plant_errors.stage", "plant_errors"
    ),
    "samples": Verb(
        "Trace the footprint samples of every pixel, once.", "fipt.stages.samples.stage", "samples", rays=True
    ),
    "segment": Verb(
        "Segment every view, by a network or from ids that are given.", "fipt.stages.segment.stage", "segment"
    ),
    "fuse": Verb(
        "Bring segment ids of single views together on the mesh.", "fipt.stages.segment.fuse_stage", "fuse", rays=True
    ),
    "regroup": Verb(
        "Cut segments of two materials, join those of one, move their borders.",
        "fipt.stages.segment.regroup_stage",
        "regroup",
    ),
    "environment": Verb(
        "Find what light comes from outside the mesh.", "fipt.stages.environment.stage", "environment", rays=True
    ),
    "cache": Verb("Gather the images' radiance in voxels on the surface.", "fipt.stages.cache.stage", "cache"),
    "bake": Verb(
        "Integrate the shading of every pixel from the radiance cache.",
        "fipt.stages.shade.bake_stage",
        "bake",
        rays=True,
    ),
    "emitters": Verb(
        "Extract the triangles that emit light and their radiance.", "fipt.stages.emitters.stage", "emitters", rays=True
    ),
    "fit": Verb(
        "Fit the network of materials, and an emission mask if asked, to images.",
        "fipt.stages.fit.stage",
        "fit",
        rays=True,
    ),
    "irradiance": Verb(
        "Divide radiance by irradiance: a baseline for comparisons.", "fipt.stages.irradiance.stage", "irradiance"
    ),
    "true-constants": Verb(
        "Average the true materials of every part: a bound for comparisons.",
        "fipt.stages.true_constants.stage",
        "true_constants",
    ),
    "inverse-trace": Verb(
        "Optimise one material a part through the path tracer: for comparisons.",
        "fipt.stages.inverse_trace.stage",
        "inverse_trace",
        rays=True,
    ),
    "import-results": Verb(
        "Bring what another program estimated to our layers: for comparisons.",
        "fipt.stages.import_results.stage",
        "import_results",
    ),
    "review": Verb(
        "List the emitters for people, who may accept, reject, name and merge them.",
        "fipt.stages.emitters.review_stage",
        "review",
    ),
    "refine": Verb(
        "Path-trace the shading again with the fitted model.", "fipt.stages.shade.refine_stage", "refine", rays=True
    ),
    "materials": Verb(
        "Write the material maps of every view.", "fipt.stages.render.materials_stage", "materials", rays=True
    ),
    "render": Verb(
        "Re-render the held-out views with the model.", "fipt.stages.render.render_stage", "render", rays=True
    ),
    "relight": Verb(
        "Render the views under another light setup.", "fipt.stages.render.relight_stage", "relight", rays=True
    ),
    "video": Verb(
        "Join what a setup's own cameras see: PNG images, an MP4.", "fipt.stages.render.video_stage", "video"
    ),
    "point": Verb("Say where in the room a pixel of a view is, and of which segment.", "fipt.cli.point"),
    "olat": Verb(
        "Render views with one light at a time, for the light mixer.",
        "fipt.stages.render.olat_stage",
        "olat",
        rays=True,
    ),
    "export": Verb(
        "Write the room for Blender, Mitsuba, game engines, USD.", "fipt.stages.export.stage", "export", rays=True
    ),
    "check-export": Verb(
        "Load every exported file back and compare its images with ours.",
        "fipt.stages.export.check_export_stage",
        "export",
        rays=True,
    ),
    "metrics": Verb(
        "Compare materials, emitters and renderings with the truth.", "fipt.stages.evaluate.stage", "metrics"
    ),
    "findings": Verb(
        "Say what is wrong with a run, why, and what to do.", "fipt.stages.findings.stage", "findings", rays=True
    ),
    "report": Verb("Write the HTML page that shows everything.", "fipt.stages.report.stage", "report"),
    "score": Verb(
        "Say what a method of a comparison reached, took and used.", "fipt.stages.compare.score_stage", "compare"
    ),
    "compare": Verb("Write the table that compares methods on a scene.", "fipt.stages.compare.stage", "compare"),
    "compare-page": Verb(
        "Write the HTML page that compares methods.", "fipt.stages.report.compare_stage", "compare_page"
    ),
    "compare-rooms": Verb(
        "Write the table that compares methods on several scenes.", "fipt.stages.compare.rooms_stage", "compare"
    ),
    "run": Verb("Run a scene as far as a target: a front to the workflow.", "fipt.cli.run"),
    "tidy": Verb("Remove what a finished room no longer needs and a run can make again.", "fipt.cli.tidy"),
    "index": Verb("Write a page and a table over all rooms: figures, findings, times.", "fipt.cli.index"),
    "verify": Verb("Say which files of a run are not as it wrote them.", "fipt.cli.verify"),
    "view": Verb("Write any result as an EXR or PNG image.", "fipt.cli.view"),
    "doctor": Verb("Check Python, packages, ray tracing backend, memory and disk.", "fipt.cli.doctor"),
}
"""Verb -> what it is, in the order of the pipeline."""

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
        values = parse_json(text)
    except (ValueError, RecursionError) as error:
        raise FiptError(f"--settings must be JSON ({error})", "give for example '{}'") from error
    return validated(section, values)


def validated(section: str, values: Mapping[str, Any]) -> Any:
    """Check ``values`` against the section's model and return it."""
    from fipt.settings import validate

    return validate(settings_class(section), section, values)
