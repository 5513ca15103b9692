import pytest

from fipt.config import read
from fipt.config.new import SOURCES, NewRoom, write_config
from fipt.errors import FiptError


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_has_a_configuration_that_holds(source, tmp_path, monkeypatch):
    file = write_config(tmp_path / "attic", NewRoom(source=source, name="attic"))
    assert file == tmp_path / "attic" / "config" / "config.yaml"
    assert "$" not in file.read_text()
    monkeypatch.chdir(tmp_path / "attic")
    assert list(read().scenes) == ["attic"]


def test_paths_are_relative_to_the_folder_or_absolute(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inside, outside = tmp_path / "attic" / "RAW files", tmp_path / "scan: 1.ply"
    room = NewRoom(name="attic", path=inside.relative_to(tmp_path), mesh=outside, poses="poses.json")
    write_config(tmp_path / "attic", room)
    monkeypatch.chdir(tmp_path / "attic")
    source = read().scenes["attic"].source
    assert source.photographs.folder == "RAW files"
    options = source.import_options()
    assert options[options.index("--mesh") + 1] == str(outside)
    assert options[options.index("--poses") + 1] == str(tmp_path / "poses.json")


def test_a_dataset_with_a_mesh_of_its_own(tmp_path, monkeypatch):
    write_config(tmp_path, NewRoom(source="dataset", name="attic", mesh=tmp_path / "scan.ply", format="fipt-real"))
    monkeypatch.chdir(tmp_path)
    assert read().scenes["attic"].source.entry.mesh == "scan.ply"
    assert read().scenes["attic"].source.entry.format == "fipt-real"


@pytest.mark.parametrize(
    ("room", "said"),
    [
        (NewRoom(name="a/b"), "scene 'a/b' cannot be used"),
        (NewRoom(source="movie"), "there is no source 'movie'; sources: raw, dataset, mitsuba, procedural"),
        (NewRoom(source="procedural", path="x"), "--path is only for source raw or dataset or mitsuba"),
        (NewRoom(source="mitsuba", mesh="x"), "--mesh is only for source raw or dataset; source is mitsuba"),
        (NewRoom(source="dataset", poses="p.json"), "--poses is only for source raw; source is dataset; omit --poses"),
        (NewRoom(source="procedural", poses="colmap"), "--poses is only for source raw; source is procedural"),
        (NewRoom(format="fipt-real"), "--format is only for source dataset; source is raw; omit --format"),
        (NewRoom(source="dataset", format="obj"), "scenes.room.format: input should be 'nerfstudio'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(room, said, tmp_path):
    with pytest.raises(FiptError) as caught:
        write_config(tmp_path, room)
    assert said in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten(tmp_path):
    file = write_config(tmp_path, NewRoom())
    file.write_text("mine")
    with pytest.raises(FiptError, match="exists already"):
        write_config(tmp_path, NewRoom())
    assert file.read_text() == "mine"
