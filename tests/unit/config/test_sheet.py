"""A sheet of rooms in place of the mapping of scenes."""

import pytest

from fipt.config import read
from fipt.config.scan import write_rooms
from fipt.errors import FiptError

HEAD = "name\tsource\tpath\tformat\tpreset\tsettings.fit.steps\tsettings.segment.mode\n"


def sheet(folder, text, *, encoding="utf-8"):
    (folder / "config").mkdir(exist_ok=True)
    (folder / "config" / "config.yaml").write_text("scenes: rooms.tsv\nrounds: 1\nfit: {batch: 77}\n")
    (folder / "rooms.tsv").write_bytes(text.encode(encoding))


def test_a_line_is_a_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sheet(tmp_path, f"{HEAD}attic\tprocedural\t\t\tdemo\t7\tnone\n# not this one\n\n2024\tdataset\t2024\tfipt\n")
    read_rooms = read()
    assert list(read_rooms.scenes) == ["attic", "2024"]
    attic, other = read_rooms.scenes.values()
    assert (attic.settings["fit"].steps, attic.settings["fit"].batch) == (7, 77)
    assert attic.settings["segment"].mode == "none"
    assert other.source.path == "2024"
    assert other.settings["fit"].steps != 7
    assert read_rooms.plain["scenes"]["attic"]["settings"] == {"fit": {"steps": 7}, "segment": {"mode": "none"}}


def test_marks_and_line_ends_of_other_programs_change_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = f"{HEAD}attic\tprocedural\t\t\tdemo\t7\t\nhall\tprocedural\n"
    sheet(tmp_path, text)
    plain = read().plain
    sheet(tmp_path, text.replace("\n", "\r\n"), encoding="utf-8-sig")
    assert read().plain == plain


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name\tsource\n", "rooms.tsv has no room"),
        ("room\tsource\na\traw\n", "rooms.tsv, line 1: the first column must be 'name'; found 'room'"),
        ("name\tsource\tcolour\na\traw\tred\n", "line 1, column 3: there is no key 'colour' of a scene"),
        ("name\tsource\tsource\na\traw\traw\n", "line 1, column 3: 'source' is there again"),
        ("name\tsource\na\tprocedural\n\na\tprocedural\n", "line 4: the room 'a' of line 2 is there again"),
        ("name\tsource\na/b\tprocedural\n", "line 2, column 1 (name): scene 'a/b' cannot be used as a file name"),
        ("name\tsource\na\tprocedural\tx\n", "line 2: 3 cells in 2 columns"),
        ("name\tsource\na\tmovie\n", "line 2, column 2 (source): scenes.a.source: input should be"),
        ("name\tsource\na\traw\n", "line 2: scenes.a.path is missing"),
        (HEAD + "a\tprocedural\t\t\t\tmany\n", "line 2, column 6 (settings.fit.steps): scenes.a.settings.fit.steps"),
        (HEAD + "a\tprocedural\t\t\tbig\n", "line 2, column 5 (preset): scenes.a.preset: there is no preset 'big'"),
        (HEAD + "a\tprocedural\t\t\t\t[1\n", "line 2, column 6 (settings.fit.steps): '[1' is not YAML"),
        ("name\tsource\tsettings.fit.stepz\na\tprocedural\t3\n", "column 3 (settings.fit.stepz): unknown key"),
    ],
)
def test_what_cannot_be_is_told_with_its_place(text, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sheet(tmp_path, text)
    with pytest.raises(FiptError) as caught:
        read()
    assert said in str(caught.value)


def test_a_missing_folder_is_told_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sheet(tmp_path, HEAD + "a\tprocedural\nb\tdataset\tnowhere\tnerfstudio\n")
    with pytest.raises(FiptError, match=r"rooms.tsv, line 3, column 3 \(path\)|rooms.tsv, line 3: .*nowhere"):
        read().check(read=True)
    assert read(overrides=["only=a"]).only == ("a",)


def test_text_of_two_bytes_a_letter_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sheet(tmp_path, HEAD + "a\tprocedural\n", encoding="utf-16")
    with pytest.raises(FiptError, match="must be UTF-8"):
        read()


def test_a_folder_of_rooms_becomes_a_sheet(tmp_path, monkeypatch):
    rooms = tmp_path / "rooms"
    for file in ("a b/hall/shot.DNG", "kitchen/transforms.json", "old/cam.txt", "old/K_list.txt", "xml/scene.xml"):
        (rooms / file).parent.mkdir(parents=True, exist_ok=True)
        (rooms / file).touch()
    (rooms / "notes").mkdir()
    (rooms / "notes" / "plan.png").touch()
    names = write_rooms(tmp_path, rooms)
    assert names == ["a_b-hall", "kitchen", "old", "xml"]
    monkeypatch.chdir(tmp_path)
    scenes = read().scenes
    assert scenes["a_b-hall"].source.photographs.folder == "rooms/a b/hall"
    assert [scene.said["source"] for scene in scenes.values()] == ["raw", "dataset", "dataset", "mitsuba"]
    assert scenes["old"].said["format"] == "fipt-real"
    with pytest.raises(FiptError, match=r"rooms.tsv exists already"):
        write_rooms(tmp_path, rooms)


def test_a_folder_without_rooms_is_told(tmp_path):
    with pytest.raises(FiptError, match="holds no capture"):
        write_rooms(tmp_path, tmp_path)
    assert not list(tmp_path.iterdir())
