"""What mirrors show of surface that no view shows."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.model.reflectance import Brdf
from fipt.scene.mesh import Mesh
from fipt.stages.emitters import mirrors
from fipt.stages.emitters.mirrors import shown_by_mirrors
from tests import scenes

SIZE = 12
BASE = 0.8


@pytest.fixture(scope="module")
def mirror_and_ceiling(backend) -> Mesh:
    """A mirror on the floor (triangles 0, 1), and a ceiling of small triangles 2 m above it, that faces down."""
    return scenes.joined(scenes.floor(1.0), scenes.sheet((-6, 2, -6), (12, 0, 0), (0, 0, 12), 60))


def model(metallic=1.0, roughness=0.05, base=BASE, paint_at=None):
    """One material everywhere, but for paint around a place."""

    def query(points, *_):
        n = len(points)
        found = Brdf(np.full((n, 3), base), np.full(n, roughness), np.full(n, metallic))
        if paint_at is not None:
            found.metallic[np.linalg.norm(points - np.float32(paint_at), axis=1) < 0.06] = 0
        return found

    return SimpleNamespace(
        settings=SimpleNamespace(footprint=1.0),
        place=lambda points, _: points,
        finest_at=lambda points: np.zeros(len(points)),
        query=query,
    )


def view(radiance, normal=None, clipped=None, masked=None, views=("a",)):
    """A shard of views of the mirror, pixels being 5 cm apart; ``radiance`` (views * SIZE, SIZE) of each."""
    count = len(views)
    row, column = np.mgrid[:SIZE, :SIZE]
    place = np.stack([0.05 * (column.ravel() + 1), 0 * row.ravel(), 0.05 * (row.ravel() - SIZE / 2)], axis=1)
    pixels = count * SIZE**2
    normals = np.tile(np.float32([0, 1, 0]), (pixels, 1)) if normal is None else normal
    samples = scenes.samples_of(
        np.tile(place, (count, 1)),
        views=views,
        shapes=[(SIZE, SIZE)] * count,
        normal=normals,
        footprint=np.full(pixels, 0.05, np.float32),
    )
    weight = np.ones(pixels, np.float32) if masked is None else 1 - np.float32(masked).ravel()
    image = np.repeat(np.float32(radiance).reshape(-1, 1), 3, axis=1), weight
    above = [np.zeros(pixels, bool) if clipped is None else np.asarray(clipped).ravel()]
    return scenes.observed([samples], [np.zeros((pixels, 1, 3))], [image], above)


def shown(mesh, *shards, material=None, centers=((0.0, 1.0, 0.0),)) -> np.ndarray:
    """What cameras, the first 1 m above the mirror, see in it."""
    places = dict(zip("abc", centers, strict=False))
    data = SimpleNamespace(camera=lambda name: SimpleNamespace(center=np.array(places[name])))
    return shown_by_mirrors(mesh, data, [each for shard in shards for each in shard], material or model())


def at(mesh, x, z) -> int:
    """The ceiling's triangle above (x, z)."""
    return int(np.linalg.norm(mesh.corners.mean(axis=1) - (x, 2.0, z), axis=1).argmin())


def dark(lamp=0.4) -> np.ndarray:
    """(SIZE, SIZE) radiance of 0.4, and of a lamp at x = 0.3, z = 0: at x = 0.9 at the height of the ceiling."""
    radiance = np.full((SIZE, SIZE), 0.4)
    radiance[6, 5] = lamp
    return radiance


def test_a_mirror_shows_what_lies_beyond(mirror_and_ceiling):
    result = shown(mirror_and_ceiling, view(dark(4.0)))
    assert result[at(mirror_and_ceiling, 0.9, 0.0)] == pytest.approx(4.0 / BASE)
    assert result[at(mirror_and_ceiling, 1.4, 0.3)] == pytest.approx(0.4 / BASE)
    assert np.isinf(result[at(mirror_and_ceiling, -1.0, 0.0)]), "behind the viewer"
    assert np.isinf(result[:2]).all(), "the mirror itself"
    centers = mirror_and_ceiling.corners.mean(axis=1)[np.isfinite(result)]
    # 8 x 8 inner pixels, and two widths of them, three times as far away
    np.testing.assert_allclose([centers[:, 0].min(), centers[:, 0].max()], [0.45 - 0.3, 1.5 + 0.3], atol=0.2)


def test_the_brightest_of_all_views_counts(mirror_and_ceiling):
    """The second view of a shard, and one of another shard, by rays of their own cameras."""
    both = view(np.concatenate([dark(), dark(4.0)]), views=("a", "b"))
    centers = [(0.0, 1.0, 0.0), (-0.3, 1.0, 0.0), (0.0, 1.0, 0.6)]
    result = shown(mirror_and_ceiling, both, view(dark(8.0), views=("c",)), centers=centers)
    assert result[at(mirror_and_ceiling, 0.3 + 2 * 0.6, 0.0)] == pytest.approx(4.0 / BASE)
    assert result[at(mirror_and_ceiling, 0.9, -1.2)] == pytest.approx(8.0 / BASE)


def test_the_border_of_a_mirror_holds_what_is_beside_it(mirror_and_ceiling):
    radiance = dark()
    radiance[:2], radiance[:, -2:] = 50, 50
    result = shown(mirror_and_ceiling, view(radiance))
    assert result[np.isfinite(result)].max() == pytest.approx(0.4 / BASE)


LAMP = dark(1.0) > 0.5


@pytest.mark.parametrize(
    ("pixels", "material"),
    [({"clipped": LAMP}, None), ({"masked": LAMP}, None), ({}, model(paint_at=(0.3, 0, 0)))],
    ids=["clipped", "masked", "no metal"],
)
def test_what_a_mirror_does_not_tell_may_be_a_lamp(mirror_and_ceiling, pixels, material):
    """What is dark beside it says nothing of it."""
    result = shown(mirror_and_ceiling, view(dark(), **pixels), material=material)
    assert np.isinf(result[at(mirror_and_ceiling, 0.9, 0.0)])
    assert result[at(mirror_and_ceiling, 1.4, 0.3)] == pytest.approx(0.4 / BASE)


@pytest.mark.parametrize(
    "material", [model(metallic=0.0), model(roughness=0.3), model(base=0.02)], ids=["paint", "rough", "dark"]
)
def test_what_is_no_mirror_shows_nothing(mirror_and_ceiling, material):
    assert np.isinf(shown(mirror_and_ceiling, view(dark()), material=material)).all()


@pytest.mark.parametrize("width", [1, 4], ids=["noise", "facets"])
def test_a_curved_mirror_shows_nothing(mirror_and_ceiling, np_rng, width):
    bend = np.repeat(np_rng.normal(0, 0.1, (SIZE, SIZE // width, 3)), width, axis=1).reshape(-1, 3)
    normal = (np.float32([0, 1, 0]) + bend).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert np.isinf(shown(mirror_and_ceiling, view(dark(), normal=normal))).all()


def test_of_many_views_those_are_asked_that_show_most_of_mirrors(mirror_and_ceiling, monkeypatch):
    """The first view shows no metal; the second has room alone."""
    monkeypatch.setattr(mirrors, "_MOST", SIZE**2)
    monkeypatch.setattr(mirrors, "_FIRST", SIZE)
    asked = []
    whole = model()

    def query(points, *_):
        asked.append(len(points))
        found = whole.query(points)
        return replace(found, metallic=np.full(len(points), float(len(asked) != 1)))

    both = view(np.concatenate([dark(), dark(4.0)]), views=("a", "b"))
    material = SimpleNamespace(**(vars(whole) | {"query": query}))
    result = shown(mirror_and_ceiling, both, material=material, centers=[(0.0, 1.0, 0.0)] * 2)
    assert result[at(mirror_and_ceiling, 0.9, 0.0)] == pytest.approx(4.0 / BASE)
    assert asked == [SIZE // 2, SIZE // 2, SIZE**2]
