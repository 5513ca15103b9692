"""The licence of every pinned package, from the metadata of what is installed.

python -m benchmarks.licences > docs/reference/licences.md
"""

import re
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

LOCK = Path(__file__).parents[1] / "requirements.lock"
FREE = re.compile(
    r"MIT|BSD|Apache|ISC|PSF|Python Software|CNRI|HPND|Zlib|Unlicense|Public Domain|0BSD|CC0|BSL-1|TOST|MPL|Mozilla",
    re.I,
)
"""Licences that ask nothing of what uses the package; the MPL binds its own files alone, TOST is nearly Apache's."""
OTHERS = {
    "codespell": "a tool of developers: nothing of it is imported or shipped",
    "docutils": "its parts under the GPL are an editor's mode; the rest is in the public domain or BSD",
}
"""Package -> why a licence that is not, or not only, one of these binds nothing here."""
HEAD = """# Licences

fipt is under the MIT licence. This table is made from the metadata of the packages in `requirements.lock`
(`python -m benchmarks.licences`); a test holds it against them. No licence forbids commercial use, and no copyleft
binds fipt. ffmpeg, which imageio-ffmpeg brings for videos, is a program of its own under the GPL.

| package | licence | |
|---|---|---|
"""


def packages() -> list[str]:
    """Names in the lock file."""
    lines = (line.split("#")[0].strip() for line in LOCK.read_text(encoding="utf-8").splitlines())
    return [line.split("==")[0] for line in lines if line]


def licence(package: str) -> str | None:
    """What a package states, in a line; None where it is not installed (packages of one system, or of one Python)."""
    try:
        found = distribution(package)
    except PackageNotFoundError:
        return None
    about = found.metadata
    stated = [about["License-Expression"]] if "License-Expression" in about else []
    kinds = [kind.split(" :: ")[-1] for kind in about.get_all("Classifier") or [] if kind.startswith("License :: ")]
    short = [text for text in about.get_all("License") or [] if text.strip() and len(text) < 60]
    return (stated or [", ".join(kinds)] if stated or kinds else short or [_in_file(found)])[0]


def _in_file(found: object) -> str:
    """Name of the licence whose text lies beside the package."""
    for file in getattr(found, "files", None) or []:
        if re.search(r"licen[cs]e|copying", file.name, re.I) and file.locate().is_file():
            text = " ".join(file.locate().read_text(encoding="utf-8", errors="replace").split())
            if "Permission is hereby granted, free of charge" in text:
                return "MIT (its file)"
            if "Redistribution and use in source and binary forms" in text:
                return "BSD (its file)"
    return "unknown"


def row(package: str, stated: str) -> str:
    """A line of the table."""
    return f"| {package} | {stated} | {OTHERS.get(package, '')} |"


def binding(package: str, stated: str) -> bool:
    """Whether a licence could bind what uses the package, or says nothing."""
    return package not in OTHERS and ("GPL" in stated or not FREE.search(stated))


def main() -> None:
    """Print the page."""
    known = {package: licence(package) for package in packages()}
    print(HEAD + "\n".join(row(package, stated) for package, stated in known.items() if stated))


if __name__ == "__main__":
    main()
