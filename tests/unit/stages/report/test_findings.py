"""The first section of the page: what is wrong, and what to do."""

import numpy as np
import pytest

from fipt.formats.images import write_png
from fipt.scene.findings import Measure, RoomFinding, write_findings
from fipt.stages.report.page import build_page
from fipt.stages.report.settings import ReportSettings
from tests.fake_results import write_results


@pytest.fixture
def results(tmp_path):
    return write_results(tmp_path / "scene")


def _page(results):
    return build_page(results, ReportSettings(max_views=1, width=64))


def test_findings_stand_first(results):
    measure = Measure("light off by", 0.31, 0.1)
    image = np.full((20, 40, 3), 200, np.uint8)
    found = RoomFinding(
        "dark", "serious", "Light <is> missing.", measure, "Look up.", {"position": [1, 2, 3.5], "views": ["a"]}, {}
    )
    pictured = RoomFinding("thin", "warning", "Thin.", measure, "Go nearer.", image=image)
    write_findings(results / "findings.json", [found, pictured], {"dark": (measure, 0.01)})
    write_png(results / "findings" / "thin.png", image)
    page = _page(results)
    section = page[page.index('<section id="findings">') : page.index("</section>")]
    assert "What is wrong, and what to do" in section
    assert "Light &lt;is&gt; missing." in section
    assert "light off by: 31 % (told from 10 %); near (1.00, 2.00, 3.50) m; views a" in section
    assert section.index("Serious.") < section.index("Warning.")
    assert section.count("<img") == 1


def test_nothing_wrong(results):
    write_findings(results / "findings.json", [], {})
    assert "Nothing was found wrong." in _page(results)


def test_a_run_that_was_not_judged(results):
    assert '<section id="findings">' not in _page(results)
