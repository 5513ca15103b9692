"""The choice of the device, and which LLVM libraries there are."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from fipt.errors import FiptError
from fipt.render import variant


@pytest.fixture
def lone_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is the only place where LLVM is looked for; no variable set."""
    monkeypatch.delenv(variant.LLVM_VARIABLE, raising=False)
    monkeypatch.delenv(variant.BACKEND_VARIABLE, raising=False)
    monkeypatch.setattr(variant, "_candidates", lambda: sorted(tmp_path.iterdir()))
    monkeypatch.setattr(variant, "find_cuda", lambda: variant.CudaDriver(problem="none"))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-14.so.1", (14,)),
        ("libLLVM-17.so.1", (17,)),
        ("libLLVM-17.so", (17,)),
        ("libLLVM.so.18.1", (18, 1)),
        ("libLLVM.so.19.1", (19, 1)),
        ("libLLVM-14.0.6.so.1", (14, 0, 6)),
        ("libLLVM.so.20.1-rust", (20, 1)),
    ],
)
def test_version_is_that_of_the_file_behind_all_links(
    fake_llvm, tmp_path: Path, name: str, version: tuple[int, ...]
) -> None:
    library = fake_llvm(tmp_path / name)
    assert variant.llvm_version(library) == version
    (tmp_path / "libLLVM.so").symlink_to(library)
    assert variant.llvm_version(tmp_path / "libLLVM.so") == version


@pytest.mark.parametrize("content", [b"", b"text", b"\x7fELF\x02\x01", b"\x7fELF\x02\x01" * 40])
@pytest.mark.parametrize("name", ["libLLVM.so.19.1", "libLLVM.so"])
def test_a_file_that_is_no_library_has_no_version(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    assert variant.llvm_version(tmp_path / name) == ()


def test_a_library_that_cannot_be_loaded_has_no_version(fake_llvm, tmp_path: Path) -> None:
    assert variant.llvm_version(fake_llvm(tmp_path / "libLLVM.so")) == ()


def test_the_newest_library_wins_and_strangers_are_left_out(fake_llvm, lone_folder: Path) -> None:
    fake_llvm(lone_folder / "libLLVM-14.so.1")
    newest = fake_llvm(lone_folder / "libLLVM.so.19.1")
    fake_llvm(lone_folder / "libLLVM.so.30.1", another=True)
    (lone_folder / "libLLVM-19.so").symlink_to(newest)
    (lone_folder / "libLLVM.so.40.1").symlink_to(lone_folder / "gone")
    (lone_folder / "libLLVM.so.50.1").write_text("INPUT(libLLVM.so.19.1)")
    assert [library.version for library in variant.list_llvm()] == [(19, 1), (14,)]
    found = variant.find_llvm()
    assert found == variant.LlvmLibrary(newest, (19, 1))
    assert found.usable
    backend = variant.choose_backend()
    assert (backend.name, backend.variant) == ("llvm", "llvm_ad_rgb")
    assert backend.device_name == "CPU (LLVM 19.1)"
    assert backend.torch_device == "cpu"


def test_without_any_library_the_error_says_what_to_install(lone_folder: Path) -> None:
    assert variant.find_llvm() is None
    with pytest.raises(FiptError, match="no LLVM library found, and no CUDA device; install LLVM"):
        variant.choose_backend()


@pytest.mark.parametrize("name", ["libLLVM-14.so.1", "libLLVM-15.so.1"])
def test_an_old_library_is_refused_with_its_remedy(fake_llvm, lone_folder: Path, name: str) -> None:
    fake_llvm(lone_folder / name)
    with pytest.raises(FiptError, match=r"libLLVM-1[45].so.1 is LLVM 1[45], too old .*apt install"):
        variant.choose_backend("llvm")


def test_a_named_old_library_is_not_replaced_in_silence(
    fake_llvm,
    lone_folder: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    old = fake_llvm(tmp_path_factory.mktemp("old") / "libLLVM-15.so.1")
    monkeypatch.setenv(variant.LLVM_VARIABLE, str(old))
    with pytest.raises(FiptError, match=r"DRJIT_LIBLLVM_PATH names .* LLVM 15, too old .*install"):
        variant.choose_backend()
    fake_llvm(lone_folder / "libLLVM.so.19.1")
    with pytest.raises(FiptError, match=r"unset it: .*libLLVM.so.19.1 is LLVM 19.1"):
        variant.choose_backend()


def test_a_named_library_may_be_a_bare_name(fake_llvm, lone_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = fake_llvm(lone_folder / "libLLVM.so.19.1")
    monkeypatch.setenv(variant.LLVM_VARIABLE, "libLLVM.so.19.1")
    assert variant.choose_backend().llvm == variant.LlvmLibrary(library, (19, 1))
    monkeypatch.setenv(variant.LLVM_VARIABLE, "/nowhere/libLLVM.so.19.1")
    with pytest.raises(FiptError, match="which is not a file; unset it"):
        variant.choose_backend()


def test_a_named_file_that_is_no_library_is_refused(lone_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = lone_folder / "notes.txt"
    stranger.write_text("no library")
    monkeypatch.setenv(variant.LLVM_VARIABLE, str(stranger))
    with pytest.raises(FiptError, match="which is not LLVM; install LLVM 16"):
        variant.choose_backend()


def test_a_library_without_a_name_is_asked_in_another_process() -> None:
    found = variant.find_llvm()
    if found is None:
        pytest.skip("no LLVM on this machine")
    assert variant._version_from_library(found.path)[0] == found.version[0]


def test_finding_llvm_is_quick() -> None:
    times = []
    for _ in range(3):
        start = time.perf_counter()
        variant.find_llvm()
        times.append(time.perf_counter() - start)
    assert min(times) < 0.05


def test_cuda_is_preferred_where_it_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(variant.BACKEND_VARIABLE, raising=False)
    monkeypatch.setattr(variant, "find_cuda", lambda: variant.CudaDriver(("Card A", "Card B")))
    backend = variant.choose_backend()
    assert backend == variant.Backend("cuda", "cuda_ad_rgb", "Card A", None)
    assert backend.torch_device == "cuda"


def test_cuda_asked_for_but_absent_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = variant.CudaDriver(("Card A",), "the driver's OptiX library is missing")
    monkeypatch.setattr(variant, "find_cuda", lambda: broken)
    monkeypatch.setenv(variant.BACKEND_VARIABLE, "cuda")
    with pytest.raises(FiptError, match=r"OptiX library is missing; .*FIPT_BACKEND=llvm"):
        variant.choose_backend()


def test_the_environment_decides_only_where_the_caller_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(variant, "find_cuda", lambda: variant.CudaDriver(("Card A",)))
    monkeypatch.setattr(variant, "find_llvm", lambda: variant.LlvmLibrary(Path("x"), (19, 1)))
    monkeypatch.setenv(variant.BACKEND_VARIABLE, "llvm")
    assert variant.choose_backend().name == "llvm"
    assert variant.choose_backend("cuda").name == "cuda"
    monkeypatch.setenv(variant.BACKEND_VARIABLE, "metal")
    with pytest.raises(FiptError, match="FIPT_BACKEND must be auto, cuda or llvm; it is 'metal'"):
        variant.choose_backend()


def test_set_variant_is_idempotent_and_refuses_a_second_backend(
    backend: variant.Backend,
) -> None:
    import mitsuba

    assert mitsuba.variant() == backend.variant
    assert variant.set_variant() is backend
    assert variant.set_variant(backend) is backend
    other = "llvm_ad_rgb" if backend.name == "cuda" else "cuda_ad_rgb"
    name = "llvm" if backend.name == "cuda" else "cuda"
    with pytest.raises(RuntimeError, match="needs a new process"):
        variant.set_variant(variant.Backend(name, other, "another", None))
    with pytest.raises(FiptError, match="threads must be at least 1, got 0"):
        variant.set_variant(threads=0)


def test_threads_reach_drjit_and_torch() -> None:
    # In a process of its own: the number of threads is shared by everything in a process.
    code = (
        "from fipt.render.variant import set_variant\n"
        "set_variant(threads=1)\n"
        "import drjit, torch\n"
        "print(drjit.thread_count(), torch.get_num_threads())\n"
        "set_variant(threads=2)\n"
        "print(drjit.thread_count(), torch.get_num_threads())\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["1", "1", "2", "2"]


@pytest.mark.gpu
def test_gpu_tests_run_on_cuda(backend: variant.Backend) -> None:
    assert backend.name == "cuda"
    assert variant.find_cuda().usable  # also after Mitsuba was imported


@pytest.mark.usefixtures("backend")
def test_variants_are_found_where_mitsuba_is_imported_already() -> None:
    assert variant.has_variant("cuda_ad_rgb")
    assert variant.has_variant("llvm_ad_rgb")
    assert not variant.has_variant("metal_ad_rgb")


def test_torch_computes_where_rays_are_traced(backend: variant.Backend) -> None:
    assert variant.active_device() == backend.torch_device


def test_torch_computes_on_the_cpu_where_it_sees_no_gpu(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import torch

    variant._torch_sees_cuda.cache_clear()
    monkeypatch.setattr(variant, "_active", variant.Backend("cuda", "cuda_ad_rgb", "Card A", None))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert variant.active_device() == "cpu"
    assert "install torch's CUDA build" in caplog.text
    variant._torch_sees_cuda.cache_clear()
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert variant.active_device() == "cuda"
    variant._torch_sees_cuda.cache_clear()


def test_torch_computes_on_the_cpu_where_no_backend_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variant, "_active", None)
    assert variant.active_device() == "cpu"


def test_the_gpu_skip_fires(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    conftest = Path(__file__).parents[1] / "conftest.py"
    (tmp_path / "conftest.py").write_text(conftest.read_text())
    (tmp_path / "test_gpu.py").write_text(
        "import pytest\n\n@pytest.mark.gpu\ndef test_gpu():\n    raise AssertionError('ran')\n"
    )
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = gpu: needs a CUDA device\n")
    # No device is visible, so that the skip fires on machines with a GPU as well.
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    command = [sys.executable, "-m", "pytest", "-rs", "-p", "no:cacheprovider", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert "1 skipped" in run.stdout
    assert "needs a CUDA device" in run.stdout
