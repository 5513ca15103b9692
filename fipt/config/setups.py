"""The relight setups of a scene: what they name, who sees them, what they are compared with."""

from __future__ import annotations

import json
from collections.abc import Mapping

from fipt.config.segmentation import SceneSegmentation
from fipt.config.sources.base import Place
from fipt.config.views import SceneViews
from fipt.formats.files import existing_file
from fipt.scene.setup import RelightSetup, check_keyframes
from fipt.settings import dumped


class SceneSetups:
    """The relight setups of a scene.

    Parameters
    ----------
    given
        Name -> setup.
    place
        What is known of the scene.
    views
        Its views.
    segmentation
        Where its segment ids come from.
    has_truth
        Whether there is a truth of views under another light: that of a known room.
    """

    def __init__(
        self,
        given: Mapping[str, RelightSetup],
        place: Place,
        views: SceneViews,
        segmentation: SceneSegmentation,
        has_truth: bool,
    ) -> None:
        self.given = dict(given)
        self._place, self._views, self._segmentation, self._has_truth = place, views, segmentation, has_truth

    # --- names

    def with_cameras(self) -> list[str]:
        """Setups with cameras of their own."""
        return [name for name, setup in self.given.items() if setup.cameras is not None]

    def of_views(self) -> list[str]:
        """Setups that views of the dataset see."""
        return [name for name, setup in self.given.items() if setup.cameras is None]

    def with_truth(self) -> list[str]:
        """Setups of which there can be true images: views of a known room, whose segments are parts of its mesh."""
        if not self._has_truth or not self.views():
            return []
        return [name for name in self.of_views() if not self._names_fused(name)]

    def _names_fused(self, setup: str) -> bool:
        """Whether a setup chooses segments that are fused from the views, not connected parts of the mesh."""
        return self.given[setup].chooses_segments and self._segmentation.is_fused

    def views(self) -> list[str]:
        """Views that setups without cameras of their own relight."""
        return [view for own in self._views.shards(self._place.settings["relight"].split).values() for view in own]

    # --- one setup

    def json(self, setup: str) -> str:
        """A setup as sorted JSON, for ``--setup``."""
        values = dumped(self.given[setup])
        del values["reference"]
        if values["cameras"] and values["cameras"]["path"]:
            for key in ("fps", "video"):  # other images do not follow from these
                del values["cameras"]["path"][key]
        return json.dumps(self._place.paths(values, f"setups.{setup}"), sort_keys=True)

    def cameras_json(self, setup: str) -> str:
        """A setup's own cameras as sorted JSON, for ``--cameras``."""
        return json.dumps(dumped(self.given[setup])["cameras"], sort_keys=True)

    def seen_options(self, setup: str, shard: str) -> list[str]:
        """The flag with a shard of the views that a setup relights, or of its own cameras, comma-separated."""
        flag = "--cameras" if self.given[setup].cameras else "--views"
        return [flag, ",".join(self.shards(setup)[shard])]

    def files(self, setup: str) -> list[str]:
        """Files that a setup names: another environment map, objects and mesh lights with their textures."""
        values = dumped(self.given[setup])
        entries = [values["environment"] or {}, *values["lights"], *values["objects"]]
        named = [entry["file"] for entry in entries if entry.get("file")]
        if not named:
            return []
        from fipt.scene.objects import object_files  # not for setups without files: it loads much

        files = [file for path in named for file in object_files(self._place.path(path, f"setups.{setup}"))]
        return list(dict.fromkeys(files))

    def shards(self, setup: str) -> dict[str, list[str]]:
        """Shards of the views that a setup relights, or of its own cameras.

        Raises
        ------
        FiptError
            If a camera path goes through a view that there is not.
        """
        own = self.given[setup].cameras
        if own is None:
            return self._views.shards(self._place.settings["relight"].split)
        if own.path is not None:
            check_keyframes(own.path, self._views.of("train", "val"))
        return self._views.cut("camera", own.names)

    # --- what jobs read

    def seen(self, setup: str) -> list[str]:
        """Manifests of what is rendered under a setup."""
        return [self._place.layout.relit.format(setup=setup, shard=shard) for shard in self.shards(setup)]

    def relit(self) -> list[str]:
        """Manifests of the views of the dataset under every setup that they see."""
        return [file for setup in self.of_views() for file in self.seen(setup)]

    def frames(self) -> list[str]:
        """Manifests of what is rendered of every setup with cameras of its own."""
        return [file for setup in self.with_cameras() for file in self.seen(setup)]

    def joined(self) -> list[str]:
        """Manifests of what setups' own cameras see."""
        return [self._place.layout.joined.format(setup=setup) for setup in self.with_cameras()]

    def truth(self) -> list[str]:
        """Manifests of the true images under setups."""
        pattern = self._place.layout.relight_truth
        return [pattern.format(setup=name, shard=shard) for name in self.with_truth() for shard in self.shards(name)]

    def fused(self, setup: str) -> list[str]:
        """Manifest of the fused ids, where a setup names some."""
        return self._segmentation.fused() if self._names_fused(setup) else []

    # --- photographs under other light

    def references(self) -> dict[str, str]:
        """Setup -> folder of photographs under its light."""
        given = {name: setup.reference for name, setup in self.given.items() if setup.reference is not None}
        return {name: self._place.path(path, f"setups.{name}.reference") for name, path in given.items()}

    def reference_options(self) -> list[str]:
        """Flags with the folders of photographs under the setups' lights."""
        return [text for setup, path in self.references().items() for text in ("--reference", f"{setup}={path}")]

    def reference_files(self) -> list[str]:
        """Photographs with which relit views are compared.

        Raises
        ------
        FiptError
            If a setup names a folder without any.
        """
        from fipt.scene.references import reference_files

        folders, views = self.references().values(), self.views()
        return [str(path) for folder in folders for path in reference_files(folder, views).values()]

    def check(self) -> None:
        """Look for the files and views that setups name: they may be read hours after the start.

        Raises
        ------
        FiptError
            If a file, a photograph or a keyframe's view is not there.
        """
        for setup in self.given:
            for path in self.files(setup):
                existing_file(path, f"a file of setups.{setup}")
        for setup in self.with_cameras():
            self.shards(setup)
        if self.references():
            self.reference_files()
