"""A small room as a scene file: a box of 4 x 2.5 x 3 m with y up, and what a test puts into it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

WALLS = """
<bsdf type="twosided" id="Wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.6 0.5 0.4"/></bsdf></bsdf>
<shape type="cube" id="walls">
  <transform name="to_world"><scale x="2" y="1.25" z="1.5"/><translate x="2" y="1.25" z="1.5"/></transform>
  <ref id="Wall"/>
</shape>
<shape type="rectangle" id="lamp">
  <transform name="to_world">
    <scale value="0.3"/><rotate x="1" angle="90"/><translate x="2" y="2.4" z="1.5"/></transform>
  <emitter type="area"><rgb name="radiance" value="5, 4, 3"/></emitter>
</shape>
<sensor type="perspective">
  <transform name="to_world"><lookat origin="0.5 1.2 1.5" target="3 1.2 1.5" up="0 1 0"/></transform>
</sensor>
"""


@pytest.fixture
def write_scene(tmp_path: Path) -> Callable[..., Path]:
    """Write a scene file of some elements and return its path."""

    def write(body: str, version: str = "3.0.0", walls: str = WALLS) -> Path:
        path = tmp_path / "scene.xml"
        path.write_text(f'<scene version="{version}">{walls}{body}</scene>')
        return path

    return write


@pytest.fixture
def parsed(tmp_path: Path, backend: object) -> Callable[[str], object]:
    """Parse one element, alone in a scene."""
    from fipt.synthetic.scenefile.xml import read_tree

    def parse(element: str) -> object:
        path = tmp_path / "one.xml"
        path.write_text(f'<scene version="3.0.0">{element}</scene>')
        return read_tree(path).root.children[-1]

    return parse
