"""The pages as files: whole, self-contained, harmless whatever the names, small and quick."""

import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import faulty
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.errors import CalibError
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.report.fleet import fleet_report
from boxcal.calib.report.fleet_tables import outlying, robot_link
from boxcal.calib.report.page import _environment, embedded, page, readable_time
from boxcal.calib.report.robot import robot_report
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import Covariance
from boxcal.detect.correspondences import Correspondences

Calibrations = Callable[[str], Calibration]
Drives = Callable[[str], Correspondences]
EVIL = "<script>alert(1)</script>/../../x"
VOID = {"meta", "link", "input", "br", "rect", "circle", "path"}
STATIC = Path(__file__).resolve().parents[2] / "calib" / "report" / "static"


class Page(HTMLParser):
    """A page taken apart; complains about tags that do not match."""

    def __init__(self, html: bytes) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.scripts: list[str] = []
        self.feed(html.decode())
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        (self.scripts if self.open and self.open[-1] in {"script", "style"} else self.texts).append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


def _data(html: bytes) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', html.decode(), re.DOTALL)
    assert found is not None
    data: dict[str, object] = json.loads(found[1])
    return data


@pytest.fixture(scope="module")
def robot_page(full: tuple[Calibration, Correspondences]) -> bytes:
    return robot_report(*full, faulty.TARGET)


@pytest.fixture(scope="module")
def fleet(calibrations: Calibrations) -> Sequence[Calibration]:
    names = ("good_drive", "few_stops", "one_side", "slipped", "box_moved", "wrong_print", "blurred")
    return [replace(calibrations(name), robot=name) for name in names]


def test_first_screen_answers_whether_how_sure_and_what_now(robot_page: bytes) -> None:
    text = Page(robot_page).text
    first = text[: text.index("Wheels, camera and extrinsics")]
    for words in (
        "Usable",
        "Between stops 6 and 7",
        "What now",
        "Drive slower",
        "How sure",
        "after 10 m straight ahead",
    ):
        assert words in first, words


def test_page_has_every_part(robot_page: bytes) -> None:
    found = Page(robot_page)
    ids = [a["id"] for _, a in found.tags if a.get("id")]
    assert len(ids) == len(set(ids))
    for part in (
        "parameters",
        "view",
        "residuals",
        "legs",
        "growth",
        "projection",
        "heldout",
        "singular",
        "provenance",
    ):
        assert part in ids
    data = _data(robot_page)
    assert all(data[k] for k in ("scene", "residuals", "legs", "growth", "projection", "heldOut"))
    for words in ("left out", "fleet-calibrate robots/r01.mcap", "ab" * 32, "T_body_cam"):
        assert words in found.text, words


def test_page_is_accessible_by_its_structure(robot_page: bytes, fleet: Sequence[Calibration]) -> None:
    for html in (robot_page, fleet_report(fleet, [CalibError("broken", source="r9.mcap", remedy="record it again")])):
        found = Page(html)
        names = [tag for tag, _ in found.tags]
        assert names.count("h1") == names.count("main") == names.count("header") == names.count("footer") == 1
        assert ("html", {"lang": "en"}) in found.tags
        assert names.count("table") == names.count("caption")
        levels = [int(t[1]) for t in names if t in {"h1", "h2", "h3"}]
        assert all(b - a <= 1 for a, b in pairwise(levels))
        ids = {a.get("id") for _, a in found.tags}
        for tag, a in found.tags:
            if tag == "canvas" or "chart" in (a.get("class") or "").split():
                assert a.get("role") == "img"
                assert len(a.get("aria-label") or "") > 20
            if tag == "svg":
                assert a.get("aria-hidden") == "true"
            if "aria-labelledby" in a:
                assert a["aria-labelledby"] in ids
            if tag == "a" and (a["href"] or "").startswith("#"):
                assert (a["href"] or "")[1:] in ids
            if tag == "th":
                assert a.get("scope") in {"col", "row"}


def test_page_asks_nobody_for_anything(robot_page: bytes, fleet: Sequence[Calibration]) -> None:
    for html in (robot_page, fleet_report(fleet, [])):
        found = Page(html)
        for tag, a in found.tags:
            assert tag not in {"img", "iframe", "object", "embed", "base"}
            assert "src" not in a
            assert not any(name.startswith("on") or name == "style" for name in a)
            if tag == "form":
                assert "action" not in a
        policy = next(a["content"] for t, a in found.tags if a.get("http-equiv") == "Content-Security-Policy")
        assert policy is not None
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "connect-src" not in policy  # falls back to none
        text = html.decode().replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text
        assert "https://" not in text


def test_static_files_cannot_end_their_element() -> None:
    for file in STATIC.iterdir():
        assert "</" not in file.read_text(encoding="utf-8"), file.name


@pytest.mark.parametrize("name", [EVIL, '"><img src=x onerror=alert(1)>', "a\u2028b", "{{ 7*7 }}", "x" * 300, "日本 é"])
def test_name_with_markup_stays_text(name: str, full: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = full
    notes = (name, *calibration.notes)
    provenance = replace(calibration.provenance, command=name, inputs={name: name}, settings={name: {name: name}})
    renamed = replace(calibration, robot=name, notes=notes, provenance=provenance)
    robot = robot_report(renamed, drive, faulty.TARGET)
    fleet = fleet_report([renamed] * 6, [CalibError(name, source=name, remedy=name)])
    plain = fleet_report([calibration] * 6, [CalibError("r", source="r", remedy="r")])
    for html, harmless in ((robot, robot_report(calibration, drive, faulty.TARGET)), (fleet, plain)):
        found = Page(html)
        assert [t for t, _ in found.tags if t in {"script", "img"}] == [
            t for t, _ in Page(harmless).tags if t in {"script", "img"}
        ]
        assert " ".join(name.split()) in found.text
        assert "49" not in re.findall(r"<h1>(.*?)</h1>", html.decode(), re.DOTALL)[0]
    assert _data(fleet)["robots"] == [name] * 6


@given(st.text(max_size=60))
def test_link_to_a_robot_stays_below_the_fleet(name: str) -> None:
    try:
        name.encode()
    except UnicodeEncodeError:
        return
    link = robot_link(name)
    if name in {"", ".", ".."}:
        assert link == ""
        return
    where = urlsplit(urljoin("file:///results/fleet.html", link))
    assert (where.scheme, where.query, where.fragment) == ("file", "", "")
    parts = where.path.split("/")
    assert parts[:2] == ["", "results"]
    assert len(parts) == 4
    assert unquote(parts[2]) == name
    assert parts[3] == "report.html"


@settings(max_examples=60)
@given(
    st.recursive(st.text(max_size=20) | st.integers() | st.booleans() | st.none(), lambda s: st.lists(s, max_size=4))
)
def test_embedded_data_comes_back_and_cannot_close_its_element(value: object) -> None:
    text = embedded({"value": value})
    assert json.loads(text) == {"value": value}
    assert not set(text) & {"<", ">", "&", "\u2028", "\u2029"}


def test_embedded_data_must_be_finite() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        embedded({"x": float("nan")})


def test_closed_form_gets_a_report_that_says_less(full: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = full
    html = robot_report(replace(calibration, detail=None, method="four-steps"), drive, faulty.TARGET)
    text = Page(html).text
    assert "Usable" in text
    assert "closed form alone" in text
    assert "±" not in text
    data = _data(html)
    assert data["growth"] is None
    assert data["projection"] is None
    assert data["legs"]
    fleet_report([replace(calibration, detail=None)] * 6, [])


def test_undetermined_parameter_is_said_not_hidden(full: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = full
    assert calibration.detail is not None
    matrix = calibration.detail.covariance.matrix.copy()
    for k in (7, 9):
        matrix[k, :], matrix[:, k], matrix[k, k] = np.nan, np.nan, np.inf
    ground = replace(calibration.detail.ground, turn_heading=np.inf, straight_heading=np.inf, straight_position=np.inf)
    open_ = replace(
        calibration, detail=replace(calibration.detail, covariance=Covariance(matrix=matrix), ground=ground)
    )
    text = Page(robot_report(open_, drive, faulty.TARGET)).text
    assert "Redo" in text
    assert text.count("not determined") >= 3
    assert "an unknown length" in Page(fleet_report([open_], [])).text


def test_calibration_without_its_drive_still_gets_a_report(full: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = full
    other = replace(drive, stops=())
    text = Page(robot_report(calibration, other, faulty.TARGET)).text
    assert "None of the stops of this drive is in the calibration" in text
    assert "There is no leg" in text


def test_several_drives_of_one_robot_get_one_report(drives: Drives) -> None:
    both = [faulty.good_drive(8, seed=1), drives("slipped")]
    calibration = faulty.calibrated(*both)
    html = robot_report(calibration, both, faulty.TARGET)
    data = _data(html)
    legs, residuals = data["legs"], data["residuals"]
    assert isinstance(legs, dict)
    assert isinstance(residuals, dict)
    assert len(legs["names"]) == 7 + 13
    assert [name for name, used in zip(legs["names"], legs["used"], strict=True) if not used] == ["2.6\u20132.7"]
    assert [s["stop"] for s in residuals["stops"]][:9] == [f"1.{k}" for k in range(1, 9)] + ["2.1"]
    assert "Between stops 6 and 7 of drive 2" in Page(html).text
    assert judge(calibration, both, faulty.TARGET).reasons[0].rule == "legs"


def test_box_that_was_estimated_is_in_the_report() -> None:
    drive = faulty.wrong_print()
    options = EstimateOptions(scale_sigma=0.02, ink_sigma=1e-4, target=faulty.TARGET)
    calibration = faulty.calibrated(drive, options=options)
    text = Page(robot_report(calibration, drive, faulty.TARGET)).text
    assert "Good" in text
    assert "+1.0% across" in text
    assert "The calibration takes it into account" in text
    assert "scale_x" in text


def test_fleet_lists_failures_with_what_to_do(fleet: Sequence[Calibration], calibrations: Calibrations) -> None:
    failures = []
    for name in ("no_turn", "swapped_wheels"):
        with pytest.raises(CalibError) as refused:
            calibrations(name)
        failures.append(refused.value.of(f"{name}.mcap"))
    text = Page(fleet_report(fleet, failures)).text
    assert "Fleet of 9" in text
    assert "no_turn.mcap : largest turn between stops is 0.3 deg" in text
    assert "What to do: add stops that face the box from other sides" in text
    assert "What to do: exchange --left-joint and --right-joint" in text
    only = Page(fleet_report([], failures)).text
    assert "Fleet of 2" in only


def test_fleet_counts_and_links_its_robots(fleet: Sequence[Calibration], drives: Drives) -> None:
    judged = [replace(c, verdict=judge(c, drives(c.robot), faulty.TARGET)) for c in fleet]
    found = Page(fleet_report(judged, []))
    assert "1 good" in found.text
    assert "4 usable" in found.text
    assert "2 redo" in found.text
    links = {a["href"] for t, a in found.tags if t == "a" and (a["href"] or "").endswith("report.html")}
    assert links == {f"./{c.robot}/report.html" for c in fleet}
    assert "no new drive is needed" in found.text
    assert "no new drive is needed" not in Page(fleet_report(fleet, [])).text


def test_odd_robot_stands_out_and_alike_ones_do_not() -> None:
    rng = np.random.default_rng(0)
    values = 1 + 0.01 * rng.standard_normal((30, 2))
    values[7, 1] = 1.2
    odd = outlying(values, np.full((30, 2), 0.001))
    assert np.argwhere(odd).tolist() == [[7, 1]]
    assert not outlying(values, np.full((30, 2), 0.2)).any()  # it is not known well enough to be odd
    assert not outlying(np.ones((30, 2)), np.zeros((30, 2))).any()
    assert not outlying(values[5:9], np.zeros((4, 2))).any()  # too few to say
    assert np.argwhere(outlying(values, np.full((30, 2), np.nan))).tolist() == [[7, 1]]


def test_pages_are_small(full: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = full
    assert len(robot_report(calibration, drive, faulty.TARGET)) < 3e6
    many = [replace(calibration, robot=f"r{i:03d}") for i in range(100)]
    assert (
        len(
            fleet_report(many, [CalibError("broken", source=f"f{i}.mcap", remedy="record it again") for i in range(20)])
        )
        < 5e6
    )


def test_long_drive_stays_below_three_megabytes(full: tuple[Calibration, Correspondences]) -> None:
    calibration, drive = full
    stops, results = [], []
    for k in range(200):  # every stop sees all four faces' worth of corners
        stop = drive.stops[k % len(drive.stops)]
        shift = 10**15 * (k + 1)
        count = len(stop.landmark_ids)
        rows = np.arange(560) % count
        stops.append(
            replace(
                stop,
                t_start_ns=stop.t_start_ns + shift,
                t_end_ns=stop.t_end_ns + shift,
                first_sample=10 * k,
                last_sample=10 * k + 1,
                landmark_ids=np.arange(560),
                **{name: getattr(stop, name)[rows] for name in ("p_box", "uv_px", "cov_px2", "faces")},
            )
        )
        result = calibration.stops[k % len(calibration.stops)]
        results.append(replace(result, t_start_ns=stop.t_start_ns + shift, t_end_ns=stop.t_end_ns + shift))
    n = len(drive.wheels.t_ns)
    tile = -(-2010 // n)
    wheels = replace(
        drive.wheels,
        t_ns=np.arange(n * tile, dtype=np.int64) * 20_000_000,
        phi_R=np.tile(drive.wheels.phi_R, tile),
        phi_L=np.tile(drive.wheels.phi_L, tile),
    )
    long = replace(drive, stops=tuple(stops), wheels=wheels)
    html = robot_report(replace(calibration, stops=tuple(results)), long, faulty.TARGET)
    assert len(html) < 3e6
    residuals = _data(html)["residuals"]
    assert isinstance(residuals, dict)
    assert residuals["every"] > 1


def test_time_is_said_as_people_read_it() -> None:
    assert readable_time("2026-01-02T03:04:05+00:00") == "2026-01-02 03:04 UTC"
    assert readable_time("yesterday") == "yesterday"


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    _environment.cache_clear()
    with pytest.raises(CalibError, match=r"pip install 'boxcal\[report\]'"):
        page("robot.html", scripts=(), data={})
