"""Other people's layouts of posed views, a reader each: the standard library alone, since plans are made from them.

Layouts, and the axes of their cameras (inside, every camera has OpenGL axes, see `fipt.conventions`):

========================  ==================================================  =====================
format                    files                                               axes
========================  ==================================================  =====================
``nerfstudio``            transforms.json, or Blender's                       x right, y up,
                          transforms_{train,val}.json; EXR images             looking along -z
``fipt-synthetic``        {train,val}/transforms.json, {train,val}/Image/     x left, y up,
                          NNN_0001.exr and truth beside it, scene.obj         looking along +z
``fipt-real``             cam.txt, K_list.txt, Image/NNN_0001.exr,            x right, y down,
                          segmentation/NNN.exr, scene.obj                     looking along +z
``fipt``                  a dataset folder of this program, with truth/ and   x right, y up,
                          segments/ where it has them                         looking along -z
========================  ==================================================  =====================
"""

from pathlib import Path

from fipt.formats.layouts.common import Matrix, PosedViews, SourceView, numbered_file
from fipt.formats.layouts.fipt_real import read_fipt_real
from fipt.formats.layouts.fipt_synthetic import read_fipt_synthetic
from fipt.formats.layouts.nerfstudio import DISTORTION, nerfstudio_views, read_nerfstudio
from fipt.formats.layouts.own import known_files, read_own

SEGMENT_FOLDERS = {"part": "IndexMA", "semantic": "segmentation"}
"""Kind of segment ids -> folder of the FIPT layouts, where the source has it."""

TRUTH_FOLDERS = {
    "kd": "DiffCol",
    "base_color": "BaseColor",
    "reflectance": "albedo",
    "emission": "Emit",
    "roughness": "Roughness",
    "metallic": "Metallic",
}
"""Layer of truth/{view}.exr -> folder of the FIPT synthetic layout, where the source has it."""

READERS = {
    "nerfstudio": read_nerfstudio,
    "fipt-synthetic": read_fipt_synthetic,
    "fipt-real": read_fipt_real,
    "fipt": read_own,
}
"""Name of a layout -> what reads it from its path."""

__all__ = [
    "DISTORTION",
    "READERS",
    "SEGMENT_FOLDERS",
    "TRUTH_FOLDERS",
    "Matrix",
    "PosedViews",
    "SourceView",
    "known_files",
    "nerfstudio_views",
    "numbered_file",
    "truth_and_ids",
]


def truth_and_ids(view: SourceView) -> list[Path]:
    """Truth and ids of a view of a FIPT folder, of which it has some."""
    if view.folder is None:
        return []
    folders = [view.folder / name for name in (*SEGMENT_FOLDERS.values(), *TRUTH_FOLDERS.values())]
    return [numbered_file(folder, view.number) for folder in folders if folder.is_dir()]
