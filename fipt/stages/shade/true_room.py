"""Shading of the true room, path traced as by a default refinement: the best that fit and refinement could come to."""

from collections.abc import Mapping, Sequence

import numpy as np

from fipt.errors import FiptError
from fipt.model.fitted import FittedScene
from fipt.model.truth import true_emitters, true_materials, true_pixels
from fipt.render.tracer import PathSettings, Shader
from fipt.scene.dataset import Dataset
from fipt.scene.environment import EnvironmentMap
from fipt.scene.samples import FootprintSamples
from fipt.stages.shade.refine import fitted_shader
from fipt.stages.shade.settings import RefineSettings


def true_shader(
    data: Dataset,
    shards: Sequence[FootprintSamples],
    cache: Mapping[str, np.ndarray],
    environment: EnvironmentMap,
) -> Shader:
    """Return a shader whose paths meet the materials and emitters that the truth of some shards of views shows.

    Surface that no view shows has the material of the nearest place. Paths are those of a refinement with defaults.

    Raises
    ------
    FiptError
        If no shard is given, or a view has no truth.
    """
    if not shards:
        raise FiptError("bake.truth needs the samples of all training shards", "give --true-samples")
    mesh, pixels = data.mesh(), true_pixels(data, shards)
    room = FittedScene(mesh, true_materials(mesh, pixels), true_emitters(mesh, pixels), environment, cache)
    usual = RefineSettings()
    return fitted_shader(room, PathSettings(usual.max_depth, usual.cache_roughness, usual.light_sampling))
