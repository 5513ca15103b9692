"""The script that opens the room in Blender."""

from pathlib import Path

from fipt.formats.files import write_text
from fipt.scene.asset import Asset

_SCRIPT = Path(__file__).with_name("blender_scene.py")


def write_blender(path: Path, asset: Asset) -> None:
    """Write the script beside scene.glb."""
    write_text(path, f"# {asset.name}\n{_SCRIPT.read_text(encoding='utf-8')}")
