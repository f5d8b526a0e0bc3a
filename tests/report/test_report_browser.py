"""The pages in a browser: nothing complained about, nothing asked for, every chart drawn, table and view at work.

With ``BOXCAL_SCREENSHOTS=<folder>`` the pictures are kept there. With ``BOXCAL_AXE=<axe.min.js>`` (npm: axe-core) the
pages are checked for faults of accessibility too.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import faulty
import numpy as np
import pytest
from browser import Browser

from boxcal.calib.errors import CalibError
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.report.robot import robot_report
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.correspondences import Correspondences

EVIL = "<script>alert(1)</script>/../../x"
WIDTHS = {"desktop": 1280, "tablet": 768, "phone": 390}


@pytest.fixture(scope="module")
def pages(
    full: tuple[Calibration, Correspondences],
    calibrations: Callable[[str], Calibration],
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Path]:
    """A robot's page, one of the closed form, a fleet's with an evil name, an odd robot and failures."""
    folder = tmp_path_factory.mktemp("pages")
    calibration, drive = full
    good = calibrations("good_drive")
    fleet = [
        replace(good, robot=f"r{i:02d}", wheels=replace(good.wheels, b=good.wheels.b + 1e-4 * i)) for i in range(8)
    ]
    fleet[3] = replace(fleet[3], wheels=replace(good.wheels, b=good.wheels.b * 1.1))
    fleet += [replace(calibration, robot=EVIL), replace(calibrations("few_stops"), robot="r-few")]
    html = {
        "robot": robot_report(calibration, drive, faulty.TARGET),
        "evil": robot_report(replace(calibration, robot=EVIL, notes=(EVIL,)), drive, faulty.TARGET),
        "closed": robot_report(replace(calibration, detail=None), drive, faulty.TARGET),
        "fleet": fleet_report(fleet, [CalibError(f"found {EVIL}", source=f"{EVIL}.mcap", remedy="rename it")]),
        "hundred": fleet_report([replace(good, robot=f"r{i:03d}") for i in range(100)], []),
    }
    for name, content in html.items():
        (folder / f"{name}.html").write_bytes(content)
    return {name: folder / f"{name}.html" for name in html}


@pytest.mark.parametrize("name", ["robot", "evil", "closed", "fleet", "hundred"])
def test_page_renders_without_complaint_or_request(name: str, browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages[name])
    assert browser.complaints() == []
    assert browser.requests() == []


@pytest.mark.parametrize("size", WIDTHS)
@pytest.mark.parametrize("name", ["robot", "fleet"])
def test_page_never_scrolls_sideways(name: str, size: str, browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages[name], width=WIDTHS[size])
    assert browser.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")


def test_first_screen_of_a_desktop_holds_verdict_certainty_and_advice(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["robot"], width=1280, height=800)
    for selector in (".verdict .word", ".verdict .reasons", ".verdict .steps", ".gauges"):
        assert browser.evaluate(f"document.querySelector('{selector}').getBoundingClientRect().bottom") < 800, selector


def test_first_screen_of_a_phone_holds_verdict_and_advice(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["robot"], width=390, height=844)
    for selector in (".verdict .word", ".verdict .reasons", ".verdict .steps"):
        assert browser.evaluate(f"document.querySelector('{selector}').getBoundingClientRect().bottom") < 844, selector


def test_every_chart_is_drawn(browser: Browser, pages: dict[str, Path]) -> None:
    for name in ("robot", "fleet", "closed"):
        browser.open(pages[name])
        empty = "[...document.querySelectorAll('.chart')].filter((c) => !c.querySelector('svg path')).map((c) => c.id)"
        assert browser.evaluate(empty) == []
    browser.open(pages["robot"])
    inked = """(() => { const c = document.getElementById("scene");
      const p = c.getContext("2d").getImageData(0, 0, c.width, c.height).data; let n = 0;
      for (let i = 3; i < p.length; i += 4) n += p[i] > 0; return n / (p.length / 4); })()"""
    assert 0.02 < browser.evaluate(inked) < 0.9


def test_evil_name_is_shown_and_runs_nothing(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["evil"])
    assert browser.evaluate("document.querySelector('h1').textContent") == EVIL
    browser.open(pages["fleet"])
    link = browser.evaluate(
        "[...document.querySelectorAll('#robot-table a')].find((a) => a.textContent.includes('<')).href"
    )
    assert link.startswith(pages["fleet"].parent.as_uri() + "/%3Cscript%3E")
    assert link.endswith("%2F..%2F..%2Fx/report.html")


def test_script_that_is_not_the_pages_own_does_not_run(
    browser: Browser, pages: dict[str, Path], tmp_path: Path
) -> None:
    html = pages["robot"].read_text(encoding="utf-8")
    for k, bad in enumerate(("<script>window.evil = 1</script>", '<img src="x" onerror="window.evil = 1">')):
        spoilt = tmp_path / f"{k}.html"
        spoilt.write_text(html.replace("</main>", f"{bad}</main>"), encoding="utf-8")
        browser.open(spoilt)
        assert browser.evaluate("window.evil === undefined")
        assert any("Content Security Policy" in c for c in browser.complaints())


def test_choosing_a_stop_and_a_face_shows_only_those(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["robot"])
    choose = """(() => { const pick = (id, v) => { const s = document.getElementById(id); s.value = v;
      s.dispatchEvent(new Event("change")); }; pick("pick-stop", %s); pick("pick-face", %s);
      return document.getElementById("residual-says").textContent; })()"""
    every = browser.evaluate(choose % ("''", "''"))
    assert int(every.split()[0]) > 2000
    stop = browser.evaluate(choose % ("'4'", "''"))
    counted = browser.evaluate("DATA.residuals.stops.find((s) => s.stop === '4').u.length")
    assert int(stop.split()[0]) == counted
    faces = [browser.evaluate(choose % ("'4'", f"'{f}'")) for f in range(4)]
    assert sum(int(t.split()[0]) for t in faces if t != "no corner") == counted


def test_view_turns_by_keys_buttons_and_drags(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["robot"])
    browser.evaluate("document.getElementById('scene').scrollIntoView({block: 'center', behavior: 'instant'})")
    picture = "document.getElementById('scene').toDataURL()"
    seen = [browser.evaluate(picture)]
    browser.evaluate("document.getElementById('scene').focus()")
    browser.press("ArrowLeft")
    seen.append(browser.evaluate(picture))
    browser.evaluate("document.querySelector('[data-view=up]').click()")
    seen.append(browser.evaluate(picture))
    box = browser.evaluate(
        "(({x, y, width, height}) => [x + width / 2, y + height / 2])"
        "(document.getElementById('scene').getBoundingClientRect())"
    )
    for kind, dx in (("mousePressed", 0), ("mouseMoved", 80), ("mouseReleased", 80)):
        browser.send(
            "Input.dispatchMouseEvent", type=kind, x=box[0] + dx, y=box[1], button="left", buttons=1, clickCount=1
        )
    seen.append(browser.evaluate(picture))
    assert len(set(seen)) == 4
    browser.press("Home")
    assert browser.evaluate(picture) == seen[0]


def test_table_sorts_by_any_column_both_ways(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["fleet"])
    column = """(() => { const t = document.getElementById("robot-table");
      const k = [...t.tHead.rows[0].cells].findIndex((c) => c.textContent.startsWith(%r));
      t.tHead.rows[0].cells[k].querySelector("button").click();
      return [t.tHead.rows[0].cells[k].getAttribute("aria-sort"),
        [...t.tBodies[0].rows].map((r) => r.cells[k].dataset.value)]; })()"""
    for name in ("Wheel separation", "After 10 m", "Stops"):
        sense, values = browser.evaluate(column % name)
        assert sense == "ascending"
        assert [float(v) for v in values] == sorted(float(v) for v in values)
        sense, values = browser.evaluate(column % name)
        assert sense == "descending"
        assert [float(v) for v in values] == sorted((float(v) for v in values), reverse=True)
    assert browser.evaluate("document.querySelectorAll('th[aria-sort=descending]').length") == 1
    _, names = browser.evaluate(column % "Robot")
    assert names[-1] == "r07"
    assert names[0] == EVIL


def test_table_filters_by_text_verdict_and_oddness(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["fleet"])
    shown = """[...document.querySelectorAll("#robot-table tbody tr")].filter((r) => !r.hidden)
      .map((r) => r.cells[0].dataset.value)"""

    def fill(field: str, value: str) -> None:
        browser.evaluate(
            f"""(() => {{ const f = document.getElementById({field!r}); f.value = {value!r};
            f.dispatchEvent(new Event(f.tagName === "SELECT" ? "change" : "input")); }})()"""
        )

    fill("filter-text", "R0")
    assert browser.evaluate(shown) == [f"r0{i}" for i in range(8)]
    browser.evaluate("document.getElementById('filter-odd').click()")
    assert browser.evaluate(shown) == ["r03"]
    assert browser.evaluate("document.getElementById('filter-says').textContent") == "1 of 10 robots"
    browser.evaluate("document.getElementById('filter-odd').click()")
    fill("filter-text", "")
    fill("filter-level", "redo")
    assert browser.evaluate(shown) == ["r-few"]


def test_pictures_of_desktop_phone_dark_and_print(browser: Browser, pages: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(os.environ.get("BOXCAL_SCREENSHOTS", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("robot", "fleet"):
        shots = {}
        for kind, width, dark in (("desktop", 1280, False), ("phone", 390, False), ("dark", 1280, True)):
            browser.open(pages[name], width=width, dark=dark)
            content = browser.screenshot(folder / f"{name}-{kind}.png")
            shots[kind] = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        assert shots["desktop"].shape[1] == 1280
        assert shots["phone"].shape[1] == 390
        assert shots["desktop"].mean() > 180
        assert shots["dark"].mean() < 75
        browser.open(pages[name])
        assert browser.pdf(folder / f"{name}-print.pdf").startswith(b"%PDF")


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("name", ["robot", "closed", "fleet"])
def test_axe_finds_no_serious_fault(name: str, *, dark: bool, browser: Browser, pages: dict[str, Path]) -> None:
    axe = Path(os.environ.get("BOXCAL_AXE", ""))
    if not axe.is_file():
        pytest.skip("axe-core is not here: npm install axe-core, then BOXCAL_AXE=node_modules/axe-core/axe.min.js")
    browser.open(pages[name], dark=dark)
    browser.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    browser.evaluate(axe.read_text(encoding="utf-8") + "; 1")
    faults = browser.evaluate(
        "axe.run(document, {resultTypes: ['violations']})"
        ".then((r) => r.violations.map((v) => [v.impact, v.id, v.nodes[0].html]))"
    )
    assert [f for f in faults if f[0] in {"serious", "critical"}] == []
