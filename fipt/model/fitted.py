"""The fitted scene: everything that later stages know of a room, in one object with one loader."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fipt.model.parts import MaterialModel, seen_materials
from fipt.model.reflectance import Brdf
from fipt.model.store import load_model
from fipt.scene.emitters import Emitters, read_emitters
from fipt.scene.environment import NOTHING, EnvironmentMap, read_environment
from fipt.scene.mesh import Mesh
from fipt.scene.voxels import facing_normals, read_cache


@dataclass(frozen=True)
class FittedScene:
    """A room as the pipeline knows it after a round.

    Attributes
    ----------
    mesh
        The surface, metres.
    model
        Fitted reflectance.
    emitters
        What emits; no triangle where that is not known yet.
    environment
        Radiance of rays that leave the mesh.
    cache
        Arrays of the radiance cache (`fipt.scene.voxels`); empty where the scene was loaded without it.
    """

    mesh: Mesh
    model: MaterialModel
    emitters: Emitters = field(default_factory=Emitters.none)
    environment: EnvironmentMap = NOTHING
    cache: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def load(
        cls,
        mesh: Mesh,
        model: Path,
        emitters: Path | None = None,
        environment: Path | None = None,
        cache: Path | None = None,
    ) -> "FittedScene":
        """Read the files of a round; what is not named stays unknown.

        Parameters
        ----------
        mesh
            Of the dataset that the model was fitted to (`fipt.scene.dataset.Dataset.mesh`).
        model, emitters, environment, cache
            model.safetensors, emitters.npz, environment.npz, cache.npz.

        Raises
        ------
        FiptError
            If a file is missing, damaged or of another version.
        """
        return cls(
            mesh,
            load_model(model),
            Emitters.none() if emitters is None else read_emitters(emitters, mesh),
            read_environment(environment),
            {} if cache is None else read_cache(cache),
        )

    def reflectance(
        self, points: np.ndarray, normals: np.ndarray, footprint: np.ndarray, triangle: np.ndarray | None = None
    ) -> Brdf:
        """Reflectance at points (N, 3) of triangles (N,) through pixels that are ``footprint`` (N,) metres wide.

        ``normals`` (N, 3) are turned to the viewer.
        """
        return seen_materials(self.model, points, normals, footprint, triangle)

    def cached_materials(self) -> Brdf:
        """Reflectance of the K records of the radiance cache, see `voxel_materials`."""
        return voxel_materials(self.model, self.cache)


def voxel_materials(model: MaterialModel, cache: Mapping[str, np.ndarray]) -> Brdf:
    """Reflectance of the K records of a cache; those that no view sees take that of the record standing for them."""
    seen, index = np.unique(cache["source"], return_inverse=True)
    size = np.full(len(seen), float(cache["side"]) / int(cache["resolution"]), np.float32)
    brdf = model.query(model.place(cache["point"][seen], facing_normals(cache["facing"][seen])), size)
    return Brdf(brdf.base_color[index], brdf.roughness[index], brdf.metallic[index])
