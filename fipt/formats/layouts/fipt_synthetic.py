"""The published synthetic rooms of FIPT: transforms.json a split, numbered EXR files, truth beside them."""

import re
from pathlib import Path, PurePosixPath

from fipt.errors import FiptError
from fipt.formats.layouts.common import PosedViews, SourceView, numbered_file, pose_matrix
from fipt.formats.layouts.nerfstudio import pinhole_intrinsics, read_entries
from fipt.formats.text import MALFORMED


def read_fipt_synthetic(root: Path) -> PosedViews:
    """Read {train,val}/transforms.json; cameras have x left and look along +z."""
    frames = []
    for split in ("train", "val"):
        folder = root / split
        path = folder / "transforms.json"
        shared, entries = read_entries(path)
        for index, entry in enumerate(entries):
            where = f"{path}, frame {index}"
            try:
                file_path = str(entry.get("file_path", ""))
                matrix = pose_matrix(entry["transform_matrix"], flip=(-1, 1, -1))
                intrinsics = pinhole_intrinsics(where, {**shared, **entry})
            except MALFORMED as error:
                raise FiptError(f"{where} is malformed ({error!r})", "correct the file") from error
            # Published scenes number images by position; a number in file_path says the same.
            match = re.fullmatch(r"(\d+)(?:_0001)?(?:\.exr)?", PurePosixPath(file_path).name)
            number = match[1] if match else f"{index:03d}"
            image = numbered_file(folder / "Image", number)
            frames.append(
                SourceView(
                    f"{split}_{number}",
                    split,
                    image,
                    matrix,
                    intrinsics,
                    folder=folder,
                    number=number,
                )
            )
    return PosedViews(tuple(frames), root / "scene.obj", root)
