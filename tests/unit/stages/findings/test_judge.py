"""All checks together: order, and causes that explain other findings."""

from types import SimpleNamespace

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings import judge
from fipt.stages.findings.settings import FindingsSettings


def _check(*keys, severity="warning"):
    def check(room, notes):
        found = []
        for key in keys:
            notes.judge(key, Measure(key, 1.0, 0.1))
            found.append(RoomFinding(key, severity, "C.", Measure(key, 1.0, 0.1), "R."))
        return found

    return check


def _judged(monkeypatch, *checks):
    monkeypatch.setattr(judge, "CHECKS", checks)
    found, notes = judge.judged(SimpleNamespace(settings=FindingsSettings()))
    return [finding.id for finding in found], set(notes.measures)


def test_serious_ones_stand_first(monkeypatch):
    found, measured = _judged(monkeypatch, _check("a"), _check("b", severity="serious"), _check("c"))
    assert found == ["b", "a", "c"]
    assert measured == {"a", "b", "c"}


def test_a_cause_hides_what_it_explains(monkeypatch):
    found, measured = _judged(monkeypatch, _check("no-emitter"), _check("edges-off", "holes"))
    assert found == ["no-emitter", "holes"]
    assert "edges-off" in measured


def test_light_that_still_changes_hides_what_is_off_with_it(monkeypatch):
    found, _ = _judged(monkeypatch, _check("not-settled"), _check("edges-off", "exposure", "view-unlike", "noisy-mesh"))
    assert found == ["not-settled", "noisy-mesh"]


def test_a_mesh_that_is_aside_hides_that_edges_are_off(monkeypatch):
    found, measured = _judged(monkeypatch, _check("mesh-misplaced"), _check("edges-off", "rerendering"))
    assert found == ["mesh-misplaced", "rerendering"]
    assert "edges-off" in measured
