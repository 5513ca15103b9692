"""One self-contained HTML page from what a results folder holds."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from fipt.conventions import LUMINANCE
from fipt.stages.report.content import TILES, Content, gather
from fipt.stages.report.images import DIFFERENCE_RANGE
from fipt.stages.report.mixer import Mixer
from fipt.stages.report.room import RoomModel
from fipt.stages.report.selection import EVERYTHING, Selection
from fipt.stages.report.settings import ReportSettings
from fipt.stages.report.views import COLUMNS

_FOLDER = Path(__file__).parent

_STYLES = ("style.css", "compare.css", "mixer.css", "room.css")
_SCRIPTS = ("script.js", "compare.js", "data.js", "mixer.js", "room.js")
"""In the order in which they run."""

_EMITTERS_SHOWN = 12
"""Emitters listed openly; the rest is folded."""


def build_page(results: Path, settings: ReportSettings, selection: Selection = EVERYTHING) -> str:
    """Return the page of a results folder (see `gather`): HTML that loads nothing from anywhere."""
    return render(gather(results, settings, selection))


def render(content: Content) -> str:
    """Fill the template; everything that comes from data is escaped."""
    return filled(
        "page.html",
        _STYLES,
        _SCRIPTS,
        content=content,
        columns=COLUMNS,
        tiles=TILES,
        difference_range=DIFFERENCE_RANGE,
        emitters_shown=_EMITTERS_SHOWN,
        mixer_facts=_mixer_facts(content.mixer),
        mixed_keys=[part.key for part in content.mixer.parts] if content.mixer else [],
        room_facts=_room_facts(content.room),
    )


def filled(template: str, styles: Sequence[str], scripts: Sequence[str], **values: Any) -> str:
    """Fill a template of this folder; style sheets and scripts of the folder become part of the page."""
    texts = [(_FOLDER / name).read_text(encoding="utf-8") for name in scripts]
    page = _environment().get_template(template)
    return page.render(
        style="\n".join((_FOLDER / name).read_text(encoding="utf-8") for name in styles),
        scripts=texts,
        script_hashes=[_digest(text) for text in texts],
        **values,
    )


@cache
def _environment() -> Environment:
    """Templates of this folder, which take half a second to compile: once for all pages of a process."""
    # autoescape on: names and messages of a scene are text, never markup.
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=number, figure=figure, duration=duration, size=size)
    return environment


def _digest(script: str) -> str:
    """By which the page's security policy knows a script."""
    return base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")


def _mixer_facts(mixer: Mixer | None) -> dict[str, Any] | None:
    """What mixer.js needs: everything but the images."""
    if mixer is None:
        return None
    parts = [{"key": part.key, "emitters": part.emitters, "radiance": part.radiance} for part in mixer.parts]
    views = [{"name": view.name, "width": view.width, "height": view.height} for view in mixer.views]
    return {"luminance": LUMINANCE, "parts": parts, "views": views}


def _room_facts(room: RoomModel | None) -> dict[str, Any] | None:
    """What room.js needs: everything but the model."""
    if room is None:
        return None
    emitters = [{"center": emitter.center} for emitter in room.emitters]
    return {"up": room.up, "viewpoints": [vars(place) for place in room.viewpoints], "emitters": emitters}


def number(value: float | None, digits: int = 3) -> str:
    """Format a number with so many significant digits; a dash where it is not known."""
    if value is None:
        return "–"  # noqa: RUF001 (a dash is meant)
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text else text


def figure(value: float | None, unit: str = "dB") -> str:
    """Format a figure of metrics.json: one decimal for dB, three for the others."""
    if value is None:
        return number(None)
    return f"{value:.1f}" if unit == "dB" else f"{value:.3f}"


def duration(seconds: float) -> str:
    """Format seconds as ``0.4 s``, ``12 s`` or ``3 min 05 s``."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def size(count: float) -> str:
    """Format bytes as MB or GB."""
    return f"{count / 1e9:.2f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"
