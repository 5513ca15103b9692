"""Where the segment ids of a scene come from."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from pathlib import Path

from fipt.config.sources.base import Place, Source
from fipt.config.views import SceneViews
from fipt.errors import FiptError
from fipt.stages.segment.settings import GivenSegments, PredictedSegments

_FUSED = ("mask2former", "given", "degraded")
_REGROUPED = {
    "none": (),
    "grown": ("geometry",),
    "fused": ("geometry", *_FUSED),
    "all": ("geometry", *_FUSED, "dataset"),
}
"""Setting -> origins of ids that are regrouped."""


class SceneSegmentation:
    """Where the segment ids of a scene come from."""

    def __init__(self, place: Place, source: Source, views: SceneViews) -> None:
        self._place, self._source, self._views = place, source, views
        self._settings = place.settings["segment"]

    @cached_property
    def origin(self) -> str:
        """``dataset``, or a mode: mask2former, given, degraded, geometry, none.

        Raises
        ------
        FiptError
            If the source must be read to know it, and cannot be.
        """
        if self._settings.mode == "none" or self._place.settings["fit"].segments == "none":
            return "none"
        if self._settings.mode != "auto":
            return self._settings.mode
        return "dataset" if self._source.has_segments else "geometry"

    @property
    def is_fused(self) -> bool:
        """Whether ids are fused on the mesh."""
        return self.origin not in ("dataset", "none")

    def fused(self) -> list[str]:
        """Manifest of the fused ids; nothing where the dataset's are used, or none."""
        return [self._place.layout.fused] if self.is_fused else []

    @property
    def is_regrouped(self) -> bool:
        """Whether segments of one material are joined before each fit; that makes parts, whatever else there is."""
        wanted = self._place.settings["regroup"].ids
        if self._place.settings["fit"].segments == "semantic":
            return False
        return self.origin in _REGROUPED[wanted]

    def of_round(self, round: str) -> list[str]:
        """Manifest of the ids that the fit of a round takes; nothing where the dataset's are used, or none."""
        return [self._place.layout.regrouped.format(round=round)] if self.is_regrouped else self.fused()

    def by_view(self) -> list[str]:
        """Manifests of the training views' ids, where they are made view by view."""
        if self.origin not in _FUSED:
            return []
        return [self._place.layout.view_segments.format(shard=shard) for shard in self._views.shards("train")]

    def files(self) -> list[str]:
        """What the ids of views are made of beside the dataset: given ids, or a local folder of weights."""
        if isinstance(self._settings, PredictedSegments):
            folder = Path(self._model(self._settings))
            return sorted(str(path) for path in folder.glob("*") if path.suffix in (".json", ".safetensors"))
        if isinstance(self._settings, GivenSegments):
            from fipt.stages.segment.given import id_files

            return [str(path) for path in id_files(self._given(self._settings))]
        return []

    def check(self) -> None:
        """Look for given ids and weights in a folder: the stage that reads them may run hours after the start.

        Raises
        ------
        FiptError
            If a path is nothing, or a folder lacks ids of a training view or files of a network.
        """
        if self.origin == "given" and isinstance(self._settings, GivenSegments):
            from fipt.stages.segment.given import check_ids

            views: list[str] = []
            with suppress(FiptError):  # a source that cannot be read says so when it is
                views = self._views.of("train")
            check_ids(self._given(self._settings), views)
        if self.origin == "mask2former" and isinstance(self._settings, PredictedSegments):
            from fipt.stages.segment.checkpoint import is_place, model_folder

            model = self._model(self._settings)
            if is_place(model):
                model_folder(model)

    def _given(self, settings: GivenSegments) -> Path:
        return Path(self._place.path(settings.path, "settings.segment.path"))

    def _model(self, settings: PredictedSegments) -> str:
        return self._place.path(settings.model, "settings.segment.model")
