"""results/SCENE as an RO-Crate: ro-crate-metadata.json says in terms of schema.org what provenance.json says.

The crate is a Process Run Crate: every stage is an action of this program, with its settings and the files it wrote.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fipt.formats.files import write_text
from fipt.provenance import input_path, read_provenance

CRATE = "ro-crate-metadata.json"
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_CRATE_1_1 = {"@id": "https://w3id.org/ro/crate/1.1"}
_PROCESS_RUN = {"@id": "https://w3id.org/ro/wfrun/process/0.5"}
_PROGRAM = {"@id": "#fipt"}

Entity = dict[str, Any]


def write_crate(results: Path) -> Path:
    """Write ro-crate-metadata.json of a folder of results; return the file.

    Raises
    ------
    FiptError
        If nothing is known of the run.
    """
    content = {"@context": _CONTEXT, "@graph": list(entities(results, read_provenance(results)))}
    write_text(results / CRATE, json.dumps(content, indent=1) + "\n")
    return results / CRATE


def entities(results: Path, known: Mapping[str, Any]) -> Iterator[Entity]:
    """What a crate says of a run, given its folder and provenance; files that were removed on purpose are left out."""
    rows = {name: row for name, row in known["files"].items() if not row.get("tidied")}
    last = max((row["mtime_ns"] for row in rows.values()), default=0)
    stages = sorted({row["stage"] for row in rows.values()})
    inputs = {input_path(results, name).as_uri(): (name, row) for name, row in known["inputs"].items()}
    yield {"@id": CRATE, "@type": "CreativeWork", "conformsTo": _CRATE_1_1, "about": {"@id": "./"}}
    yield {
        "@id": "./",
        "@type": "Dataset",
        "name": results.name,
        "description": "Materials and lights of a room, by inverse path tracing of photographs",
        "datePublished": datetime.fromtimestamp(last / 1e9, UTC).isoformat(timespec="seconds"),
        "conformsTo": _PROCESS_RUN,
        "hasPart": [{"@id": name} for name in (*map(quote, rows), *inputs)],
        "mentions": [{"@id": f"#{stage}"} for stage in stages],
    }
    yield _PROGRAM | {
        "@type": "SoftwareApplication",
        "name": "fipt",
        "version": known["fipt"],
        "softwareRequirements": [f"{name} {version}" for name, version in sorted(known["packages"].items())],
        "processorRequirements": json.dumps(known["machine"], sort_keys=True),
    }
    for stage in stages:
        yield from _action(stage, known["stages"].get(stage), [name for name in rows if rows[name]["stage"] == stage])
    for name, row in rows.items():
        yield _file(quote(name), row)
    for identifier, (name, row) in inputs.items():
        yield _file(identifier, row) | {"name": name, "description": "read by the run"}


def _action(stage: str, how: Mapping[str, Any] | None, written: list[str]) -> Iterator[Entity]:
    """A stage, and its settings where they are known."""
    action = {
        "@id": f"#{stage}",
        "@type": "CreateAction",
        "name": f"fipt {stage}",
        "instrument": _PROGRAM,
        "result": [{"@id": quote(name)} for name in written],
    }
    if how is not None:
        settings = {"@id": f"#{stage}-settings", "@type": "PropertyValue", "name": "settings and version of the stage"}
        yield settings | {"value": json.dumps(how, sort_keys=True)}
        action["object"] = [{"@id": settings["@id"]}]
    yield action


def _file(identifier: str, row: Mapping[str, Any]) -> Entity:
    return {"@id": identifier, "@type": "File", "contentSize": str(row["size"]), "sha256": row["sha256"]}
