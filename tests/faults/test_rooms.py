"""New rooms, sheets of rooms, records of runs, lists of emitters, results of other programs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fipt.cli.main import main
from fipt.config import read
from fipt.errors import FiptError, unloadable
from fipt.formats.arrays import save_npz
from fipt.formats.exr import write_exr
from fipt.formats.video import write_mp4
from fipt.provenance import record
from fipt.scene.review import read_review
from fipt.stages.segment import given
from tests.fake_results import HEIGHT, WIDTH, write_results
from tests.faults.faults import contents, refused


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def dataset(folder: str) -> None:
    Path(folder).mkdir(parents=True)
    Path(folder, "transforms.json").write_text("{}")


def linked(count: int) -> None:
    """Folders of which each has links to all others: there are 986,409 ways through nine."""
    for place in range(count):
        Path(f"e/{place}").mkdir(parents=True)
        for other in range(count):
            Path(f"e/{place}/to{other}").symlink_to(f"../{other}")


CALLS: dict[str, tuple[Callable[[], object], tuple[str, ...], str]] = {
    "undo of nothing": (lambda: None, ("tidy", "ghost", "--undo"), "there is no folder results/ghost"),
    "a scene without a name": (lambda: None, ("verify", ""), "the name of a scene must not be empty"),
    "a path with braces": (lambda: None, ("init", "d", "--path", "a{b}"), "must hold no braces or control characters"),
    "a path with a line end": (lambda: None, ("init", "d", "--path", "a\nb"), "must hold no braces or control"),
    "one room and many": (lambda: dataset("e/x"), ("init", "d", "--scan", "e", "--name", "q"),
                          "--scan finds out what each room is; --name is of one room"),
    "folders that differ by case": (lambda: (dataset("e/a"), dataset("e/A")), ("init", "d", "--scan", "e"),
                                    "differ by case alone"),
    "a folder with braces": (lambda: dataset("e/{x}"), ("init", "d", "--scan", "e"), "must hold no braces"),
    "a folder with a tab": (lambda: dataset("e/a\tb"), ("init", "d", "--scan", "e"), "cannot stand in a sheet"),
    "a link that leads back": (lambda: (Path("e").mkdir(), Path("e/loop").symlink_to("../e")),
                               ("init", "d", "--scan", "e"), "e holds no capture, no dataset and no scene file"),
    "two links to each other": (lambda: (Path("e").mkdir(), *(Path("e", x).symlink_to(y) for x, y in ("ab", "ba"))),
                                ("init", "d", "--scan", "e"), "e holds no capture, no dataset and no scene file"),
    "nine folders with links to all others": (lambda: linked(9), ("init", "d", "--scan", "e"), "e holds no capture"),
    "a table that is a list": (lambda: (write_results(Path("x")), Path("t.json").write_text("[]")),
                               ("compare-page", "--table", "t.json", "--results", "x", "--out", "p.html"),
                               "t.json is not the table of a comparison"),
    "a table of nothing": (lambda: Path("t.json").write_text('{"rooms": []}'),
                           ("compare-page", "--table", "t.json", "--out", "p"),
                           "t.json is not the table of a comparison"),
}  # fmt: skip


def test_a_room_with_links_to_it_is_one_room() -> None:
    for room in ("e/room", "outside"):
        dataset(room)
    for link, room in (("a", "room"), ("z", "room"), ("far", "../outside"), ("twice", "../outside")):
        Path("e", link).symlink_to(room)
    assert main(["init", "d", "--scan", "e"]) == 0
    listed = [line.split("\t")[0] for line in Path("d/rooms.tsv").read_text().splitlines()]
    assert listed == ["name", "far", "room"]


@pytest.mark.parametrize("name", CALLS)
def test_a_call_that_cannot_be(name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    plant, argv, said = CALLS[name]
    plant()
    before = contents(tmp_path)
    assert said in refused(capsys, *argv)
    assert contents(tmp_path) == before


def test_a_room_is_called_as_it_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("true", "010", "room"):
        assert main(["init", name, "--name", name, "--path", "nowhere"]) == 0
        assert list(yaml.safe_load(Path(name, "config/config.yaml").read_text())["scenes"]) == [name]
    assert "warning: --path: nowhere is not there yet" in capsys.readouterr().err


SHEETS = {
    "a section and its key": ("name\tsource\tsettings\tsettings.fit.steps\na\tprocedural\t3\t4\n",
                              "line 2, column 3 (settings): '3' is no section, but column settings.fit.steps is in it"),
    "a name of a formula": ("name\tsource\n=1+1\tprocedural\n", "scene '=1+1' cannot be used as a file name"),
    "two bytes a letter": ("name\n".encode("utf-16"), "must be UTF-8 text"),
    "a comment for a head": ("#name\tsource\na\tprocedural\n", "has no room"),
    "a key of two dots": ("name\tsource\tsettings..steps\na\tprocedural\t4\n", "unknown key scenes.a.settings."),
    "no source": ("name\tpath\na\tx\n", "line 2: scenes.a.source is missing"),
}  # fmt: skip


@pytest.mark.parametrize("name", SHEETS)
def test_a_sheet_that_cannot_be(name: str) -> None:
    text, said = SHEETS[name]
    Path("config").mkdir()
    Path("config/config.yaml").write_text("scenes: rooms.tsv\n")
    Path("rooms.tsv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FiptError) as caught:
        read()
    assert said in str(caught.value)


def changed(key: str, value: object) -> Callable[[dict[str, Any]], object]:
    """Change what a record says of one file."""
    return lambda content: content["files"]["metrics.json"].update({key: value})


RECORDS: dict[str, Callable[[dict[str, Any]], object]] = {
    "a time in words": changed("mtime_ns", "z"),
    "a time beyond all clocks": changed("mtime_ns", 10**30),
    "a stage that is nothing": changed("stage", None),
    "a size that is nothing": changed("size", None),
    "a hash that is a number": changed("sha256", 3),
    "packages that are not there": lambda content: content.pop("packages"),
    "a machine in a list": lambda content: content.update(machine=[]),
    "a file outside": lambda content: content["files"].update({"../../x": content["files"]["metrics.json"]}),
    "a file of the system": lambda content: content["files"].update({"/etc/passwd": content["files"]["metrics.json"]}),
}


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_that_has_another_form(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = Path("results/x")
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text("{}")
    content = json.loads(record(folder, {}, []).read_text())
    RECORDS[name](content)
    (folder / "provenance.json").write_text(json.dumps(content))
    for more in ((), ("--crate",), ("--against", "x")):
        assert "results/x/provenance.json is not the provenance of a run" in refused(capsys, "verify", "x", *more)


def test_a_record_of_a_name_that_no_disk_has(capsys: pytest.CaptureFixture[str]) -> None:
    folder = Path("results/x")
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text("{}")
    content = json.loads(record(folder, {}, []).read_text())
    content["files"]["a" * 5000] = content["files"]["metrics.json"]
    (folder / "provenance.json").write_text(json.dumps(content))
    assert main(["verify", "x"]) == 1
    assert "aaa is missing" in capsys.readouterr().out


def test_an_emitter_of_ten_billion_triangles() -> None:
    """Such a set would take all memory, before anything else is said."""
    entry = {"emitter": "emitter-0", "triangles": "0-9999999999"}
    Path("r.yaml").write_text(yaml.safe_dump({"mesh_triangles": 10**30, "emitters": [entry]}))
    with pytest.raises(FiptError, match="an emitter must have fewer than 10000000 triangles; found '0-9999999999'"):
        read_review("r.yaml")


WHITE = np.ones((HEIGHT, WIDTH, 3), np.float32)
OTHERS: dict[str, tuple[dict[str, np.ndarray], dict[str, Any], str]] = {
    "of 8 bits": ({"albedo": (255 * WHITE).astype(np.uint8)}, {}, "reflectance must hold floats; found uint8"),
    "of 0 to 255": ({"albedo": 255 * WHITE}, {}, "reflectance must lie between 0 and 100; 144 values do not"),
    "below zero": ({"diffuse": -WHITE}, {}, "kd must lie between 0 and 100"),
    "light below zero": ({"emission": -WHITE}, {}, "emission must lie between 0 and any number"),
    "a roughness of 7": ({"roughness": 7 * WHITE[..., 0]}, {}, "roughness must lie between 0 and 1.01"),
    "arrays of other names": (
        {"ghost": WHITE},
        {},
        "must hold one of albedo, diffuse, roughness, emission, depth; it holds gh",
    ),
    "no folder": ({"albedo": WHITE}, {"path": None}, "import_results.path must name the folder"),
    "a setup without truth": ({"albedo": WHITE}, {"setup": "ghost"}, "names ghost, of which x/dataset has no truth"),
}


def import_results(settings: dict[str, Any]) -> tuple[str, ...]:
    values = json.dumps({"path": "their", "layout": "npz"} | settings)
    files = ("--dataset", "x/dataset", "--samples", "x/samples/train-000", "--out", "run", "--manifest", "run/m.json")
    return ("import-results", *files, "--scene", "x", "--settings", values)


@pytest.mark.parametrize("name", OTHERS)
def test_results_of_another_program_that_cannot_be(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    arrays, settings, said = OTHERS[name]
    write_results(Path("x"))
    Path("their").mkdir()
    for number in range(2):
        save_npz(Path(f"their/{number:06d}.npz"), **arrays)
    assert said in refused(capsys, *import_results(settings))
    assert not Path("run").exists()


def test_results_of_more_views_than_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    write_results(Path("x"))
    Path("their").mkdir()
    for number in range(3):
        save_npz(Path(f"their/{number:06d}.npz"), albedo=WHITE)
    assert main(list(import_results({}))) == 0
    assert "their/000002.npz: there are 2 views, so files from this one on are of none" in capsys.readouterr().err


def test_a_package_that_is_missing_or_broken() -> None:
    """One line; but a module of ours that is missing is a mistake of ours."""
    said = str(unloadable(ImportError("libGL.so.1: cannot open shared object file", name="open3d.cpu")))
    assert said.startswith("the package open3d cannot be loaded (libGL.so.1: cannot open shared object file)")
    assert "fipt doctor says what is missing" in said
    assert unloadable(ModuleNotFoundError("No module named 'fipt.ghost'", name="fipt.ghost")) is None


def test_no_ffmpeg_and_no_image(monkeypatch: pytest.MonkeyPatch) -> None:
    from fipt.formats import video
    from fipt.formats.images import write_png

    with pytest.raises(FiptError, match=r"frame-1\.png is not a readable image"):
        write_mp4("a.mp4", Path(), "frame-%d.png", 1, 24, 20)
    write_png(Path("frame-1.png"), np.zeros((4, 4), np.uint8))
    monkeypatch.setattr(video, "_program", lambda: "/nowhere/ffmpeg")
    with pytest.raises(FiptError, match=r"ffmpeg cannot be run: /nowhere/ffmpeg .No such file"):
        write_mp4("a.mp4", Path(), "frame-%d.png", 1, 24, 20)
    assert not Path("a.mp4").exists()


DAMAGED = {
    "figures that are cut": ("metrics.json", "{", "warning: results/x/metrics.json is not JSON"),
    "figures in a list": ("metrics.json", "[]", "warning: results/x/metrics.json must hold keys"),
    "a split in a list": ("metrics.json", '{"val": [1], "definitions": [2]}', ""),
    "findings of words": ("findings.json", '{"findings": ["a"]}', ""),
    "a time in words": ("stats/fit.json", '{"wall_s": "x", "peak_memory_bytes": []}', ""),
    "frames of words": ("dataset/transforms.json", '{"frames": ["a"]}', ""),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_an_index_goes_without_what_is_damaged(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    file, text, said = DAMAGED[name]
    path = Path("results/x", file)
    for folder in (path.parent, Path("results/x/logs")):
        folder.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    assert main(["index"]) == 0
    assert said in capsys.readouterr().err
    assert Path("results/index.html").is_file()


TABLES = {
    "an id of a fraction": ('[{"id": 1.7}]', "id 1.7: ids are whole numbers from 0 to 65535"),
    "an id that is true": ('[{"id": true}]', "id True: ids are whole numbers"),
    "one colour for two ids": ('[{"id": 1, "color": [1, 2, 3]}, {"id": 2, "color": [1, 2, 3]}]', "is there twice"),
    "one id for two colours": ('[{"id": 1, "color": [1, 2, 3]}, {"id": 1, "color": [3, 2, 1]}]', "id 1 is there twice"),
    "a class that is a number": ('[{"id": 1, "class": 3}]', "class 3: a name"),
    "a class that is a list": ('[{"id": 1, "class": ["a"]}]', "class ['a']: a name"),
    "a colour that is a word": ('[{"id": 1, "color": "red"}]', "color red: three numbers from 0 to 255"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_ids_that_cannot_be(name: str) -> None:
    text, said = TABLES[name]
    Path("table.json").write_text(text)
    with pytest.raises(FiptError) as caught:
        given._table_entries(Path("table.json"))
    assert "table.json is not a table of ids" in str(caught.value)
    assert said in str(caught.value)


def test_labels_of_words_and_ids_of_a_jpeg() -> None:
    from PIL import Image

    np.savez("l.npz", segment=np.array(["a", "b"]))
    with pytest.raises(FiptError, match=r"l\.npz: labels must be numbers; segment holds <U1"):
        given.triangle_labels(Path("l.npz"), "segment", 2)
    Image.new("L", (4, 4), 3).save("a.jpg")
    Path("a.jpg").rename("a.png")
    with pytest.raises(FiptError, match=r"a\.png must be a PNG; it holds JPEG, which may change ids"):
        given.read_id_image(Path("a.png"), None)


@pytest.mark.parametrize("option", ["--shard-view", "--samples", "--views"])
def test_an_option_that_means_nothing_for_a_file(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    write_exr("a.exr", {"": np.ones((4, 4, 3), np.float32)})
    assert f"{option} is for " in refused(capsys, "view", "a.exr", option, "x", "--out", "a.png")
    assert not Path("a.png").exists()
