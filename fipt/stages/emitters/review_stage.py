"""``fipt review``: emitters -> the list of emitters for people, and the file in which they decide."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, DecisionsJson, EmittersFile, SamplesFolders

if TYPE_CHECKING:
    import numpy as np

    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import Emitters
    from fipt.scene.samples import FootprintSamples
    from fipt.stages.emitters.review import Visibility
    from fipt.stages.emitters.settings import ReviewSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ReviewInputs:
    """Files of ``fipt review``."""

    dataset: DatasetFolder
    samples: SamplesFolders
    emitters: EmittersFile
    out: Annotated[Path, "Folder of emitters.json and the emitters' images."]
    review: Annotated[Path, "File for a person's decisions, emitters_review.yaml; they are kept."]
    decisions: DecisionsJson = ""


def run(inputs: ReviewInputs, settings: "ReviewSettings") -> dict[str, Any]:
    """List the emitters with names and images; bring emitters_review.yaml up to date.

    What may emit or reflect becomes an entry with an image too. What a person decided in that file stays, also if that
    happens meanwhile.

    Raises
    ------
    FiptError
        If ``out`` holds something else than an earlier list, or ``review`` is wrong.
    """
    import numpy as np

    from fipt.errors import FiptError
    from fipt.formats.files import ANYTHING, atomic_folder, manifest_beside
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import (
        emitter_triangles,
        question_triangles,
        read_emitters,
        write_list,
    )
    from fipt.scene.review import numbers, parse_decisions, read_review, refreshed, write_review
    from fipt.scene.samples import read_samples
    from fipt.settings import dumped
    from fipt.stages.emitters.review import emitter_names, review_entry, review_question, strange_files

    out, review = inputs.out, inputs.review
    if strange := strange_files(out):
        raise FiptError(f"the folder {out} is replaced, but holds {strange[0]}", "choose a folder for the list alone")
    data = Dataset(inputs.dataset)
    mesh = data.mesh()
    _check_decisions(review, len(mesh.triangles))  # refused now, not after all views were looked at
    found, shards = read_emitters(inputs.emitters, mesh), [read_samples(folder) for folder in inputs.samples]
    decided = parse_decisions(inputs.decisions, len(mesh.triangles))
    emitters = emitter_triangles(found)
    rejected = [np.array(sorted(numbers(text, len(mesh.triangles)))) for text in decided.reject]
    with atomic_folder(out, ANYTHING) as folder:
        rows, asked, written = _drawn(folder, found, (data, shards, settings.width), rejected)
        names = emitter_names(decided, emitters, len(mesh.triangles))
        for row, name in zip(rows, names, strict=True):
            row["name"] = name
        write_list(folder / "emitters.json", rows, asked)
        withdraw_manifest(manifest_beside(out))
    write_manifest(manifest_beside(out), "review", list(out.iterdir()), dumped(settings))
    shown = iter([None if file is None else f"{out.name}/{file}" for file in written])  # in the order of the shapes
    facts = [review_entry(row, own, next(shown)) for row, own in zip(rows, emitters, strict=True)]
    facts += [review_question(row, own, next(shown)) for row, own in zip(asked, question_triangles(found), strict=True)]
    images = {frozenset(own.tolist()): next(shown) for own in rejected}
    write_review(review, refreshed(read_review(review), facts, len(mesh.triangles), images))
    log.info("review: %d emitters listed in %s; decide about them in %s", len(emitters), out / "emitters.json", review)
    if asked:
        log.info("review: %d surfaces may emit or reflect, and are for you to decide there", len(asked))
    return {
        "emitters": len(emitters),
        "undecided": len(asked),
        "rejected": len(rejected),
        "named": len(decided.names),
    }


def _check_decisions(review: Path, triangles: int) -> None:
    """Raise FiptError if a file of decisions is wrong, or decides about another mesh."""
    from fipt.errors import FiptError
    from fipt.scene.review import read_review

    old = read_review(review)
    if old is not None and old.mesh_triangles != triangles and any(entry.decided for entry in old.entries):
        raise FiptError(
            f"{review} decides about triangles of a mesh of {old.mesh_triangles}; the mesh has {triangles}",
            "delete that file, or bring the mesh back",
        )


def _drawn(
    folder: Path,
    found: "Emitters",
    views: tuple["Dataset", list["FootprintSamples"], int],
    rejected: list["np.ndarray"],
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[str | None]]:
    """Write the images; return facts of emitters and questions, and their images, those of the rejected last."""
    from fipt.scene.emitters import (
        emitter_facts,
        emitter_triangles,
        in_source_unit,
        question_triangles,
        undecided_facts,
    )
    from fipt.stages.emitters.review import visibilities

    data, shards, _ = views
    mesh, emitters, questions = data.mesh(), emitter_triangles(found), question_triangles(found)
    shapes = [*emitters, *questions, *rejected]
    seen = visibilities(data, shards, shapes, len(mesh.triangles))
    files = [f"emitter-{n}.png" for n in range(len(emitters))] + [f"undecided-{n}.png" for n in range(len(questions))]
    files += [f"rejected-{own[0]}.png" for own in rejected]
    written = _write_thumbnails(folder, files, shapes, seen, views)
    rows, asked = (
        emitter_facts(in_source_unit(found, data.radiance_scale), mesh),
        undecided_facts(found.undecided, mesh),
    )
    for row, where, file in zip([*rows, *asked], seen, written, strict=False):
        row["seen_by"], row["thumbnail"] = where.views, file
    return rows, asked, written


def _write_thumbnails(
    folder: Path,
    files: list[str],
    triangles: list["np.ndarray"],
    seen: list["Visibility"],
    views: tuple["Dataset", list["FootprintSamples"], int],
) -> list[str | None]:
    """Write an image of every emitter that some view shows; return the names, None where there is none."""
    from fipt.formats.images import write_png
    from fipt.stages.emitters.review import thumbnail

    data, shards, width = views
    written: list[str | None] = []
    for file, own, where in zip(files, triangles, seen, strict=True):
        image = thumbnail(data, shards, where, own, width)
        written.append(None if image is None else file)
        if image is not None:
            write_png(folder / file, image)
    return written
