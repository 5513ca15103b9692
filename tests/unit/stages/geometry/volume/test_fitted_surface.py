"""A room's surface, fitted to views of it by volume rendering: from a sphere, and from fused depth."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.render.variant import Backend
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.mesh_settings import MonosdfGeometry, RefinedGeometry
from fipt.stages.geometry.tsdf import BLOCK
from fipt.stages.geometry.volume.blocks import BlockGrid
from fipt.stages.geometry.volume.field import VolumeField
from fipt.stages.geometry.volume.loop import fit_field
from fipt.stages.geometry.volume.monosdf import box_of, from_sphere, tap_step
from fipt.stages.geometry.volume.pixels import VolumePixels
from fipt.stages.geometry.volume.refine import refined
from fipt.stages.geometry.volume.sampling import ErrorBounded
from fipt.stages.geometry.volume.start import Sphere
from tests.unit.stages.geometry.test_fusing import HALF, around, off_the_walls

VOXEL = 0.05
SMALL = {"levels": 5, "finest": 64, "table_log2": 13, "width": 16, "learning_rate": 5e-3}
QUICK = MonosdfGeometry(
    iterations=100, rays=128, samples=8, even_samples=4, first_samples=16, sampling_rounds=1, **SMALL
)

SHORT = RefinedGeometry(iterations=25, rays=256, samples=6, **SMALL)


def lit(views: Sequence[DepthView]) -> list[DepthView]:
    """Views of walls with a pattern."""
    return [replace(view, radiance=(0.7 + 0.5 * np.sin(6 * view.points)).astype(np.float32)) for view in views]


def cube(half: float) -> BlockGrid:
    """Blocks around the walls of a cube, with their distances."""
    axis = np.arange(-5, 5, dtype=np.int32)
    blocks = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    empty = np.zeros((len(blocks), BLOCK**3), np.float32)
    grid = BlockGrid(blocks, empty, np.ones(empty.shape, bool), VOXEL)
    distance = half - np.abs(grid.places(slice(None))).max(axis=1)
    empty[:] = np.clip(distance, -4 * VOXEL, 4 * VOXEL).reshape(empty.shape)
    return grid


def seen(mesh: Mesh) -> np.ndarray:
    """(V,) distances from the walls, of the vertices at a height that all cameras see."""
    return off_the_walls(mesh)[np.abs(mesh.vertices[:, 1]) < 1]


@pytest.mark.usefixtures("open3d")
def test_a_room_is_found_from_a_sphere(backend: Backend):
    mesh, _ = from_sphere(lit(around()), QUICK, VOXEL, backend.torch_device)
    assert np.median(seen(mesh)) < 0.03
    assert mesh.areas[np.abs(mesh.corners.mean(axis=1)).max(axis=1) < HALF + 0.3].sum() > 4 * 2 * HALF * 2


@pytest.mark.gpu
@pytest.mark.usefixtures("open3d")
def test_a_room_is_found_on_a_gpu():
    mesh, _ = from_sphere(lit(around()), QUICK, VOXEL, "cuda")
    assert np.median(seen(mesh)) < 0.03


@pytest.mark.usefixtures("open3d")
def test_a_fused_surface_moves_to_the_depth_of_the_views(backend: Backend):
    mesh, figures = refined(cube(HALF - 0.03), lit(around()), SHORT, backend.torch_device)
    assert np.median(seen(mesh)) < 0.015
    assert figures["moved_mm"]["median"] > 10


def test_the_same_seed_gives_the_same_bytes(backend: Backend, threads: Callable[[int], None]):
    views = lit(around())
    pixels, settings = VolumePixels(views, box_of(views)), QUICK.model_copy(update={"iterations": 5, "rays": 512})
    made = []
    for count in (1, 2):
        threads(count)
        field = VolumeField(Sphere(), settings, 0.1).to(backend.torch_device)
        fit_field(field, pixels, ErrorBounded(settings), settings, lambda done: tap_step(settings, done))
        made.append(field.state_dict())
    for name, values in made[0].items():
        np.testing.assert_array_equal(values.cpu().numpy(), made[1][name].cpu().numpy(), err_msg=name)


def test_what_cannot_be_fitted_is_one_line():
    views = lit(around())
    with pytest.raises(FiptError, match=r"1024 rays with 98 samples needs about .* GB; geometry.memory_gb is 0.5"):
        from_sphere(views, MonosdfGeometry(memory_gb=0.5), VOXEL, "cpu")
    black = [replace(view, radiance=np.zeros_like(view.radiance)) for view in views]
    with pytest.raises(FiptError, match="all pixels are black"):
        from_sphere(black, QUICK, VOXEL, "cpu")
    broken = np.arange(60)[:, None, None] % 2 == 0
    burnt = [replace(view, radiance=np.where(broken, np.nan, view.radiance)) for view in views]
    with pytest.raises(FiptError, match=r"must be finite; it is not at step 0 \(color\)"):
        from_sphere(burnt, QUICK, VOXEL, "cpu")
