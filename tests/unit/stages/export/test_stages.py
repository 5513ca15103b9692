"""``fipt export`` and ``fipt check-export``."""

import json

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.formats.exr import read_rgb
from fipt.formats.manifests import read_manifest
from fipt.scene.dataset import Dataset
from tests import scenes
from tests.fitted import call


@pytest.fixture(scope="module")
def exported(scene, tmp_path_factory):
    """The room for other programs, and the check of its files."""
    folder, zero = tmp_path_factory.mktemp("export"), scene / "round-0"
    out, data, samples = folder / "export", scene / "dataset", scene / "samples"
    fitted = {
        "--model": zero / "model.safetensors",
        "--emitters": zero / "emitters.npz",
        "--confidence": zero / "confidence.npz",
        "--environment": scene / "environment.npz",
        "--samples": samples / "train-000",
        "--manifest": folder / "export.manifest.json",
        "--settings": json.dumps({"texel_density": 20}),
    }
    options = ["--name", "tiny", "--dataset", data, "--out", out, *(text for pair in fitted.items() for text in pair)]
    assert main(["export", *map(str, options)]) == 0
    clean = folder / "render"
    settings = {"spp": 512, "max_depth": 3}
    assert call("render", scene, "--out", clean, "--manifest", folder / "render.json", settings=settings) == 0
    options = ["--dataset", data, "--rays-per-side", 3, "--export", out, "--render", clean]
    options += ["--out", out / "check.json", "--settings", json.dumps({"check_spp": 128, "max_depth": 4})]
    assert main(["check-export", *map(str, options)]) == 0
    return out


def test_every_exported_file_shows_the_room(exported):
    from fipt.stages.export.check import psnr

    check = json.loads((exported / "check.json").read_text())
    assert list(check["formats"]) == ["glb", "usd", "mitsuba", "exact"]
    ours = read_rgb(exported.parent / "render" / "c.exr")
    for kind, entry in check["formats"].items():
        picture = read_rgb(exported / "check" / kind / "c.exr")
        assert psnr(picture, ours) > (27 if kind == "mitsuba" else 30), kind
        assert psnr(picture[:, ::-1], ours) < 20, kind
        assert entry["psnr"] == pytest.approx(psnr(picture, ours), abs=0.1)
        assert set(entry["views"]) == {"c"}


def test_the_export_lists_its_files(exported):
    manifest = read_manifest(exported.parent / "export.manifest.json", "export")
    written = {str(path.relative_to(exported.parent)) for path in exported.rglob("*") if path.is_file()}
    checked = {name for name in written if name.startswith(("export/check", "export.", "render"))}
    assert set(manifest["files"]) == written - checked
    facts = json.loads((exported / "export.json").read_text())
    assert facts["scene"] == "tiny"
    assert [lamp["radiance"] for lamp in facts["emitters"]] == [pytest.approx(scenes.EMITTER_RADIANCE)]
    script = (exported / "blender.py").read_text()
    compile(script, "blender.py", "exec")


def test_photographs_without_a_valid_pixel_judge_nothing(exported, scene, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Dataset, "clipped", lambda data, view: np.ones(data.image(view)[1].shape, bool))
    options = ["--dataset", scene / "dataset", "--rays-per-side", 3, "--export", exported]
    options += ["--render", exported.parent / "render", "--out", tmp_path / "check.json"]
    assert main(["check-export", *map(str, options)]) == 2
    assert "no image of a held-out view whose photograph has a valid pixel" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_check_without_its_files(exported, scene, refused, tmp_path):
    common = ["--dataset", str(scene / "dataset"), "--out", "x.json"]
    here = ["--render", str(scene / "render")]
    assert main(["check-export", *common, *here, "--export", str(tmp_path)]) == 2
    assert main(["check-export", *common, "--render", str(tmp_path), "--export", str(exported)]) == 2
