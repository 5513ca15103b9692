"""Figures and findings of a capture: planted faults are found, sound views are let through."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.stages.capture import findings, inspection, qa, quality
from fipt.stages.capture.brackets import Bracket, Capture, judge, read_capture
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.raw import Shot
from tests import captures


def inspected(folder):
    qualities, unreadable = inspection.inspect(read_capture(folder))
    assert unreadable == []
    return qualities


def test_figures_of_a_sound_view(tmp_path):
    made = captures.write(tmp_path, views=1, calibration_frames=1)
    (quality,) = inspected(tmp_path)
    assert quality.view == "train_000"
    assert [frame.stops for frame in quality.frames] == [0, -2, -4, -6, -8]
    assert quality.frames[0].measured is None
    for frame in quality.frames[1:3]:
        assert frame.measured == pytest.approx(4, rel=0.01)
    # shot noise apart: read noise of 3 electrons of 40,000 in the longest, 8 stops to the shortest
    assert quality.dynamic_range == pytest.approx(np.log2(made.settings.full_well / 3) + 8, abs=0.5)
    assert quality.clipped == quality.noisy == quality.moved == 0
    assert quality.white_balance == pytest.approx((1 / 0.55, 1, 1 / 0.65), rel=1e-3)


def test_clipped_share_is_the_lamps(tmp_path):
    """The lamp has radiance 30; at half of that the shortest exposure is full."""
    made = captures.write(tmp_path, views=1, calibration_frames=1, white_radiance=15.0)
    (quality,) = inspected(tmp_path)
    assert quality.clipped == pytest.approx(float((made.truth("train_000")["saturated"] > 0.5).mean()), rel=0.2)
    assert quality.clipped > 0.005


def test_what_moves_is_found_in_its_view_only(tmp_path):
    captures.write(tmp_path, views=2, calibration_frames=1, ghosts=("train_000",))
    ghost, calm = inspected(tmp_path)
    assert ghost.moved > findings.MOVED_SHARE
    assert calm.moved == 0
    found = findings.check(read_capture(tmp_path), [], [ghost, calm])
    assert [(finding.kind, finding.views) for finding in found] == [("moved", ("train_000",))]


def test_wrong_shutter_times_are_measured(tmp_path):
    made = captures.write(tmp_path, views=1, calibration_frames=1, shutter_error=0.08)
    (quality,) = inspected(tmp_path)
    true = [exposure["seconds"] for exposure in reversed(made.camera_truth["exposures"])]
    for frame, longer, shorter in zip(quality.frames[1:3], true, true[1:], strict=False):
        assert frame.measured == pytest.approx(longer / shorter, rel=0.005)
    found = findings.check(read_capture(tmp_path), [], [quality])
    assert {(finding.kind, finding.views) for finding in found} == {("ratio", ("train_000",))}
    assert "capture.times to measured" in found[0].remedy


def test_sharpness_tells_blur_from_contrast(tmp_path):
    def blurred(camera):
        return gaussian_filter(captures.scene_image(camera), (4, 4, 0))

    def dimmed(camera):
        return 0.5 * captures.scene_image(camera)

    values = {}
    for name, scene in (("sharp", captures.scene_image), ("blurred", blurred), ("dimmed", dimmed)):
        captures.write(tmp_path / name, views=1, calibration_frames=1, scene=scene)
        (values[name],) = inspected(tmp_path / name)
    assert values["blurred"].sharpness < 0.6 * values["sharp"].sharpness
    assert values["dimmed"].sharpness == pytest.approx(values["sharp"].sharpness, rel=0.1)


# --- findings -------------------------------------------------------------------------------------


def shots(view, **changes):
    shot = Shot(Path(f"{view}.arw"), 0.1, 8.0, 100.0, 24.0, lens="FE 24", camera="A", time=0.0)
    return Bracket(view, "raw", (replace(shot, **changes),))


@pytest.mark.parametrize(
    ("change", "kind", "severity", "said"),
    [
        ({"focal_length": 35.0}, "focal-length", "error", "most photographs have 24 mm, but odd.arw 35 mm (view odd)"),
        ({"lens": "FE 35"}, "lens", "error", "most photographs have FE 24, but odd.arw FE 35"),
        ({"iso": 800.0}, "iso", "warning", "mixed ISO"),
        ({"aperture": 5.6}, "aperture", "warning", "but odd.arw f/5.6"),
    ],
)
def test_what_should_be_the_same(change, kind, severity, said):
    brackets = (shots("odd", **change), shots("a"), shots("b"))
    capture = Capture(Path("folder"), brackets, tuple(judge(brackets)))
    (finding,) = findings.check(capture)
    assert (capture.usual_shot.path.stem == "odd") == (severity != "error"), (
        "nothing is calibrated for a view that is left out"
    )
    assert (finding.kind, finding.severity, finding.views) == (kind, severity, ("odd",))
    assert said in finding.message
    assert finding.remedy
    brackets = (shots("a"), shots("b", **dict.fromkeys(change)))
    assert findings.check(Capture(Path("folder"), brackets, tuple(judge(brackets)))) == []


def figures(view, **changes):
    frames = (quality.BracketFrame("1.arw", 0.1, 0.0, None, None),)
    return replace(quality.Quality(view, frames, 0.0, 0.0, 20.0, 1.0, 0.0, (2.0, 1.0, 1.5)), **changes)


@pytest.mark.parametrize(
    ("change", "kind", "severity"),
    [
        ({"clipped": 0.02}, "clipped", "warning"),
        ({"noisy": 0.2}, "noise", "warning"),
        ({"moved": 0.01}, "moved", "warning"),
        ({"sharpness": 0.3}, "blurred", "warning"),
        ({"white_balance": (2.2, 1.0, 1.5)}, "white-balance", "note"),
    ],
)
def test_figures_become_findings(change, kind, severity):
    capture = Capture(Path("folder"), tuple(map(shots, "abc")), ())
    (finding,) = findings.check(capture, [], [figures("a"), figures("b"), figures("c", **change)])
    assert (finding.kind, finding.severity, finding.views) == (kind, severity, ("c",))
    assert "c" in finding.message
    assert findings.check(capture, [], [figures(view) for view in "abc"]) == []


# --- developed views ------------------------------------------------------------------------------


@pytest.fixture
def developed(tmp_path):
    """Two developed views and one that could not be developed."""
    for view, value in (("a", 2.0), ("b", 6.0)):
        facts = {
            "view": view,
            "exposures": [],
            "ratios": [],
            "shares": dict.fromkeys(("saturated", "noisy", "moved"), 0),
        }
        facts |= {"sharpness": 1.0, "scene_stops": 9.0, "camera": None}
        (tmp_path / f"{view}.json").write_text(json.dumps(facts))
        valid = np.ones((4, 6), np.float32)
        valid[0] = 0
        radiance = np.full((4, 6, 3), value, np.float32)
        radiance[0] = 1e6
        write_exr(tmp_path / "hdr" / f"{view}.exr", {"": radiance, "valid.Y": valid})
    (tmp_path / "c.json").write_text(json.dumps({"view": "c", "rejected": "c_2.arw is truncated"}))
    return tmp_path


def test_the_report_rejects_what_could_not_be_developed(developed):
    capture = Capture(developed, tuple(map(shots, "abcd")), ())
    found = qa.report(capture, developed, Calibration("raw", "A", 6, 4, absent=("no flat field",)))
    assert {view: state["accepted"] for view, state in found["views"].items()} == {"a": True, "b": True, "c": False}
    assert found["views"]["c"]["reason"] == "c_2.arw is truncated"
    assert found["views"]["a"]["dynamic_range"] == 9.0
    assert [(f["kind"], f["severity"]) for f in found["findings"]] == [("rejected", "error"), ("uncalibrated", "note")]
    # half of the pixels with weight have 2, half 6: their median becomes 0.2
    assert found["exposure"]["scale"] == pytest.approx(0.2 / 4.0)
    json.dumps(found, allow_nan=False)


def test_a_simulated_capture_states_its_unit(developed):
    (developed / "truth").mkdir()
    (developed / "truth" / "camera.json").write_text(json.dumps({"radiance_of_full_second": 0.125}))
    found = qa.report(Capture(developed, tuple(map(shots, "ab")), ()), developed, Calibration("raw", "A", 6, 4))
    assert found["exposure"]["scale"] == 0.125


def test_nothing_left(developed):
    with pytest.raises(FiptError, match="it holds none"):
        qa.report(Capture(developed, (shots("x"),), ()), developed, Calibration("raw", "A", 6, 4))
    with pytest.raises(FiptError, match=r"all views of .* are rejected: view c: c_2\.arw is truncated"):
        qa.report(Capture(developed, (shots("c"),), ()), developed, Calibration("raw", "A", 6, 4))
