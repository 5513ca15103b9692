"""What another program estimated of a scene, as the settings of a run of a method say."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from fipt.config.setups import SceneSetups
from fipt.config.sources.base import Place
from fipt.config.views import SceneViews
from fipt.errors import FiptError
from fipt.stages.import_results.files import OtherResults, found_results

if TYPE_CHECKING:
    from fipt.stages.import_results.settings import ImportResultsSettings


class OutputsOfOthers:
    """Files of another program, and the photographs with which they are compared.

    Parameters
    ----------
    settings
        Of the import.
    scene
        Name of the scene; of a run of a method that of its scene.
    place, views, setups
        Of the scene.
    """

    def __init__(
        self, settings: ImportResultsSettings, scene: str, place: Place, views: SceneViews, setups: SceneSetups
    ) -> None:
        self._settings, self._scene, self._place = settings, scene, place
        self._views, self._setups = views, setups

    def lack(self) -> str | None:
        """What is not there; None: nothing.

        Raises
        ------
        FiptError
            If a folder or setup that is named does not exist, or files of some views are missing.
        """
        settings, photographed = self._settings, self._setups.references()
        if settings.path is None:
            return "needs outputs of the program itself, and import_results.path names no folder of them"
        if settings.input == "reference" and not photographed:
            return "needs photographs of the room under another light, and no setup names any (setups.NAME.reference)"
        if settings.input == "reference" and settings.setup not in photographed:
            raise FiptError(
                f"import_results.setup must name a setup with photographs; found {settings.setup!r}",
                f"name one of {', '.join(photographed)}",
            )
        return None if self.files() else f"there are no outputs of this scene in {settings.path}"

    def files(self) -> list[str]:
        """All files; none where there is none of this scene."""
        return [str(path) for path in self._found().files()]

    def compared(self) -> list[str]:
        """Flag with the photographs under the setup that was relit, if there are both."""
        setup = self._settings.setup
        folder = self._setups.references().get(setup)
        return ["--reference", f"{setup}={folder}"] if folder and "relight" in self._found().images else []

    def setups(self) -> list[str]:
        """The setup that was relit, if there is truth of it: images of an earlier one do not count."""
        relit = "relight" in self._found().images
        return [name for name in self._setups.with_truth() if relit and name == self._settings.setup]

    def photographs(self) -> list[str]:
        """Photographs under the setup that was relit."""
        return list((self._photographed() or {}).values()) if self.compared() else []

    def _photographed(self) -> dict[str, str] | None:
        """Held-out view -> its photograph under the setup; None: the setup has none."""
        from fipt.scene.references import find_references

        folder = self._setups.references().get(self._settings.setup)
        if folder is None:
            return None
        return {view: str(path) for view, path in find_references(folder, self._views.of("val")).items()}

    def _found(self) -> OtherResults:
        settings = self._settings
        if settings.path is None:
            raise FiptError(f"{self._scene}: import_results.path must name a folder", "set it in the method's settings")
        placed = Path(self._place.path(settings.path, "settings.import_results.path"))
        if not placed.is_dir():
            raise FiptError(f"import_results.path must be a folder; there is none at {placed}", "correct the path")
        if settings.setup and settings.setup not in self._setups.given:
            raise FiptError(f"import_results.setup: there is no relight setup {settings.setup!r}", "name one of setups")
        settings = settings.model_copy(update={"path": str(placed)})
        views, held_out = self._views.of(settings.views), self._views.of("val")
        return found_results(settings, self._scene, views, held_out, self._photographed())
