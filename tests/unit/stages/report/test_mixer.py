"""The light mixer's numbers: which parts there are, and how their pictures are packed."""

import base64
import json
import zlib

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.files import write_text
from fipt.formats.manifests import write_manifest
from fipt.scene.emitters import default_name
from fipt.stages.report.content import gather
from fipt.stages.report.mixer import _scaled, encoded
from fipt.stages.report.selection import Selection
from fipt.stages.report.settings import ReportSettings
from tests.fake_results import HEIGHT, WIDTH, olat_layers, write_olat, write_results


@pytest.fixture
def results(tmp_path):
    root = write_results(tmp_path / "scene")
    write_olat(root)
    return root


def decoded(text, *shape):
    data = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(2, -1)
    return np.ascontiguousarray(data.T).view("<f2").reshape(shape).astype(np.float32)


def test_layers_are_half_floats_at_the_pages_exposure(results):
    content = gather(results, ReportSettings())
    (view,) = content.mixer.views
    assert (view.name, view.width, view.height) == ("c", WIDTH, HEIGHT)
    planes = decoded(view.data, 3, 3, HEIGHT, WIDTH)
    expected = np.stack([layer * content.exposure for layer in olat_layers().values()]).transpose(0, 3, 1, 2)
    np.testing.assert_allclose(planes, expected, rtol=2**-11, atol=2**-24)


def test_parts_name_their_emitters(results):
    first, second, third = map(default_name, range(3))
    parts = gather(results, ReportSettings()).mixer.parts
    assert [(part.key, part.label, list(part.emitters)) for part in parts] == [
        (first, first, [first]),
        ("rest", "The other 2 lamps", [second, third]),
        ("outside", "Light from outside", []),
    ]
    # only a lamp of one colour, with light in every channel, can be given another
    assert [part.radiance for part in parts] == [[4, 4, 2], None, None]
    path = results / "round-1" / "emitters.json"
    content = json.loads(path.read_text())
    content["emitters"][0]["radiance"] = [4, 0, 2]
    write_text(path, json.dumps(content))
    assert gather(results, ReportSettings()).mixer.parts[0].radiance is None


def test_no_lamps_no_mixer(tmp_path):
    root = write_results(tmp_path / "scene")
    assert gather(root, ReportSettings()).mixer is None
    write_manifest(root / "olat.val-000.manifest.json", "olat", [], {})  # a room without any light
    assert gather(root, ReportSettings()).mixer is None


def test_lamps_of_another_run_are_not_mixed(results, caplog):
    path = results / "olat" / "c.exr"
    write_exr(path, {default_name(7): olat_layers()["rest"]})
    assert gather(results, ReportSettings()).mixer is None
    assert "c.exr shows other lamps than there are" in caplog.text
    path.unlink()
    with pytest.raises(FiptError, match=r"c\.exr"):
        gather(results, ReportSettings())


def test_views_of_an_earlier_plan_are_not_mixed(results):
    old = results / "olat" / "d.exr"
    write_exr(old, olat_layers())
    write_manifest(results / "olat.val-001.manifest.json", "olat", [old], {})
    mixer = gather(results, ReportSettings(), Selection(olat_shards=["val-000"])).mixer
    assert [view.name for view in mixer.views] == ["c"]
    assert gather(results, ReportSettings(), Selection(olat_shards=[])).mixer is None
    assert len(gather(results, ReportSettings()).mixer.views) == 2  # by hand nobody says what the plan is


def test_wide_pictures_are_averaged_down():
    picture = np.zeros((4, 800, 3), np.float32)
    picture[:, ::2] = [2, 4, 6]
    np.testing.assert_allclose(_scaled(picture), np.broadcast_to([1, 2, 3], (2, 400, 3)), rtol=1e-6)


def test_extremes_stay_finite():
    planes = decoded(encoded(np.array([[[[1e9, np.nan, -1.0]]]])), 1, 3, 1, 1)
    np.testing.assert_array_equal(planes.ravel(), [65504, 0, 0])
