"""The stage video: pictures of a setup's own cameras, shown as the report shows them and joined."""

from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.exr import read_rgb
from fipt.formats.images import write_png
from fipt.formats.manifests import Stats, write_manifest
from fipt.formats.video import write_mp4
from fipt.progress import progress
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset
from fipt.scene.display import common_exposure, shown_views, tone_mapped
from fipt.scene.setup import OwnCameras
from fipt.settings import dumped
from fipt.stages.render.cameras import own_cameras
from fipt.stages.render.settings import VideoSettings


def write_video(
    dataset: Path,
    own: OwnCameras,
    pictures: Path,
    manifest: Path,
    max_views: int,
    settings: VideoSettings,
    stats: Stats,
) -> None:
    """Write PNG pictures and transforms.json into ``pictures``, a path's video beside it, then their manifest.

    One exposure holds for all pictures: the stated one, else that of the report which shows ``max_views`` views.
    """
    data = Dataset(dataset)
    cameras = own_cameras(own, data)
    exposure = settings.exposure or common_exposure(data.image(view)[0] for view in shown_views(data, max_views))
    files = [pictures / "transforms.json"]
    with progress("video", len(cameras), " pictures") as bar:
        for camera in cameras:
            path = pictures / f"{camera.name}.exr"
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
    write_transforms(files[0], cameras, folder="")
    video = pictures.with_name(f"{pictures.name}.mp4")
    if own.path is not None and own.path.video == "mp4":
        write_mp4(video, pictures, "frame-%04d.png", len(cameras), own.path.fps, settings.quality)
        files.append(video)
        stats["video_bytes"] = video.stat().st_size
    else:
        video.unlink(missing_ok=True)  # of an earlier run with other settings
    stats["pictures"], stats["exposure"] = len(cameras), exposure
    write_manifest(manifest, "video", files, {**dumped(settings), "cameras": dumped(own)})
