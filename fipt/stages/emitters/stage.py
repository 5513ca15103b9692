"""``fipt emitters``: model and images -> emitting triangles of a round."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, DecisionsJson, EnvironmentFile, SamplesFolders, SettledFile, ShadingFolders

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import Emitters
    from fipt.scene.mesh import Mesh
    from fipt.scene.observed import ObservedShard
    from fipt.scene.review import ReviewDecisions
    from fipt.stages.emitters.extract import Extracted
    from fipt.stages.emitters.settings import EmittersSettings

log = logging.getLogger(__name__)

_BYTES_A_PIXEL = 1000
"""Of memory, for each pixel of the largest view: measured 995, where every pixel may show an emitter."""
_PIXEL_ON_DISK = 57
"""Bytes of nameless files for each pixel of the training views, 40 of them in later rounds."""
_MOST_ASKED = 40
"""Undecided regions that a person is asked about, the largest: of a noisy mesh there are hundreds of small ones."""
_MOST_NAMED = 3
"""Undecided regions that a warning names."""


@dataclass(frozen=True, kw_only=True)
class EmittersInputs:
    """Files of ``fipt emitters``."""

    dataset: DatasetFolder
    samples: SamplesFolders
    shading: ShadingFolders
    out: Annotated[Path, "File to write, emitters.npz; emitters.json comes beside it."]
    model: Annotated[Path | None, "Fitted model, where its emission mask decides."] = None
    decisions: DecisionsJson = ""
    cache: Annotated[Path | None, "Radiance cache; absent: light that no view shows is not looked for."] = None
    environment: EnvironmentFile = None
    settled: SettledFile = None
    previous: Annotated[Path | None, "Emitters of the round before, which stay where the loop has settled."] = None
    model_before: Annotated[Path | None, "Fitted model of the round before: it tells what is a mirror."] = None


def run(inputs: EmittersInputs, settings: "EmittersSettings") -> dict[str, Any]:
    """Extract the triangles that emit light and their radiance."""
    from fipt.scene.settled import read_state

    state = read_state(inputs.settled)
    if state is not None and state.settled is not None and inputs.previous is not None:
        _copy(inputs.previous, inputs.out)
        log.info("settled in round %d: the emitters of the round before stay", state.settled)
        return {"copied": True, "settled_in_round": state.settled}
    if settings.decide == "regions" and inputs.previous is not None and _without_light(inputs.previous, inputs):
        _copy(inputs.previous, inputs.out)
        log.warning("no emitter found: shading without any light tells no emitter, so that nothing is decided anew")
        return {"copied": True, "triangles": 0, "emitters": 0}
    return _found(inputs, settings)


def _copy(previous: Path, out: Path) -> None:
    """Take over the emitters of the round before, and their list."""
    from fipt.formats.files import copy_file

    for suffix in (".npz", ".json"):
        copy_file(previous.with_suffix(suffix), out.with_suffix(suffix))


def _without_light(previous: Path, inputs: EmittersInputs) -> bool:
    """Whether this round's shading was traced without a source of light: then every surface seems too bright."""
    from fipt.scene.emitters import read_emitters
    from fipt.scene.environment import read_environment

    return len(read_emitters(previous).triangle) == 0 and not read_environment(inputs.environment).radiance.any()


def _check_room(data: "Dataset", out: Path) -> None:
    """Refuse views that memory is too small for, or what is kept of them the disk."""
    from fipt.formats.files import check_disk, check_memory

    pixels = [camera.width * camera.height for camera in data.cameras if camera.split == "train"]
    check_memory(_BYTES_A_PIXEL * max(pixels, default=0), "the search for emitters", "use smaller images")
    check_disk(out.parent, _PIXEL_ON_DISK * sum(pixels), "the search for emitters")


def _found(inputs: EmittersInputs, settings: "EmittersSettings") -> dict[str, Any]:
    """Extract them; return the figures."""
    from fipt.errors import FiptError
    from fipt.formats.arrays import on_disk
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import undecided_facts, write_emitters
    from fipt.scene.environment import read_environment
    from fipt.scene.observed import read_observed, without_openings
    from fipt.scene.review import parse_decisions
    from fipt.stages.emitters.emitter_copies import copies_in_words
    from fipt.stages.emitters.extract import extract

    if settings.decide == "mask" and inputs.model is None:
        raise FiptError("emitters.decide: mask needs a fitted model; none is given", "give --model, or decide: regions")
    query_mask = None
    if settings.decide == "mask" and inputs.model is not None:
        from fipt.model.store import load_field

        field = load_field(inputs.model)
        if field.emission_network is None:
            raise FiptError(
                f"emitters.decide: mask needs a model with an emission mask; {inputs.model} has none",
                "fit it without --emitters, or set decide: regions",
            )
        query_mask = field.query_mask
    data = Dataset(inputs.dataset)
    _check_room(data, inputs.out)
    mesh = data.mesh()
    decided = parse_decisions(inputs.decisions, len(mesh.triangles))
    shards = read_observed(data, inputs.samples, inputs.shading, on_disk(inputs.out.parent))
    if read_environment(inputs.environment).emits:
        shards = without_openings(shards)
    extracted = extract(mesh, shards, query_mask, settings, decided)
    found = extracted.emitters
    guess: tuple[str, ...] = ()
    figures: dict[str, Any] = {}
    if settings.guess and inputs.cache is not None:
        found, guess, figures = _guessed(inputs, extracted, data, mesh, shards, decided)
    found = replace(found, undecided=found.undecided.largest(mesh.areas, _MOST_ASKED))
    write_emitters(inputs.out, found, mesh, data.radiance_scale)
    count = int(found.emitter.max(initial=-1)) + 1
    questions = undecided_facts(found.undecided, mesh)
    copies = copies_in_words(mesh, found, extracted.emitters.triangle[extracted.emitters.guessed])
    warnings = [*_warnings(found, count, decided, len(mesh.triangles)), *questions_in_words(questions), *copies, *guess]
    for warning in warnings:
        log.warning("%s", warning)
    if count == 0:
        log.warning("no emitter found; refined shading will have no light of its own")
    else:
        log.info("emitters: %d emitters of %d triangles", count, len(found.triangle))
    figures = {"triangles": len(found.triangle), "emitters": count, "undecided": len(questions), **figures}
    return figures | ({"warnings": warnings} if warnings else {})


def _guessed(
    inputs: EmittersInputs,
    extracted: "Extracted",
    data: "Dataset",
    mesh: "Mesh",
    shards: "Sequence[ObservedShard]",
    decided: "ReviewDecisions",
) -> tuple["Emitters", tuple[str, ...], dict[str, Any]]:
    """Emitters with what no view shows, warnings and figures about it."""
    import numpy as np

    from fipt.model.store import load_model
    from fipt.scene.change import read_change
    from fipt.scene.emitters import read_emitters
    from fipt.scene.environment import read_environment
    from fipt.scene.voxels import read_cache
    from fipt.stages.emitters.clusters import with_what_they_light
    from fipt.stages.emitters.emitter_copies import copied
    from fipt.stages.emitters.mirrors import shown_by_mirrors
    from fipt.stages.emitters.unseen_guess import with_guess

    assert inputs.cache is not None
    rejected, accepted = (_named(texts, len(mesh.triangles)) for texts in (decided.reject, decided.accept))
    at_most = np.full(len(mesh.triangles), np.inf)
    if inputs.model_before is not None:
        at_most = shown_by_mirrors(mesh, data, shards, load_model(inputs.model_before))
    at_most[rejected] = 0
    outside = read_environment(inputs.environment)
    before, raised = np.full(len(mesh.triangles), -1), np.zeros(len(mesh.triangles), bool)
    if inputs.previous is not None:
        last = read_emitters(inputs.previous, mesh)
        raised[last.triangle] = last.raised > 0
        own = last.guessed & ~copied(mesh, last)  # copies of lamps are guessed anew, and ask for nothing
        before[last.triangle[own]] = last.emitter[own]
    change = read_change(inputs.shading)
    asked = change is not None and change.light_missing
    cache = read_cache(inputs.cache)
    found, brighter = with_what_they_light(mesh, shards, extracted, cache, outside, raised, accepted)
    guessed = with_guess(mesh, shards, replace(extracted, emitters=found), cache, outside, at_most, before, asked)
    figures = {
        "raised": len(np.unique(found.emitter[found.raised > 0])),
        "area_in_mirrors": float(mesh.areas[np.isfinite(at_most) & ~rejected].sum()),
        **guessed.figures,
    }
    return guessed.emitters, (*brighter, *guessed.warnings), figures


def _named(texts: "Sequence[str]", triangles: int) -> "np.ndarray":
    """(T,) bool: triangles that a person named in some ranges."""
    import numpy as np

    from fipt.scene.review import numbers

    named = np.zeros(triangles, bool)
    for text in texts:
        named[sorted(numbers(text, triangles))] = True
    return named


def questions_in_words(regions: "Sequence[dict[str, Any]]") -> list[str]:
    """What a person is asked about regions that may emit, in one line: which triangles stands in the review file."""
    if not regions:
        return []
    largest = sorted(regions, key=lambda row: -row["area"])[:_MOST_NAMED]
    places = "; ".join(f"{row['area']:.3f} m2 near ({', '.join(f'{v:.2f}' for v in row['center'])})" for row in largest)
    more = f"; and {len(regions) - len(largest)} more" if len(regions) > len(largest) else ""
    return [
        f"emitter or mirror? The photographs do not tell for {len(regions)} regions: {places}{more}. "
        "Accept or reject them in emitters_review.yaml, or photograph them from other sides"
    ]


def _warnings(found: "Emitters", count: int, decided: "ReviewDecisions", triangles: int) -> list[str]:
    """What a person should know of the emitters found."""
    import numpy as np

    from fipt.scene.review import numbers

    warnings = []
    bounds = len(np.unique(found.emitter[found.lower_bound]))
    if bounds:
        warnings.append(f"{bounds} of {count} emitters are clipped in every exposure: their radiance is a lower bound")
    for text in decided.accept:
        if not np.isin(sorted(numbers(text, triangles)), found.triangle).any():
            warnings.append(f"no pixel shows the accepted triangles {text}: their radiance cannot be measured")
    return warnings
