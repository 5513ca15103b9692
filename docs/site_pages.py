"""What the site adds to its pages when it is built: text that stands elsewhere in the repository.

A hook of MkDocs. Pages hold a line ``<!-- site: NAME -->``; what `PARTS` makes of NAME takes its place.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
_MARK = re.compile(r"^<!-- site: ([\w-]+) -->$", re.M)
_TITLE = re.compile(r"^# (.+)$", re.M)


def configuration() -> str:
    """``config/README.md`` without its title, its links seen from ``docs/reference/``."""
    text = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    return _TITLE.sub("", text, count=1).replace("](../docs/", "](../")


def changelog() -> str:
    """``CHANGELOG.md`` without its title."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return _TITLE.sub("", text, count=1).replace("](docs/", "](")


def command_line() -> str:
    """What ``fipt VERB --help`` prints, of every verb."""
    sys.path.insert(0, str(ROOT))
    from fipt.registry import VERBS

    return "\n".join(
        f"## fipt {name}\n\n{verb.help}\n\n```text\n{help_of(name)}\n```\n" for name, verb in VERBS.items()
    )


def help_of(name: str) -> str:
    """Help of a verb, as the command line prints it, 88 columns wide."""
    command = click_command(name)
    width: Any = {"terminal_width": 88, "max_content_width": 88}
    with command.make_context(f"fipt {name}", [], resilient_parsing=True, **width) as context:
        return command.get_help(context).strip()


def click_command(name: str):
    """The command behind a verb, with its options."""
    import typer

    from fipt.cli.verbs import command_of

    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(command_of(name))
    return typer.main.get_command(app)


def decisions() -> str:
    """List of the pages in ``docs/adr/``."""
    pages = sorted(path for path in (ROOT / "docs" / "adr").glob("0*.md") if path.stem != "0000-template")
    titles = {path: _TITLE.search(path.read_text(encoding="utf-8")) for path in pages}
    return "\n".join(f"- [{title[1] if title else path.stem}]({path.name})" for path, title in titles.items())


def modules(*patterns: str) -> str:
    """The line of mkdocstrings for every module that fits a pattern below ``fipt/``."""
    paths = [path for pattern in patterns for path in sorted((ROOT / "fipt").glob(pattern)) if path.stem[0] != "_"]
    return "\n\n".join("::: " + ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths)


PARTS: dict[str, Callable[[], str]] = {
    "configuration": configuration,
    "changelog": changelog,
    "command-line": command_line,
    "decisions": decisions,
    "api-config": lambda: modules("config/*.py"),
    "api-formats": lambda: modules("formats/*.py"),
    "api-model": lambda: modules("model/*.py"),
    "api-render": lambda: modules("render/*.py"),
    "api-scene": lambda: modules("scene/*.py"),
    "api-stages": lambda: modules("stages/*/settings.py", "stages/*/stage.py", "stages/*/*_stage.py"),
    "api-synthetic": lambda: modules("synthetic/*.py", "synthetic/scenefile/*.py"),
}


def on_page_markdown(markdown: str, **_: object) -> str:
    """Put the parts into a page."""
    return _MARK.sub(lambda mark: PARTS[mark[1]](), markdown)
