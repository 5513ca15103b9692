"""Materials of Wavefront OBJ files: the files that they stand in, checked before anything takes them as they are."""

import logging
import math
import re
from collections.abc import Iterator
from pathlib import Path

from fipt.errors import FiptError

log = logging.getLogger(__name__)

_NUMBER = r"\s+[-+]?(?:\d+\.?|\.\d)[\deE+-]*"
_OPTIONS = re.compile(rf"^(?:-(?:[ost](?:{_NUMBER}){{1,3}}|mm(?:{_NUMBER}){{2}}|\w+\s+\S+)\s+)*")
"""Of a map: shift, scale and turbulence have up to three numbers, its base and gain two, all others have one word."""


class NamedFiles:
    """Contents of files beside ``folder`` by what lines of OBJ and MTL files say of them; trimesh asks for no more."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __getitem__(self, said: str) -> bytes:
        return (self._folder / named_file(said)).read_bytes()

    get = __getitem__


def named_file(said: str) -> str:
    """Name of a file in what a line says of it: after the options of a map, with the separators of any system."""
    return _OPTIONS.sub("", said.strip(), count=1).replace("\\", "/")


def named_files(path: Path, keyword: str) -> list[Path]:
    """Files beside ``path`` that its lines name after a keyword, there or not."""
    found = (re.match(rf"\s*{keyword}\s+(.+)", line, re.IGNORECASE) for _, line in _lines(path))
    return [path.parent / named_file(match[1]) for match in found if match]


def is_there(file: Path) -> bool:
    """Whether a file is there; its name may be longer than any disk has."""
    try:
        return file.is_file()
    except OSError:
        return False


def material_files(path: Path) -> list[Path]:
    """Files of the materials of an OBJ file, there or not."""
    return named_files(path, "mtllib")


def texture_files(path: Path) -> list[Path]:
    """Images that a file of materials names, there or not."""
    return named_files(path, "map_Kd")


def defined_materials(path: Path) -> set[str]:
    """Names of the materials of an OBJ file that its MTL files define; a warning names what is not there.

    Raises
    ------
    FiptError
        If a number of a material cannot be, or an image cannot be read.
    """
    defined: set[str] = set()
    for file in material_files(path):
        if not is_there(file):
            log.warning("%s names the materials %.200s, which are not there: what has them is neutral", path, file)
            continue
        for number, line in _lines(file):
            _check_numbers(f"{file}, line {number}", line.split())
        defined |= {found[1].strip() for _, line in _lines(file) if (found := re.match(r"\s*newmtl\s+(.+)", line))}
        for image in texture_files(file):
            _check_image(file, image)
    used = {found[1].strip() for _, line in _lines(path) if (found := re.match(r"\s*usemtl\s+(.+)", line))}
    if defined and used - defined:
        log.warning("%s uses the material %s, which no file defines: what has it is neutral", path, min(used - defined))
    return defined


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    return enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1)


def _check_numbers(where: str, words: list[str]) -> None:
    """Refuse a colour or a shininess that is no number, or none that materials have."""
    wanted = {"Kd": (3, 1.0), "Ns": (1, 1e9)}.get(words[0] if words else "")
    if wanted is None or words[1:2] == ["spectral"]:
        return
    count, most = wanted
    try:
        values = [float(word) for word in words[1 : count + 1]]
    except ValueError:
        values = []
    if len(values) not in (1, count) or not all(math.isfinite(x) and 0 <= x <= 1.001 * most for x in values):
        number = "three numbers" if count == 3 else "a number"
        raise FiptError(
            f"{where}: {words[0]} must be {number} from 0 to {most:g}; found {' '.join(words[1:])[:60]!r}", "correct it"
        )


def _check_image(file: Path, image: Path) -> None:
    from PIL import Image

    if not is_there(image):
        log.warning("%s names the image %.200s, which is not there: colours are those of Kd", file, image)
        return
    try:
        with Image.open(image) as opened:
            opened.load()
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise FiptError(
            f"{image} is not a readable image ({error})", f"replace it, or remove it from {file}"
        ) from error
