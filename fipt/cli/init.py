"""``fipt init``: the configuration of a new room."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    folder: Annotated[Path, typer.Argument(help="Folder of the new room; made if it is missing.")],
    source: Annotated[
        str, typer.Option(help="Where the room comes from: raw (photographs), dataset, mitsuba, procedural.")
    ] = "raw",
    path: Annotated[
        Path | None, typer.Option(help="Folder of photographs or of a dataset, or a Mitsuba scene file.")
    ] = None,
    mesh: Annotated[
        Path | None, typer.Option(help="Mesh of the room; default: that of a dataset, else made of the views.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the scene; default: that of the folder.")] = None,
    poses: Annotated[
        str | None, typer.Option(help="Of photographs: a file of poses; default: colmap, which estimates them.")
    ] = None,
    format: Annotated[
        str | None, typer.Option(help="Layout of a dataset: nerfstudio (default), fipt-synthetic, fipt-real.")
    ] = None,
    scan: Annotated[
        Path | None, typer.Option(help="Folder of many captures or data sets: write FOLDER/rooms.tsv, a line for each.")
    ] = None,
) -> None:
    """Write FOLDER/config/config.yaml for a new room, with comments. Nothing is overwritten."""
    if scan is not None:
        from fipt.config.scan import SHEET_FILE, write_rooms
        from fipt.errors import FiptError

        said = {"path": path, "mesh": mesh, "name": name, "poses": poses, "format": format}
        given = {"source": source != "raw", **{key: value is not None for key, value in said.items()}}
        other = next((key for key, is_given in given.items() if is_given), None)
        if other is not None:
            raise FiptError(f"--scan finds out what each room is; --{other} is of one room", "leave one of them out")
        rooms = write_rooms(folder, scan)
        print(
            f"{folder / SHEET_FILE} lists {len(rooms)} rooms: look through it, then\n    cd {folder}\n    fipt run all"
        )
        return
    from fipt.config.new import NewRoom, write_config

    chosen = name or folder.resolve().name
    room = NewRoom(source=source, name=chosen, path=path, mesh=mesh, poses=poses, format=format)
    file = write_config(folder, room)
    print(f"{file} is written: look through it, then\n    cd {folder}\n    fipt run {chosen}")
