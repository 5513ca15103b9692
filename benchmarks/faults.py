"""The table of planted faults: every test of tests/faults with its verdict, and counts for each class.

    python -m benchmarks.faults [--all] [--out docs/measurements]

A test passes if the words, the exit code and the files that are left are those that docs/robustness.md promises.
``--all`` prints a row for each fault; ``--out`` writes all of them to faults.md there.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from benchmarks.jobs import REPOSITORY
from fipt.formats.files import write_text

CLASSES = {
    "data_loss": "inputs that a run would clear",
    "geometry": "meshes",
    "cameras": "cameras",
    "alignment": "cameras",
    "checked": "cameras",
    "images": "pictures",
    "captures": "captures",
    "scene_files": "scene files",
    "configuration": "configuration",
    "parsers": "files that cannot be read",
    "between_stages": "files between stages: content",
    "arrays": "files between stages: form",
    "invariance": "what means nothing",
    "objects": "objects of setups",
    "after_the_fit": "what is asked of a fitted room",
    "origins": "files between stages: origin",
    "resources": "resources, signals, native code",
    "rooms": "new rooms, records, results of others",
    "planted": "sources, light, methods, options",
}
"""File of tests/faults -> class of its faults."""


class Verdicts:
    """A plugin of pytest that keeps how each test ended.

    Attributes
    ----------
    found
        (class, fault, verdict) of every test, in their order.
    """

    def __init__(self) -> None:
        self.found: list[tuple[str, str, str]] = []

    def pytest_runtest_logreport(self, report: object) -> None:
        """Keep the report of a test's call, or of what kept it from being called."""
        when, outcome, name = (str(getattr(report, key)) for key in ("when", "outcome", "nodeid"))
        if when == "call" or outcome != "passed":
            file, _, fault = name.partition("::")
            kind = CLASSES.get(Path(file).stem.removeprefix("test_"), file)
            self.found.append((kind, fault.removeprefix("test_").replace("_", " "), outcome))


def counts(found: Sequence[tuple[str, str, str]]) -> list[str]:
    """Rows of a table: tests and verdicts of each class, and of all."""
    kinds = list(dict.fromkeys(kind for kind, _, _ in found))
    rows = ["| class | faults | as promised | not | skipped |", "|---|---|---|---|---|"]
    for kind in [*kinds, "all"]:
        own = Counter(verdict for name, _, verdict in found if kind in (name, "all"))
        rows.append(f"| {kind} | {own.total()} | {own['passed']} | {own['failed']} | {own['skipped']} |")
    return rows


def listed(found: Sequence[tuple[str, str, str]]) -> list[str]:
    """Rows of a table of every fault."""
    rows = ["| class | fault | verdict |", "|---|---|---|"]
    rows += [f"| {kind} | {fault.replace('|', '/')} | {verdict} |" for kind, fault, verdict in found]
    return rows


def main() -> int:
    """Run the tests, and print the table."""
    import pytest

    parser = argparse.ArgumentParser("python -m benchmarks.faults", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--all", action="store_true", help="print a row for each fault")
    parser.add_argument("--out", type=Path, help="folder of faults.md")
    arguments = parser.parse_args()
    verdicts = Verdicts()
    quiet = ("-q", "-q", "--no-header", "--no-summary", "-p", "no:cacheprovider", "-n", "0")
    code = pytest.main([*quiet, str(REPOSITORY / "tests" / "faults")], plugins=[verdicts])
    print("\n".join(["", *counts(verdicts.found), *(["", *listed(verdicts.found)] if arguments.all else [])]))
    if arguments.out is not None:
        text = "\n".join(["# Planted faults", "", *counts(verdicts.found), "", *listed(verdicts.found)])
        write_text(arguments.out / "faults.md", text + "\n")
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
