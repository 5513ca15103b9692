"""MP4 files: read back by the decoder."""

import subprocess

import imageio_ffmpeg
import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats import video
from fipt.formats.images import write_png


@pytest.mark.parametrize(("width", "height"), [(48, 32), (47, 31), (5, 32)])
def test_what_is_written_is_read(tmp_path, width, height):
    """Number, rate, colours and, of odd sizes, every pixel: the rest is a repeated edge."""
    colors = np.uint8([(200, 40, 30), (30, 180, 60), (40, 60, 220), (90, 90, 90)])
    for number, color in enumerate(colors, 1):
        write_png(tmp_path / f"frame-{number:04d}.png", np.broadcast_to(color, (height, width, 3)).copy())
    video.write_mp4(tmp_path / "film.mp4", tmp_path, "frame-%04d.png", 3, 12.5, 5)
    assert not list(tmp_path.glob(".*"))
    decode = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", tmp_path / "film.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(decode, capture_output=True, check=True)
    size = (width + width % 2, height + height % 2)
    for fact in (b"yuv420p(tv, bt709, ", f" {size[0]}x{size[1]}, ".encode(), b" 12.50 fps, "):
        assert fact in done.stderr
    shown = np.frombuffer(done.stdout, np.uint8).reshape(-1, *size[::-1], 3)
    assert len(shown) == 3  # not the fourth
    for frame, color in zip(shown, colors, strict=False):
        np.testing.assert_allclose(frame.reshape(-1, 3).astype(int), np.tile(color, (frame[..., 0].size, 1)), atol=6)


@pytest.mark.parametrize(
    ("error", "said"), [("x: No space left on device", "the disk is full"), ("", "ffmpeg ended with -9")]
)
def test_a_full_disk_and_a_killed_ffmpeg_say_so(tmp_path, monkeypatch, error, said):
    write_png(tmp_path / "frame-0001.png", np.zeros((4, 4, 3), np.uint8))
    ended = subprocess.CompletedProcess([], -9, "", error)
    monkeypatch.setattr(subprocess, "run", lambda *args, **keys: ended)
    with pytest.raises(FiptError, match=said):
        video.write_mp4(tmp_path / "film.mp4", tmp_path, "frame-%04d.png", 1, 10, 20)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["frame-0001.png"]


def test_what_ffmpeg_says_is_told_in_one_line(tmp_path, monkeypatch):
    write_png(tmp_path / "frame-0001.png", np.zeros((4, 4, 3), np.uint8))
    (tmp_path / "frame-0001.png").write_bytes((tmp_path / "frame-0001.png").read_bytes()[:60])
    with pytest.raises(FiptError, match=r"film\.mp4 could not be written: .*; set video: png"):
        video.write_mp4(tmp_path / "film.mp4", tmp_path, "frame-%04d.png", 1, 25, 20)
    assert [path.name for path in tmp_path.iterdir()] == ["frame-0001.png"]

    def nowhere():
        raise RuntimeError("No ffmpeg exe could be found")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", nowhere)
    with pytest.raises(FiptError, match="no ffmpeg was found"):
        video.write_mp4(tmp_path / "film.mp4", tmp_path, "frame-%04d.png", 1, 25, 20)
