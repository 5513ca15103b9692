"""metals.json: which parts are metal, and which are not."""

import pytest

from fipt.errors import FiptError
from fipt.scene.metals import JudgedMetals, read_metals, write_metals


def test_round_trip(tmp_path):
    metals = JudgedMetals({7: 0.2, 3: 0.02}, frozenset({9, 4}))
    write_metals(tmp_path, metals)
    assert read_metals(tmp_path / "metals.json") == metals


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"roughness": {}}',
        '{"roughness": {"0": 0.2}, "dielectric": []}',
        '{"roughness": {"3": 1.5}, "dielectric": []}',
        '{"roughness": {"3": NaN}, "dielectric": []}',
        '{"roughness": {"3": true}, "dielectric": []}',
        '{"roughness": {"3": "0.5"}, "dielectric": []}',
        '{"roughness": [], "dielectric": []}',
        '{"roughness": {"3": 0.5}, "dielectric": [3]}',
        '{"roughness": {}, "dielectric": ["x"]}',
        '{"roughness": {}, "dielectric": 5}',
    ],
)
def test_a_damaged_file_is_one_line(tmp_path, text):
    (tmp_path / "metals.json").write_text(text)
    with pytest.raises(FiptError, match=r"is damaged|is not JSON"):
        read_metals(tmp_path / "metals.json")
