"""Grouping photographs into brackets, and what is found to be wrong with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.stages.capture.brackets import Bracket, group, judge, read_capture
from fipt.stages.capture.exposures import exposure, shutter_text, snapped, snapped_aperture
from fipt.stages.capture.raw import Shot

TIMES = (1 / 4000, 1 / 1000, 1 / 250, 1 / 60, 1 / 15, 1 / 4, 1.0, 4.0, 15.0)
THIRDS = (
    *(
        "30",
        "25",
        "20",
        "15",
        "13",
        "10",
        "8",
        "6",
        "5",
        "4",
        "3.2",
        "2.5",
        "2",
        "1.6",
        "1.3",
        "1",
        "0.8",
        "0.6",
        "0.5",
    ),
    *("0.4", "0.3", "1/4", "1/5", "1/6", "1/8", "1/10", "1/13", "1/15", "1/20", "1/25", "1/30", "1/40", "1/50", "1/60"),
    *("1/80", "1/100", "1/125", "1/160", "1/200", "1/250", "1/320", "1/400", "1/500", "1/640", "1/800", "1/1000"),
    *("1/1250", "1/1600", "1/2000", "1/2500", "1/3200", "1/4000", "1/5000", "1/6400", "1/8000"),
)


def shots(views: int, times: tuple[float, ...], pause: float = 20.0, clock: bool = True) -> list[Shot]:
    """Brackets one after the other, half a second between the frames of one."""
    found, now = [], 1000.0
    for view in range(views):
        for index, time in enumerate(times):
            name = f"DSC{view * len(times) + index:05d}.ARW"
            found.append(Shot(Path(name), time, 8.0, 100, camera="C", time=now if clock else None))
            now += time + 0.5
        now += pause
    return found


def names(brackets: list[tuple[Shot, ...]]) -> list[list[str]]:
    return [sorted(shot.path.name for shot in bracket) for bracket in brackets]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 9])
@pytest.mark.parametrize("pause", [0.6, 20.0])
@pytest.mark.parametrize("clock", [True, False])
def test_brackets_of_any_length_whatever_the_order_given(
    count: int, pause: float, clock: bool, np_rng: np.random.Generator
) -> None:
    given = shots(4, TIMES[:count], pause, clock)
    expected = [[f"DSC{view * count + k:05d}.ARW" for k in range(count)] for view in range(4)]
    mixed = [given[k] for k in np_rng.permutation(len(given))]
    assert names(group(mixed)) == expected


def test_one_photograph_without_a_time_shifts_no_bracket() -> None:
    given = shots(3, TIMES[:3])
    given[4] = replace(given[4], time=None)
    assert names(group(given)) == [[f"DSC{view * 3 + k:05d}.ARW" for k in range(3)] for view in range(3)]


def test_merged_views_whose_names_become_alike_are_all_kept(tmp_path: Path) -> None:
    for name in ("客厅", "厨房", "bath room", "bath_room", "bath_room_3"):
        write_exr(tmp_path / f"{name}.exr", {"": np.ones((4, 4, 3), np.float32)})
    found = {bracket.view: bracket.shots[0].path.stem for bracket in read_capture(tmp_path).brackets}
    assert sorted(found.values()) == sorted(("客厅", "厨房", "bath room", "bath_room", "bath_room_3"))


@pytest.mark.parametrize("gone", range(5))
def test_a_missing_frame_does_not_shift_the_brackets_after_it(gone: int) -> None:
    given = shots(4, TIMES[:5])
    kept = [shot for k, shot in enumerate(given) if k != 5 + gone]
    assert [len(bracket) for bracket in group(kept)] == [5, 4, 5, 5]


@pytest.mark.parametrize("twice", range(5, 10))
def test_a_frame_taken_twice_stays_in_its_bracket(twice: int) -> None:
    given = shots(3, TIMES[:5])
    again = replace(given[twice], path=Path("again.ARW"), time=given[twice].time + 0.1)
    assert [len(bracket) for bracket in group([*given, again])] == [5, 6, 5]


def test_whole_seconds_on_the_clock_are_enough() -> None:
    given = [replace(shot, time=float(int(shot.time))) for shot in shots(4, TIMES[:5], pause=6.0)]
    assert [len(bracket) for bracket in group(given)] == [5, 5, 5, 5]


def test_names_are_sorted_as_numbers_where_there_is_no_clock() -> None:
    given = [Shot(Path(f"IMG_{k}.CR2"), TIMES[k % 3]) for k in range(12)]
    assert names(group(sorted(given, key=lambda s: s.path.name)))[3] == ["IMG_10.CR2", "IMG_11.CR2", "IMG_9.CR2"]


def brackets_of(*lists: list[Shot]) -> list[Bracket]:
    return [
        Bracket(f"v{k}", "raw", tuple(sorted(list_, key=lambda shot: -exposure(shot)))) for k, list_ in enumerate(lists)
    ]


def test_findings_name_view_and_frame() -> None:
    a, b, c = (shots(3, TIMES[:5])[k : k + 5] for k in (0, 5, 10))
    assert judge(brackets_of(a, b, c)) == []
    (missing,) = judge(brackets_of(a, b[:1] + b[2:], c))
    assert missing.message == "view v1 has 4 exposures where the other views have 5: 1/1000 s missing"
    (doubled,) = judge(brackets_of(a, [*b, replace(b[1], path=Path("again.ARW"))], c))
    assert doubled.message == "view v1: DSC00006.ARW and again.ARW have the same exposure (1/1000 s)"
    (turned,) = judge(brackets_of(a, b, [*c[:4], replace(c[4], orientation=6)]))
    assert "view v2" in turned.message
    assert "DSC00014.ARW differs" in turned.message
    (camera,) = judge(brackets_of(a, b, [*c[:4], replace(c[4], camera="D")]))
    assert camera.views == ("v2",)
    assert [f.severity for f in (missing, doubled, turned, camera)] == ["warning", "error", "error", "error"]


def test_iso_and_aperture_belong_to_the_exposure() -> None:
    base = Shot(Path("a"), 1 / 64, 8.0, 100)
    assert exposure(base) == pytest.approx(1 / 64)
    assert exposure(replace(base, iso=400)) == pytest.approx(1 / 16)
    assert exposure(replace(base, aperture=5.6)) == pytest.approx(1 / 32)
    assert exposure(Shot(Path("a"), 1 / 64)) == pytest.approx(1 / 64)


def test_nominal_times_are_thirds_of_a_stop() -> None:
    """The whole series that cameras print, against its definition."""
    for n, text in enumerate(THIRDS):
        numerator, _, denominator = text.partition("/")
        nominal = float(numerator) / float(denominator or 1)
        assert snapped(nominal) == pytest.approx(2 ** (5 - n / 3), rel=1e-12), text
    for power, half in enumerate((45, 90, 180, 350, 750, 1500, 3000, 6000)):
        assert snapped(1 / half) == pytest.approx(2 ** -(5.5 + power))
    assert [snapped(half) for half in (1.5, 3.0, 12.0)] == pytest.approx([2**0.5, 2**1.5, 2**3.5])
    assert snapped(0.7) == pytest.approx(2**-0.5)
    assert snapped(60.0) == 60.0
    assert snapped_aperture(5.6) == pytest.approx(2**2.5)
    assert snapped_aperture(11) == pytest.approx(2**3.5)
    assert shutter_text(1 / 60) == "1/60 s"


def table(folder: Path, text: str) -> None:
    for name in ("a.arw", "b.arw", "c.jpg"):
        (folder / name).touch()
    (folder / "captures.tsv").write_text(text, encoding="utf-8")


def test_the_table_overrides_exif(tmp_path: Path) -> None:
    table(tmp_path, "view\tfile\tshutter\taperture\tiso\nw\ta.arw\t1/60\t8\t200\nw\tb.arw\t0.5\t\t\n")
    capture = read_capture(tmp_path)
    assert [bracket.view for bracket in capture.brackets] == ["w"]
    long, short = capture.brackets[0].shots
    assert (long.path.name, long.shutter, long.iso) == ("b.arw", 0.5, None)
    assert (short.path.name, short.shutter, short.aperture, short.iso) == ("a.arw", pytest.approx(1 / 60), 8.0, 200.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "view\tshutter\n",
            "must have the columns view and file, and may have shutter, aperture, iso; found view, shutter",
        ),
        ("view\tfile\tf\n", "found view, file, f"),
        ("view\tfile\n", "must list files of one kind (raw, ldr or merged); found no file"),
        (
            "view\tfile\tshutter\nv\ta.arw\t-1\n",
            "line 2: shutter must be a positive number such as 0.5 or 1/60; found '-1'",
        ),
        ("view\tfile\tshutter\nv\tz.arw\t1\n", "a photograph ("),
        ("view\tfile\tshutter\n../v\ta.arw\t1\n", "line 2: view '../v' cannot be used as a file name"),
        ("view\tfile\tshutter\nv\ta.arw\t1\nv\tc.jpg\t1\n", "found ldr and raw"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    table(tmp_path, text)
    with pytest.raises(FiptError) as caught:
        read_capture(tmp_path)
    assert message in str(caught.value)


def test_empty_and_missing_folders(tmp_path: Path) -> None:
    with pytest.raises(FiptError, match=r"must hold photographs .* it holds 0 other files"):
        read_capture(tmp_path)
    with pytest.raises(FiptError, match="the capture folder is missing"):
        read_capture(tmp_path / "no")
