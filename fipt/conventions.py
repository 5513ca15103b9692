"""Axes, units and physical constants, each defined once.

Axes
    Cameras follow OpenGL / nerfstudio: x right, y up, the camera looks along -z. ``world_from_camera`` maps
    camera coordinates to world coordinates. Pixel (column 0, row 0) is the top left one; its centre is at (0.5, 0.5).
Units
    Lengths in metres, radiance in linear RGB relative to the capture's exposure, roughness perceptual
    (GGX alpha = roughness squared), angles in radians unless a name says degrees.
Directions
    ``wo`` points from a surface point to the camera (or to the previous path vertex), ``wi`` to where light comes from.
"""

import re

ROUGHNESS_MIN = 0.02
"""Smallest roughness the model can express (paper, Sec. 4)."""

ROUGHNESS_LEVELS = (0.02, 0.118, 0.216, 0.412, 0.608, 0.804, 1.0)
"""Roughness of the baked specular levels: the paper's six (Sec. 4.1), and one between the two smoothest."""

SHADING_OUTPUTS = 1 + 2 * len(ROUGHNESS_LEVELS)
"""Ld, then Ls0 of every level, then Ls1 of every level; each RGB."""

F0_DIELECTRIC = 0.04
"""Reflectance of a dielectric at normal incidence."""

EMITTER_GAIN = 1.5
"""What is this much brighter than any reflection there could be must emit."""

RADIANCE_LEVEL = 0.27
"""Median luminance of a room's images, within a factor of 1.4: constants of the fit and of what is shown are those of
such a room."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear sRGB in luminance (ITU-R BT.709)."""

XYZ_FROM_SRGB = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
"""CIE XYZ from linear sRGB under D65 (IEC 61966-2-1)."""

DARK_BASE_COLOR = 0.01
"""Base colour that is added before a logarithm is taken: below it differences are noise."""

UNSEEN_DIFFERENCE = 0.5 / 255
"""Of sRGB-encoded values: half a step of an 8-bit picture shows nowhere."""

RAY_EPSILON = 3e-5
"""Offset of a ray's origin along the normal, as a fraction of the scene's largest extent."""

RAYS_PER_SIDE = 4
"""A pixel is looked through by the square of this many rays, unless the section ``samples`` says otherwise."""

SHOWN_VIEWS = 12
"""Views that the report shows, and whose photographs set the exposure of what is shown, unless it says otherwise."""

SUB_POSITIONS = 4
"""Surface points stored for each footprint sample, spread over its part of the pixel."""

NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""What a scene, view or setup may be called: names become paths."""

FARTHEST = 1e12
"""No position is farther from the origin, in any unit: map coordinates in millimetres have 1e10. Squares of what is
below stay far from the end of float32.
"""
FLAG_SATURATED = 1
"""The radiance is a lower bound: every exposure was clipped."""
FLAG_NOISE = 2
"""Below the noise of the longest exposure."""
FLAG_OUTSIDE = 4
"""Outside the undistorted frame."""
FLAG_MOVED = 8
"""The exposures disagree: something moved."""
