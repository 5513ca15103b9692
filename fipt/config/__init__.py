"""Which scenes, with which settings: what a person writes, checked, and what the workflow asks.

A scene's settings come from, later ones winning: the settings classes (which are the preset ``default``), what its
source changes in them, the scene's preset, the config's stage sections, the scene's own ``settings``. Nothing heavy is
loaded.

- `schema`: what a person writes; `sources`: one module a source of scenes; `sections`: stage sections and their layers
- `reading`: files and overrides to a checked `Configuration`; `renamed`: old names of keys
- `scene`: a `SceneConfig`, with `views`, `segmentation`, `setups` and `decisions`; `layout`: every path of its results
- `kept`: what a run reads is never cleared
- `documentation`: generated schema and tables of keys
"""

from fipt.config.layout import RESULTS, Layout
from fipt.config.reading import Configuration, load, read
from fipt.config.scene import SceneConfig

__all__ = ["RESULTS", "Configuration", "Layout", "SceneConfig", "load", "read"]
