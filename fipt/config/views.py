"""The views of a scene, and the shards that jobs work on."""

from __future__ import annotations

from collections.abc import Sequence

from fipt.config.sources.base import Source


class SceneViews:
    """Views by split, cut into shards. The source is read when they are asked for.

    Parameters
    ----------
    source
        Where the views come from.
    size
        SceneViews in a shard.
    """

    def __init__(self, source: Source, size: int) -> None:
        self._source, self._size = source, size

    def of(self, *splits: str) -> list[str]:
        """Names of the views of splits, in the source's order."""
        return [name for split in splits for name in self._source.views[split]]

    def shards(self, *splits: str) -> dict[str, list[str]]:
        """Shard -> names of its views; for the splits named, or ``all``."""
        chosen = ("train", "val") if splits == ("all",) else splits
        return {shard: views for split in chosen for shard, views in self.cut(split, self.of(split)).items()}

    def cut(self, kind: str, names: Sequence[str]) -> dict[str, list[str]]:
        """Shards of any names; ``kind`` is the first part of a shard's name."""
        size = self._size
        parts = [list(names[start : start + size]) for start in range(0, len(names), size)]
        return {f"{kind}-{number:03d}": part for number, part in enumerate(parts)}

    def listed(self, shard: str) -> str:
        """Views of a shard, comma-separated."""
        return ",".join(self.shards("all")[shard])

    def olat_shards(self) -> dict[str, list[str]]:
        """Shards of the views that are rendered with one light at a time -> these views."""
        chosen = (self.of("val") or self.of("train"))[: self._source.place.settings["olat"].views]
        own = {shard: [view for view in views if view in chosen] for shard, views in self.shards("all").items()}
        return {shard: views for shard, views in own.items() if views}

    def olat_listed(self, shard: str) -> str:
        """Views of a shard that are rendered with one light at a time, comma-separated."""
        return ",".join(self.olat_shards()[shard])

    def held_out(self) -> str:
        """Views for judging, comma-separated."""
        return ",".join(self.of("val"))
