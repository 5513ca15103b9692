"""What is seen through the room's open window: a sky that is brightest in one direction, and the ground below it."""

from collections.abc import Sequence

import numpy as np

from fipt.scene.environment import EnvironmentMap, texel_directions

_ROWS = 64
_BRIGHT = np.array([0.6, 0.3, -0.74])
"""Direction of the brightest sky, to the right of the window as it is seen from inside."""


def sky(horizon: Sequence[float]) -> EnvironmentMap:
    """Return the sky whose horizon has a radiance (3,).

    It is darker and bluer above, up to twice as bright around `_BRIGHT`; the ground is brown and a quarter as bright.
    """
    d = texel_directions(_ROWS, 2 * _ROWS)
    height = d[:, 1:2]
    toward = np.clip(d @ _BRIGHT / np.linalg.norm(_BRIGHT), 0, 1)[:, None]
    above = 1 + np.clip(height, 0, 1) * (np.array([0.4, 0.6, 0.8]) - 1) + toward**4
    ground = np.broadcast_to([0.28, 0.25, 0.2], above.shape)
    blend = np.clip(0.5 + height / 0.1, 0, 1)  # a hazy horizon
    radiance = (above * blend + ground * (1 - blend)) * np.asarray(horizon, float)
    return EnvironmentMap("given", radiance.reshape(_ROWS, 2 * _ROWS, 3).astype(np.float32))
