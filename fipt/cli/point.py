"""``fipt point``: a pixel of a view -> where that is in the room, and which segment, for setups."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder.")],
    view: Annotated[str, typer.Argument(help="Name of a view.")],
    column: Annotated[float, typer.Argument(help="Column of its image, pixels from the left edge.")],
    row: Annotated[float, typer.Argument(help="Row, pixels from the upper edge.")],
    segments: Annotated[
        Path | None, typer.Option(help="fusion.npz; default: segments are the connected parts of the mesh.")
    ] = None,
) -> None:
    """Say which point of the room a pixel shows, in metres, and of which segment."""
    import numpy as np

    from fipt.errors import FiptError
    from fipt.render.variant import set_variant
    from fipt.scene.dataset import Dataset
    from fipt.scene.fusion import read_fusion

    data = Dataset(dataset)
    camera, mesh = data.camera(view), data.mesh()
    if not (0 <= column <= camera.width and 0 <= row <= camera.height):
        raise FiptError(
            f"{view} has {camera.width} x {camera.height} pixels; column {column:g}, row {row:g} is outside",
            "choose another",
        )
    set_variant()
    from fipt.render.edits import Segments
    from fipt.render.scene import RayScene

    ids = None if segments is None else read_fusion(segments)[0].part
    direction = camera.directions(np.array([column]), np.array([row]))
    distance, triangle = RayScene(mesh).intersect(camera.center, direction)
    if triangle[0] < 0:
        raise FiptError(f"column {column:g}, row {row:g} of {view} shows no surface", "choose another pixel")
    x, y, z = camera.center + distance[0] * direction[0]
    print(f"at: [{x:.3f}, {y:.3f}, {z:.3f}]")
    print(Segments(mesh, ids, "y").described(triangle[0]))
