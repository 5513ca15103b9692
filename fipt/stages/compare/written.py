"""The table of a comparison as Markdown and CSV."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any


def as_markdown(table: Mapping[str, Any]) -> str:
    """The table for people: our figures, then the published definitions, then the methods."""
    every = table["columns"]
    parts = ["# Comparison\n"]
    seeds = max((row["seeds"] for row in table["methods"]), default=1)
    parts.append(
        f"Held-out views. Means over {seeds} seeds, in parentheses the largest difference between seeds. " * (seeds > 1)
        + "Held-out views, one seed: no spread is known, and less than 0.3 dB is not ranked. " * (seeds == 1)
        + "Bold: the best, and what differs from it by less than the spread. Bounds are not ranked.\n"
    )
    parts.append(_grid([column for column in every if column["kind"] != "published"], table["methods"], oracle=True))
    published = [column for column in every if column["kind"] == "published"]
    parts.append("## As published tables count, training views\n")
    parts.append(_grid(published, table["methods"]))
    parts.append("## Methods\n")
    parts += [f"- **{row['label']}** (`{row['id']}`, {row['kind']}): {_about(row)}" for row in table["methods"]]
    parts += [f"- `{name}` is not applicable: {reason}." for name, reason in table["not_applicable"].items()]
    return "\n".join(parts) + "\n"


def _about(row: Mapping[str, Any]) -> str:
    text = f"{row['source']}."
    if row["deviations"] != "none":
        text += f" Deviates: {row['deviations']}."
    if row["not_estimated"]:
        text += f" Does not estimate {', '.join(row['not_estimated'])}."
    return text


def _grid(columns: Sequence[Mapping[str, Any]], rows: Sequence[Mapping[str, Any]], oracle: bool = False) -> str:
    units = [f", {column['unit']}" if column["unit"] and column["kind"] != "cost" else "" for column in columns]
    heads = [(column["label"] + unit).replace("|", "\\|") for column, unit in zip(columns, units, strict=True)]
    lines = [f"| method | {' | '.join(heads)} |{' from the truth |' if oracle else ''}"]
    lines.append("|---" * (len(columns) + 1 + oracle) + "|")
    for row in rows:
        cells = []
        for column in columns:
            cell = row["figures"][column["key"]]
            cells.append(f"**{cell['text']}**" if cell["first"] else cell["text"])
        truth = f" {', '.join(row['oracle']) or 'nothing'} |" if oracle else ""
        lines.append(f"| {row['label']} | {' | '.join(cells)} |{truth}")
    return "\n".join(lines) + "\n"


def as_csv(table: Mapping[str, Any]) -> str:
    """One row a method; of every figure its mean, and its spread over seeds; empty where it is not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = [column["key"] for column in table["columns"]]
    writer.writerow(
        ["method", "label", "kind", "oracle", "seeds", *(f for key in keys for f in (key, f"{key}_spread"))]
    )
    for row in table["methods"]:
        cells = [row["figures"][key][part] for key in keys for part in ("mean", "spread")]
        numbers = ["" if value is None else f"{value:.6g}" for value in cells]
        writer.writerow([row["id"], row["label"], row["kind"], "; ".join(row["oracle"]), row["seeds"], *numbers])
    return text.getvalue()
