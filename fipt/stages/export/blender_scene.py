"""Open the exported room in Blender, and render a view of it if asked.

    blender --python blender.py                                  the room, its emitters and the cameras of all views
    blender --background --python blender.py -- VIEW OUT.exr     one image, path traced by Cycles

It needs the files beside it, and nothing of fipt. MIT licence.
"""

import json
import math
import sys
from pathlib import Path

import bpy

FOLDER = Path(__file__).resolve().parent


def load() -> dict:
    """Replace what is open by the room; return its cameras by view name."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(FOLDER / "scene.glb"))
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    # 32 surfaces on a path, as in the Mitsuba files of fipt's defaults; Cycles does not count the first
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 31
    scene.cycles.sample_clamp_indirect = 0
    scene.cycles.pixel_filter_type = "BOX"  # a pixel is the mean over its area
    # radiance times nothing, sRGB curve: what fipt's own images show
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    _shine_from_the_front()
    _light_from_outside(scene)
    return _cameras(scene)


def _shine_from_the_front() -> None:
    """Keep emitters of one side dark from behind: Cycles lets all shine from both."""
    for material in bpy.data.materials:
        if not material.use_backface_culling:  # what the import makes of a mesh that is not double-sided
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        strength = nodes["Principled BSDF"].inputs["Emission Strength"]
        geometry, front = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMath")
        front.operation = "MULTIPLY_ADD"  # strength - strength * backfacing
        front.inputs[1].default_value, front.inputs[2].default_value = -strength.default_value, strength.default_value
        links.new(geometry.outputs["Backfacing"], front.inputs[0])
        links.new(front.outputs["Value"], strength)


def _light_from_outside(scene: "bpy.types.Scene") -> None:
    """Black where no light comes from outside; else the map, which glTF has no place for."""
    world = scene.world or bpy.data.worlds.new("outside")
    scene.world = world
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    environment, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    environment.inputs["Color"].default_value = (0, 0, 0, 1)
    links.new(environment.outputs["Background"], output.inputs["Surface"])
    path = FOLDER / "textures" / "environment.exr"
    if not path.is_file():
        return
    image, mapping = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeMapping")
    coordinates = nodes.new("ShaderNodeTexCoord")
    image.image = bpy.data.images.load(str(path))
    # the map's centre is seen along y here, Blender's along x
    mapping.inputs["Rotation"].default_value = (0, 0, -math.pi / 2)
    links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], image.inputs["Vector"])
    links.new(image.outputs["Color"], environment.inputs["Color"])


def _cameras(scene: "bpy.types.Scene") -> dict:
    """Complete the cameras by what glTF cannot say: size of the image and of its pixels, principal point."""
    frames = json.loads((FOLDER / "cameras" / "transforms.json").read_text(encoding="utf-8"))["frames"]
    found = {}
    for frame in frames:
        name = Path(frame["file_path"]).stem
        camera = bpy.data.objects[name]
        tall = frame["fl_x"] / frame["fl_y"]  # height of a pixel over its width
        width, height = frame["w"], tall * frame["h"]
        # shifts are in units of the side that the field of view is given for
        unit = {"HORIZONTAL": width, "VERTICAL": height, "AUTO": max(width, height)}[camera.data.sensor_fit]
        camera.data.shift_x = (width / 2 - frame["cx"]) / unit
        camera.data.shift_y = (tall * frame["cy"] - height / 2) / unit
        camera["size"] = (frame["w"], frame["h"])
        camera["pixel"] = (max(1 / tall, 1.0), max(tall, 1.0))  # Blender has none below 1
        found[name] = camera
    if found:
        show(scene, next(iter(found.values())))
    return found


def show(scene: "bpy.types.Scene", camera: "bpy.types.Object") -> None:
    """Look through a view's camera."""
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = camera["size"]
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = camera["pixel"]
    scene.render.resolution_percentage = 100


def render(camera: "bpy.types.Object", path: Path, samples: int = 256) -> None:
    """Path trace a view; OpenEXR holds linear radiance, PNG the image as shown."""
    scene = bpy.context.scene
    show(scene, camera)
    scene.cycles.samples = samples
    exr = path.suffix.lower() == ".exr"
    scene.render.image_settings.file_format = "OPEN_EXR" if exr else "PNG"
    if exr:
        scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(path.resolve())
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    cameras = load()
    wanted = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    if wanted:
        view, out = wanted
        render(cameras[view], Path(out))
