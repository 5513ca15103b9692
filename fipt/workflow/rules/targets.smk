"""Named stopping points over the scenes of the config, or of ``--config only=[...]``.

INPUTS:  what each stage writes last
OUTPUTS: none
"""


localrules:
    capture,
    dataset,
    shading,
    materials,
    render,
    relight,
    export,
    metrics,
    report,
    compare,


rule capture:
    """The capture report of every photographed scene."""
    input:
        of_asked_scenes(ask("judged")),


rule dataset:
    """Cameras, pictures, mesh, segments and truth."""
    input:
        of_asked_scenes(
            "results/{scene}/dataset/transforms.json", ask("images", splits=["all"])
        ),


rule shading:
    """The shading of the last round."""
    input:
        of_asked_scenes(ask("last_shading")),


rule materials:
    """Material maps of every view."""
    input:
        of_asked_scenes(
            sharded("results/{scene}/materials.{shard}.manifest.json", "all")
        ),


rule render:
    """Held-out views, rendered with the model."""
    input:
        of_asked_scenes(sharded("results/{scene}/render.{shard}.manifest.json", "val")),


rule relight:
    """Every view of every relight setup."""
    input:
        of_asked_scenes(ask("setups.relit"), ask("setups.joined")),


rule export:
    """The room for other programs, and the check of every file."""
    input:
        of_asked_scenes(ask("exported")),


rule metrics:
    """Figures against ground truth and pictures."""
    input:
        of_asked_scenes("results/{scene}/metrics.json"),


rule report:
    """The page that shows everything."""
    input:
        of_asked_scenes("results/{scene}/report.html"),


rule compare:
    """The page that compares methods, and its tables; of several scenes those of all together, too."""
    input:
        of_asked_scenes("results/{scene}/compare.html"),
        "results/compare/page.html" if len(CONFIG.only) > 1 else [],
