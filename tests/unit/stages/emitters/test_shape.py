"""The shape of emitters: triangles at their edge, by half of the step of radiance there."""

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.stages.emitters.regions import PIXELS, Surface
from fipt.stages.emitters.shape import shaped
from tests import scenes

LAMP, WALL = 0, 1
COUNT = 24
"""Cells of a strip of squares, a pixel wide each; two triangles a cell."""


def strip(radiance):
    """A strip of cells of some radiance (COUNT,), and what views show of it: the first half of it is the lamp."""
    mesh = scenes.joined(*(scenes.quad((x, 0, 0), (1, 0, 0), (0, 1, 0)) for x in range(COUNT)))
    of_cell = np.repeat(np.arange(COUNT), 2)
    samples = scenes.samples_of(mesh.corners.mean(axis=1), np.arange(2 * COUNT), footprint=np.ones(2 * COUNT))
    image = np.repeat(np.float32(radiance)[of_cell][:, None], 3, axis=1)
    shading = np.zeros((2 * COUNT, SHADING_OUTPUTS, 3), np.float16)
    shards = scenes.observed([samples], [shading], [(image, np.ones(2 * COUNT, np.float32))])
    region = np.where(of_cell < COUNT // 2, LAMP, WALL)
    surface = Surface(
        radiance=image,
        pixels=np.full(2 * COUNT, PIXELS),
        width=np.ones(2 * COUNT),
        part=np.zeros(2 * COUNT, np.int64),
        region=region,
        touching=np.array([[LAMP], [WALL]]),
        dark=0.0,
    )
    return mesh, surface, shards


def emitting_cells(radiance):
    mesh, surface, shards = strip(radiance)
    found = shaped(mesh, surface, np.array([True, False]), shards)
    assert set(found) <= {LAMP, -1}
    return np.unique(np.flatnonzero(found == LAMP) // 2).tolist()


def steps(**changed):
    """A lamp of 10 beside a wall of 1; cells ``at_N`` have other radiance."""
    radiance = np.where(np.arange(COUNT) < COUNT // 2, 10.0, 1.0)
    for name, value in changed.items():
        radiance[int(name.removeprefix("at_"))] = value
    return radiance


@pytest.mark.parametrize(("edge", "cells"), [(5.0, 12), (6.0, 13)])
def test_a_triangle_at_the_edge_belongs_to_the_lamp_from_half_of_the_step(backend, edge, cells):
    assert emitting_cells(steps(at_12=edge)) == list(range(cells))


@pytest.mark.parametrize("around", [10.2, 9.99, 9.6])
def test_what_is_as_bright_as_the_lamp_is_not_its_surroundings(backend, around):
    """A globe in the air has little around it; one triangle as bright, of another region, made half of it dark."""
    radiance = steps()
    radiance[: COUNT // 2 : 2], radiance[1 : COUNT // 2 : 2] = 9.8, 10.2
    radiance[COUNT // 2 :] = around
    assert set(range(COUNT // 2)) <= set(emitting_cells(radiance))


def test_a_dim_lamp_has_an_edge_too(backend):
    """Half of the step from 10 to 7 is at 8.5."""
    radiance = steps()
    radiance[COUNT // 2 :] = 7.0
    radiance[COUNT // 2] = 8.4
    assert emitting_cells(radiance) == list(range(COUNT // 2))


def test_an_uneven_lamp_has_an_edge_too(backend):
    """As a lampshade: its own values differ by more than the wall does from it."""
    radiance = steps()
    radiance[: COUNT // 2] = np.resize([7.5, 10.0, 12.5], COUNT // 2)
    radiance[COUNT // 2 :] = 4.5
    radiance[COUNT // 2] = 7.0  # half of the step from 10 to 4.5 is at 7.25
    assert emitting_cells(radiance) == list(range(COUNT // 2))
