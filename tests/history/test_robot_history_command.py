"""The command ``robot-history``, and results that ``fleet-calibrate`` puts into a store."""

import pickle
import re
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sqlalchemy")
pytest.importorskip("alembic")

from boxcal.calib.cli import main as fleet_calibrate
from boxcal.calib.history.session import session_of
from boxcal.calib.history_store.connection import open_store
from boxcal.calib.history_store.sessions import put, read
from boxcal.calib.report.history import file_name, history_pages
from boxcal.calib.results.json_format import load_calibration, save_calibration
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.robot_history.cli import main
from boxcal.calib.simulate.years import Years, simulated_years


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A year of twelve robots: one wears, one is knocked."""
    path = tmp_path_factory.mktemp("store") / "fleet.sqlite"
    asked = Years(robots=12, sessions=26, worn=(3,), wear=-0.004, knocked={7: 15})
    with open_store(f"sqlite:///{path}") as connection:
        put(connection, simulated_years(asked, np.random.default_rng(0)))
    return path


def test_list_tells_all_robots_and_their_changes(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "--store", str(store)]) == 0
    out = capsys.readouterr().out
    rows = [line for line in out.splitlines() if line.startswith("r0")]
    assert len(rows) == 12 + 2
    assert "r0003: wheel radii: drift of" in out
    assert "r0007: camera turned by 0.3" in out
    assert "no more than 0.02 false alarms a year" in out


def test_show_tells_a_robots_drives(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "r0003", "--store", str(store)]) == 0
    out = capsys.readouterr().out
    assert out.count("good") == 26
    assert re.search("left radius: \N{MINUS SIGN}0.(3[5-9]|4[0-5]) ± 0.0[1-9] % a year over 26 drives", out)
    assert "calibrate again by: 20" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["show", "r00003"],
            "no robot r00003 in the store; robot-history list shows those that are; did you mean r0003?",
        ),
        (["page", "out", "r0003", "r00007"], "no robot r00007 in the store"),
        (["list", "--store", "nowhere.sqlite"], "nowhere.sqlite: no such file; fleet-calibrate --store makes it"),
        (["list", "--store", "postgresql://u:geheim@h/x"], "--store holds a password"),
        (["import", "empty"], "empty: cannot be read|empty: "),
        (["date", "r0003", "3-1", "yesterday"], "'yesterday' is no date, one such as 2026-03-01"),
        (["date", "r0003", "x", "2026-03-01"], "no drive of r0003 begin with 'x'"),
    ],
)
def test_faults_are_one_line(
    words: list[str], message: str, store: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BOXCAL_STORE", str(store))
    status = main(words)
    err = capsys.readouterr().err
    assert status in {1, 2}
    assert any(part in err for part in message.split("|"))
    assert err.count("\n") == 1
    assert "geheim" not in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["shwo", "r1"], "did you mean show?"),
        (["list", "--stor", "x"], "did you mean --store?"),
        (["show"], "show needs the name of a robot"),
        (["date", "r1"], "date needs ROBOT DRIVE DATE"),
    ],
)
def test_mistyped_words_are_answered(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as leave:
        main(words)
    assert leave.value.code == 2
    assert message in capsys.readouterr().err


def test_no_store_is_said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("BOXCAL_STORE", raising=False)
    assert main(["list"]) == 2
    assert (
        capsys.readouterr().err == "robot-history: no store is named; give --store FILE, or its URL by BOXCAL_STORE\n"
    )


def test_names_of_robots_stay_inside_the_folder_of_pages(tmp_path: Path) -> None:
    from boxcal.calib.history.fleet_history import fleet_history  # noqa: PLC0415

    pytest.importorskip("jinja2")
    names = ["../../x", ".", "..", "<b>&", "a" * 300, "r 01", "CON/..", "Ünï"]
    sessions = simulated_years(Years(robots=1, sessions=2), np.random.default_rng(0))
    fleet = fleet_history([replace(s, robot=name, key=f"{s.key}{k}") for k, name in enumerate(names) for s in sessions])
    pages = dict(history_pages(fleet))
    assert len(pages) == 1 + len(names)
    for relative in pages:
        path = (tmp_path / relative).resolve()
        assert path.parent in {tmp_path.resolve(), (tmp_path / "robots").resolve()}
        assert len(path.name) < 256
    assert len({file_name(name) for name in names}) == len(names)
    assert b"<b>&" not in pages["history.html"]


def test_results_go_into_the_store_once_and_an_import_adds_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import boxcal  # noqa: PLC0415

    drives = []
    for seed in (1, 2):
        simulated = boxcal.simulate(stops=8, seed=seed)
        path = tmp_path / f"r{seed}.npz"
        simulated.correspondences.save(path)
        drives.append(str(path))
    store, out = tmp_path / "fleet.sqlite", tmp_path / "calibration"
    asked = [*drives, "--out", str(out), "--store", str(store), "--no-report", "--quiet", "--hardware", "rev B"]
    assert fleet_calibrate([*asked, "--jobs", "1"]) == 0
    assert fleet_calibrate([*asked, "--jobs", "1"]) == 0
    with open_store(f"sqlite:///{store}") as connection:
        found = read(connection)
    assert [s.robot for s in found] == ["r1", "r2"]
    assert {s.hardware for s in found} == {"rev B"}
    saved = load_calibration(out / "r1" / "calibration.json")
    assert saved.detail is not None
    np.testing.assert_allclose(found[0].covariance, saved.detail.covariance.matrix, rtol=1e-12)
    assert found[0].wheels.tolist() == [saved.wheels.rR, saved.wheels.rL, saved.wheels.b]
    kept, other = (without_drive(pickle.loads(pickle.dumps(c))) for c in (saved, saved))
    assert kept.verdict is not None
    assert saved.verdict is not None
    assert kept.verdict.count == saved.verdict.count
    assert list(kept.verdict.lines()) == list(saved.verdict.lines())
    assert all(a is b for a, b in zip(kept.verdict.passed, other.verdict.passed, strict=True))  # type: ignore[union-attr]
    assert len(pickle.dumps(kept)) < 7000
    whole, slim = session_of(saved), session_of(kept)
    assert (whole.key, whole.t_ns, whole.hardware) == (slim.key, slim.t_ns, slim.hardware)
    assert (found[0].key, found[0].t_ns) == (whole.key, whole.t_ns)
    capsys.readouterr()
    assert main(["import", str(out), "--store", str(store)]) == 0
    assert capsys.readouterr().out == "2 results read: 0 new drives, 2 of drives that were there already\n"
    other = tmp_path / "other.sqlite"
    (out / "r2" / "calibration.json").write_text("{}")
    assert main(["import", str(out), "--store", str(other)]) == 1
    told = capsys.readouterr()
    assert told.out == "1 results read: 1 new drives, 0 of drives that were there already\n"
    assert "r2/calibration.json: no calibration in it" in told.err
    save_calibration(saved, out / "r2" / "calibration.json")


def test_a_store_that_is_locked_costs_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import boxcal  # noqa: PLC0415

    monkeypatch.setitem(open_store.__wrapped__.__kwdefaults__, "patience_s", 0.1)  # type: ignore[attr-defined]
    simulated = boxcal.simulate(stops=8, seed=1)
    simulated.correspondences.save(tmp_path / "r1.npz")
    store, out = tmp_path / "fleet.sqlite", tmp_path / "calibration"
    with open_store(f"sqlite:///{store}"):
        pass
    other = sqlite3.connect(store, isolation_level=None)
    other.execute("begin exclusive")
    asked = [str(tmp_path / "r1.npz"), "--out", str(out), "--store", str(store), "--no-report", "--quiet"]
    assert fleet_calibrate([*asked, "--jobs", "1"]) == 1
    err = capsys.readouterr().err
    assert "the results will be in their folder all the same" in err
    assert f"the results are in their folder: robot-history import {out}" in err
    other.close()
    assert main(["import", str(out), "--store", str(store)]) == 0
    with open_store(f"sqlite:///{store}") as connection:
        assert [s.robot for s in read(connection)] == ["r1"]


def test_a_store_of_a_newer_version_is_said_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = tmp_path / "fleet.sqlite"
    with open_store(f"sqlite:///{store}") as connection:
        connection.exec_driver_sql("update boxcal_version set version_num = '9999'")
    (tmp_path / "r1.npz").write_bytes(b"")
    assert fleet_calibrate([str(tmp_path / "r1.npz"), "--out", str(tmp_path / "out"), "--store", str(store)]) == 2
    assert "made by a newer version of boxcal" in capsys.readouterr().err


def test_a_clock_that_was_never_set_is_dated_by_the_calibration() -> None:
    import boxcal  # noqa: PLC0415

    simulated = boxcal.simulate(stops=8, seed=1)
    found = boxcal.calibrate(simulated.correspondences, simulated.target)
    created = "2026-03-04T05:06:07+00:00"
    dated = replace(found, provenance=replace(found.provenance, created=created))

    def at(t_ns: int) -> object:
        stops = tuple(replace(s, t_start_ns=t_ns + k, t_end_ns=t_ns + k) for k, s in enumerate(dated.stops))
        s = session_of(replace(dated, stops=stops))
        return s.date, bool(s.notes)

    day = 86_400 * 10**9
    assert at(0) == ("2026-03-04", True)
    assert at(1_772_600_000 * 10**9 + 40 * day) == ("2026-03-04", True)
    assert at(1_772_600_000 * 10**9 - 40 * day) == ("2026-01-23", False)
