"""Code samples of the documentation: where they stand, and what is wrong with one."""

import importlib.util
import re
import shlex
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
_RULE = re.compile(r"^\s*(?:rule|checkpoint) (\w+):", re.M)


@dataclass(frozen=True)
class Sample:
    """A fenced block: its file, line, language and text."""

    file: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


def samples(language: str) -> list[Sample]:
    """All blocks of a language in the pages that describe the program as it is; decisions describe it as it was."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "config" / "README.md"]
    pages += [page for page in sorted((ROOT / "docs").rglob("*.md")) if page.parent.name != "adr"]
    found = []
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for block in _FENCE.finditer(text):
            if block[1] == language:
                line = text.count("\n", 0, block.start()) + 1
                found.append(Sample(str(page.relative_to(ROOT)), line, language, block[2]))
    return found


def commands(text: str) -> list[list[str]]:
    """The commands of a block of shell, as words, without comments."""
    joined = text.replace("\\\n", " ")
    lines = [part for line in joined.splitlines() for part in line.split("&&")]
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def problem(words: list[str]) -> str | None:
    """What is wrong with a command, None where nothing is known to be."""
    check = {"fipt": _fipt, "snakemake": _snakemake, "make": _make, "python": _python}.get(words[0])
    return check(words[1:]) if check else None


@cache
def site_pages() -> ModuleType:
    """``docs/site_pages.py``, which knows the commands behind the verbs."""
    spec = importlib.util.spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def targets() -> set[str]:
    """Names of the workflow's rules."""
    files = (ROOT / "fipt" / "workflow").rglob("*.smk")
    return {name for file in files for name in _RULE.findall(file.read_text(encoding="utf-8"))}


def _fipt(words: list[str]) -> str | None:
    from fipt.registry import VERBS

    verb, *rest = words
    if verb in ("--help", "--version", "VERB"):
        return None
    if verb not in VERBS:
        return f"no verb {verb}"
    parameters = site_pages().click_command(verb).params
    options = {name: parameter for parameter in parameters for name in (*parameter.opts, *parameter.secondary_opts)}
    given = [word.partition("=")[0] for word in rest if word.startswith("-")]
    unknown = [name for name in given if name not in {*options, "--help"}]
    if unknown:
        return f"fipt {verb} has no option {', '.join(unknown)}"
    called = {options[name].name for name in given if name in options}
    missing = [p.opts[0] for p in parameters if p.required and p.opts[0].startswith("-") and p.name not in called]
    if missing and "--help" not in given:
        return f"fipt {verb} needs {', '.join(missing)}"
    plain = _arguments(rest, options)
    if verb == "run" and len(plain) > 1 and plain[-1] not in targets() and "/" not in plain[-1]:
        return f"no target {plain[-1]}"
    return None


def _arguments(words: list[str], options: dict) -> list[str]:
    """Words that are no option and no value of one."""
    found, skip = [], False
    for word in words:
        if skip:
            skip = False
        elif word.startswith("-"):
            skip = word in options and not options[word].is_flag and "=" not in word
        else:
            found.append(word)
    return found


def _snakemake(words: list[str]) -> str | None:
    from snakemake.cli import get_argument_parser

    try:
        given = get_argument_parser().parse_args([word for word in words if word != "--"])
    except SystemExit:
        return f"snakemake does not know these options: {words}"
    unknown = [
        name for name in sorted(given.targets or ()) if name not in targets() and not name.startswith("results/")
    ]
    return f"no target {', '.join(unknown)}" if unknown else None


def _make(words: list[str]) -> str | None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    unknown = [word for word in words if "=" not in word and not re.search(rf"^{re.escape(word)}:", text, re.M)]
    return f"no target {', '.join(unknown)}" if unknown else None


def _python(words: list[str]) -> str | None:
    if words[:1] != ["-m"] or not words[1].startswith("benchmarks"):
        return None
    path = ROOT.joinpath(*words[1].split("."))
    return None if path.with_suffix(".py").is_file() or (path / "__main__.py").is_file() else f"no module {words[1]}"
