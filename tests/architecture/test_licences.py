"""Every pinned package has a licence that binds nothing here, and the page says which."""

from benchmarks.licences import LOCK, binding, licence, packages, row

PAGE = LOCK.parent / "docs" / "reference" / "licences.md"


def test_no_licence_binds_and_the_page_lists_all() -> None:
    known = {package: stated for package in packages() if (stated := licence(package)) is not None}
    assert len(known) > 100
    assert [package for package, stated in known.items() if binding(package, stated)] == []
    rows = set(PAGE.read_text(encoding="utf-8").splitlines())
    assert [package for package, stated in known.items() if row(package, stated) not in rows] == []


def test_what_would_bind_is_told() -> None:
    assert binding("x", "GPL-3.0-only")
    assert binding("x", "GNU Lesser General Public License v3 (LGPLv3)")
    assert binding("x", "CC-BY-NC-4.0")
    assert binding("x", "unknown")
    assert not binding("x", "MIT")
