"""Disk, memory, signals and crashes of libraries: each ends with one line, and nothing looks finished that is not."""

import dataclasses
import errno
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fipt.cli import guard, main
from fipt.errors import FiptError, shortage
from fipt.formats.arrays import load_npy, save_npy, save_npz
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.files import atomic, atomic_folder, write_text
from fipt.formats.images import write_png
from fipt.render.variant import Backend
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh, write_ply
from fipt.stages.capture.brackets import Bracket, read_capture
from fipt.stages.capture.calibrate import calibrate
from fipt.stages.capture.calibration import Calibration
from fipt.stages.capture.develop import develop_views
from fipt.stages.capture.settings import CaptureSettings
from fipt.stages.export.write import check_room as check_export_room
from fipt.stages.poses.matching import database
from fipt.stages.poses.settings import PosesSettings
from fipt.stages.poses.views import UnposedViews
from fipt.stages.render.settings import RenderSettings
from fipt.stages.render.views import Destination, write_views
from fipt.stages.samples.settings import SamplesSettings
from fipt.stages.samples.trace import trace
from fipt.stages.segment.views import observe
from fipt.stages.shade.integrate import write_shading
from fipt.stages.shade.settings import BakeSettings
from tests import captures, fitted, scenes
from tests.faults.faults import contents, refused

NOISE = np.random.default_rng(0).random((90, 90, 3)).astype(np.float32)
SMALL = Camera("a", "train", 8, 6, 4.0, 4.0, 4.0, 3.0, np.eye(4))
WRITERS: dict[str, Callable[[Path], object]] = {
    "a.npy": lambda path: save_npy(path, NOISE),
    "a.npz": lambda path: save_npz(path, noise=NOISE),
    "a.exr": lambda path: write_exr(path, {"": NOISE}),
    "a.png": lambda path: write_png(path, (NOISE * 255).astype(np.uint8)),
    "a.txt": lambda path: write_text(path, "x" * 100_000),
    "a.ply": lambda path: write_ply(path, Mesh(NOISE.reshape(-1, 3), np.zeros((9, 3), np.int32))),
}


def limited(folder: Path, said: "multiprocessing.SimpleQueue[tuple[str, str]]") -> None:
    """Write with files limited to 5000 bytes, as a full disk cuts them."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
    for name, write in WRITERS.items():
        try:
            write(folder / name)
        except FiptError as error:
            said.put((name, str(error)))
        except BaseException as error:  # noqa: BLE001 - told to the test
            said.put((name, repr(error)))
        else:
            said.put((name, "nothing"))


def test_a_file_that_is_cut_is_one_line_and_absent(tmp_path: Path) -> None:
    context = multiprocessing.get_context("fork")
    said = context.SimpleQueue()
    process = context.Process(target=limited, args=(tmp_path, said))
    process.start()
    process.join(60)
    for _ in WRITERS:
        name, words = said.get()
        place = f"while writing {tmp_path / name}"
        assert f"a file is larger than the system allows {place}" in words or f"the disk is full {place}" in words
    assert list(tmp_path.iterdir()) == []


SHORTAGES = [
    (OSError(errno.ENOSPC, "No space left on device"), "the disk is full while writing x; free some space"),
    (OSError("120000 requested and 1218 written"), "the disk is full while writing x, or a quota or limit is reached"),
    (OSError(errno.EDQUOT, "Disk quota exceeded"), "the quota of the disk is used up while writing x; free"),
    (OSError(errno.EFBIG, "File too large"), "a file is larger than the system allows while writing x; raise"),
    (RuntimeError("Failed to write pixel data. No space left on device."), "the disk is full while writing x"),
    (OSError(errno.ENOMEM, "Cannot allocate memory"), "there is too little memory"),
    (MemoryError(), "there is too little memory; close other programs"),
    (RuntimeError("std::bad_alloc"), "there is too little memory (std::bad_alloc)"),
    (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"), "too little memory"),
]


@pytest.mark.parametrize(("error", "said"), SHORTAGES, ids=[said for _, said in SHORTAGES])
def test_what_ran_out_is_named(
    error: Exception, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for writer in (atomic("x"), atomic_folder("x", "x")):
        if isinstance(error, MemoryError):
            break  # passes to the command line
        with pytest.raises(FiptError) as caught, writer:
            raise error
        assert said in str(caught.value)
    assert list(tmp_path.iterdir()) == []

    def dispatch(_: list[str]) -> int:
        raise error

    monkeypatch.setattr(main, "_dispatch", dispatch)
    assert main.main(["fit"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fipt: error: ")
    assert said.split(" while")[0] in line


@pytest.mark.parametrize("error", [OSError(errno.ETIMEDOUT, "timed out"), RuntimeError("a mistake")])
def test_other_failures_keep_their_traceback(error: Exception) -> None:
    assert shortage(error) is None


def test_too_little_memory_is_not_told_as_a_broken_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_npy(tmp_path / "a.npy", NOISE)

    def short(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 3 GiB")

    monkeypatch.setattr(np.lib.format, "read_array", short)
    with pytest.raises(FiptError, match=r"a\.npy cannot be read: memory is too small, or a size in it is absurd"):
        load_npy(tmp_path / "a.npy", mmap=False)


def crash(number: int) -> Callable[[], int]:
    def call() -> int:
        os.kill(os.getpid(), number)
        return 0

    return call


def interrupted(number: int) -> Callable[[], int]:
    """The watching process gets the signal, as from a terminal or a scheduler."""

    def call() -> int:
        os.kill(os.getppid(), number)
        time.sleep(60)
        return 0

    return call


def deaf() -> int:
    """A library takes the interruption for a failure of its own, as some do while they load."""
    os.kill(os.getppid(), signal.SIGINT)
    end = time.monotonic() + 60
    while time.monotonic() < end:
        try:
            time.sleep(1)
        except KeyboardInterrupt:
            continue
    return 0


def noisy() -> int:
    os.kill(os.getppid(), signal.SIGINT)
    try:
        time.sleep(60)
    except KeyboardInterrupt as error:
        raise ImportError("numpy is broken") from error
    return 0


def in_a_library() -> int:
    np.apply_along_axis(lambda _: os.kill(os.getpid(), signal.SIGSEGV), 0, NOISE)
    return 0


ENDS: list[tuple[str, Callable[[], int], int, str]] = [
    ("done", lambda: 0, 0, ""),
    ("refused", lambda: 2, 2, ""),
    ("crash", crash(signal.SIGSEGV), 2, "fipt: error: fipt fit crashed in native code (SIGSEGV); run again"),
    ("abort", crash(signal.SIGABRT), 2, "fipt: error: fipt fit crashed in native code (SIGABRT); run again"),
    ("in a library", in_a_library, 2, "fipt: error: fipt fit crashed in native code (SIGSEGV"),
    ("killed", crash(signal.SIGKILL), 2, "fipt: error: fipt fit was killed (SIGKILL), most likely by the system for"),
    ("hangs", lambda: time.sleep(60) or 0, 2, "fipt: error: fipt fit hung: no processor worked for it for 1 s"),
    ("SIGINT", interrupted(signal.SIGINT), 130, "fipt: interrupted\n"),
    ("SIGTERM", interrupted(signal.SIGTERM), 143, "fipt: terminated\n"),
    ("SIGHUP", interrupted(signal.SIGHUP), 129, "fipt: terminated\n"),
    ("swallowed", deaf, 130, "fipt: interrupted\n"),
    ("told as a broken library", noisy, 130, "fipt: interrupted\n"),
]


@pytest.mark.parametrize(("call", "code", "said"), [end[1:] for end in ENDS], ids=[end[0] for end in ENDS])
def test_every_end_is_one_line(call: Callable[[], int], code: int, said: str, tmp_path: Path) -> None:
    """In a process of its own: signals of the test's process stay as they are."""
    log = tmp_path / "stderr"

    def run() -> None:
        os.dup2(os.open(log, os.O_CREAT | os.O_WRONLY), 2)
        sys.stderr = os.fdopen(2, "w", buffering=1)
        for number in (signal.SIGSEGV, signal.SIGABRT):
            signal.signal(number, signal.SIG_DFL)  # other tests have loaded libraries that catch them
        guard.GRACE = 0.5
        guard._SAID = guard._WORDS  # whatever the tests were started with
        os._exit(guard.guarded("fit", call, hang=1.0))

    process = multiprocessing.get_context("fork").Process(target=run)
    process.start()
    process.join(30)
    words = log.read_text()
    assert process.exitcode == code, words
    assert words.startswith(said)
    assert words.count("\n") == bool(said)
    assert "Traceback" not in words


def test_what_nohup_starts_goes_on() -> None:
    """A terminal that closes sends SIGHUP, which nohup has let the process ignore."""
    script = (
        "import os, signal, sys\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\nsys.argv[0] = 'fipt'\n"
        "from fipt.cli.guard import guarded\n"
        "def call():\n    os.kill(os.getpid(), signal.SIGHUP)\n    os.kill(os.getppid(), signal.SIGHUP)\n    return 7\n"
        "sys.exit(guarded('fit', call))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (7, "")


@pytest.mark.skipif(sys.platform != "linux", reason="the system kills a child with its parent on Linux")
def test_no_stage_outlives_its_watcher(tmp_path: Path) -> None:
    script = (
        "import os, pathlib, time\nfrom fipt.cli.guard import guarded\n"
        "def call():\n    print(os.getpid(), flush=True)\n    time.sleep(60)\nguarded('fit', call)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as watcher:
        assert watcher.stdout is not None
        stage = int(watcher.stdout.readline())
        watcher.kill()
    end = time.monotonic() + 10
    while time.monotonic() < end:
        try:
            os.kill(stage, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("the stage lives on")


LARGE = 16384


def test_a_camera_that_needs_more_memory_than_there_is(tmp_path: Path, backend: Backend) -> None:
    camera = dataclasses.replace(SMALL, width=LARGE, height=LARGE)
    dataset: Any = SimpleNamespace(camera=lambda _: camera, accepted=lambda views: views)
    with pytest.raises(
        FiptError, match=r"tracing the samples needs about 940 GB of memory; there are \d+ GB; use smaller"
    ):
        trace(dataset, ["a"], SamplesSettings(), {})
    destination = Destination("render", tmp_path, tmp_path / "m.json")
    with pytest.raises(FiptError, match=r"an image of the stage render needs about 121 GB of memory"):
        write_views(dataset, [camera], RenderSettings(), 1, destination)


def test_a_disk_that_samples_and_images_do_not_fit_on(
    tmp_path: Path, backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset: Any = SimpleNamespace(camera=lambda _: SMALL, accepted=lambda views: views)
    scene: Any = SimpleNamespace(illuminations=range(5))
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=4000))
    with pytest.raises(FiptError, match=r"a shard of samples needs 0\.\d MB in .*; 0\.\d MB are free"):
        trace(dataset, ["a"], SamplesSettings(), {}, tmp_path / "samples" / "a")  # 90 bytes for each of 48 pixels
    destination = Destination("olat", tmp_path, tmp_path / "m.json")
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=2900))
    with pytest.raises(FiptError, match="the output of the stage olat needs"):  # 12 for each of them, five times
        write_views(scene, [SMALL], RenderSettings(), 1, destination)
    assert list(tmp_path.iterdir()) == []


def test_later_stages_refuse_what_does_not_fit(
    tmp_path: Path, backend: Backend, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A planted small limit of memory, then of the disk, for every stage whose needs grow with its work."""
    scenes.write_dataset(tmp_path / "dataset")
    assert fitted.call("samples", tmp_path) == 0
    before = contents(tmp_path)
    limits: list[tuple[str, object, str]] = [
        ("fipt.formats.files.total_memory", lambda: 1000, "needs about 0 GB of memory; there are 0 GB; use"),
        ("shutil.disk_usage", lambda _: SimpleNamespace(free=1000), "0.0 MB are free; free some space"),
    ]
    for place, limit, said in limits:
        monkeypatch.setattr(place, limit)
        for verb, name in {
            "cache": "the radiance cache",
            "fit": "the fit",
            "emitters": "the search for emitters",
        }.items():
            folders = ("--samples", str(tmp_path / "samples/train-000"), "--out", str(tmp_path / f"{verb}.npz"))
            shading = () if verb == "cache" else ("--shading", str(tmp_path / "none"))
            line = refused(capsys, verb, "--dataset", str(tmp_path / "dataset"), *folders, *shading)
            assert line.startswith(f"fipt: error: {name} needs")
            assert said in line
        monkeypatch.undo()
    assert contents(tmp_path) == before


def refuse_shading(out: Path) -> None:
    samples = scenes.samples_of(np.zeros((50, 3)))
    write_shading("bake", None, None, samples, BakeSettings(), out)  # type: ignore[arg-type] # pyright: ignore


def refuse_poses(out: Path) -> None:
    cameras = (dataclasses.replace(SMALL, width=LARGE, height=LARGE),) * 3
    database(UnposedViews(cameras, {}, {}), out / "work", PosesSettings())


NEEDY: dict[str, tuple[Callable[[Path], object], bool]] = {
    "the bake shading": (refuse_shading, True),
    "the estimate of poses": (refuse_poses, True),
    "the fusion of segments": (lambda out: observe(scenes.room().mesh, [SMALL], out), True),
    "the export": (lambda out: check_export_room(scenes.room().mesh, (100.0, 2, 4096), out), True),
    "the calibration": (lambda out: calibrate(read_capture(out), CaptureSettings()), False),
}
"""What a stage does -> how it begins, and whether it needs the disk."""


@pytest.mark.parametrize("stage", NEEDY)
def test_other_stages_refuse_it_too(stage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begin, stores = NEEDY[stage]
    if not stores:
        captures.write(tmp_path, views=1, exposures=2, calibration_frames=1)
    before = contents(tmp_path)
    monkeypatch.setattr("fipt.formats.files.total_memory", lambda: 1000)
    with pytest.raises(FiptError, match=rf"^{stage} needs about \d+ GB of memory; there are 0 GB; use"):
        begin(tmp_path)
    if stores:
        monkeypatch.setattr("fipt.formats.files.total_memory", lambda: 10**15)
        monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=500))
        with pytest.raises(FiptError, match=rf"^{stage} needs .* in .*; 0\.0 MB are free"):
            begin(tmp_path)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("place", "limit", "said"),
    [
        (
            "fipt.formats.files.total_memory",
            lambda: 100,
            "developing a view needs about 0 GB of memory; there are 0 GB",
        ),
        ("shutil.disk_usage", lambda _: SimpleNamespace(free=100), "the developed views needs 0.0 MB in"),
    ],
)
def test_photographs_that_do_not_fit(
    place: str, limit: object, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot = SimpleNamespace(path=tmp_path / "a.dng")
    capture: Any = SimpleNamespace(brackets=[Bracket("a", "raw", (shot,) * 3)], findings=[])  # pyright: ignore
    monkeypatch.setattr(place, limit)
    calibration = Calibration("raw", None, 8, 6)
    with pytest.raises(FiptError) as caught:
        develop_views(capture, ["a"], calibration, tmp_path, CaptureSettings(), keep_going=True)
    assert said in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_an_image_that_needs_more_memory_than_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_exr(tmp_path / "a.exr", {"": NOISE})
    monkeypatch.setattr("fipt.formats.files.total_memory", lambda: 291_599)
    with pytest.raises(FiptError, match=r"reading .*a\.exr needs about 0 GB of memory"):
        read_exr(tmp_path / "a.exr")
    monkeypatch.setattr("fipt.formats.files.total_memory", lambda: 291_600)  # 12 bytes for each of 90 x 90 x 3
    read_exr(tmp_path / "a.exr")


def catches(status: str, number: signal.Signals) -> bool:
    """Whether a process has a handler, by its /proc/PID/status."""
    (mask,) = (line.split()[1] for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(mask, 16) >> (number - 1) & 1)


@pytest.mark.skipif(sys.platform != "linux", reason="/proc says which signals a process catches")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("seconds", [0.0, 0.6])
def test_what_is_stopped_while_it_loads_says_so(seconds: float, number: signal.Signals, tmp_path: Path) -> None:
    """``fipt run`` loads Snakemake, typer makes an exit without a word of an interruption."""
    command = [sys.executable, "-m", "fipt.cli.main", "run", "none"]
    environment = os.environ | {"PYTHONPATH": str(Path(guard.__file__).parents[2])}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as running:
        status = Path(f"/proc/{running.pid}/status")
        while running.poll() is None and not catches(status.read_text(), signal.SIGTERM):
            time.sleep(0.01)  # Python itself begins
        time.sleep(seconds)
        running.send_signal(number)
        said = running.communicate()[1]
    assert "Traceback" not in said
    if "fipt: error: " not in said:  # it had ended: there is no such scene
        word = "interrupted" if number == signal.SIGINT else "terminated"
        assert said == f"fipt: {word}\n"
        assert running.returncode in (128 + number, -number)  # a shell sees the same


def test_a_home_that_snakemake_cannot_use_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    from fipt.cli.run_view import _explain_error

    text = (
        "  File snakemake/sourcecache.py\n\nFileNotFoundError: [Errno 2] No such file or directory: '/proc/.cache'\n\n"
    )
    assert _explain_error(SimpleNamespace(msg=text, exception="FileNotFoundError")) == 2
    said = capsys.readouterr().err
    assert said.startswith("fipt: error: Snakemake cannot use /proc/.cache (No such file or directory); check its")
    assert said.count("\n") == 1


def test_a_verb_ends_well_whose_outputs_are_closed() -> None:
    script = "import sys\nsys.stdout = sys.stderr = None\nfrom fipt.cli.process import leave\nleave(3)"
    done = subprocess.run([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (3, "")
