"""Inverse path tracing of rooms: from posed HDR views to materials, lamps, relit views and a report.

    snakemake -n                                                       what would run, and why
    snakemake --workflow-profile workflow/profiles/local               every scene of the config
    snakemake --workflow-profile workflow/profiles/local materials     up to a stopping point
    snakemake --cores all results/demo/report.html                     one file and what it needs

Stopping points: capture, dataset, shading, materials, render, relight, export, metrics, report.
Which scenes, with which settings: config/config.yaml, explained in config/README.md.
"""

from snakemake.utils import min_version

min_version("9.25")


configfile: "config/config.yaml"


# Used only with --sdm apptainer: an image that holds this package; none is published. Without it,
# every rule runs in the environment that Snakemake runs in.
container: "fipt.sif"


include: "workflow/rules/common.smk"
include: "workflow/rules/params.smk"
include: "workflow/rules/photographs.smk"
include: "workflow/rules/targets.smk"
include: "workflow/rules/simulate.smk"
include: "workflow/rules/capture.smk"
include: "workflow/rules/poses.smk"
include: "workflow/rules/dataset.smk"
include: "workflow/rules/check_poses.smk"
include: "workflow/rules/samples.smk"
include: "workflow/rules/segmentation.smk"
include: "workflow/rules/environment.smk"
include: "workflow/rules/cache.smk"
include: "workflow/rules/shading.smk"
include: "workflow/rules/fit.smk"
include: "workflow/rules/emitters.smk"
include: "workflow/rules/materials.smk"
include: "workflow/rules/render.smk"
include: "workflow/rules/relight.smk"
include: "workflow/rules/export.smk"
include: "workflow/rules/metrics.smk"
include: "workflow/rules/report.smk"


onstart:
    lock_scenes()


rule all:
    """The report of every scene."""
    default_target: True
    input:
        rules.report.input,
