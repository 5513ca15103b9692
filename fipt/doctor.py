"""Health check: whether the pipeline can run here, and with which device.

Nothing that could fail is imported into this process: versions are read from the packages'
records, libraries are judged from their files, and the first ray is traced in a process of its
own, so that an abort inside a compiled library becomes a line of the report.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fipt.errors import FiptError
from fipt.formats.files import total_memory
from fipt.render import variant
from fipt.stages.geometry.library import tried

#: Below this the baking of an ordinary scene starts to swap.
LOW_MEMORY_GB = 4.0
#: Less free disk than this does not hold the demo's results.
LOW_DISK_GB = 2.0

REINSTALL = "run make setup, or: pip install -r requirements.lock"


@dataclass(frozen=True)
class Check:
    """One line of the report.

    Attributes
    ----------
    name : str
        What was looked at.
    status : {"ok", "warning", "problem"}
        With a ``problem`` the pipeline cannot run.
    found : str
        What was found.
    remedy : str
        What to do about it; empty where nothing is wrong.
    """

    name: str
    status: Literal["ok", "warning", "problem"]
    found: str
    remedy: str = ""


def run_checks(results: Path = Path("results")) -> list[Check]:
    """Run every check.

    Parameters
    ----------
    results : Path
        The folder that results go to; it need not exist.

    Returns
    -------
    list of Check
        In the order of the report. The pipeline can run if none is a ``problem``.
    """
    return [
        check_python(),
        *check_packages(),
        *check_backend(),
        check_open3d(),
        check_memory(),
        check_disk(results),
    ]


def check_python() -> Check:
    """Check the interpreter's version."""
    found = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if sys.version_info < (3, 11):  # noqa: UP036 - from a source tree it can be older
        return Check("Python", "problem", found, "install Python 3.11 or newer")
    return Check("Python", "ok", found)


def check_packages() -> Iterator[Check]:
    """Compare the installed packages with what pyproject.toml asks for, without importing them."""
    try:
        from packaging.requirements import Requirement

        needed = importlib.metadata.requires("fipt") or []
    except ImportError as error:  # PackageNotFoundError, of fipt itself, is an ImportError
        yield Check("packages", "problem", f"not installed: {error.name}", REINSTALL)
        return
    right = []
    for text in needed:
        requirement = Requirement(text)
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue  # for development only, or for another platform
        try:
            version = importlib.metadata.version(requirement.name)
        except importlib.metadata.PackageNotFoundError:
            yield Check(requirement.name, "problem", "not installed", REINSTALL)
            continue
        # torch's local tag (+cpu) and pre-releases are no reason to refuse a version.
        if not requirement.specifier.contains(version.split("+")[0], prereleases=True):
            found = f"{version}, but fipt needs {requirement.specifier}"
            yield Check(requirement.name, "problem", found, REINSTALL)
            continue
        right.append(f"{requirement.name} {version}")
    yield Check("packages", "ok", ", ".join(right))


def check_backend() -> Iterator[Check]:
    """Check CUDA and LLVM, say which is used, and trace a ray with it in another process."""
    cuda = variant.find_cuda()
    libraries = variant.list_llvm()
    newest = libraries[0] if libraries else None
    others = ", ".join(f"{library.version_text} ({library.path})" for library in libraries)
    try:
        backend = variant.choose_backend()
    except FiptError as error:
        yield Check("CUDA", "ok", cuda.problem or cuda.devices[0])
        if newest is not None and newest.path.name not in error.message:
            yield Check("LLVM", "ok", f"found: {others}")
        yield Check("backend", "problem", error.message, error.remedy)
        return
    if cuda.usable:
        yield Check("CUDA", "ok", f"{', '.join(cuda.devices)}; OptiX found")
    elif cuda.devices:
        remedy = "start the container with NVIDIA_DRIVER_CAPABILITIES=all, or update the driver"
        yield Check("CUDA", "warning", f"{cuda.devices[0]}, but {cuda.problem}", remedy)
    else:
        yield Check("CUDA", "ok", f"{cuda.problem}: not needed")
    if backend.llvm is not None:
        yield Check("LLVM", "ok", f"{backend.llvm.version_text} ({backend.llvm.path})")
    elif newest is None or not newest.usable:
        remedy = f"only for runs without CUDA: {variant.LLVM_REMEDY}"
        yield Check("LLVM", "warning", others or "none found", remedy)
    else:
        yield Check("LLVM", "ok", f"{newest.version_text} ({newest.path})")
    yield from _probe(backend)


# Every step prints a line when it is over, so that the last line tells where the process died.
# `minimum` is the operation at which LLVM 15 aborts.
_PROBE = """
import json, sys, warnings
warnings.simplefilter("ignore")
def done(step, found):
    print(json.dumps([step, found]), flush=True)
import mitsuba as mi
mi.set_variant(sys.argv[1])
import drjit as dr
scene = mi.load_dict({"type": "scene", "shape": {"type": "sphere"}})
x = dr.arange(mi.Float, 64) / 64
hit = scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(x, 0, -4), mi.Vector3f(0, 0, 1)))
count = int(dr.count(hit.is_valid() & (dr.minimum(x, 0.5) <= 0.5))[0])
if count != 64:
    raise SystemExit(f"64 rays must hit the sphere, {count} did")
done("ray tracing", f"{sys.argv[1]}, {dr.thread_count()} CPU threads")
import torch
if sys.argv[1].startswith("cuda") and not torch.cuda.is_available():
    done("torch", "")
else:
    device = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "CPU"
    done("torch", f"{torch.__version__} on {device}, {torch.get_num_threads()} CPU threads")
try:
    import pyoidn
    pyoidn.Device().commit()
    done("denoiser", "Open Image Denoise")
except Exception as error:
    done("no denoiser", f"{type(error).__name__}: {error}")
"""


def _probe(backend: variant.Backend) -> Iterator[Check]:
    environment = dict(os.environ)
    if backend.llvm is not None:
        environment[variant.LLVM_VARIABLE] = str(backend.llvm.path)
    try:
        process = subprocess.run(
            [sys.executable, "-c", _PROBE, backend.variant],
            capture_output=True,
            text=True,
            env=environment,
            timeout=120,
            check=False,
        )
        output, code, errors = process.stdout, process.returncode, process.stderr
    except subprocess.TimeoutExpired as error:
        output, code, errors = _text(error.stdout), None, "no answer within 120 s"
    steps = dict(json.loads(line) for line in output.splitlines() if line.startswith('["'))
    words = errors.strip().splitlines()
    why = words[-1] if words else f"exit code {code}"
    if code is not None and code < 0:
        why = f"the process was ended by signal {-code}: {words[0] if words else 'no message'}"

    used = f"{backend.device_name}, {steps.get('ray tracing', '')}"
    if "ray tracing" in steps:
        yield Check("ray tracing", "ok", used)
    else:
        remedy = REINSTALL if "Error" in why else variant.LLVM_REMEDY
        yield Check("ray tracing", "problem", f"{backend.device_name}: {why}", remedy)
        return
    if steps.get("torch"):
        yield Check("torch", "ok", steps["torch"])
    elif "torch" in steps:
        remedy = "install torch's CUDA build, or set FIPT_BACKEND=llvm"
        yield Check("torch", "problem", "rays on CUDA, but torch sees no CUDA device", remedy)
    else:
        yield Check("torch", "problem", f"cannot be loaded: {why}", REINSTALL)
        return
    if "denoiser" in steps:
        yield Check("denoiser", "ok", steps["denoiser"])
    else:
        found = f"Open Image Denoise cannot be loaded: {steps.get('no denoiser', why)}"
        yield Check("denoiser", "warning", found, f"results are noisier without it: {REINSTALL}")


def _text(output: bytes | str | None) -> str:
    """What a process wrote before its time was over: bytes even where text was asked for."""
    return output.decode("utf-8", "replace") if isinstance(output, bytes) else output or ""


def check_open3d() -> Check:
    """Import open3d, which fuses depth maps, in another process: the wheel lacks libraries of the system."""
    works, said = tried()
    if works:
        return Check("open3d", "ok", said)
    libraries = "sudo apt-get install libgl1 libegl1 libx11-6 libusb-1.0-0"
    remedy = "pip install 'fipt[geometry]'" if "ModuleNotFoundError" in said else libraries
    return Check("open3d", "warning", f"cannot be imported: {said}", f"only for meshes of photographs: {remedy}")


def check_memory() -> Check:
    """Check main memory, limits of containers included."""
    total = total_memory()
    found = f"{total / 1e9:.1f} GB"
    if total < LOW_MEMORY_GB * 1e9:
        remedy = "use smaller images, or the demo preset"
        return Check("memory", "warning", f"{found}, {LOW_MEMORY_GB:.0f} GB advised", remedy)
    return Check("memory", "ok", found)


def check_disk(results: Path) -> Check:
    """Check that the folder of the results can be written and has room."""
    folder = results.absolute()
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        found = f"{folder} is no folder that can be written"
        return Check("disk", "problem", found, "change its permissions, or use another folder")
    free = shutil.disk_usage(folder).free
    found = f"{free / 1e9:.1f} GB free in {folder}"
    if free < LOW_DISK_GB * 1e9:
        remedy = "free some space, or use another folder"
        return Check("disk", "warning", f"{found}, {LOW_DISK_GB:.0f} GB advised", remedy)
    return Check("disk", "ok", found)
