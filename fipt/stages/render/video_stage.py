"""``fipt video``: what a setup's own cameras see -> PNG images, their cameras, an MP4."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.conventions import SHOWN_VIEWS
from fipt.inputs import DatasetFolder, ManifestFile

if TYPE_CHECKING:
    from fipt.stages.render.settings import VideoSettings


@dataclass(frozen=True, kw_only=True)
class VideoInputs:
    """Files of ``fipt video``."""

    dataset: DatasetFolder
    cameras: Annotated[str, "The section cameras of the light setup, JSON."]
    images: Annotated[Path, "Folder of the images that fipt relight wrote."]
    manifest: ManifestFile
    max_views: Annotated[int, "Photographs that set the exposure: max_views of the section report."] = SHOWN_VIEWS


def run(inputs: VideoInputs, settings: "VideoSettings") -> dict[str, Any]:
    """Write IMAGES/*.png and IMAGES/transforms.json, and of a path IMAGES.mp4; one exposure for all."""
    from fipt.errors import FiptError
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.scene.dataset import Dataset
    from fipt.scene.display import common_exposure, shown_views
    from fipt.scene.setup import parse_cameras
    from fipt.settings import dumped
    from fipt.stages.render.cameras import own_cameras
    from fipt.stages.render.video import write_film, write_frames

    if inputs.max_views < 1:
        raise FiptError(f"--max-views must be at least 1; it is {inputs.max_views}", "give that of the report")
    data, own = Dataset(inputs.dataset), parse_cameras(inputs.cameras)
    cameras = own_cameras(own, data)
    photographs = (data.image(view)[0] for view in shown_views(data, inputs.max_views))
    exposure = settings.exposure or common_exposure(photographs)
    withdraw_manifest(inputs.manifest)
    files = write_frames(inputs.images, cameras, exposure)
    film = write_film(inputs.images, own.path, len(cameras), settings.quality)
    figures: dict[str, Any] = {"images": len(cameras), "exposure": exposure}
    if film is not None:
        files.append(film)
        figures["video_bytes"] = film.stat().st_size
    write_manifest(inputs.manifest, "video", files, {**dumped(settings), "cameras": dumped(own)})
    return figures
