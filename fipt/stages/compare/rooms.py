"""Tables of several scenes as one: the mean of every figure over all of them."""

from collections.abc import Mapping, Sequence
from typing import Any

from fipt.stages.compare.table import Column, absent, filled_row, finished, mean_and_spread, rank

_RELIT = "relit_"
RELIT = Column(
    "relit",
    "Relit",
    "dB",
    "higher",
    (),
    text="Mean over the relight setups of a scene of the PSNR against its true pictures.",
)
"""Scenes have other setups: over several of them, only the mean over setups can be compared."""
_JOINED = ("inputs", "oracle", "not_estimated", "views", "findings")
"""Lists of a row that hold what any scene says."""


def across_rooms(tables: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Tables of scenes and, in the same form, the table of means over them.

    Parameters
    ----------
    tables
        Scene -> content of its table.json.

    Returns
    -------
    dict
        ``rooms``: the tables as they are; ``mean``: their mean. A figure that a method lacks in one scene has no mean.
    """
    rooms = {name: _with_relit(table) for name, table in tables.items()}
    first = next(iter(rooms.values()))
    columns = [
        Column(column["key"], column["label"], column["unit"], column["better"], (), text=column["text"])
        for column in first["columns"]
        if all(column["key"] in _keys(table) for table in rooms.values())
    ]
    kinds = {column["key"]: column["kind"] for column in first["columns"]}
    methods = dict.fromkeys(row["id"] for table in rooms.values() for row in table["methods"])
    found = {name: [row for table in rooms.values() for row in _rows(table, name)] for name in methods}
    rows = [_mean(own, columns) for own in found.values() if len(own) == len(rooms)]
    for column in columns:
        rank(rows, column)
    described = [
        {name: getattr(column, name) for name in ("key", "label", "unit", "better", "text")}
        | {"kind": kinds[column.key]}
        for column in columns
    ]
    missing = {
        name: "; ".join(
            f"in {room}: {absent(table).get(name, 'not compared')}"
            for room, table in tables.items()
            if not _rows(table, name)
        )
        for name, own in found.items()
        if len(own) < len(rooms)
    }
    return {"rooms": dict(tables), "mean": finished(rows, described, missing, {})}


def _keys(table: Mapping[str, Any]) -> set[str]:
    return {column["key"] for column in table["columns"]}


def _rows(table: Mapping[str, Any], method: str) -> list[Mapping[str, Any]]:
    """The row of a method; none where it was not compared."""
    return [row for row in table["methods"] if row["id"] == method]


def _with_relit(table: Mapping[str, Any]) -> dict[str, Any]:
    """The table with one column for all relight setups, their mean, in the place of the first, where there are some."""
    setups = [column["key"] for column in table["columns"] if column["key"].startswith(_RELIT)]
    if not setups:
        return dict(table)
    own = {name: getattr(RELIT, name) for name in ("key", "label", "unit", "better", "text")} | {"kind": "figure"}
    columns = [own if column["key"] == setups[0] else column for column in table["columns"]]
    columns = [column for column in columns if column["key"] not in setups]
    rows = []
    for row in table["methods"]:
        values = _means([row["figures"][key]["values"] for key in setups])
        rows.append({**row, "figures": {**row["figures"], RELIT.key: mean_and_spread(values)}})
    return {**table, "columns": columns, "methods": rows}


def _mean(rows: Sequence[Mapping[str, Any]], columns: Sequence[Column]) -> dict[str, Any]:
    """Row of a method over all scenes; of each seed the mean, then the mean and spread of seeds."""
    seeds = min(row["seeds"] for row in rows)
    figures = {
        column.key: mean_and_spread(_means([row["figures"][column.key]["values"][:seeds] for row in rows]))
        for column in columns
    }
    return filled_row(_said(rows), figures, seeds, rows[0]["random"])


def _said(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What is said of a method in any of the scenes; an import may have other settings in each."""
    joined: dict[str, Any] = {"label": " / ".join(dict.fromkeys(row["label"] for row in rows))}
    for name in _JOINED:
        known = [row[name] for row in rows if row[name] is not None]
        every = [entry for entries in known for entry in entries]
        joined[name] = [entry for k, entry in enumerate(every) if entry not in every[:k]] if known else None
    return {**rows[0], **joined}


def _means(rows: Sequence[Sequence[float | None]]) -> list[float | None]:
    """Mean of every column of some rows; None where one is not known."""
    return [
        None if any(value is None for value in values) else sum(values) / len(values)  # pyright: ignore[reportArgumentType, reportCallIssue]
        for values in zip(*rows, strict=True)
    ]
