"""Radiance RGBE pictures (.hdr): the usual form of environment maps beside OpenEXR."""

from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file


def read_hdr(path: str | Path) -> np.ndarray:
    """Read a .hdr picture whose rows go from top to bottom, flat or run-length coded.

    Returns
    -------
    (height, width, 3) float32 linear RGB.

    Raises
    ------
    FiptError
        If the file is missing, damaged or of another kind.
    """
    data = existing_file(path, "a .hdr picture").read_bytes()
    try:
        head, _, rest = data.partition(b"\n\n")
        size, _, body = rest.partition(b"\n")
        words = size.split()
        if not head.startswith(b"#?") or b"32-bit_rle_rgbe" not in head or words[0] != b"-Y" or words[2] != b"+X":
            raise ValueError("not RGBE with rows from top to bottom")
        height, width = int(words[1]), int(words[3])
        rgbe = _pixels(np.frombuffer(body, np.uint8), height, width)
    except (ValueError, IndexError) as error:
        raise FiptError(f"{path} is not a readable .hdr picture ({error})", "convert it to OpenEXR") from error
    scale = np.where(rgbe[..., 3:] > 0, np.exp2(rgbe[..., 3:].astype(np.float32) - 136.0), 0.0)
    return (rgbe[..., :3] * scale).astype(np.float32)


def _pixels(body: np.ndarray, height: int, width: int) -> np.ndarray:
    """(height, width, 4) bytes; each row is run-length coded by channel where it begins with 2, 2, width."""
    coded = 8 <= width < 32768 and len(body) > 4 and bytes(body[:4]) == bytes([2, 2, width >> 8, width & 255])
    if not coded:
        return body[: height * width * 4].reshape(height, width, 4)
    rows, place = np.empty((height, 4, width), np.uint8), 0
    for row in rows:
        place += 4
        for channel in row:
            column = 0
            while column < width:
                count = int(body[place])
                run = count > 128  # one value, repeated; otherwise so many values
                count -= 128 if run else 0
                if count == 0 or column + count > width:
                    raise ValueError("a row is too long")
                channel[column : column + count] = body[place + 1 : place + 1 + (1 if run else count)]
                place, column = place + (2 if run else 1 + count), column + count
    return rows.transpose(0, 2, 1)
