"""The driver that runs many rooms, clean and scanned."""

import json

import pytest

from benchmarks import rooms
from fipt.config.reading import load

KNOWN = {"office": None, "living_room": "/data/living_room/dataset"}


def test_the_configuration_is_one_that_the_workflow_takes(tmp_path):
    config = rooms.configuration(KNOWN, tmp_path, ["", "2cm", "3cm"])
    scenes = load(config).scenes
    suffixes = ("", "_no_ids", "_2cm", "_2cm_no_ids", "_3cm", "_3cm_no_ids")
    assert set(scenes) == {room + suffix for room in KNOWN for suffix in suffixes}
    assert scenes["office"].settings["synthesize"].room == "office"
    assert config["scenes"]["office_2cm"]["mesh"].endswith("scans/office_2cm.ply")
    assert scenes["office_3cm_no_ids"].settings["segment"].mode == "geometry"


def test_rooms_and_scans_come_before_what_needs_them(tmp_path):
    found = list(rooms.commands(KNOWN, tmp_path, ["", "2cm"]))
    names = [" ".join(command[1:4]) for _, command in found]
    assert names.index("run office dataset") < names.index("run office_2cm metrics")
    scans = [number for number, (file, _) in enumerate(found) if file is not None]
    assert len(scans) == len(KNOWN)
    assert max(scans) < min(number for number, name in enumerate(names) if name.endswith("metrics"))


def test_clean_rooms_are_left_out_where_only_scans_are_asked_for(tmp_path):
    names = [
        command[2] for _, command in rooms.commands({"office": None}, tmp_path, ["2cm"]) if command[-3] == "metrics"
    ]
    assert names == ["office_2cm", "office_2cm_no_ids"]


def test_the_table_has_flux_and_time(tmp_path, capsys, monkeypatch):
    folder = tmp_path / "results" / "office"
    for name in ("round-0", "round-1", "dataset", "benchmarks"):
        (folder / name).mkdir(parents=True)
    figures = {
        "kd_psnr": 25.04,
        "reflectance_psnr": None,
        "roughness_l1": 0.05,
        "metallic_l1": 0.01,
        "emission_iou": 1.0,
    }
    (folder / "metrics.json").write_text(json.dumps({"val": figures | {"render_psnr": 28.0}}))
    emitter = {"area": 2.0, "radiance": [1.0, 1.0, 1.0]}
    (folder / "dataset" / "room.json").write_text(json.dumps({"emitters": [emitter]}))
    (folder / "round-0" / "emitters.json").write_text(json.dumps({"emitters": [emitter, emitter]}))
    (folder / "round-1" / "emitters.json").write_text(json.dumps({"emitters": [emitter | {"area": 1.8}]}))
    (folder / "benchmarks" / "fit.jsonl").write_text('{"s": 60.0}\n{"s": 61.2}\n')
    (folder / "benchmarks" / "synthesize.train-000.jsonl").write_text('{"s": 500.0}\n')
    monkeypatch.setattr("sys.argv", ["rooms", "table", str(tmp_path)])
    assert rooms.main() == 0
    line = capsys.readouterr().out.splitlines()[2]
    assert line == (
        "| office | 25.0 / - | 0.050 / 0.010 | 1.00 | 0.90 | 28.0 | 1 min 1 s | `fipt run office metrics` |"
    )
    (folder / "dataset" / "room.json").unlink()
    assert rooms.flux_ratio(folder) is None


@pytest.mark.parametrize("quality", rooms.QUALITIES)
def test_qualities_are_voxel_and_noise(quality):
    voxel, noise = rooms.QUALITIES[quality]
    assert 0.01 <= voxel <= 0.05
    assert noise < voxel
