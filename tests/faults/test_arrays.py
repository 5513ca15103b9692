"""Whole npz files of something else, of another form or with values that cannot be: one line names the array."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.arrays import save_npz
from fipt.scene.confidence import read_confidence
from fipt.scene.emitters import read_emitters
from fipt.scene.environment import read_environment
from fipt.scene.voxels import read_cache

N = 4
BOX = {"center": np.zeros(3), "side": np.float64(2), "resolution": np.int64(8)}
ONES, ROWS = np.ones(N, np.float32), np.arange(N, dtype=np.int32)
FILES: dict[str, tuple[dict[str, Any], Callable[[Path], object]]] = {
    "cache": (
        {**BOX, "key": ROWS, "facing": ROWS, "point": np.ones((N, 3)), "radiance": np.ones((N, 3)), "count": ONES,
         "source": ROWS, "part": ROWS},
        read_cache,
    ),
    "emitters": (
        {
            **dict.fromkeys(("triangle", "emitter", "views"), ROWS),
            **dict.fromkeys(("area", "confidence", "clipped", "spread", "raised"), ONES),
            **{name: np.zeros(N, bool) for name in ("lower_bound", "guessed")},
            **{f"undecided_{name}": ROWS for name in ("triangle", "region", "reflects", "emits", "price")},
            "radiance": np.ones((N, 3)), "error": np.ones((N, 3)), "sides": ROWS % 3 + 1,
        },
        read_emitters,
    ),
    "environment": (
        {"mode": np.array("none"), "radiance": np.ones((1, 1, 3)), "up": np.array("y"), "rotation": np.float64(0)},
        read_environment,
    ),
    "confidence": (
        {**BOX, "record": ROWS, "kd_error": ONES, "roughness_error": ONES, "metallic_error": ONES,
         "known": np.ones(N, bool), "unseen": np.ones(3)},
        read_confidence,
    ),
}  # fmt: skip
FAULTS: dict[str, list[tuple[str, Any]]] = {
    "cache": [
        ("key", ROWS + 0.5), ("key", ROWS[:0]), ("radiance", np.full((N, 3), np.nan)), ("radiance", -np.ones((N, 3))),
        ("radiance", np.ones((N - 1, 3))), ("radiance", np.array(["x"] * N)), ("center", np.zeros(2)),
        ("side", np.float64(0)), ("side", np.float64(np.inf)), ("resolution", np.int64(2**40)),
        ("resolution", np.int64(0)), ("point", np.ones((N, 2))), ("facing", np.ones(N + 1, np.uint8)),
        ("key", ROWS[::-1]), ("key", ROWS - 1), ("key", ROWS + 8**3), ("facing", ROWS + 6),
        ("source", ROWS + 1), ("source", ROWS - 1), ("point", np.full((N, 3), np.nan)), ("count", -ONES),
        ("part", ROWS[:2]), ("part", ONES * 0.5),
    ],
    "emitters": [
        ("triangle", ONES), ("triangle", ROWS[:2]), ("radiance", np.ones((N, 4))),
        ("radiance", np.full((N, 3), np.inf)), ("area", ONES * np.nan), ("emitter", ONES[:0]),
        ("sides", ROWS), ("sides", ROWS + 1), ("sides", ROWS[:1] + 1), ("undecided_region", ROWS[:1]),
        ("triangle", ROWS - 1), ("triangle", ROWS * 0), ("undecided_region", ROWS + 1), ("confidence", ONES * 2),
        ("radiance", -np.ones((N, 3))), ("guessed", np.array(["x"] * N)), ("spread", -ONES),
    ],
    "environment": [
        ("radiance", np.ones(7)), ("radiance", np.full((1, 1, 3), np.nan)), ("radiance", -np.ones((1, 1, 3))),
        ("up", np.array("q")), ("rotation", np.array("q")), ("rotation", np.float64(np.nan)), ("up", np.array("x")),
        ("mode", np.array("sunny")), ("mode", np.int64(3)), ("radiance", np.full((1, 1, 3), 1e30)),
    ],
    "confidence": [
        ("record", ONES), ("record", ROWS[:2]), ("known", np.array(["x"] * N)), ("center", np.full(3, np.nan)),
        ("unseen", np.ones(2)), ("resolution", np.float64(8)), ("record", ROWS[::-1]), ("record", ROWS - 1),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("file", "array", "value"), [(f, *fault) for f, faults in FAULTS.items() for fault in faults])
def test_an_array_that_cannot_be_is_named(file: str, array: str, value: Any, tmp_path: Path) -> None:
    sound, read = FILES[file]
    path = tmp_path / f"{file}.npz"
    save_npz(path, **sound)
    read(path)
    save_npz(path, **{**sound, array: value})
    with pytest.raises(FiptError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
