"""The table of a comparison: mean and spread of every figure of every method, and who is first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Column:
    """A figure of the table.

    Attributes
    ----------
    key
        Its name in table.json.
    label, unit
        For people.
    better
        ``higher``, ``lower``, or empty: not ranked.
    place
        Where it stands in method.json.
    definition
        Its name in the definitions of metrics.json; empty: ``text`` says it.
    text
        What it means, where the metrics do not say.
    """

    key: str
    label: str
    unit: str
    better: str
    place: tuple[str, ...]
    definition: str = ""
    text: str = ""


_VAL, _PUBLISHED = ("figures", "val"), ("figures", "train", "published")
COLUMNS = (
    Column("kd_psnr", "kd", "dB", "higher", (*_VAL, "kd_psnr"), "kd_psnr"),
    Column("reflectance_psnr", "a'", "dB", "higher", (*_VAL, "reflectance_psnr"), "reflectance_psnr"),
    Column("roughness_l1", "Roughness", "L1", "lower", (*_VAL, "roughness_l1"), "roughness_l1"),
    Column("metallic_l1", "Metallic", "L1", "lower", (*_VAL, "metallic_l1"), "metallic_l1"),
    Column("emission_iou", "Emission", "IoU", "higher", (*_VAL, "emission_iou"), "emission_iou"),
    Column(
        "false_triangles",
        "False triangles",
        "",
        "lower",
        ("figures", "emitters", "false_triangles"),
        text="Triangles that are found to emit and do not.",
    ),
    Column(
        "log_radiance_error", "Log radiance", "|Δ ln|", "lower", (*_VAL, "log_radiance_error"), "log_radiance_error"
    ),
    Column("render_psnr", "Re-rendering", "dB", "higher", (*_VAL, "render_psnr"), "render_psnr"),
)
COSTS = (
    Column(
        "time_s",
        "Time",
        "s",
        "",
        ("time_s",),
        text="Wall time of all jobs that make materials and emitters, of those that methods share too; not of what is "
        "rendered to judge them.",
    ),
    Column("peak_memory_bytes", "Memory", "B", "", ("peak_memory_bytes",), text="Largest peak memory of these jobs."),
)
PUBLISHED = (
    Column("published_kd_psnr", "kd", "dB", "higher", (*_PUBLISHED, "kd_psnr"), "published"),
    Column("published_reflectance_psnr", "a'", "dB", "higher", (*_PUBLISHED, "reflectance_psnr"), "published"),
    Column("published_roughness_psnr", "Roughness", "dB", "higher", (*_PUBLISHED, "roughness_psnr"), "published"),
    Column("published_emission_iou", "Emission", "IoU", "higher", (*_PUBLISHED, "emission_iou"), "published"),
    Column("published_log_l2", "Emission", "log L2", "lower", (*_PUBLISHED, "log_l2"), "published"),
)

UNKNOWN = "–"  # noqa: RUF001 (a dash is meant)

ONE_SEED = {"dB": 0.3}
"""Differences that mean little with one seed (docs/measurements/accuracy.md), by unit."""

_SAID = ("id", "label", "kind", "source", "deviations", "inputs", "oracle", "not_estimated", "settings", "rounds")
_SENSITIVITY = ("series", "size", "unit", "findings")
"""Of an error that was planted: what it is, and what the findings say of it."""
_IMPORTED = ("views",)
"""Of outputs of another program: the views that alone are judged; none: all."""
_UNRANKED = ("bound", "sensitivity")


def comparison(
    runs: Sequence[Mapping[str, Any]], not_applicable: Mapping[str, str], failed: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Content of table.json.

    Parameters
    ----------
    runs
        Contents of method.json, in the order of the table; those of one method are its seeds.
    not_applicable
        Method -> why it cannot be compared here.
    failed
        Run of a method -> why it failed.
    """
    columns = [*COLUMNS, *_relit(runs), *COSTS, *PUBLISHED]
    methods: dict[str, list[Mapping[str, Any]]] = {}
    for run in runs:
        methods.setdefault(run["id"], []).append(run)
    rows = [_row(own, columns) for own in methods.values()]
    for column in columns:
        rank(rows, column)
    described = [_described(column, runs[0]["definitions"] if runs else {}) for column in columns]
    return finished(rows, described, not_applicable, failed or {})


def finished(
    rows: list[dict[str, Any]],
    described: list[dict[str, Any]],
    not_applicable: Mapping[str, str],
    failed: Mapping[str, str],
) -> dict[str, Any]:
    """Content of table.json of ranked rows: how columns and figures are read is filled in."""
    for column in described:
        column["noise"] = ONE_SEED.get(column["unit"], 0.0) if all(row["seeds"] == 1 for row in rows) else 0.0
    for row in rows:
        for column in described:
            cell = row["figures"][column["key"]]
            cell["text"] = with_spread(column, cell)
    return {
        "columns": described,
        "methods": rows,
        "not_applicable": dict(not_applicable),
        "failed": dict(failed),
    }


def absent(table: Mapping[str, Any]) -> dict[str, str]:
    """Methods and runs without figures -> what happened: rows of a table too."""
    states = {"not applicable": table["not_applicable"], "failed": table["failed"]}
    return {name: f"{state}: {why}" for state, found in states.items() for name, why in found.items()}


def _relit(runs: Sequence[Mapping[str, Any]]) -> list[Column]:
    setups = dict.fromkeys(setup for run in runs for setup in run["figures"]["relight"])
    return [
        Column(f"relit_{setup}", f"Relit: {setup}", "dB", "higher", ("figures", "relight", setup), "relight_psnr")
        for setup in setups
    ]


def _row(seeds: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> dict[str, Any]:
    figures = {}
    for column in columns:
        figures[column.key] = mean_and_spread([_value(run, column.place) for run in seeds])
    return filled_row(seeds[0], figures, len(seeds), seeds[0]["random"])


def filled_row(said: Mapping[str, Any], figures: Mapping[str, Any], seeds: int, random: bool) -> dict[str, Any]:
    """A row of the table: what is said of the method, and its figures."""
    own = {name: said[name] for name in _SAID} | {name: said.get(name) for name in (*_SENSITIVITY, *_IMPORTED)}
    return {**own, "random": random, "seeds": seeds, "figures": figures}


def mean_and_spread(values: Sequence[float | None]) -> dict[str, Any]:
    """Figure of a row from that of every seed; None where one is not known."""
    known = [value for value in values if value is not None]
    whole = len(known) == len(values) > 0
    return {
        "mean": sum(known) / len(known) if whole else None,
        "spread": max(known) - min(known) if whole and len(known) > 1 else None,
        "values": list(values),
        "first": False,
    }


def _value(run: Mapping[str, Any], place: tuple[str, ...]) -> float | None:
    found: Any = run
    for name in place:
        found = (found or {}).get(name)
    return found


def rank(rows: Sequence[dict[str, Any]], column: Column) -> None:
    """Mark who is first in a column: the best, and all whose distance to it is below the spread of one of both.

    Bounds, planted errors, methods that know the truth and those of a few views do not take part. Where a method has
    random numbers and one seed, the largest spread that is known in the column stands for its own, else `ONE_SEED`.
    What reads the same is equal.
    """
    sign = {"higher": 1, "lower": -1}.get(column.better)
    cells = [
        (row["figures"][column.key], row["random"])
        for row in rows
        if row["kind"] not in _UNRANKED
        and not row["oracle"]
        and not row["views"]
        and row["figures"][column.key]["mean"] is not None
    ]
    if sign is None or not cells:
        return
    known = [cell["spread"] for cell, _ in cells if cell["spread"] is not None]
    typical = max(known, default=ONE_SEED.get(column.unit, 0.0))
    described = {"key": column.key, "unit": column.unit}

    def spread(cell: Mapping[str, Any], random: bool) -> float:
        if cell["spread"] is not None:
            return cell["spread"]
        return typical if random else 0.0

    best, best_random = max(cells, key=lambda entry: sign * entry[0]["mean"])
    for cell, random in cells:
        noise = max(spread(best, best_random), spread(cell, random))
        alike = shown(described, cell["mean"]) == shown(described, best["mean"])
        cell["first"] = alike or sign * (best["mean"] - cell["mean"]) <= noise


def _described(column: Column, definitions: Mapping[str, Any]) -> dict[str, Any]:
    text = definitions[column.definition]["text"] if column.definition in definitions else column.text
    kind = "published" if column in PUBLISHED else "cost" if column in COSTS else "figure"
    shown = {name: getattr(column, name) for name in ("key", "label", "unit", "better")}
    return {**shown, "kind": kind, "text": text}


def shown(column: Mapping[str, Any], value: float | None) -> str:
    """Format a figure by its column: one decimal for dB, minutes and MB for costs, three decimals for others."""
    if value is None:
        return UNKNOWN
    if column["key"] == "time_s":
        return f"{value:.0f} s" if value < 100 else f"{value / 60:.1f} min"
    if column["key"] == "peak_memory_bytes":
        return f"{value / 1e6:.0f} MB"
    if column["key"] == "false_triangles":
        return f"{value:.0f}" if value == round(value) else f"{value:.1f}"
    return f"{value:.1f}" if column["unit"] == "dB" else f"{value:.3f}"


def with_spread(column: Mapping[str, Any], cell: Mapping[str, Any]) -> str:
    """Format the mean of a cell, and its spread over seeds where that shows."""
    text = shown(column, cell["mean"])
    if cell["spread"] is None or column["kind"] == "cost":
        return text
    spread = shown(column, cell["spread"])
    return text if float(spread) == 0 else f"{text} ({spread})"
