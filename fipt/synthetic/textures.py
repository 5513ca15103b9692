"""Base-colour textures drawn in code: (height, width, 3) float32 linear RGB in [0, 1].

Row 0 is v = 0 and column 0 is u = 0; the outermost texel centres lie on the edges of [0, 1].
"""

import numpy as np
from scipy.ndimage import gaussian_filter

Rgb = tuple[float, float, float]


def wood(rng: np.random.Generator, height: int, width: int, light: Rgb, dark: Rgb) -> np.ndarray:
    """Grain along u between two colours."""
    grain = gaussian_filter(rng.standard_normal((height, width)), (1.0, 28), mode="wrap")
    waves = gaussian_filter(rng.standard_normal((height, width)), (6, 90), mode="wrap")
    tone = 0.6 * grain / grain.std() + 0.9 * waves / waves.std()
    share = 1 / (1 + np.exp(-1.2 * tone))
    return _mix(light, dark, share)


def planks(rng: np.random.Generator, size: tuple[float, float], texel: float = 0.006) -> np.ndarray:
    """Floor of oak planks along u, for a floor of ``size`` metres."""
    width, height = (round(side / texel) for side in size)
    board, length = round(0.16 / texel), round(1.25 / texel)
    image = wood(rng, height, width, (0.47, 0.29, 0.15), (0.31, 0.17, 0.078))
    for top in range(0, height, board):
        rows = slice(top, top + board)
        start = int(rng.integers(length)) - length
        for left in range(start, width, length):
            columns = slice(max(left, 0), max(left + length, 0))
            tone = 1.0 + 0.16 * rng.standard_normal()
            warm = 0.05 * rng.standard_normal()
            image[rows, columns] *= np.array([tone, tone * (1 - warm), tone * (1 - 2 * warm)], np.float32)
            image[rows, columns][:, :1] *= 0.35
        image[top : top + 1] *= 0.35
    return np.clip(image, 0.01, 0.8)


def rug(height: int = 240, width: int = 340) -> np.ndarray:
    """Woven rug: borders and a field of diamonds."""
    cream, rust, navy, sand = (
        (0.62, 0.54, 0.42),
        (0.42, 0.12, 0.06),
        (0.05, 0.075, 0.16),
        (0.5, 0.33, 0.16),
    )
    y, x = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    image = np.empty((height, width, 3), np.float32)
    image[:] = cream
    diamonds = (np.abs((x + 30) % 60 - 30) + np.abs((y + 30) % 60 - 30)) / 30
    image[diamonds < 0.8] = rust
    image[diamonds < 0.5] = sand
    image[diamonds < 0.25] = navy
    edge = np.minimum(np.minimum(x, width - 1 - x), np.minimum(y, height - 1 - y))
    for limit, color in ((38, cream), (34, navy), (24, sand), (20, rust), (5, navy)):
        image[edge < limit] = color
    image[(edge >= 24) & (edge < 34) & ((x + y) % 20 < 10)] = cream
    return image


def landscape(height: int = 150, width: int = 200) -> np.ndarray:
    """Wall print: a sun over hills, v upwards."""
    y, x = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    image = _mix((0.86, 0.62, 0.36), (0.22, 0.40, 0.58), np.clip(1.5 * y - 0.5, 0, 1))
    image[(x - 0.66) ** 2 * (width / height) ** 2 + (y - 0.62) ** 2 < 0.021] = (0.85, 0.30, 0.10)
    for base, swing, turns, phase, color in (
        (0.50, 0.10, 1.3, 0.4, (0.30, 0.36, 0.48)),
        (0.36, 0.08, 1.9, 2.0, (0.16, 0.28, 0.32)),
        (0.22, 0.07, 1.1, 4.2, (0.07, 0.17, 0.13)),
        (0.10, 0.04, 2.3, 1.0, (0.30, 0.21, 0.06)),
    ):
        image[y < base + swing * np.sin(2 * np.pi * turns * x + phase)] = color
    return image


def shapes_print(height: int = 160, width: int = 120) -> np.ndarray:
    """Wall print: circles and arches on cream."""
    y, x = np.meshgrid(np.linspace(0, height / width, height), np.linspace(0, 1, width), indexing="ij")
    image = np.empty((height, width, 3), np.float32)
    image[:] = (0.72, 0.65, 0.53)
    for cx, cy, outer, inner, color in (
        (0.36, 0.44, 0.26, 0.0, (0.55, 0.13, 0.06)),
        (0.62, 0.60, 0.30, 0.20, (0.04, 0.09, 0.17)),
        (0.40, 0.92, 0.22, 0.12, (0.62, 0.36, 0.06)),
        (0.70, 1.02, 0.13, 0.0, (0.10, 0.26, 0.24)),
    ):
        distance = np.hypot(x - cx, y - cy)
        image[(distance < outer) & (distance >= inner)] = color
    image[(x > 0.12) & (x < 0.88) & (np.abs(y - 0.2) < 0.025)] = (0.04, 0.09, 0.17)
    return image


def weave(rng: np.random.Generator, color: Rgb, height: int = 96, width: int = 96) -> np.ndarray:
    """Cloth: one colour, slightly mottled."""
    noise = gaussian_filter(rng.standard_normal((height, width)), 2.0, mode="wrap")
    share = 1.0 + 0.10 * np.clip(noise / noise.std(), -2, 2)
    return np.clip(np.array(color, np.float32) * share[..., None], 0, 0.9).astype(np.float32)


def _mix(first: Rgb, second: Rgb, share: np.ndarray) -> np.ndarray:
    share = share[..., None].astype(np.float32)
    return np.array(first, np.float32) * (1 - share) + np.array(second, np.float32) * share


def grid(
    rng: np.random.Generator,
    size: tuple[float, float],
    cell: tuple[float, float],
    joint: float,
    colors: tuple[Rgb, Rgb],
    spread: float = 0.04,
    offset: float = 0.0,
    texel: float = 0.006,
) -> tuple[np.ndarray, np.ndarray]:
    """Tiles with joints between them.

    Parameters
    ----------
    rng
        Draws the tone of each tile.
    size, cell
        Of the surface and of a tile with its joint, along u and v, metres.
    joint
        Width of the joints, metres.
    colors
        Of tiles and of joints.
    spread
        Standard deviation of the tiles' tones.
    offset
        Shift of every other row, as a share of a tile.
    texel
        Side of a texel, metres.

    Returns
    -------
    image, is_joint
        (h, w, 3) float32 colours; (h, w) bool.
    """
    width, height = (max(round(side / texel), 2) for side in size)
    v, u = np.meshgrid(np.linspace(0, size[1], height), np.linspace(0, size[0], width), indexing="ij")
    row = np.floor(v / cell[1])
    shifted = u + offset * cell[0] * (row % 2)
    column = np.floor(shifted / cell[0])
    tone = 1 + spread * rng.standard_normal((int(row.max()) + 1, int(column.max()) + 1))
    image = np.array(colors[0], np.float32) * tone[row.astype(int), column.astype(int), None]
    is_joint = (shifted % cell[0] < joint) | (v % cell[1] < joint)
    image[is_joint] = colors[1]
    return np.clip(image, 0.01, 0.85).astype(np.float32), is_joint
