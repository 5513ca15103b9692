"""``fipt doctor``: problems with their remedies, and no abort."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fipt import doctor
from fipt.cli.main import main
from fipt.render import variant


def run_doctor(*options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the real command in a process of its own, as an abort would end ours."""
    return subprocess.run(
        [sys.executable, "-m", "fipt.cli.main", "doctor", *options],
        capture_output=True,
        text=True,
        env=os.environ | {"COLUMNS": "200"} | environment,
        check=False,
    )


def by_name(text: str) -> dict[str, dict[str, str]]:
    """The checks of a JSON report by their names."""
    return {check["name"]: check for check in json.loads(text)["checks"]}


def test_a_working_machine(tmp_path: Path) -> None:
    run = run_doctor("--json", "--results", str(tmp_path), FIPT_BACKEND="llvm")
    checks = by_name(run.stdout)
    assert [name for name, check in checks.items() if check["status"] == "problem"] == []
    assert run.returncode == 0
    assert json.loads(run.stdout)["can_run"] is True
    assert list(checks) == [
        "Python",
        "packages",
        "CUDA",
        "LLVM",
        "ray tracing",
        "torch",
        "denoiser",
        "open3d",
        "memory",
        "disk",
    ]
    assert "llvm_ad_rgb" in checks["ray tracing"]["found"]
    assert "mitsuba 3.9" in checks["packages"]["found"]


def test_an_old_llvm_is_recognised_before_it_aborts(tmp_path: Path, fake_llvm) -> None:
    library = fake_llvm(tmp_path / "libLLVM-15.so.1")
    run = run_doctor(DRJIT_LIBLLVM_PATH=str(library), FIPT_BACKEND="llvm")
    assert run.returncode == 1
    assert "LLVM 15, too old for Dr.Jit" in run.stdout
    assert "-> " in run.stdout
    assert "The pipeline cannot run here." in run.stdout
    assert run.stderr == ""


def test_a_real_old_llvm_is_recognised_too() -> None:
    old = next((found for found in variant.list_llvm() if not found.usable), None)
    if old is None:
        pytest.skip("no LLVM below 16 on this machine")
    run = run_doctor("--json", DRJIT_LIBLLVM_PATH=str(old.path), FIPT_BACKEND="llvm")
    check = by_name(run.stdout)["backend"]
    assert run.returncode == 1
    assert check["status"] == "problem"
    assert "too old for Dr.Jit" in check["found"]
    assert check["remedy"]


@pytest.mark.parametrize("code", ["import os; os.abort()", "raise OSError('no such library')"])
def test_an_abort_in_the_first_kernel_is_a_line_of_the_report(code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_PROBE", f"import sys; print('LLVM ERROR', file=sys.stderr); {code}")
    library = variant.LlvmLibrary(Path("libLLVM.so"), (19, 1))
    checks = list(doctor._probe(variant.Backend("llvm", "llvm_ad_rgb", "CPU", library)))
    assert [check.status for check in checks] == ["problem"]
    assert ("signal 6: LLVM ERROR" if "abort" in code else "no such library") in checks[0].found
    assert checks[0].remedy


def test_a_missing_and_an_outdated_package(monkeypatch: pytest.MonkeyPatch) -> None:
    needed = ["numpy<1", "surely-not-installed>=1", "torch>=2.0", 'pytest; extra == "dev"']
    monkeypatch.setattr(doctor.importlib.metadata, "requires", lambda name: needed)
    checks = {check.name: check for check in doctor.check_packages()}
    assert list(checks) == ["numpy", "surely-not-installed", "packages"]
    assert "but fipt needs <1" in checks["numpy"].found
    assert checks["surely-not-installed"].status == "problem"
    assert "make setup" in checks["numpy"].remedy
    assert "torch" in checks["packages"].found


def test_results_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # However little is free here.
    monkeypatch.setattr(doctor, "LOW_DISK_GB", 0.0)
    file = tmp_path / "file"
    file.write_text("")
    assert doctor.check_disk(file / "results").status == "problem"
    assert doctor.check_disk(tmp_path / "not" / "yet").status == "ok"


def test_low_memory_and_low_disk_are_warnings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "LOW_MEMORY_GB", 1e9)
    monkeypatch.setattr(doctor, "LOW_DISK_GB", 1e9)
    for check in (doctor.check_memory(), doctor.check_disk(tmp_path)):
        assert check.status == "warning"
        assert "advised" in check.found
        assert check.remedy


def test_the_table_shows_every_check(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    checks = [
        doctor.Check("Python", "ok", "3.11"),
        doctor.Check("disk", "problem", "[full]", "free some space"),
    ]
    monkeypatch.setattr(doctor, "run_checks", lambda results: checks)
    assert main(["doctor"]) == 1
    shown = capsys.readouterr().out
    assert "[full]" in shown
    assert "-> free some space" in shown
