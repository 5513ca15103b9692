"""A relight setup: the room under other light, with other things in it, from other places."""

from collections.abc import Sequence
from difflib import get_close_matches
from operator import sub
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, model_validator

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED
from fipt.formats.yaml import read_yaml
from fipt.settings import (
    Angle,
    Count,
    Fraction,
    Length,
    Point,
    Reflectance,
    Rgb,
    Roughness,
    Settings,
    Turn,
    Weight,
)
from fipt.strict_json import parse_json
from fipt.validation import checked

_Lit = TypeVar("_Lit", bound=Settings)


class EmitterEdit(Settings):
    """A change to found emitters."""

    index: Count | None = Field(
        default=None, description="number of a lamp in emitters.json; every lamp where none is chosen"
    )
    name: str | None = Field(
        default=None, description="name of an emitter: `emitter-N`, or as emitters_review.yaml calls it"
    )
    names: tuple[str, ...] | None = Field(default=None, description="names of several lamps", min_length=1)
    off: bool = Field(default=False, description="switch off")
    scale: Weight | None = Field(default=None, description="radiance factor; 0 switches off")
    color: Rgb | None = Field(default=None, description="new chromaticity; the luminance is kept")
    radiance: Rgb | None = Field(default=None, description="new radiance")

    @model_validator(mode="before")
    @classmethod
    def _yaml_off(cls, values: Any) -> Any:
        """YAML reads the key ``off`` as the value false."""
        return {"off" if key is False else key: v for key, v in values.items()} if isinstance(values, dict) else values

    @model_validator(mode="after")
    def _agrees(self) -> "EmitterEdit":
        """Refuse what says two things at once."""
        chosen = [key for key in ("index", "name", "names") if getattr(self, key) is not None]
        if len(chosen) > 1:
            raise ValueError(f"lamps are chosen by one of index, name and names, not by {' and '.join(chosen)}")
        changed = [key for key in ("scale", "color", "radiance") if getattr(self, key) is not None]
        if self.off and changed:
            raise ValueError(f"off: true leaves no light for {' and '.join(changed)}")
        if self.color is not None and not any(self.color):
            raise ValueError("black is no color of light; switch off with off: true")
        return self

    @property
    def called(self) -> tuple[str, ...]:
        """Names by which the edit chooses lamps; none where it chooses by number, or all of them."""
        return self.names or ((self.name,) if self.name is not None else ())


class _AreaLight(Settings):
    radiance: Rgb = Field(description="of its surface")


class QuadLight(_AreaLight):
    """A rectangle that shines to both sides."""

    shape: Literal["quad"] = Field(description="a rectangle")
    center: Point = Field(description="metres")
    normal: Point = Field(default=(0.0, -1.0, 0.0), description="direction it faces")
    size: tuple[Length, Length] = Field(default=(0.5, 0.5), description="its sides, metres")

    @model_validator(mode="after")
    def _faces(self) -> Self:
        if max(map(abs, self.normal)) < 1e-6:
            raise ValueError("the normal of a new quad light must not be zero")
        return self


class SphereLight(_AreaLight):
    """A ball."""

    shape: Literal["sphere"] = Field(description="a ball")
    center: Point = Field(description="metres")
    radius: Length = Field(default=0.1, description="metres")


class MeshLight(_AreaLight):
    """The surface of a file."""

    shape: Literal["mesh"] = Field(description="the surface of a file")
    file: str = Field(description="PLY, OBJ or GLB; {data_root} is replaced")
    position: Point = Field(default=(0.0, 0.0, 0.0), description="where the origin of the file comes to lie")
    rotation: Turn = Field(default=(0.0, 0.0, 0.0), description="degrees about x, then y, then z of the world")
    scale: Length = Field(default=1.0, description="metres in a unit of the file")


class SpotLight(Settings):
    """A point that shines into a cone."""

    shape: Literal["spot"] = Field(description="a point that shines into a cone")
    intensity: Rgb = Field(description="along its axis, watts per steradian")
    position: Point = Field(description="metres")
    direction: Point | None = Field(default=None, description="along its axis; or give its target")
    target: Point | None = Field(default=None, description="point on its axis")
    cone_angle: float = Field(default=60.0, gt=0, le=178, description="of the whole cone, edge to edge, degrees")
    soft_edge: float = Field(
        default=5.0, gt=0, le=89, description="degrees inside the edge over which the light fades out"
    )

    @model_validator(mode="after")
    def _aimed(self) -> Self:
        if (self.direction is None) == (self.target is None):
            raise ValueError("a spot needs either direction or target")
        if not any(self.axis):
            raise ValueError("a spot's direction must not be zero, nor its target its position")
        if self.soft_edge > self.cone_angle / 2:
            raise ValueError(f"soft_edge must be at most half of cone_angle; found {self.soft_edge:g}")
        return self

    @property
    def axis(self) -> tuple[float, ...]:
        """Where it shines, of any length."""
        return tuple(map(sub, self.target, self.position)) if self.target is not None else self.direction or ()


AreaLight = QuadLight | SphereLight | MeshLight
"""A new light with a surface."""

NewLight = Annotated[AreaLight | SpotLight, Field(discriminator="shape")]
"""A light to add: an area light (quad, sphere, mesh of a file) or a spot, which is a point."""


class NewObject(Settings):
    """An object to put into the room."""

    file: str | None = Field(
        default=None, description="PLY, OBJ or GLB with its own materials; {data_root} is replaced"
    )
    shape: Literal["sphere", "cube"] | None = Field(default=None, description="or one of these, around its own centre")
    size: Length = Field(default=0.3, description="of a shape: diameter of the sphere, side of the cube, metres")
    position: Point = Field(description="where the file's origin, or the shape's centre, comes to lie")
    rotation: Turn = Field(default=(0.0, 0.0, 0.0), description="degrees about x, then y, then z of the world")
    scale: Length = Field(default=1.0, description="metres in a unit of the file")
    drop: bool = Field(default=False, description="falls straight down from there until it touches what is below")
    base_color: Reflectance | None = Field(default=None, description="instead of the object's own, linear RGB")
    roughness: Roughness | None = Field(default=None, description="instead of the object's own")
    metallic: Fraction | None = Field(default=None, description="instead of the object's own")

    @model_validator(mode="after")
    def _complete(self) -> "NewObject":
        if (self.file is None) == (self.shape is None):
            raise ValueError("an object needs either file or shape")
        return self


class BrushBox(Settings):
    """A box in the room."""

    center: Point
    size: tuple[Length, Length, Length] = Field(description="sides along x, y and z before it is turned, metres")
    rotation: Angle = Field(default=0.0, description="about the up axis, degrees, counter-clockwise from above")


class Removal(Settings):
    """What vanishes: a segment by its number or by a point of it, or what is in a box. One of the three."""

    segment: Count | None = Field(default=None, description="id of a fused segment, or of a connected part of the mesh")
    at: Point | None = Field(default=None, description="the segment or part of the surface nearest to this point")
    box: BrushBox | None = Field(default=None, description="triangles whose centre is in a box")

    @model_validator(mode="after")
    def _one(self) -> "Removal":
        if sum(value is not None for value in (self.segment, self.at, self.box)) != 1:
            raise ValueError("give one of segment, at and box")
        return self


class MaterialEdit(Removal):
    """Another material on a segment or in a box (chosen by one of segment, at, box)."""

    base_color: Reflectance | None = Field(default=None, description="instead of what was found, linear RGB")
    tint: Rgb | None = Field(
        default=None, description="factor on the base colour that was found; the result is at most 1"
    )
    roughness: Roughness | None = Field(default=None, description="instead of what was found")
    metallic: Fraction | None = Field(default=None, description="instead of what was found")

    @model_validator(mode="after")
    def _some(self) -> "MaterialEdit":
        if self.base_color is not None and self.tint is not None:
            raise ValueError("give base_color or tint, not both")
        if all(value is None for value in (self.base_color, self.tint, self.roughness, self.metallic)):
            raise ValueError("give at least one of base_color, tint, roughness and metallic")
        return self


class EnvironmentEdit(Settings):
    """A change to the light from outside."""

    file: str | None = Field(default=None, description="another map, EXR or HDR; {data_root} is replaced")
    radiance: Rgb | None = Field(default=None, description="one radiance for all directions instead of a map")
    scale: Weight | None = Field(default=None, description="radiance factor; 0 switches off")
    rotation: Angle = Field(
        default=0.0, description="turns the map about the up axis, degrees, counter-clockwise from above"
    )

    @model_validator(mode="after")
    def _one_light(self) -> Self:
        if self.file is not None and self.radiance is not None:
            raise ValueError("give file or radiance, not both")
        return self


class CameraLens(Settings):
    """How a setup's own cameras see; what is absent is as in the dataset's first view."""

    fov: float | None = Field(default=None, ge=1, le=170, description="horizontal field of view, degrees")
    vertical_fov: float | None = Field(default=None, ge=1, le=170, description="the vertical one instead, degrees")
    width: int | None = Field(default=None, ge=1, le=16384, description="of the pictures, pixels")
    height: int | None = Field(default=None, ge=1, le=16384, description="of the pictures, pixels")
    up: Point | None = Field(
        default=None,
        description="direction to the upper edge; absent: the world axis nearest to up in the dataset's views",
    )

    @model_validator(mode="after")
    def _one_meaning(self) -> Self:
        if self.fov is not None and self.vertical_fov is not None:
            raise ValueError("give fov or vertical_fov, not both")
        if self.up is not None and max(map(abs, self.up)) < 1e-6:
            raise ValueError("up must have a length")
        return self


class LookAt(CameraLens):
    """A camera that stands anywhere."""

    position: Point
    target: Point = Field(description="world position in the middle of the picture, metres")

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        check_distinct(self.position, self.target)
        ahead = tuple(map(sub, self.target, self.position))
        if self.up is not None and _parallel(self.up, ahead):
            raise ValueError("up must not be the direction in which the camera looks, nor its opposite")
        return self


class Keyframe(Settings):
    """A place on a camera's way: a view of the dataset (its name alone will do), or position and target."""

    view: str | None = Field(default=None, description="name of a view of the dataset")
    position: Point | None = Field(default=None, description="world position, metres")
    target: Point | None = Field(default=None, description="world position in the middle of the picture, metres")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        return {"view": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.view is None) == (self.position is None) or (self.position is None) != (self.target is None):
            raise ValueError("a keyframe must be the name of a view, or position and target")
        if self.position is not None and self.target is not None:
            check_distinct(self.position, self.target)
        return self


class CameraPath(CameraLens):
    """A camera that moves smoothly through keyframes."""

    keyframes: tuple[Keyframe, ...] = Field(
        min_length=2, description="names of views, or sections with position and target"
    )
    frames: int = Field(ge=1, le=9_999, description="pictures along the way")
    fps: float = Field(default=24.0, gt=0, le=240, description="pictures a second of the video")
    loop: bool = Field(
        default=False, description="go on from the last keyframe to the first; the video can be repeated"
    )
    timing: Literal["speed", "keyframes"] = Field(
        default="speed", description="the same speed all the way, or the same time between neighbouring keyframes"
    )
    video: Literal["mp4", "png"] = Field(
        default="mp4", description="join the pictures into an MP4, or leave them as they are"
    )


class OwnCameras(Settings):
    """Cameras of a setup instead of the dataset's."""

    look_at: dict[str, LookAt] | None = Field(default=None, min_length=1, description="name of a picture -> its camera")
    path: CameraPath | None = Field(default=None, description="cameras along a way, for a video")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.look_at is None) == (self.path is None):
            raise ValueError("cameras must have look_at or path, one of them")
        return self

    @property
    def names(self) -> list[str]:
        """Names of the pictures, in order."""
        if self.path is None:
            return list(self.look_at or {})
        return [f"frame-{number:04d}" for number in range(1, self.path.frames + 1)]


class RelightSetup(Settings):
    """The room under other light, with other things in it."""

    emitters: tuple[EmitterEdit, ...] = Field(default=(), description="changes to found emitters, in order")
    lights: tuple[NewLight, ...] = Field(default=(), description="lights to add")
    environment: EnvironmentEdit | None = Field(default=None, description="change of the light from outside")
    cameras: OwnCameras | None = Field(default=None, description="other cameras than the dataset's views")
    objects: tuple[NewObject, ...] = Field(default=(), description="objects to put in, one after the other")
    materials: tuple[MaterialEdit, ...] = Field(default=(), description="other materials, in order")
    remove: tuple[Removal, ...] = Field(default=(), description="what vanishes, before anything is put in")
    reference: str | None = Field(
        default=None,
        description="folder of linear photographs under this light, EXR or HDR, named as the views, of any one "
        "exposure; relit views are compared with them; {data_root} is replaced",
    )

    @model_validator(mode="after")
    def _views_to_compare(self) -> Self:
        if self.cameras is not None and self.reference is not None:
            raise ValueError("reference is compared with views of the dataset; a setup with cameras renders none")
        return self

    def in_unit(self, scale: float) -> "RelightSetup":
        """Return the setup with all its light multiplied: what people write is in the unit of the source."""
        if scale == 1.0:
            return self

        def scaled(entry: _Lit) -> _Lit:
            stated = {key: getattr(entry, key, None) for key in ("radiance", "intensity")}
            light = {key: tuple(scale * x for x in value) for key, value in stated.items() if value is not None}
            return entry.model_copy(update=light)

        outside = None if self.environment is None else scaled(self.environment)
        if outside is not None and outside.file is not None and outside.radiance is None:
            outside = outside.model_copy(update={"scale": scale * (1.0 if outside.scale is None else outside.scale)})
        lights, emitters = tuple(map(scaled, self.lights)), tuple(map(scaled, self.emitters))
        return self.model_copy(update={"emitters": emitters, "lights": lights, "environment": outside})

    @property
    def chooses_segments(self) -> bool:
        """Whether it names a segment, by number or by a point."""
        return any(entry.box is None for entry in (*self.materials, *self.remove))


def _parallel(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Whether two vectors have one direction, or opposite ones, up to a thousandth."""
    along = sum(x * y for x, y in zip(a, b, strict=True))
    return along**2 > (1 - 1e-6) * sum(x * x for x in a) * sum(x * x for x in b)


def check_distinct(position: tuple[float, ...], target: tuple[float, ...]) -> None:
    """Raise ValueError if a camera stands where it looks."""
    if max(abs(a - b) for a, b in zip(position, target, strict=True)) < 1e-6:
        raise ValueError("position and target must be apart, so that there is a direction to look in")


def check_keyframes(path: CameraPath, views: Sequence[str]) -> None:
    """Raise FiptError if a keyframe names none of the ``views``."""
    for key in path.keyframes:
        if key.view is not None and key.view not in views:
            close = get_close_matches(key.view, views, n=3, cutoff=0.3) or list(views[:3])
            raise FiptError(
                f"a camera path goes through view {key.view!r}, which there is not", f"use {', '.join(close)}"
            )


def parse_setup(text: str) -> RelightSetup:
    """Read a light setup: JSON, or the path of a YAML file with the same keys.

    Raises
    ------
    FiptError
        If it is neither, has unknown keys or values out of range.
    """
    if text.lstrip().startswith("{"):
        return checked(RelightSetup, _json(text, "setup"), root="setup")
    what = "light setup (JSON, or the path of a YAML file)"
    return checked(RelightSetup, read_yaml(text, what), root=f"setup {text}")


def parse_cameras(text: str) -> OwnCameras:
    """Parse the JSON of a setup's own cameras.

    Raises
    ------
    FiptError
        If it is not JSON, has unknown keys or values out of range.
    """
    return checked(OwnCameras, _json(text, "cameras"), root="cameras")


def _json(text: str, name: str) -> Any:
    try:
        return parse_json(text)
    except MALFORMED as error:
        raise FiptError(f"{name} must be JSON ({error})", "see config/README.md") from error
