"""Numbers, colours and transforms of a scene file."""

from __future__ import annotations

import logging

import numpy as np

from fipt.formats.images import srgb_decode
from fipt.render.assets import spectrum_rgb
from fipt.synthetic.scenefile.xml import Node

log = logging.getLogger(__name__)

COLORS = ("rgb", "srgb", "spectrum", "color", "blackbody", "float", "integer")
"""Tags of properties that are a colour, or one number for all channels."""

_LARGEST = 1e12
"""Of a colour, as in light setups: float32 holds what is made of it."""

_PLANCK_NM = 1.191042972e20
"""2 h c^2 in W nm^4 / (m^2 sr), and per nanometre."""
_PLANCK_K = 1.438776877e7
"""h c / k in nm K."""


def numbers(node: Node, text: str) -> list[float]:
    """Split a list of numbers at blanks and commas."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise node.wrong(f"{node.name or node.tag} must be numbers; found {text!r}") from error


def point(node: Node) -> np.ndarray:
    """(3,) float64 of a point that must be somewhere."""
    found = vector(node)
    if not np.isfinite(found).all():
        raise node.wrong(f"{node.name or node.tag} must be finite")
    return found


def vector(node: Node, default: float = 0.0) -> np.ndarray:
    """(3,) float64 of a point or vector: ``value="x, y, z"`` (or one number), or attributes x, y, z."""
    if "value" in node.attributes:
        found = numbers(node, node.attributes["value"])
        if len(found) not in (1, 3):
            raise node.wrong(f"{node.name or node.tag} must have three numbers; found {len(found)}")
        return np.array(found * 3 if len(found) == 1 else found)
    axes = [numbers(node, node.attributes[axis]) if axis in node.attributes else [default] for axis in "xyz"]
    return np.array([axis[0] for axis in axes])


# --- transforms ---------------------------------------------------------------------------------


def transform(node: Node | None) -> np.ndarray:
    """(4, 4) float64 matrix of a ``transform``: its operations one after another; the identity where there is none."""
    matrix = np.eye(4)
    if node is None:
        return matrix
    for step in node.children:
        matrix = _operation(step) @ matrix
    if not np.isfinite(matrix).all():
        raise node.wrong("the transform must be finite")
    if np.abs(matrix[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise node.wrong(f"the last row of a transform must be 0, 0, 0, 1; found {matrix[3].tolist()}")
    return matrix


def _operation(node: Node) -> np.ndarray:
    made = np.eye(4)
    if node.tag == "matrix":
        found = numbers(node, node.attributes.get("value", ""))
        if len(found) not in (9, 16):
            raise node.wrong(f"a matrix must have 16 (or 9) numbers; found {len(found)}")
        side = 4 if len(found) == 16 else 3
        made[:side, :side] = np.reshape(found, (side, side))
    elif node.tag == "translate":
        made[:3, 3] = vector(node)
    elif node.tag == "scale":
        made[:3, :3] = np.diag(vector(node, 1.0))
    elif node.tag == "rotate":
        axis = vector(node)
        if not axis.any():
            raise node.wrong("a rotation must have an axis: x, y or z, or three numbers as its value")
        angle = np.radians(numbers(node, node.attributes.get("angle", "0"))[0])
        made[:3, :3] = _rotation(axis / max(np.linalg.norm(axis), 1e-12), angle)
    elif node.tag.lower() == "lookat":
        made = _look_at(*(numbers(node, node.attributes.get(key, "")) for key in ("origin", "target", "up")))
    else:
        raise node.wrong(f"a transform has no operation {node.tag}")
    return made


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(axis * angle).as_matrix()


def _look_at(origin: list[float], target: list[float], up: list[float]) -> np.ndarray:
    """Local z looks from origin to target, y up, x to the left, as Mitsuba's cameras and spots do."""
    ahead = np.subtract(target, origin)
    ahead = ahead / (np.linalg.norm(ahead) or np.nan)  # what is not finite is told
    upward = np.array(up or ((0.0, 1.0, 0.0) if abs(ahead[1]) < 0.9 else (0.0, 0.0, 1.0)))
    left = np.cross(upward, ahead)
    left /= np.linalg.norm(left) or np.nan
    made = np.eye(4)
    made[:3] = np.stack([left, np.cross(ahead, left), ahead, origin], axis=1)
    return made


# --- colours ------------------------------------------------------------------------------------


def color(node: Node, light: bool = False) -> np.ndarray:
    """(3,) float64 linear RGB of a colour property, never negative; ``light``: it is emitted, not reflected."""
    if node.tag == "blackbody" or (node.tag == "spectrum" and node.type == "blackbody"):
        return _blackbody(node)
    if node.tag in ("spectrum", "texture") and node.type in ("uniform", "rgb", "srgb", "constant", "d65"):
        inner = node.get("value", "color")
        return (np.ones(3) if inner is None else color(inner, light)) * node.number("scale", 1.0)
    text = node.attributes.get("value", "")
    if text.startswith("#") and len(text) == 7:
        try:
            found = np.array([int(text[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        except ValueError as error:
            raise node.wrong(f"{text} is no colour") from error
    elif ":" in text:
        pairs = np.array([numbers(node, word.replace(":", " ")) for word in text.replace(",", " ").split()])
        found = _of_spectrum(node, pairs, light)
    else:
        found = np.array(numbers(node, text))
        if len(found) == 1:
            found = np.repeat(found, 3)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise node.wrong(f"{node.name or node.tag} must be a colour of one or three numbers; found {text!r}")
    if (np.abs(found) > _LARGEST).any():
        raise node.wrong(f"{node.name or node.tag} must be at most {_LARGEST:.0e}; found {text!r}")
    if ":" not in text and (found < 0).any():  # fits of spectra have such, and other renderers take them
        log.warning("%s: %s has negative numbers (%s), which are taken as 0", node.where, node.name or node.tag, text)
        found = np.maximum(found, 0.0)
    # Saturated spectra may lie outside of linear sRGB.
    return np.maximum(srgb_decode(found) if node.tag == "srgb" else found, 0.0)


def _of_spectrum(node: Node, pairs: np.ndarray, light: bool) -> np.ndarray:
    if pairs.ndim != 2 or pairs.shape[1] != 2 or len(pairs) < 2 or (np.diff(pairs[:, 0]) <= 0).any():
        raise node.wrong("a spectrum must be pairs wavelength:value with growing wavelengths")
    return spectrum_rgb(pairs[:, 0], pairs[:, 1], reflects=not light)


def _blackbody(node: Node) -> np.ndarray:
    """Planck's law, as Mitsuba scales it: radiance in W / (m^2 sr nm)."""
    text = node.attributes.get("temperature", "").rstrip("Kk") or node.text("temperature", "5000")
    kelvin = numbers(node, text)[0]
    scale = numbers(node, node.attributes["scale"])[0] if "scale" in node.attributes else node.number("scale", 1.0)
    nm = np.linspace(360.0, 830.0, 95)
    radiance = _PLANCK_NM / nm**5 / np.expm1(_PLANCK_K / (nm * max(kelvin, 1.0)))
    return np.maximum(spectrum_rgb(nm, radiance, reflects=False) * scale, 0.0)
