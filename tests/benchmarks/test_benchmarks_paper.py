"""Quick runs of the benchmarks against the paper work, and the figures they print hold together."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OPTIODOM = ROOT / "../shared/data/optiodom"


def run(script: str, out: Path) -> str:
    command = [sys.executable, str(ROOT / "benchmarks" / script), "--quick", "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def rows(text: str) -> dict[str, list[str]]:
    lines = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| ")]
    return {cells[0].strip(): [c.strip() for c in cells[1:]] for cells in lines}


@pytest.mark.slow
def test_paper_beats_its_procedure_under_slip_and_writes_tables_and_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="pictures need the extra 'bench'")
    printed = run("paper.py", tmp_path)
    slip = rows(printed.split("\nslip\n")[1].split("\nexperiment\n")[0])
    for name in ("rR (%)", "b (%)"):
        closed, ours, ratio = (float(v) for v in slip[name][-3:])
        assert ratio == pytest.approx(closed / ours, rel=0.05)
        assert ratio > 2
    odometry = rows(printed)["P = 5: rR, rL, b (rms)"]
    assert max(float(v) for v in re.findall(r"[\d.]+", odometry[2])) < 0.2
    assert "P = 20, paper's procedure" in (tmp_path / "paper.md").read_text(encoding="utf-8")
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == {
        "paper-fig5-radii.png",
        "paper-fig6-translation.png",
        "paper-fig8-odometry.png",
        "paper-fig9-mounting.png",
    }


@pytest.mark.slow
def test_sensitivity_of_box_scale_and_toed_wheel_is_what_geometry_says(tmp_path: Path) -> None:
    found = rows(run("sensitivity.py", tmp_path))
    head = found["source: procedure"]
    for procedure in ("paper's", "likelihood"):
        scale = dict(zip(head, found[f"box too large by 0.1 %: {procedure}"], strict=True))
        assert [float(scale[k]) for k in ("rR (%)", "rL (%)", "b (%)")] == pytest.approx([-0.1] * 3, rel=0.02)
        toe = dict(zip(head, found[f"right wheel toed in by 1 deg: {procedure}"], strict=True))
        assert float(toe["a1 (deg)"]) == pytest.approx(-0.5, rel=0.02)
        assert float(toe["tx (mm)"]) == pytest.approx(0.0174533 * 80 / 4, rel=0.03)
    assert "box wider" in (tmp_path / "paper.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(not OPTIODOM.exists(), reason="no ../shared/data/optiodom beside the project")
def test_real_wheels_end_nearer_than_nominal_figures_say(tmp_path: Path) -> None:
    printed = run("optiodom.py", tmp_path)
    times = re.search(r"\*\*([\d.]+) times better\*\*", printed)
    assert times is not None
    assert float(times[1]) > 2
    assert len([name for name in rows(printed) if name.startswith(("free", "square"))]) == 3
    assert "times better" in (tmp_path / "accuracy.md").read_text(encoding="utf-8")
