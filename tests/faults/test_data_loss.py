"""What a run reads is never cleared: each of these lost data, or could have."""

import json
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fipt.cli.main import main
from fipt.config import read
from fipt.config.documentation import SCHEMA
from fipt.config.kept import PATHS, check_kept
from fipt.errors import FiptError
from fipt.formats.images import write_png
from fipt.formats.manifests import write_manifest
from tests.faults.faults import Fault, contents, named, refused
from tests.layouts import room, write_nerfstudio, write_obj
from tests.unit.stages.geometry.test_depth import camera
from tests.unit.stages.geometry.test_stage import write_dataset
from tests.workflow.conftest import Workspace


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def configure(path: str, source: str = "dataset", **keys: Any) -> None:
    """Write a configuration whose scene x reads ``path``."""
    formats = {"dataset": {"format": "nerfstudio"}, "raw": {"poses": "colmap", "mesh": "mesh.ply"}}
    scene = {"source": source, "path": path, **formats[source], **keys.pop("scene", {})}
    Path("config").mkdir(exist_ok=True)
    Path("config/config.yaml").write_text(yaml.safe_dump({"scenes": {"x": scene}, "rounds": 0, **keys}))


def configured(scenes: Any) -> None:
    """Write a configuration of these scenes."""
    Path("config").mkdir(exist_ok=True)
    Path("config/config.yaml").write_text(yaml.safe_dump({"scenes": scenes}))


def link(place: str, target: str) -> None:
    """Make a link, and the folder that it lies in."""
    Path(place).parent.mkdir(parents=True, exist_ok=True)
    Path(place).symlink_to(Path(target).resolve())


def planned_in(place: str, path: str, **keys: Any) -> None:
    """A source in a place, and a configuration that names it as ``path``."""
    write_nerfstudio(Path(place))
    configure(path, **keys)


def linked(place: str, target: str, path: str, **keys: Any) -> None:
    """A source in src, a link, and a configuration."""
    write_nerfstudio(Path("src"))
    link(place, target)
    configure(path, **keys)


def photographs(folder: str) -> None:
    Path(folder).mkdir(parents=True)
    Path(folder, "a.dng").write_bytes(b"raw")
    configure(folder, "raw")


def images_elsewhere() -> None:
    """The source lies outside, its images are links into the results."""
    write_nerfstudio(Path("src"))
    Path("results/x").mkdir(parents=True)
    shutil.move("src/images", "results/x/kept")
    link("src/images", "results/x/kept")
    configure("src")


def named_elsewhere() -> None:
    """transforms.json names images in the results."""
    write_nerfstudio(Path("src"))
    Path("results/x").mkdir(parents=True)
    shutil.move("src/images", "results/x/kept")
    text = Path("src/transforms.json").read_text().replace('"images/', '"../results/x/kept/')
    Path("src/transforms.json").write_text(text)
    configure("src")


def nobody_named() -> None:
    """A source where the dataset of a room in code would go."""
    write_nerfstudio(Path("results/x/dataset"))
    configured({"x": {"source": "procedural"}})


def nobody_named_after_a_run() -> None:
    """It was put there when a run had left its logs."""
    for trace in ("logs", "stats"):
        Path("results/x", trace).mkdir(parents=True)
    Path("results/x/.lock").touch()
    nobody_named()


def other_scene() -> None:
    """Scene y reads what scene x would clear, and no run made it."""
    write_nerfstudio(Path("results/x/dataset"))
    Path("results/x/logs").mkdir()
    Path("results/x/stats").mkdir()
    other = {"source": "dataset", "format": "nerfstudio", "path": "results/x/dataset"}
    configured({"x": {"source": "procedural"}, "y": other})


def with_key(key: str, value: Any, place: str) -> None:
    """A file in the results that another key names."""
    write_nerfstudio(Path("src"))
    file = Path(place)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.mkdir() if not file.suffix else file.write_text("mine")
    configure("src", **{key: value})


def sheet_in_results() -> None:
    """The table of rooms lies in the results of one."""
    configured("results/x/rooms.tsv")
    Path("results/x").mkdir(parents=True)
    Path("results/x/rooms.tsv").write_text("name\tsource\nx\tprocedural\n")


def others_below(path: str, scene: str = "x") -> None:
    """Outputs of another program lie in the results of a scene, deep below the folder that is named."""
    write_nerfstudio(Path("src"))
    folder = Path(path, "brdf/m/x")
    if path == "others":
        link(str(folder), "results/x/theirs")
    Path("results", scene, "theirs" if path == "others" else "m/x").mkdir(parents=True)
    settings = {"import_results": {"path": path, "method": "m", "scene": "x"}}
    Path("config").mkdir(exist_ok=True)
    source = {"source": "dataset", "path": "src", "format": "nerfstudio"}
    text = yaml.safe_dump({"scenes": {scene: source}, "methods": {"other": OTHER | {"settings": settings}}})
    Path("config/config.yaml").write_text(text)


HERE = "results/x/dataset"
OTHER = {"label": "o", "kind": "imported", "estimator": "imported", "source": "s",
         "settings": {"import_results": {"path": "results/x/others"}}}  # fmt: skip
IN_RESULTS = "lies in results/x"
THROUGH = "through the link"
IDS = np.ones((2, 3), np.uint16)
PLANNED = [
    Fault("path", lambda: planned_in("results/x/dataset", "results/x/dataset"), IN_RESULTS),
    Fault("path of the file", lambda: planned_in("results/x/dataset", "results/x/dataset/transforms.json"), IN_RESULTS),
    Fault("absolute path", lambda: planned_in(HERE, str(Path(HERE).resolve())), IN_RESULTS),
    Fault("dots", lambda: planned_in("results/x/dataset", "config/../results/x/./dataset/"), IN_RESULTS),
    Fault("data_root", lambda: planned_in(HERE, "{data_root}/x/dataset", data_root="results"), IN_RESULTS),
    Fault("another folder of the results", lambda: planned_in("results/x/mine", "results/x/mine"), IN_RESULTS),
    Fault("link of the dataset", lambda: linked(HERE, "src", "src"), "through the link results/x/dataset"),
    Fault("link named as path", lambda: linked("results/x/dataset", "src", "results/x/dataset"), THROUGH),
    Fault("link of the scene", lambda: linked("results/x", "src", "src"), IN_RESULTS),
    Fault("link of a folder above", lambda: linked("results/x/dataset", ".", "src"), THROUGH),
    Fault("link of the mesh", lambda: linked("results/x/dataset/mesh.ply", "src/mesh.ply", "src"), THROUGH),
    Fault("link to the results", lambda: (planned_in("results/x/dataset", "way"), link("way", "results/x/dataset"))[0],
          IN_RESULTS),
    Fault("images are links", images_elsewhere, IN_RESULTS),
    Fault("images are named", named_elsewhere, IN_RESULTS),
    Fault("capture", lambda: photographs("results/x/capture"), IN_RESULTS),
    Fault("photographs", lambda: photographs("results/x/photos"), IN_RESULTS),
    Fault("mesh", lambda: with_key("scene", {"mesh": "results/x/mesh.ply"}, "results/x/mesh.ply"), "mesh names"),
    Fault("given ids", lambda: with_key("segment", {"mode": "given", "path": "results/x/ids"}, "results/x/ids"),
          "settings.segment.path names"),
    Fault("environment", lambda: with_key("environment", {"mode": "given", "file": f"{HERE}.exr"}, f"{HERE}.exr"),
          "settings.environment.file names"),
    Fault("photographs of a setup",
          lambda: with_key("setups", {"night": {"reference": "results/x/night"}}, "results/x/night"),
          "setups.night.reference names"),
    Fault("scan", lambda: with_key("scene", {"settings": {"geometry": {"scan": "results/x/s.ply"}}}, "results/x/s.ply"),
          "settings.geometry.scan names"),
    Fault("depth maps", lambda: with_key("depth", {"given": "results/x/depth"}, "results/x/depth"),
          "settings.depth.given names"),
    Fault("outputs of another program", lambda: with_key("methods", {"other": OTHER}, "results/x/others"),
          "methods.other.settings.import_results.path names"),
    Fault("outputs of another program, by a folder above", lambda: others_below("results", "brdf"),
          "import_results.path names results/brdf/m/x; it lies in results/brdf"),
    Fault("outputs of another program, by a link deep below", lambda: others_below("others"),
          "import_results.path names others/brdf/m/x"),
    Fault("sheet of rooms", sheet_in_results, "scenes names results/x/rooms.tsv"),
    Fault("a source that nobody named", nobody_named, "no run wrote"),
    Fault("a source that nobody named, after a run", nobody_named_after_a_run, "no run wrote"),
    Fault("a source in another scene", other_scene, "scene y: path names results/x/dataset"),
]  # fmt: skip


@named(PLANNED)
def test_a_plan_that_would_clear_its_input_is_refused(fault: Fault, tmp_path: Path) -> None:
    fault.plant()
    before = contents(tmp_path)
    with pytest.raises(FiptError) as caught:
        check_kept(read())
    assert fault.said in str(caught.value)
    assert "a run would clear it" in str(caught.value)
    assert contents(tmp_path) == before


def test_a_disk_that_ignores_case_is_looked_at_by_identity(monkeypatch: pytest.MonkeyPatch) -> None:
    """What such a disk does: another spelling leads to the same file."""
    planned_in("results/x/dataset", "Results/X/Dataset")
    true_stat = os.stat
    monkeypatch.setattr(os, "stat", lambda path, **keys: true_stat(_lower(path), **keys))
    with pytest.raises(FiptError, match="path names Results/X/Dataset; it lies in results/x"):
        check_kept(read())


def _lower(path: Any) -> Any:
    """The spelling on the disk, below the working directory."""
    here, text = str(Path.cwd()), os.fspath(path) if not isinstance(path, int) else path
    if not isinstance(text, str):
        return path
    return here + text[len(here) :].lower() if text.startswith(here) else text if text[:1] == "/" else text.lower()


def accepted() -> Iterable[tuple[str, Any]]:
    """Configurations that look alike and lose nothing."""
    yield "source beside results", lambda: planned_in("src", "src")
    yield "source above results", lambda: planned_in(".", ".")
    yield "results on another disk", lambda: linked("results", "disk", "src")
    yield "a scene's results on another disk", lambda: (planned_in(".", "."), link("results/x", "disk"))
    yield "a link called as a word", lambda: linked_made("dataset", "src")
    yield "a link beside the images, to results", lambda: linked_made("latest", ".")
    yield "a bookmark in the results", lambda: linked("results/x/originals", ".", "src")
    yield "results of a scene that is not configured", lambda: planned_in("results/old/dataset", "results/old/dataset")


@pytest.mark.parametrize(("name", "plant"), list(accepted()))
def test_what_loses_nothing_is_accepted(name: str, plant: Any) -> None:
    Path("disk").mkdir()
    plant()
    check_kept(read())


def linked_made(place: str, path: str) -> None:
    """A link to a folder of the results."""
    Path("results/x/export").mkdir(parents=True)
    planned_in(path, path)
    link(place, "results/x/export")


def test_what_another_scene_made_may_be_imported() -> None:
    other_scene()
    write_manifest(Path("results/x/dataset/images.manifest.json"), "import", [], {})
    check_kept(read())


def test_own_poses_are_copied_out_before_they_are_pinned() -> None:
    """They are not another's: a run that estimates poses again would replace them."""
    photographs("photos")
    configure("photos", "raw", scene={"poses": "results/x/poses/transforms.json"})
    Path("results/x/poses").mkdir(parents=True)
    for name in ("transforms.json", "views.json"):
        Path("results/x/poses", name).write_text("{}")
    with pytest.raises(
        FiptError, match=r"a result of the scene itself.*; copy it out of results/x and name the copy in poses"
    ):
        check_kept(read())


def test_every_key_that_names_a_path_is_known() -> None:
    """Descriptions of such keys say that {data_root} is replaced."""
    schema = SCHEMA.read_text(encoding="utf-8")
    named = set()

    def walk(value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                if isinstance(inner, dict) and "{data_root}" in str(inner.get("description", "")):
                    named.add(key)
                walk(inner)
        elif isinstance(value, list):
            for inner in value:
                walk(inner)

    walk(json.loads(schema))
    assert named
    assert {key for key in named - {"data_root"} if not PATHS.fullmatch(key)} == set()


def test_the_room_that_a_scene_photographs_may_be_its_reference() -> None:
    Path("results/x/room").mkdir(parents=True)
    Path("results/x/room/transforms.json").write_text("{}")
    Path("config").mkdir()
    scene = {"source": "procedural", "simulate_raw": True, "poses": "colmap"}
    poses = {"align": {"reference": "results/x/room/transforms.json"}}
    Path("config/config.yaml").write_text(yaml.safe_dump({"scenes": {"x": scene}, "poses": poses}))
    Path("results/x/stats").mkdir()
    with pytest.raises(FiptError, match="a run would clear it"):
        check_kept(read())  # nobody made it
    Path("results/x/room/views.json").write_text('{"views": {}}')
    check_kept(read())


@pytest.mark.parametrize("front", ["fipt run", "snakemake"])
def test_both_fronts_refuse_before_anything_runs(front: str, tmp_path: Path) -> None:
    linked("results/x/dataset", "src", "src")
    here = Workspace(tmp_path, yaml.safe_load(Path("config/config.yaml").read_text()), stand_in=False)
    before = contents(tmp_path / "src")
    said = here.fipt_run(code=2, scene="x") if front == "fipt run" else here.snakemake(succeeds=False)
    assert "it lies in results/x, through the link results/x/dataset: a run would clear it" in said
    assert "Traceback" not in said
    assert contents(tmp_path / "src") == before


@pytest.mark.parametrize(("front", "place"), [("fipt run", "way/more.yaml"), ("snakemake", "results/x/more.yaml")])
def test_a_file_of_the_configuration_is_not_cleared(front: str, place: str, tmp_path: Path) -> None:
    write_nerfstudio(Path("src"))
    configure("src")
    Path("results/x").mkdir(parents=True)
    link("way", "results/x")
    Path("results/x/more.yaml").write_text("rounds: 1\n")
    here = Workspace(tmp_path, yaml.safe_load(Path("config/config.yaml").read_text()), stand_in=False)
    if front == "fipt run":
        said = here.fipt_run("--configfile", place, code=2, scene="x")
    else:
        said = here.snakemake("--configfile", place, succeeds=False)
    assert f"{place} lies in results/x: a run would clear it; move it out of results/x" in said
    assert "fipt: error: the configuration file " in said
    assert "Traceback" not in said
    assert Path("results/x/more.yaml").read_text() == "rounds: 1\n"


def import_into(*options: str) -> list[str]:
    return ["import", "--source", "src", "--format", "nerfstudio", "--dataset", "out", *options]


def mesh_in_target() -> None:
    """An earlier dataset in which somebody left the mesh of the next."""
    write_nerfstudio(Path("src"))
    assert main([*import_into(), "--settings", '{"prepare": "never", "overlay": false}']) == 0


def other_files(folder: str, file: str) -> None:
    Path(folder).mkdir()
    Path(folder, file).write_text("mine")


def depth_over(folder: str, file: str) -> None:
    """A dataset of views, and a folder of somebody else."""
    cameras = [camera("a", 0.0), camera("b", 0.2), camera("c", -0.2)]
    write_dataset(Path("src"), cameras)
    Path(folder).mkdir(exist_ok=True)
    Path(folder, file).write_text("mine")


VERBS: list[tuple[Fault, list[str]]] = [
    (Fault("mesh in the dataset", mesh_in_target, "out/mesh.ply lies in the dataset out, which is replaced"),
     import_into("--mesh", "out/mesh.ply")),
    (Fault("source is the dataset", lambda: planned_in("out", "out"), "must not hold its source"),
     ["import", "--source", "out", "--format", "nerfstudio", "--dataset", "out"]),
    (Fault("dataset is a link to the source", lambda: linked("out", "src", "src"), "must not hold its source"),
     import_into()),
    (Fault("an id map shown over itself", lambda: write_png("ids.png", IDS), "is the file that"),
     ["view", "ids.png"]),
    (Fault("an image shown as another format", lambda: write_png("ids.png", IDS), "must be a PNG"),
     ["view", "ids.png", "--out", "mesh.ply"]),
    (Fault("out is an input", lambda: other_files("d", "cache.npz"), "--out and --cache are the same place"),
     ["bake", "--dataset", "d", "--samples", "s", "--cache", "d/cache.npz", "--out", "d/cache.npz"]),
    (Fault("out is an input by a link", lambda: (other_files("d", "c.npz"), link("l.npz", "d/c.npz"))[0],
           "--out and --cache are the same place"),
     ["bake", "--dataset", "d", "--samples", "s", "--cache", "d/c.npz", "--out", "l.npz"]),
    (Fault("figures over an input", lambda: other_files("d", "cache.npz"), "--stats and --cache"),
     ["bake", "--dataset", "d", "--samples", "s", "--cache", "d/cache.npz", "--out", "o", "--stats", "d/cache.npz"]),
    (Fault("depth over photographs", lambda: depth_over("photos", "a.dng"), "photos is replaced, but holds a.dng"),
     ["depth", "--dataset", "src", "--out", "photos"]),
    (Fault("depth over a dataset's images", lambda: depth_over("src/images", "b.exr"), "lies in what --dataset reads"),
     ["depth", "--dataset", "src", "--out", "src/images"]),
]  # fmt: skip


@pytest.mark.parametrize(("fault", "argv"), VERBS, ids=[fault.name for fault, _ in VERBS])
def test_a_verb_that_would_write_its_input_is_refused(
    fault: Fault, argv: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fault.plant()
    before = contents(tmp_path)
    assert fault.said in refused(capsys, *argv)
    assert contents(tmp_path) == before


def test_a_mesh_of_a_given_folder_stays(tmp_path: Path) -> None:
    """An OBJ beside the source is read, and is there afterwards."""
    write_nerfstudio(Path("src"))
    write_obj(Path("room.obj"), room())
    before = contents(tmp_path / "src") | {"room": Path("room.obj").read_text()}
    quick = ["--settings", '{"prepare": "never", "overlay": false}']
    assert main([*import_into("--mesh", "room.obj"), *quick]) == 0
    assert contents(tmp_path / "src") | {"room": Path("room.obj").read_text()} == before
