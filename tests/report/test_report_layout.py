"""No text of the pages is cut or printed over, whatever the screen; measured in the browser."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import faulty
import numpy as np
import pytest
from browser import Browser

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.photographs import MOST, small_jpeg
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.report.robot import FLEET_PAGE, robot_report
from boxcal.calib.results.calibration import Calibration
from boxcal.detect.correspondences import Correspondences

LAYOUT = (Path(__file__).parent / "layout.js").read_text(encoding="utf-8")
HEIGHTS = {390: 844, 768: 1024, 1280: 800}
"""Screens: width and height, px."""
LARGEST_PHOTO = 60_000


@pytest.fixture(scope="module")
def pages(
    full: tuple[Calibration, Correspondences],
    calibrations: Callable[[str], Calibration],
    drives: Callable[[str], Correspondences],
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, Path]:
    """A good robot's page with photographs, a redo and one with everything, a fleet of four and one of forty."""
    folder = tmp_path_factory.mktemp("layout")
    good, redo = calibrations("good_drive"), calibrations("few_stops")
    photos = {str(k + 1): photograph(k) for k in range(14)}
    four = [replace(good, robot=name) for name in ("r01", "r02", "a-robot-of-a-long-name-07")]
    four.append(replace(redo, robot="r10"))
    forty = [
        replace(
            good, robot=f"r{k:02d}", wheels=replace(good.wheels, b=good.wheels.b * (1.1 if k == 7 else 1 + 1e-5 * k))
        )
        for k in range(40)
    ]
    lost = CalibError("3 stops, none sees the box", source="r11.mcap", remedy="drive nearer to the box")
    html = {
        "good": robot_report(good, drives("good_drive"), faulty.TARGET, photographs=photos, fleet=FLEET_PAGE),
        "redo": robot_report(redo, drives("few_stops"), faulty.TARGET, fleet=FLEET_PAGE),
        "full": robot_report(*full, faulty.TARGET, photographs=photos, fleet=FLEET_PAGE),
        "fleet": fleet_report(four, [lost], {"r02": "its last log failed"}),
        "forty": fleet_report(forty, []),
    }
    for name, content in html.items():
        (folder / f"{name}.html").write_bytes(content)
    return {name: folder / f"{name}.html" for name in html}


def photograph(seed: int) -> bytes:
    """A noisy picture, which compresses badly."""
    noise = np.random.default_rng(seed).normal(128, 25, (480, 640))
    return small_jpeg(cv2.GaussianBlur(np.clip(noise, 0, 255).astype(np.uint8), (3, 3), 0))


@pytest.mark.parametrize("width", HEIGHTS)
@pytest.mark.parametrize("name", ["good", "redo", "full", "fleet", "forty"])
def test_no_text_is_cut_or_printed_over(name: str, width: int, browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages[name], width=width, height=HEIGHTS[width])
    faults = browser.evaluate(LAYOUT)
    assert browser.complaints() == []
    assert faults == []


def test_the_measurement_finds_what_is_cut_and_what_is_printed_over(
    browser: Browser, pages: dict[str, Path], tmp_path: Path
) -> None:
    html = pages["good"].read_text(encoding="utf-8")
    spoilt = tmp_path / "spoilt.html"
    # the page's policy forbids styles of its own in an element, so the fault is in a drawing and a narrow cell
    words = {"one": (2, 15), "two": (4, 16), "beyond": (50, 15)}
    texts = "".join(f'<text x="{x}" y="{y}">{word}</text>' for word, (x, y) in words.items())
    drawing = f'<svg width="60" height="30" viewBox="0 0 60 30">{texts}</svg>'
    spoilt.write_text(html.replace("</main>", f"{drawing}</main>"), encoding="utf-8")
    browser.open(spoilt)
    faults = browser.evaluate(LAYOUT)
    assert any('"one"' in f and "over" in f and '"two"' in f for f in faults)
    assert any(f.startswith("cut by svg") and '"beyond"' in f for f in faults)


@pytest.mark.parametrize("width", HEIGHTS)
@pytest.mark.parametrize("name", ["good", "redo"])
def test_first_screen_holds_verdict_cause_and_what_now(
    name: str, width: int, browser: Browser, pages: dict[str, Path]
) -> None:
    browser.open(pages[name], width=width, height=HEIGHTS[width])
    for selector in (".verdict .word", ".verdict .headline", ".verdict .reasons li", ".verdict .steps"):
        bottom = browser.evaluate(f"document.querySelector('{selector}').getBoundingClientRect().bottom")
        assert bottom <= HEIGHTS[width], selector


def test_photographs_are_small_folded_and_drawn_with_their_residuals(browser: Browser, pages: dict[str, Path]) -> None:
    assert len(photograph(1)) < LARGEST_PHOTO
    assert pages["good"].stat().st_size < 1_000_000 + MOST * LARGEST_PHOTO * 4 / 3
    browser.open(pages["good"])
    folds = "[...document.querySelectorAll('details.photograph')]"
    assert browser.evaluate(f"{folds}.map((d) => d.open)") == [False] * 14
    browser.evaluate(f"{folds}.forEach((d) => {{ d.open = true; }})")
    browser.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
    drawn = browser.evaluate(
        f"{folds}.map((d) => [d.querySelectorAll('image').length, d.querySelectorAll('.vectors').length])"
    )
    assert all(pictures == 1 and vectors >= 1 for pictures, vectors in drawn)
    assert browser.complaints() == []
    assert browser.requests() == []


def test_pages_of_robot_and_fleet_link_to_each_other(
    calibrations: Callable[[str], Calibration],
    drives: Callable[[str], Correspondences],
    browser: Browser,
    tmp_path: Path,
) -> None:
    good = calibrations("good_drive")
    (tmp_path / "r 01").mkdir()
    (tmp_path / "fleet.html").write_bytes(
        fleet_report([replace(good, robot="r 01"), replace(good, robot="r02")], [], without_page=("r02",))
    )
    page = robot_report(good, drives("good_drive"), faulty.TARGET, fleet=FLEET_PAGE)
    (tmp_path / "r 01" / "report.html").write_bytes(page)
    browser.open(tmp_path / "fleet.html")
    links = browser.evaluate("[...document.querySelectorAll('#robot-table a')].map((a) => a.href)")
    assert links == [(tmp_path / "r 01" / "report.html").as_uri()]
    browser.open(tmp_path / "r 01" / "report.html")
    assert browser.evaluate("document.querySelector('a.up').href") == (tmp_path / "fleet.html").as_uri()


def test_every_dot_of_a_small_fleet_has_its_name(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["fleet"])
    names = browser.evaluate(
        "[...document.querySelectorAll('#spread-charts svg')]"
        ".map((s) => [...s.querySelectorAll('text')].map((t) => t.textContent))"
    )
    assert len(names) == 14
    for texts in names:
        assert {"r01", "r02", "r10", "a-robot-of-a-lo\u2026"} <= set(texts)


def test_a_phone_shows_each_robot_of_a_fleet_without_scrolling(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["fleet"], width=390, height=844)
    shown = (
        "[...document.querySelectorAll('#robot-table tbody tr')]"
        ".map((r) => [...r.cells].filter((c) => c.offsetWidth).length)"
    )
    assert set(browser.evaluate(shown)) == {6, 7}  # name, verdict, four figures, and why where there is a reason
    browser.evaluate("document.getElementById('filter-level').value = 'redo'")
    browser.evaluate("document.getElementById('filter-level').dispatchEvent(new Event('change'))")
    assert browser.evaluate(shown) == [7]


@pytest.mark.parametrize("name", ["full", "fleet"])
def test_no_figure_is_split_on_paper(name: str, browser: Browser, pages: dict[str, Path]) -> None:
    """Each may not be broken and is lower than a page of A4 between margins of 1 cm, px of 1/96 inch."""
    wide, high = 718, 1046
    browser.open(pages[name], width=wide, height=high)
    browser.send("Emulation.setEmulatedMedia", media="print")
    browser.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
    figures = browser.evaluate(
        "[...document.querySelectorAll('figure, .verdict, .sure, tr, .note')].filter((f) => f.offsetHeight)"
        ".map((f) => [f.className || f.tagName, getComputedStyle(f).breakInside, f.offsetHeight])"
    )
    assert len(figures) > 10
    assert [f for f in figures if f[1] != "avoid" or f[2] > high] == []


@pytest.mark.parametrize("width", [390, 1280])
def test_figures_below_a_strip_keep_apart_however_many_digits_they_have(
    width: int, calibrations: Callable[[str], Calibration], browser: Browser, tmp_path: Path
) -> None:
    good = calibrations("good_drive")
    assert good.detail is not None
    sharp = replace(good.detail, covariance=replace(good.detail.covariance, matrix=np.eye(14) * 4e-12))
    robots = [replace(good, robot=f"robot-{k}-of-the-fleet", detail=sharp) for k in (1, 2)]
    (tmp_path / "fleet.html").write_bytes(fleet_report(robots, []))
    browser.open(tmp_path / "fleet.html", width=width, height=900)
    gaps = browser.evaluate(
        "[...document.querySelectorAll('#spread-charts svg')].flatMap((s) => {"
        " const t = [...s.querySelectorAll('text[text-anchor=middle]')].map((e) => e.getBoundingClientRect());"
        " return t.slice(1).map((r, k) => r.left - t[k].right); })"
    )
    assert len(gaps) > 8
    assert min(gaps) > 3
