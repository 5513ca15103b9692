"""The table of a comparison as Markdown and CSV."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from fipt.stages.compare.table import absent


def as_markdown(table: Mapping[str, Any]) -> str:
    """The table for people: our figures, then the published definitions, then the methods."""
    parts = ["# Comparison\n", *_tables(table, "##"), "## Methods\n", *_methods(table)]
    return "\n".join(parts) + "\n"


def rooms_as_markdown(found: Mapping[str, Any]) -> str:
    """Tables of several scenes for people: the mean, the methods, then each scene."""
    rooms, mean = found["rooms"], found["mean"]
    parts = [f"# Comparison on {', '.join(rooms)}\n", "Means over these rooms.\n", *_tables(mean, "##")]
    parts += ["## Methods\n", *_methods(mean)]
    for name, table in rooms.items():
        parts += [f"\n## {name}\n", *_tables(table, "###")]
    return "\n".join(parts) + "\n"


def _tables(table: Mapping[str, Any], heading: str) -> list[str]:
    """Our figures, then the published definitions."""
    every, parts = table["columns"], []
    seeds = max((row["seeds"] for row in table["methods"]), default=1)
    parts.append(
        f"Held-out views. Means over {seeds} seeds, in parentheses the largest difference between seeds. " * (seeds > 1)
        + "Held-out views, one seed: no spread is known, and less than 0.3 dB is not ranked. " * (seeds == 1)
        + "Bold: the best, and what differs from it by less than the spread. Bounds are not ranked.\n"
    )
    parts.append(_grid([column for column in every if column["kind"] != "published"], table, oracle=True))
    published = [column for column in every if column["kind"] == "published"]
    parts.append(f"{heading} As published tables count, training views\n")
    parts.append(_grid(published, table))
    return parts


def _methods(table: Mapping[str, Any]) -> list[str]:
    return [f"- **{row['label']}** (`{row['id']}`, {row['kind']}): {_about(row)}" for row in table["methods"]]


def _about(row: Mapping[str, Any]) -> str:
    text = f"{row['source']}."
    if row["deviations"] != "none":
        text += f" Deviates: {row['deviations']}."
    if row["not_estimated"]:
        text += f" Does not estimate {', '.join(row['not_estimated'])}."
    return text


def _grid(columns: Sequence[Mapping[str, Any]], table: Mapping[str, Any], oracle: bool = False) -> str:
    units = [f", {column['unit']}" if column["unit"] and column["kind"] != "cost" else "" for column in columns]
    heads = [(column["label"] + unit).replace("|", "\\|") for column, unit in zip(columns, units, strict=True)]
    lines = [f"| method | {' | '.join(heads)} |{' from the truth |' if oracle else ''}"]
    lines.append("|---" * (len(columns) + 1 + oracle) + "|")
    for row in table["methods"]:
        cells = []
        for column in columns:
            cell = row["figures"][column["key"]]
            cells.append(f"**{cell['text']}**" if cell["first"] else cell["text"])
        truth = f" {', '.join(row['oracle']) or 'nothing'} |" if oracle else ""
        lines.append(f"| {row['label']} | {' | '.join(cells)} |{truth}")
    for name, why in absent(table).items():
        lines.append(f"| `{name}` | {why.replace('|', '/')} |" + " |" * (len(columns) - 1 + oracle))
    return "\n".join(lines) + "\n"


def as_csv(table: Mapping[str, Any]) -> str:
    """One row a method; of every figure its mean, and its spread over seeds; empty where it is not known."""
    keys = [column["key"] for column in table["columns"]]
    return _csv([_csv_head(keys), *_csv_rows(table, keys)])


def rooms_as_csv(found: Mapping[str, Any]) -> str:
    """One row a method and scene, those of the means first, with the scene ``mean``."""
    tables = {"mean": found["mean"], **found["rooms"]}
    keys = list(dict.fromkeys(column["key"] for table in tables.values() for column in table["columns"]))
    rows = [[name, *row] for name, table in tables.items() for row in _csv_rows(table, keys)]
    return _csv([["room", *_csv_head(keys)], *rows])


def _csv(rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _csv_head(keys: Sequence[str]) -> list[str]:
    return [
        "method",
        "label",
        "kind",
        "oracle",
        "seeds",
        "absent",
        *(name for key in keys for name in (key, f"{key}_spread")),
    ]


def _csv_rows(table: Mapping[str, Any], keys: Sequence[str]) -> list[list[Any]]:
    rows = []
    for row in table["methods"]:
        cells = [row["figures"].get(key, {}).get(part) for key in keys for part in ("mean", "spread")]
        numbers = ["" if value is None else f"{value:.6g}" for value in cells]
        rows.append([row["id"], row["label"], row["kind"], "; ".join(row["oracle"]), row["seeds"], "", *numbers])
    empty = [""] * (2 * len(keys))
    return [*rows, *([name, "", "", "", "", why, *empty] for name, why in absent(table).items())]
