"""What mirrors show of surface that no view shows."""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.model.reflectance import Brdf
from fipt.scene.mesh import Mesh
from fipt.stages.emitters.mirrors import shown_by_mirrors
from tests import scenes

SIZE = 12
BASE = 0.8


@pytest.fixture(scope="module")
def mirror_and_ceiling(backend) -> Mesh:
    """A mirror on the floor (triangles 0, 1), and a ceiling of small triangles 2 m above it, that faces down."""
    return scenes.joined(scenes.floor(1.0), scenes.sheet((-6, 2, -6), (12, 0, 0), (0, 0, 12), 60))


def model(metallic=1.0, roughness=0.05, base=BASE):
    """One material everywhere."""

    def query(points, *_):
        n = len(points)
        return Brdf(np.full((n, 3), base), np.full(n, roughness), np.full(n, metallic))

    return SimpleNamespace(
        settings=SimpleNamespace(footprint=1.0),
        place=lambda points, _: points,
        finest_at=lambda points: np.zeros(len(points)),
        query=query,
    )


def shown(mesh, radiance, material=None, normal=None, clipped=None) -> np.ndarray:
    """What a camera 1 m above the mirror sees in it, pixels being 5 cm apart; ``radiance`` (SIZE, SIZE) of each."""
    row, column = np.mgrid[:SIZE, :SIZE]
    place = np.stack([0.05 * (column.ravel() + 1), 0 * row.ravel(), 0.05 * (row.ravel() - SIZE / 2)], axis=1)
    normals = np.tile(np.float32([0, 1, 0]), (SIZE**2, 1)) if normal is None else normal
    samples = scenes.samples_of(
        place, shapes=[(SIZE, SIZE)], normal=normals, footprint=np.full(SIZE**2, 0.05, np.float32)
    )
    image = np.repeat(np.float32(radiance).reshape(-1, 1), 3, axis=1), np.ones(SIZE**2, np.float32)
    shards = scenes.observed([samples], [np.zeros((SIZE**2, 1, 3))], [image], None if clipped is None else [clipped])
    data = SimpleNamespace(camera=lambda _: SimpleNamespace(center=np.array([0.0, 1.0, 0.0])))
    return shown_by_mirrors(mesh, data, shards, material or model())


def at(mesh, x, z) -> int:
    """The ceiling's triangle above (x, z)."""
    return int(np.linalg.norm(mesh.corners.mean(axis=1) - (x, 2.0, z), axis=1).argmin())


def test_a_mirror_shows_what_lies_beyond(mirror_and_ceiling):
    radiance = np.full((SIZE, SIZE), 0.4)
    radiance[6, 5] = 4.0  # at x = 0.3, z = 0: three times as far away at the height of the ceiling
    result = shown(mirror_and_ceiling, radiance)
    assert result[at(mirror_and_ceiling, 0.9, 0.0)] == pytest.approx(4.0 / BASE)
    assert result[at(mirror_and_ceiling, 0.5, 0.3)] == pytest.approx(0.4 / BASE)
    assert np.isinf(result[at(mirror_and_ceiling, -1.0, 0.0)]), "behind the viewer"
    assert np.isinf(result[:2]).all(), "the mirror itself"
    centers = mirror_and_ceiling.corners.mean(axis=1)[np.isfinite(result)]
    # 10 x 10 inner pixels, and two widths of them, three times as far away
    np.testing.assert_allclose([centers[:, 0].min(), centers[:, 0].max()], [0.3 - 0.3, 1.65 + 0.3], atol=0.2)


def test_the_border_of_a_mirror_holds_what_is_beside_it(mirror_and_ceiling):
    radiance = np.full((SIZE, SIZE), 0.4)
    radiance[0], radiance[:, -1] = 50, 50
    result = shown(mirror_and_ceiling, radiance)
    assert result[np.isfinite(result)].max() == pytest.approx(0.4 / BASE)


@pytest.mark.parametrize(
    "material", [model(metallic=0.0), model(roughness=0.3), model(base=0.02)], ids=["paint", "rough", "dark"]
)
def test_what_is_no_mirror_shows_nothing(mirror_and_ceiling, material):
    assert np.isinf(shown(mirror_and_ceiling, np.ones((SIZE, SIZE)), material)).all()


def test_a_curved_mirror_shows_nothing(mirror_and_ceiling, np_rng):
    normal = np.float32([0, 1, 0]) + np_rng.normal(0, 0.1, (SIZE**2, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert np.isinf(shown(mirror_and_ceiling, np.ones((SIZE, SIZE)), normal=normal)).all()


def test_clipped_pixels_tell_nothing(mirror_and_ceiling):
    assert np.isinf(shown(mirror_and_ceiling, np.ones((SIZE, SIZE)), clipped=np.ones(SIZE**2, bool))).all()
