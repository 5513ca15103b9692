"""Choice of the device that traces rays: CUDA where it works, else LLVM; decided once.

Dr.Jit compiles its kernels with a shared LLVM library of the system (no Python wheel carries one).
With LLVM 15 and older the *process* aborts in the middle of a kernel, so every library's version is
known here before Dr.Jit may load it: by the name of its file, else by asking it in another process. This
module imports neither Mitsuba nor torch until `set_variant` is called.
"""

from __future__ import annotations

import ctypes
import importlib.machinery
import logging
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, cast

from fipt.errors import FiptError

log = logging.getLogger(__name__)

#: Oldest LLVM that Dr.Jit 1.5 compiles our kernels with: 15 and older lack `fminimum` on vectors.
MIN_LLVM = 16
#: Names the LLVM library for Dr.Jit; if a user sets it, no other library is tried.
LLVM_VARIABLE = "DRJIT_LIBLLVM_PATH"
#: Forces the backend: ``llvm`` or ``cuda``.
BACKEND_VARIABLE = "FIPT_BACKEND"
#: Remedy for a missing or too old LLVM.
LLVM_REMEDY = (
    f"install LLVM {MIN_LLVM} or newer (Debian/Ubuntu: apt install libllvm19, "
    f"conda: conda install -c conda-forge libllvm19, macOS: brew install llvm) "
    f"or set {LLVM_VARIABLE} to its library file"
)

BackendName = Literal["cuda", "llvm"]


@dataclass(frozen=True)
class LlvmLibrary:
    """A shared LLVM library.

    Attributes
    ----------
    path : Path
        The file, links resolved.
    version : tuple of int
        ``(major, minor, ...)`` as far as known; empty if the file is no LLVM library for this machine.
    """

    path: Path
    version: tuple[int, ...]

    @property
    def usable(self) -> bool:
        """Whether Dr.Jit can compile our kernels with it."""
        return bool(self.version) and self.version[0] >= MIN_LLVM

    @property
    def version_text(self) -> str:
        """The version for people, such as ``19.1``."""
        return ".".join(map(str, self.version)) or "of unknown version"


@dataclass(frozen=True)
class CudaDriver:
    """What the NVIDIA driver says.

    Attributes
    ----------
    devices : tuple of str
        Names of the devices, in the driver's order.
    problem : str
        Why CUDA cannot be used; empty if it can.
    """

    devices: tuple[str, ...] = ()
    problem: str = ""

    @property
    def usable(self) -> bool:
        """Whether rays can be traced with CUDA."""
        return bool(self.devices) and not self.problem


@dataclass(frozen=True)
class Backend:
    """The chosen device.

    Attributes
    ----------
    name : {"cuda", "llvm"}
    variant : str
        Mitsuba's variant, such as ``llvm_ad_rgb``.
    device_name : str
        For people: the GPU's name, or ``CPU (LLVM 19.1)``.
    llvm : LlvmLibrary or None
        The library for Dr.Jit; always set where `name` is ``llvm``.
    """

    name: BackendName
    variant: str
    device_name: str
    llvm: LlvmLibrary | None

    @property
    def torch_device(self) -> Literal["cuda", "cpu"]:
        """The torch device that goes with it: ``cuda`` or ``cpu``."""
        return "cuda" if self.name == "cuda" else "cpu"


# --- LLVM ---------------------------------------------------------------------------------------


def find_llvm() -> LlvmLibrary | None:
    """Find the LLVM library that would be used, without loading it.

    Returns
    -------
    LlvmLibrary or None
        The library named by ``DRJIT_LIBLLVM_PATH`` if that is set, else the newest one on this
        machine; None if there is none. It may be too old: ask `LlvmLibrary.usable`.

    Raises
    ------
    FiptError
        ``DRJIT_LIBLLVM_PATH`` names a file that does not exist.
    """
    named = os.environ.get(LLVM_VARIABLE)
    if not named:
        found = list_llvm()
        return found[0] if found else None
    path = Path(named)
    if not path.is_file():
        # Dr.Jit also takes a bare name, which the system's loader looks up.
        matches = [library for library in list_llvm() if path.name == library.path.name]
        if path.name != named or not matches:
            raise FiptError(
                f"{LLVM_VARIABLE} names {named}, which is not a file",
                f"unset it, or name the library of LLVM {MIN_LLVM} or newer",
            )
        return matches[0]
    return LlvmLibrary(path.resolve(), llvm_version(path))


def list_llvm() -> list[LlvmLibrary]:
    """List the LLVM libraries of this machine, newest first; files that are none are left out."""
    paths = dict.fromkeys(path.resolve() for path in _candidates())
    libraries = [LlvmLibrary(path, version) for path in paths if path.is_file() and (version := llvm_version(path))]
    return sorted(libraries, key=lambda library: library.version, reverse=True)


def llvm_version(path: Path) -> tuple[int, ...]:
    """Find out the version of an LLVM library without loading it.

    Parameters
    ----------
    path : Path
        A shared library, or a link to one.

    Returns
    -------
    tuple of int
        ``(19, 1)`` for a file ``libLLVM.so.19.1``. A file whose name tells no version (macOS) is asked, in
        another process so that nothing can happen to this one. Empty if it is no LLVM library, or one of another
        architecture.
    """
    path = path.resolve()  # libLLVM-19.so and libLLVM.so are links to a file whose name tells more
    if not _for_this_machine(path):
        return ()
    # Up to LLVM 17 libLLVM-17.so.1 (the last number is no version), from 18 on libLLVM.so.18.1.
    match = re.match(r"libLLVM-(\d+(?:\.\d+)*)\.", path.name) or re.match(r"libLLVM\.so\.(\d+(?:\.\d+)*)", path.name)
    return tuple(map(int, match[1].split("."))) if match else _version_from_library(path)


def _for_this_machine(path: Path) -> bool:
    """Whether a binary begins like Python's own: same format and architecture. Mac files may hold several: all pass."""
    heads = []
    for binary in (path, Path(sys.executable)):
        try:
            with binary.open("rb") as file:
                heads.append(file.read(20))
        except OSError:
            return False  # unreadable: not a library this user can load
    # an ELF header: magic, word size, byte order; from byte 18 on the architecture
    found, own = ((head[:6], head[18:20]) for head in heads)
    return sys.platform == "darwin" or found == own


def _candidates() -> Iterable[Path]:
    folders = [Path(sys.prefix, "lib")]
    if os.environ.get("CONDA_PREFIX"):
        folders.append(Path(os.environ["CONDA_PREFIX"], "lib"))
    folders += [Path("/usr/lib"), Path("/usr/lib64"), Path("/usr/local/lib")]
    folders += Path("/usr/lib").glob("*-linux-gnu")  # Debian's folder per architecture
    folders += Path("/usr/lib").glob("llvm*/lib")
    folders += Path("/usr/lib64").glob("llvm*/lib")
    for homebrew in ("/opt/homebrew/opt", "/usr/local/opt"):
        folders += Path(homebrew).glob("llvm*/lib")
    for folder in folders:
        for pattern in ("libLLVM*.so*", "libLLVM*.dylib"):
            yield from folder.glob(pattern)
    yield from _linker_cache()


def _linker_cache() -> list[Path]:
    """Libraries that the loader knows: covers folders that only /etc/ld.so.conf.d names."""
    search = os.pathsep.join([os.environ.get("PATH", ""), "/sbin", "/usr/sbin"])
    ldconfig = shutil.which("ldconfig", path=search)
    if ldconfig is None or sys.platform == "darwin":
        return []
    listing = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
    return [Path(match) for match in re.findall(r"^\s*libLLVM\S* .*=> (\S+)$", listing, re.M)]


# LLVMGetVersion exists from LLVM 16 on: a library without it is LLVM, but too old.
_ASK_LIBRARY = """
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
library.LLVMContextCreate
if hasattr(library, "LLVMGetVersion"):
    numbers = [ctypes.c_uint() for _ in range(3)]
    library.LLVMGetVersion(*map(ctypes.byref, numbers))
    print(*(number.value for number in numbers))
else:
    print(15)
"""


@cache
def _version_from_library(path: Path) -> tuple[int, ...]:
    try:
        answer = subprocess.run(
            [sys.executable, "-I", "-c", _ASK_LIBRARY, str(path)],
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return ()
    return tuple(map(int, answer.stdout.split())) if answer.returncode == 0 else ()


# --- CUDA ---------------------------------------------------------------------------------------


@cache
def find_cuda() -> CudaDriver:
    """Ask the NVIDIA driver for its devices, through its own library and nothing else.

    Returns
    -------
    CudaDriver
        With the devices, or with the reason why CUDA cannot be used. ``CUDA_VISIBLE_DEVICES`` is
        respected by the driver itself. Asked once a process.
    """
    names = ("nvcuda.dll",) if sys.platform == "win32" else ("libcuda.so.1", "libcuda.so")
    driver = _load_first(names)
    if driver is None:
        return CudaDriver(problem="no NVIDIA driver (libcuda) on this machine")
    status = driver.cuInit(0)
    if status != 0:
        return CudaDriver(problem=f"the NVIDIA driver reports no usable device (error {status})")
    count = ctypes.c_int()
    status = driver.cuDeviceGetCount(ctypes.byref(count))
    if status != 0 or count.value == 0:
        return CudaDriver(problem="the NVIDIA driver reports no device")
    devices = []
    for index in range(count.value):
        device, text = ctypes.c_int(), ctypes.create_string_buffer(256)
        driver.cuDeviceGet(ctypes.byref(device), index)
        driver.cuDeviceGetName(text, len(text), device)
        devices.append(text.value.decode("utf-8", "replace"))
    # Mitsuba traces through OptiX, whose library belongs to the driver but is left out of
    # containers that were started without the "graphics" capability.
    optix = ("nvoptix.dll",) if sys.platform == "win32" else ("libnvoptix.so.1", "libnvoptix.so")
    if _load_first(optix) is None:
        return CudaDriver(tuple(devices), "the driver's OptiX library (libnvoptix) is missing")
    if not has_variant("cuda_ad_rgb"):
        return CudaDriver(tuple(devices), "the installed Mitsuba has no variant cuda_ad_rgb")
    return CudaDriver(tuple(devices))


def _load_first(names: Iterable[str]) -> ctypes.CDLL | None:
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue  # the next name, or None: the caller says what is missing
    return None


def has_variant(name: str) -> bool:
    """Whether the installed Mitsuba brings a variant, found without importing it."""
    # Not importlib.util.find_spec: once imported, Mitsuba names one of its libraries as its origin.
    spec = importlib.machinery.PathFinder.find_spec("mitsuba")
    if spec is None:
        return False
    folders = spec.submodule_search_locations or []
    return any(any(Path(folder).glob(f"{name}.*")) for folder in folders)


# --- the choice ---------------------------------------------------------------------------------


def choose_backend(preference: Literal["auto", "cuda", "llvm"] = "auto") -> Backend:
    """Choose the device: CUDA if it works, else LLVM.

    Parameters
    ----------
    preference : {"auto", "cuda", "llvm"}
        ``auto`` asks the environment variable ``FIPT_BACKEND`` first.

    Returns
    -------
    Backend

    Raises
    ------
    FiptError
        The backend asked for cannot be used here, or none can; says what to install.
    """
    if preference == "auto":
        preference = _preference_from_environment()
    if preference != "llvm":
        cuda = find_cuda()
        if cuda.usable:
            # Dr.Jit's CUDA backend needs no LLVM library.
            return Backend("cuda", "cuda_ad_rgb", cuda.devices[0], None)
        if preference == "cuda":
            raise FiptError(
                f"CUDA cannot be used: {cuda.problem}",
                f"install a current NVIDIA driver with OptiX, or set {BACKEND_VARIABLE}=llvm",
            )
    llvm = find_llvm()
    if llvm is None:
        what = "no LLVM library found" + (", and no CUDA device" if preference == "auto" else "")
        raise FiptError(what, LLVM_REMEDY)
    if not llvm.usable:
        what = f"LLVM {llvm.version_text}, too old for Dr.Jit" if llvm.version else "not LLVM"
        if not os.environ.get(LLVM_VARIABLE):
            raise FiptError(f"{llvm.path} is {what}", LLVM_REMEDY)
        newest = next(iter(list_llvm()), None)
        remedy = (
            f"unset it: {newest.path} is LLVM {newest.version_text}"
            if newest is not None and newest.usable
            else LLVM_REMEDY
        )
        raise FiptError(f"{LLVM_VARIABLE} names {llvm.path}, which is {what}", remedy)
    return Backend("llvm", "llvm_ad_rgb", f"CPU (LLVM {llvm.version_text})", llvm)


def _preference_from_environment() -> Literal["auto", "cuda", "llvm"]:
    value = os.environ.get(BACKEND_VARIABLE, "auto").strip().lower()
    if value not in ("auto", "cuda", "llvm", ""):
        raise FiptError(f"{BACKEND_VARIABLE} must be auto, cuda or llvm; it is '{value}'")
    return cast(Literal["auto", "cuda", "llvm"], value or "auto")


_active: Backend | None = None


def active_device() -> Literal["cuda", "cpu"]:
    """Where torch computes: with the backend in use, if this torch can; ``cpu`` where none has been chosen."""
    on_gpu = _active is not None and _active.torch_device == "cuda" and _torch_sees_cuda()
    return "cuda" if on_gpu else "cpu"


@cache
def _torch_sees_cuda() -> bool:
    import torch

    seen = torch.cuda.is_available()
    if not seen:
        log.warning("the GPU traces rays, but this torch sees none: networks are slow; install torch's CUDA build")
    return seen


def set_variant(backend: Backend | None = None, threads: int | None = None) -> Backend:
    """Set Mitsuba's variant for this process, and the number of threads.

    Call it before anything else that uses Mitsuba or Dr.Jit. Later calls only change the threads.

    Parameters
    ----------
    backend : Backend, optional
        Default: the one in use, else ``choose_backend()``.
    threads : int, optional
        CPU threads of Dr.Jit and of torch, >= 1; default: as they are. Results do not depend on it.

    Returns
    -------
    Backend
        The one in use.

    Raises
    ------
    FiptError
        No backend can be used; `threads` is below 1.
    RuntimeError
        Another backend is in use already: objects of two variants cannot be mixed.
    """
    global _active
    if threads is not None and threads < 1:
        raise FiptError(f"threads must be at least 1, got {threads}")
    if _active is None:
        chosen = backend or choose_backend()
        if chosen.llvm is not None:
            # Dr.Jit would otherwise take the first library it finds, which may be too old.
            os.environ[LLVM_VARIABLE] = str(chosen.llvm.path)
        else:
            # Memory of its own for each matrix product: their sums repeat. cuBLAS reads it when torch first uses it.
            os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
        import mitsuba

        mitsuba.set_variant(chosen.variant)
        _active = chosen
    elif backend is not None and backend.variant != _active.variant:
        raise RuntimeError(f"the variant is {_active.variant} already; {backend.variant} needs a new process")
    if threads is not None:
        _set_threads(threads)
    return _active


def _set_threads(threads: int) -> None:
    import drjit

    drjit.set_thread_count(threads)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(threads)
    else:
        # torch reads it when it is imported; importing it here would cost stages without
        # networks several seconds.
        os.environ["OMP_NUM_THREADS"] = str(threads)
