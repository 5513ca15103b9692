"""Images of a setup's own cameras, shown as the report shows them and joined."""

from collections.abc import Sequence
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.exr import read_rgb
from fipt.formats.images import write_png
from fipt.formats.video import write_mp4
from fipt.progress import progress
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.display import tone_mapped
from fipt.scene.setup import CameraPath


def write_frames(folder: Path, cameras: Sequence[Camera], exposure: float) -> list[Path]:
    """Write ``folder``'s transforms.json, and a PNG image beside each EXR image, all at one exposure; return them.

    Raises
    ------
    FiptError
        If an image has not the size of its camera.
    """
    files = [folder / "transforms.json"]
    with progress("video", len(cameras), " images") as bar:
        for camera in cameras:
            path = folder / f"{camera.name}.exr"
            radiance = read_rgb(path)
            if radiance.shape[:2] != (camera.height, camera.width):
                raise FiptError(
                    f"{path} must be {camera.width}x{camera.height} like its camera; it is "
                    f"{radiance.shape[1]}x{radiance.shape[0]}",
                    "run fipt relight again",
                )
            files.append(path.with_suffix(".png"))
            write_png(files[-1], tone_mapped(radiance, exposure))
            bar.advance()
    write_transforms(files[0], list(cameras), folder="")
    return files


def write_film(folder: Path, path: CameraPath | None, frames: int, quality: int) -> Path | None:
    """Join the frames of a camera path to ``folder``.mp4, where it asks for that; else remove an earlier one."""
    film = folder.with_name(f"{folder.name}.mp4")
    if path is None or path.video != "mp4":
        film.unlink(missing_ok=True)  # of an earlier run with other settings
        return None
    write_mp4(film, folder, "frame-%04d.png", frames, path.fps, quality)
    return film
