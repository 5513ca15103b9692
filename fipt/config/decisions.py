"""What a person decided about the emitters of a scene that were found."""

from __future__ import annotations

import re
from functools import cached_property
from pathlib import Path

from fipt.config.layout import Layout
from fipt.config.setups import SceneSetups
from fipt.errors import FiptError
from fipt.scene.review import Review, closest, read_review

_NUMBERED = re.compile(r"emitter-(0|[1-9]\d*)")
"""Names that every emitter has."""
_LONGEST = 100_000
"""Characters of decisions: Linux starts no command of 128 KiB, and a job's names files as well."""


class SceneDecisions:
    """What a person decided, in ``file``: results/SCENE/emitters_review.yaml, also for runs of methods on the scene.

    The file is no input of any job: what it says is passed as parameters, which run again what they change.
    """

    def __init__(self, scene: str, layout: Layout, setups: SceneSetups, file: Path) -> None:
        self._scene, self._layout, self._setups, self._file = scene, layout, setups, file

    @cached_property
    def review(self) -> Review:
        """What the file says; nothing where there is none.

        Raises
        ------
        FiptError
            If the file is wrong, or a setup names an emitter that nobody called so.
        """
        path = self._file
        found = read_review(path) or Review(0)
        for setup in self._setups.given:
            for name in self._named(setup):
                if name not in found.names():
                    raise FiptError(
                        f"setups.{setup} of scene {self._scene} names the emitter {name!r}, and none has this name",
                        f"name it in {path}, which a run without this setup writes; there are "
                        f"{closest(name, [*found.names(), 'emitter-N'])}",
                    )
        return found

    def emission(self) -> list[str]:
        """Options of ``fipt emitters`` that say what was decided; none where nothing was."""
        return self._option(self.review.emission())

    def listing(self) -> list[str]:
        """Options of ``fipt review`` that say how emitters are named, and which are rejected."""
        return self._option(self.review.listing())

    def names(self, setup: str) -> list[str]:
        """Manifest of the list of emitters, where a setup chooses some by what a person called them."""
        return [self._layout.listed_emitters] if self._named(setup) else []

    def _option(self, decisions: str) -> list[str]:
        if len(decisions) > _LONGEST:
            raise FiptError(
                f"{self._file}: decisions must be of at most {_LONGEST} characters; these are of {len(decisions)}",
                "decide about fewer triangles, or make a mesh of fewer",
            )
        return ["--decisions", decisions] if decisions else []

    def _named(self, setup: str) -> list[str]:
        called = [name for edit in self._setups.given[setup].emitters for name in edit.called]
        return [name for name in called if not _NUMBERED.fullmatch(name)]
