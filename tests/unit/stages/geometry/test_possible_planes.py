"""Depth from beyond an edge, and planes that other views' radiance speaks against."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry import completion
from fipt.stages.geometry.borrowed_depth import borrowed
from fipt.stages.geometry.completion import complete
from fipt.stages.geometry.depth_views import DepthNoise, DepthView
from fipt.stages.geometry.patch_match import REACH
from fipt.stages.geometry.photo_consistency import Radiances
from fipt.stages.geometry.possible_planes import alike, probes_of
from fipt.stages.geometry.room_box import RoomBox
from fipt.stages.geometry.superpixels import superpixels
from tests.unit.stages.geometry.test_fusing import HALF, around
from tests.unit.stages.geometry.test_planes import NOISE, TABLE, above_a_table, painted

ANGLES = np.arange(6.0)


def top_of(view: DepthView) -> np.ndarray:
    """(H, W) bool: pixels of the table."""
    found: np.ndarray = np.abs(view.points[..., 1] - TABLE) < 1e-3
    return found


def with_table(view: DepthView) -> DepthView:
    """Painted, and the table of another grey than the floor."""
    grey = painted(view)
    radiance = np.where(top_of(view)[..., None], np.float32(0.15), grey.radiance)
    return replace(grey, radiance=radiance.astype(np.float32))


def with_rim(angle: float) -> tuple[DepthView, DepthView]:
    """A view of a bare floor whose pixels beside the table have the table's height, as stereo's windows make it; and
    with its true depth.
    """
    true = with_table(above_a_table(angle, 1.0))
    top = top_of(true)
    rim = binary_dilation(top, np.ones((2 * REACH + 1,) * 2)) & ~top
    height = (TABLE - true.camera.center[1]) / true.rays[..., 1]
    depth = np.where(rim, height, true.map.depth).astype(np.float32)
    view = true.with_map(DepthMap(depth, true.map.confidence, true.map.normal))
    floor = ~top & (true.map.normal[..., 1] > 0.9)
    return view.without(floor & ~rim), true


def test_the_border_of_a_bare_segment_is_borrowed():
    view, true = with_rim(0.3)
    floor = ~top_of(true) & (true.map.normal[..., 1] > 0.9)
    pieces = superpixels(view.radiance)
    found = borrowed(view, pieces)
    assert found[floor & view.map.known].mean() > 0.6  # of the rest, edges have made segments
    assert not found[top_of(true)].any()
    assert not borrowed(true, pieces).any()  # a floor that is known inside, too, has its own depth


def off_floor(views: list[tuple[DepthView, DepthView]]) -> float:
    """Share of the floor's pixels, of views and their truth among others, whose completed depth is off by 5 cm."""
    others = [*map(with_table, around(NOISE)), *(with_table(above_a_table(angle, 0.2)) for angle in ANGLES)]
    done = complete([*others, *(view for view, _ in views)], DepthNoise(NOISE, 0.0)).views[len(others) :]
    off = []
    for (_, true), completed in zip(views, done, strict=True):
        floor = ~top_of(true) & (true.map.normal[..., 1] > 0.9)
        off.append(np.abs(completed.view.map.depth - true.map.depth)[floor] > 0.05)
    return float(np.concatenate(off).mean())


def test_a_bare_floor_does_not_take_the_height_of_the_table_beside_it(monkeypatch: pytest.MonkeyPatch):
    views = [with_rim(angle + 0.5) for angle in ANGLES[:3]]
    good = off_floor(views)
    monkeypatch.setattr(completion, "borrowed", lambda view, _: np.zeros(view.map.depth.shape, bool))
    monkeypatch.setattr(completion, "alike", lambda *a: np.ones((len(a[3]), len(a[2])), bool))
    bad = off_floor(views)
    assert good < 0.3 < 0.5 < bad  # what is left lies along the table's edge


def test_views_agree_on_places_that_surface_has():
    views = [with_table(view) for view in [*around(), *(above_a_table(angle, 1.0) for angle in ANGLES)]]
    radiances, number = Radiances.of(views), len(around())
    view = views[number]
    row, column = (part[::7] for part in np.nonzero(top_of(view)))
    heights = np.array([TABLE, 0.01 - HALF])
    slopes = np.array([0.0, 1.0, 0.0]) / (heights - view.camera.center[1])[:, None]
    agree, show = radiances.agreement(number, row, column, slopes)
    assert (show[:, 0] > 2).all()
    assert (agree / show)[:, 0].mean() > 0.9
    assert (agree / np.maximum(show, 1))[:, 1].mean() < 0.7  # there, some see the floor
    assert radiances.tolerance == pytest.approx(0.15)  # nothing differs, but for what is assumed


def test_masked_pixels_say_nothing():
    views = [with_table(view) for view in around()]
    masked = [views[0], *(replace(view, radiance=np.zeros_like(view.radiance)) for view in views[1:])]
    radiances = Radiances.of(masked)
    row, column = (part[::50] for part in np.nonzero(views[0].map.known))
    agree, show = radiances.agreement(0, row, column, np.array([[0.0, 0.0, -1 / HALF]]))
    assert not show.any()
    assert not agree.any()
    assert Radiances.of(views).agreement(0, row, column, np.array([[0.0, 0.0, -1 / HALF]]))[1].any()


def test_radiance_speaks_against_planes_that_surface_has_not():
    views = [with_table(view) for view in [*around(), *(above_a_table(angle, 1.0) for angle in ANGLES)]]
    half, view, number = np.full(3, HALF), views[-1], len(views) - 1
    box = RoomBox(np.eye(3), -half, half, np.array([-half, half]))
    pieces = superpixels(view.radiance)
    slopes = np.array([0.0, 1.0, 0.0]) / (np.array([TABLE, 1e-6 - HALF]) - view.camera.center[1])[:, None]
    found = alike(Radiances.of(views), number, slopes, probes_of(pieces), box)
    share = np.bincount(pieces.label.ravel(), top_of(view).ravel()) / np.bincount(pieces.label.ravel())
    on_table = found[share > 0.9].mean(axis=0)
    assert on_table[0] > 0.95
    assert on_table[1] < 0.7  # what lies far from its edge looks the same from everywhere
    assert not alike(Radiances.of(views), number, slopes[:0], probes_of(pieces), box).size
