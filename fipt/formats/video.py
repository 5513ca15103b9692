"""MP4 videos: the only module that calls ffmpeg, whose program comes with the package imageio-ffmpeg."""

import errno
import os
import subprocess
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import atomic

_OTHERWISE = "set video: png, and join elsewhere"


def write_mp4(path: str | Path, images: Path, pattern: str, count: int, fps: float, quality: int) -> None:
    """Join numbered images into an MP4 (H.264, 4:2:0, BT.709) that browsers play.

    Parameters
    ----------
    images, pattern
        Folder, and file names such as ``frame-%04d.png``; numbers start at 1. All have one size.
    count
        So many images; more may lie there.
    fps
        Images a second.
    quality
        Constant rate factor, 0 (lossless) to 51.
    """
    width, height = _size(images / (pattern % 1))
    odd = (width % 2, height % 2)  # 4:2:0 wants even sizes: the last column or row is repeated
    filters = [f"pad={width + odd[0]}:{height + odd[1]}", f"fillborders=right={odd[0]}:bottom={odd[1]}:mode=smear"]
    color = "scale=in_range=full:out_range=tv:out_color_matrix=bt709,format=yuv420p"
    color += ",setparams=range=tv:colorspace=bt709:color_primaries=bt709:color_trc=bt709"
    with atomic(path) as temporary:
        command = [_program(), "-v", "error", "-nostdin", "-y", "-framerate", f"{fps:g}", "-start_number", "1"]
        command += ["-i", pattern, "-frames:v", str(count), "-vf", ",".join([*(filters if any(odd) else []), color])]
        command += ["-c:v", "libx264", "-crf", str(quality), "-preset", "slow"]
        command += ["-movflags", "+faststart", "-fflags", "+bitexact", str(temporary.resolve())]
        try:
            done = subprocess.run(command, cwd=images, capture_output=True, text=True, check=False)
        except OSError as error:
            raise FiptError(f"ffmpeg cannot be run: {command[0]} ({error.strerror})", _OTHERWISE) from error
        if done.returncode:
            if "No space left" in done.stderr:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # `atomic` says what to do
            why = done.stderr[-500:].strip() or f"ffmpeg ended with {done.returncode}"
            raise FiptError(f"{path} could not be written: {why}", _OTHERWISE)


def _size(path: Path) -> tuple[int, int]:
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.size
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise FiptError(f"{path} is not a readable image ({error})", "render it again") from error


def _program() -> str:
    import imageio_ffmpeg

    try:
        return imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise FiptError(f"no ffmpeg was found ({error})", "install it, or set video: png") from error
