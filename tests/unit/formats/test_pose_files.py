"""Poses of other programs: COLMAP writes its own files, scipy turns Metashape's and RealityCapture's cameras."""

import cv2  # noqa: F401 (before pycolmap)
import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fipt.errors import FiptError
from fipt.formats.pose_files import is_pose_file, pose_model_files, read_pose_file
from fipt.scene.sources import read_poses

FLIP = np.diag([1.0, -1, -1, 1])
"""Between axes with y down that look along +z, and OpenGL's."""


def poses(count=3):
    """(N, 4, 4) random world_from_camera, OpenGL axes."""
    rng = np.random.default_rng(5)
    found = np.tile(np.eye(4), (count, 1, 1))
    found[:, :3, :3] = Rotation.random(count, random_state=5).as_matrix()
    found[:, :3, 3] = rng.uniform(-3, 3, (count, 3))
    return found


def colmap_model(model, parameters):
    """COLMAP's own reconstruction of three images with points, one pose a picture."""
    made = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model=model, width=64, height=48, params=parameters, camera_id=1)
    made.add_camera_with_trivial_rig(camera)
    for number, pose in enumerate(poses(), start=1):
        view = np.linalg.inv(pose @ FLIP)[:3]
        points = pycolmap.Point2DList([pycolmap.Point2D(np.array([1.0, 2.0]))] * (number - 1))
        image = pycolmap.Image(name=f"room/view_{number}.png", camera_id=1, image_id=number, points2D=points)
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view))
    return made


@pytest.mark.parametrize("binary", [True, False])
def test_colmap_models(tmp_path, binary):
    made = colmap_model("OPENCV", [50.0, 51.0, 31.0, 23.0, 0.1, 0.0, 0.0, 0.0])
    (made.write_binary if binary else made.write_text)(tmp_path)
    assert is_pose_file(tmp_path)
    found = read_pose_file(tmp_path)
    assert sorted(p.name for p in found) == ["view_1", "view_2", "view_3"]
    for posed in found:
        expected = poses()[int(posed.name[-1]) - 1]
        np.testing.assert_allclose(posed.world_from_camera, expected, atol=1e-9)
        pinhole = {"w": 64, "h": 48, "fl_x": 50, "fl_y": 51, "cx": 31, "cy": 23}
        assert posed.intrinsics == pinhole | {"k1": 0.1, "k2": 0, "p1": 0, "p2": 0}
    frames = read_poses(tmp_path, val_every=2)
    assert [frame.split for frame in frames] == ["val", "train", "val"]


def test_colmap_cameras_with_one_focal_length_and_others(tmp_path):
    colmap_model("SIMPLE_RADIAL", [50.0, 31.0, 23.0, 0.1]).write_binary(tmp_path)
    assert read_pose_file(tmp_path)[0].intrinsics["fl_y"] == 50
    assert read_pose_file(tmp_path)[0].intrinsics["k1"] == 0.1
    colmap_model("OPENCV_FISHEYE", [50.0, 51.0, 31.0, 23.0, 0, 0, 0, 0]).write_binary(tmp_path)
    with pytest.raises(FiptError, match="cameras must be pinholes"):
        read_pose_file(tmp_path)
    data = (tmp_path / "images.bin").read_bytes()
    (tmp_path / "images.bin").write_bytes(data[: len(data) // 2])
    with pytest.raises(FiptError):
        read_pose_file(tmp_path)
    (tmp_path / "cameras.bin").unlink()
    with pytest.raises(FiptError, match="lacks"):
        read_pose_file(tmp_path)


def metashape(path, transform=True, component=False):
    """What Metashape exports, in a chunk that is turned, scaled and moved against the world."""
    turn, scale, shift = Rotation.from_euler("xyz", [20, 40, 60], degrees=True).as_matrix(), 2.5, [1.0, -2.0, 3.0]
    chunk = np.eye(4)
    chunk[:3, :3], chunk[:3, 3] = scale * turn, shift
    cameras = ""
    for number, pose in enumerate(poses()):
        local = np.eye(4)
        local[:3, :3] = turn.T @ pose[:3, :3]
        local[:3, 3] = np.linalg.solve(chunk, pose)[:3, 3]
        numbers = " ".join(f"{value:.15g}" for value in (local @ FLIP).ravel())
        own = ' component_id="0"' if component else ""
        name = f'id="{number}" sensor_id="0" label="IMG_{number}.ARW"{own}'
        cameras += f"<camera {name}><transform>{numbers}</transform></camera>"
    world = (
        f"<transform><rotation>{' '.join(map(repr, turn.ravel().tolist()))}</rotation>"
        f"<translation>{' '.join(map(str, shift))}</translation><scale>{scale}</scale></transform>"
    )
    if component:
        world = f'<components><component id="0">{world}</component></components>'
    path.write_text(
        '<document version="2.0.0"><chunk><sensors><sensor id="0" type="frame"><resolution width="64" height="48"/>'
        '<calibration type="frame" class="initial"><f>1</f></calibration>'
        '<calibration type="frame" class="adjusted"><f>50</f><cx>1.5</cx><k1>0.1</k1></calibration></sensor></sensors>'
        f'<cameras><group id="0">{cameras}</group><camera id="9" sensor_id="0" label="lost.ARW"/></cameras>'
        f"{world if transform else ''}</chunk></document>"
    )
    return path


@pytest.mark.parametrize("ending", ["txt", "bin"])
def test_the_files_of_a_model_are_named_not_its_folder(tmp_path, ending):
    """Files may change in place, of which the folder's own time knows nothing."""
    for name in ("cameras", "images"):
        (tmp_path / f"{name}.{ending}").touch()
    assert pose_model_files(tmp_path) == [str(tmp_path / f"{name}.{ending}") for name in ("cameras", "images")]
    assert pose_model_files(tmp_path / "cameras.xml") == [str(tmp_path / "cameras.xml")]


@pytest.mark.parametrize("component", [False, True])
def test_metashape(tmp_path, component):
    """Older exports have the transform in the chunk, newer ones in a component."""
    found = read_pose_file(metashape(tmp_path / "cameras.xml", component=component))
    assert [posed.name for posed in found] == ["IMG_0", "IMG_1", "IMG_2"]
    for posed, expected in zip(found, poses(), strict=True):
        np.testing.assert_allclose(posed.world_from_camera, expected, atol=1e-9)
        assert posed.intrinsics == {"w": 64, "h": 48, "fl_x": 50, "fl_y": 50, "cx": 33.5, "cy": 24, "k1": 0.1}
    unmoved = read_pose_file(metashape(tmp_path / "local.xml", transform=False))
    assert not np.allclose(unmoved[0].world_from_camera, poses()[0])
    (tmp_path / "cameras.xml").write_text("<document><chunk></document>")
    with pytest.raises(FiptError, match="not a readable list of cameras"):
        read_pose_file(tmp_path / "cameras.xml")


def test_reality_capture(tmp_path):
    """Heading 0 looks north with pitch 90; pitch 0 looks straight down; z is up and y north."""
    rows = ["#name,x,y,alt,heading,pitch,roll,f,px,py"]
    rows += ["down.jpg,1,2,3,0,0,0,24,0,0", "north.jpg,0,0,1,0,90,0,24,0,0", "east.jpg,0,0,1,90,90,0,24,0,0"]
    rng = np.random.default_rng(2)
    angles = rng.uniform(-80, 80, 3)
    rows.append(f"any.jpg,0,0,0,{angles[0]},{angles[1]},{angles[2]},24,0,0")
    path = tmp_path / "cameras.csv"
    path.write_text("\n".join(rows) + "\n")
    found = {posed.name: np.array(posed.world_from_camera) for posed in read_pose_file(path)}
    np.testing.assert_allclose(found["down"][:3, 3], [1, 2, 3])
    for name, ahead, up in (
        ("down", (0, 0, -1), (0, 1, 0)),
        ("north", (0, 1, 0), (0, 0, 1)),
        ("east", (1, 0, 0), (0, 0, 1)),
    ):
        np.testing.assert_allclose(-found[name][:3, 2], ahead, atol=1e-12)
        np.testing.assert_allclose(found[name][:3, 1], up, atol=1e-12)
    expected = Rotation.from_euler("ZXY", [-angles[0], angles[1], angles[2]], degrees=True).as_matrix()
    np.testing.assert_allclose(found["any"][:3, :3], expected, atol=1e-12)
    path.write_text(path.read_text().replace(",1,2,3,", ",4500000000,2,3,"))
    with pytest.raises(FiptError, match="positions must be metres"):
        read_pose_file(path)
    path.write_text("#name,x,y\na.jpg,1,2\n")
    with pytest.raises(FiptError, match="not a readable list of cameras"):
        read_pose_file(path)
