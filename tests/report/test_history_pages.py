"""Pages of a fleet's history in a browser, and the page of a very large fleet: its size and how fast it answers."""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Browser

from boxcal.calib.history.channels import KEYS
from boxcal.calib.history.fleet_history import fleet_history
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.report.history import _panels, history_pages
from boxcal.calib.report.page import ROWS
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.simulate.years import Years, simulated_years

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from fleet_page import GOALS, MOST_BYTES, REVISIONS, made_up, measured

LAYOUT = (Path(__file__).parent / "layout.js").read_text(encoding="utf-8")
MANY = 5000


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pages of sixty robots in a year with changes, one of them with a name that is markup."""
    folder = tmp_path_factory.mktemp("history")
    asked = Years(robots=60, sessions=12, worn=(3,), wear=-0.01, knocked={7: 6, 8: 11})
    sessions = simulated_years(asked, np.random.default_rng(0))
    sessions = [replace(s, robot="<b>r</b>/..", hardware="rev B") if s.robot == "r0007" else s for s in sessions]
    for relative, content in history_pages(fleet_history(sessions)):
        path = folder / relative
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    return folder


@pytest.mark.parametrize("page", ["history.html", "robots/r0003.html", "robots/%3Cb%3Er%3C%2Fb%3E%2F...html"])
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (768, True), (390, False)])
def test_history_is_drawn_whole_at_every_width(
    page: str, width: int, dark: bool, browser: Browser, history: Path
) -> None:
    browser.open((history / page).as_uri(), width=width, dark=dark)
    assert browser.complaints() == []
    assert browser.requests() == []
    assert browser.evaluate(LAYOUT) == []
    if page != "history.html":
        assert browser.evaluate("document.querySelectorAll('#history-charts svg circle').length") == 12 * 12
        assert browser.evaluate("document.querySelector('a.up').href") == (history / "history.html").as_uri()


def test_history_links_sorts_and_filters(browser: Browser, history: Path) -> None:
    browser.open(history / "history.html")
    links = "[...document.querySelectorAll('#history-table a')].map((a) => a.href)"
    for link in browser.evaluate(links):
        browser.open(link)
        assert browser.evaluate("!!document.getElementById('history-charts')")
        break
    browser.open(history / "history.html")
    column = """(() => { document.querySelectorAll("#history-table thead button")[%d].click();
      return [...document.querySelectorAll("#history-table tbody tr")].map((r) => r.cells[%d].dataset.value); })()"""
    first = browser.evaluate(column % (3, 3))
    assert [float(v) for v in first] == sorted(float(v) for v in first)
    assert len(first) == ROWS
    browser.evaluate("document.getElementById('filter-changed').click()")
    shown = browser.evaluate("[...document.querySelectorAll('#history-table tbody th')].map((c) => c.textContent)")
    assert set(shown) >= {"r0003", "<b>r</b>/..", "r0008"}
    assert browser.evaluate("document.querySelector('.history-changes').textContent").count("camera turned by 0.3") == 1


def test_the_trend_that_is_drawn_is_the_one_that_is_stated() -> None:
    asked = Years(robots=6, sessions=30, worn=(3,), wear=-0.01, tyres={3: 8})
    robot = fleet_history(simulated_years(asked, np.random.default_rng(2))).robots[3]
    assert any(event.change.drift for event in robot.events)
    for key, name in (("rL", "Left radius"), ("rR", "Right radius")):
        (panel,) = [panel for panel in _panels(robot) if panel["name"] == name]
        x0, y0, x1, y1 = panel["lines"][-1]
        assert (y1 - y0) / (x1 - x0) == pytest.approx(100 * robot.trends[key].rate, rel=1e-2)
        assert x0 == robot.series.years[robot.watched.start[KEYS.index(key)]]
        assert y1 == pytest.approx(100 * robot.trends[key].level, rel=1e-3)


@pytest.mark.parametrize("page", ["history.html", "robots/r0003.html"])
def test_axe_finds_no_serious_fault_in_a_history(page: str, browser: Browser, history: Path) -> None:
    axe = Path(os.environ.get("BOXCAL_AXE", ""))
    if not axe.is_file():
        pytest.skip("axe-core is not here: npm install axe-core, then BOXCAL_AXE=node_modules/axe-core/axe.min.js")
    for dark in (False, True):
        browser.open(history / page, dark=dark)
        assert _faults(browser, axe) == []


def _faults(browser: Browser, axe: Path) -> list[object]:
    browser.evaluate(axe.read_text(encoding="utf-8") + "; 1")
    found = browser.evaluate(
        "axe.run(document, {resultTypes: ['violations']})"
        ".then((r) => r.violations.map((v) => [v.impact, v.id, v.nodes[0].html]))"
    )
    return [f for f in found if f[0] in {"serious", "critical"}]


@pytest.fixture(scope="module")
def large(calibrations: Callable[[str], Calibration], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of five thousand robots of three hardware revisions."""
    path = tmp_path_factory.mktemp("large") / "fleet.html"
    path.write_bytes(fleet_report(made_up(calibrations("good_drive"), MANY, np.random.default_rng(1)), []))
    return path


def test_page_of_five_thousand_robots_is_small_and_answers_at_once(browser: Browser, large: Path) -> None:
    """In processor time of the page's main thread, which a busy machine does not change."""
    assert large.stat().st_size < MOST_BYTES
    times = measured(large, browser)
    assert set(times) >= set(GOALS)
    assert {name: t for name, (t, _) in times.items() if name in GOALS and t > GOALS[name]} == {}
    assert browser.complaints() == []


def test_page_of_five_thousand_robots_turns_sorts_and_filters_all_of_them(browser: Browser, large: Path) -> None:
    browser.open(large)
    rows = "[...document.querySelectorAll('#robot-table tbody tr')]"
    text = f"{rows}.map((r) => [...r.cells].map((c) => c.textContent.trim()))"
    written = browser.evaluate(text)
    assert len(written) == ROWS
    browser.evaluate("document.querySelectorAll('.pager button')[1].click()")
    assert browser.evaluate("document.querySelector('#robot-table tbody th').textContent") == f"robot-{ROWS:04d}"
    browser.evaluate("document.querySelectorAll('.pager button')[0].click()")
    assert browser.evaluate(text) == written  # the script's rows are those that the page came with
    values = f"{rows}.map((r) => Number(r.cells[9].dataset.value))"
    browser.evaluate("document.querySelectorAll('#robot-table thead button')[9].click()")
    rising = browser.evaluate(values)
    browser.evaluate("document.querySelectorAll('#robot-table thead button')[9].click()")
    falling = browser.evaluate(values)
    every = browser.evaluate("DATA.panels[2].value")
    assert rising == sorted(every)[:ROWS]
    assert falling == sorted(every, reverse=True)[:ROWS]
    revision = "document.getElementById('filter-hardware')"
    browser.evaluate(f"{revision}.value = {REVISIONS[1]!r}; {revision}.dispatchEvent(new Event('change'))")
    says = browser.evaluate("document.getElementById('filter-says').textContent")
    count = browser.evaluate(
        f"DATA.rows.hardware[1].filter((k) => DATA.rows.hardware[0][k] === {REVISIONS[1]!r}).length"
    )
    assert says == f"{count} of {MANY} robots"
    browser.evaluate("document.getElementById('filter-odd').click()")
    assert 1 <= int(browser.evaluate("document.getElementById('filter-says').textContent").split()[0]) < count


@pytest.mark.parametrize("width", [1280, 768, 390])
def test_page_of_five_thousand_robots_is_cut_nowhere(width: int, browser: Browser, large: Path) -> None:
    browser.open(large, width=width)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.evaluate("document.querySelectorAll('#spread-charts svg').length") <= 14
    assert browser.evaluate(LAYOUT) == []


def test_spread_tells_what_is_real_and_what_the_hardware_explains(large: Path) -> None:
    from html.parser import HTMLParser  # noqa: PLC0415

    class Cells(HTMLParser):
        rows: list[list[str]]

        def handle_starttag(self, tag: str, _: list[tuple[str, str | None]]) -> None:
            if tag == "tr":
                self.rows.append([])
            elif tag in {"td", "th"} and self.rows:
                self.rows[-1].append("")

        def handle_data(self, data: str) -> None:
            if self.rows and self.rows[-1]:
                self.rows[-1][-1] += data.strip()

    page = Cells()
    page.rows = []
    text = large.read_text(encoding="utf-8")
    page.feed(text[text.index('id="spread"') : text.index("Hardware revisions")])
    rows = {row[0]: row for row in page.rows if row}
    radius, centre = rows["Left radiusrL"], rows["Principal point ucu"]
    assert int(radius[8]) > 95  # of the spread is real
    assert int(radius[9]) > 95  # of that lies between revisions, which differ by 2 % where robots do by .2 %
    assert centre[7].startswith("0 (<")
