"""A fleet's manifest: rows to jobs, and every fault with its line and column."""

from pathlib import Path

import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.manifest import given_manifest, jobs_of, one_target, read_manifest
from boxcal.calib.fleet.options import options
from boxcal.detect.log.wheel_samples import JointUnit
from boxcal.target.box import make_target


def _written(folder: Path, text: str | bytes) -> Path:
    path = folder / "fleet.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_rows_name_robots_logs_and_options(tmp_path: Path) -> None:
    text = (
        "\ufeffrobot,log,joint-unit,ticks-per-turn,reverse-left,camera-topic\n"
        "r01,logs/a.mcap,ticks,508.8,yes,\n"
        "\n"
        ",logs/b.mcap; /else/c.mcap,,,no,/front/image_raw\n"
        'r03,s3://bucket/d.mcap,,,,"/odd,name"\n'
    )
    rows = read_manifest(_written(tmp_path, text), options())
    assert [row.robot for row in rows] == ["r01", "b", "r03"]
    assert [row.line for row in rows] == [2, 4, 5]
    assert rows[1].logs == (tmp_path / "logs/b.mcap", Path("/else/c.mcap"))
    assert rows[2].logs == (Path("s3://bucket/d.mcap"),)
    args = options().parse_args([str(tmp_path / "fleet.csv"), "--camera-topic", "/cam", "--slip-mm", "1"])
    assert [row.robot for row in given_manifest(args, options())] == ["r01", "b", "r03"]
    jobs = jobs_of(rows, args, make_target(), report=False, command="x")
    assert [job.robot for job in jobs] == ["r01", "b", "r03"]
    first = jobs[0].settings.wheel_units
    assert (first.unit, first.ticks_per_turn, first.reverse_left) == (JointUnit.TICKS, 508.8, True)
    assert [job.settings.topics.camera_topic for job in jobs] == ["/cam", "/front/image_raw", "/odd,name"]
    assert {job.settings.slip for job in jobs} == {1e-3}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"^fleet.csv: an empty manifest, a first row of columns is needed \(all-cameras, .* and \d+ more\)"),
        ("log\n", r"^fleet.csv: a manifest without robots"),
        ("robot\nr01\n", r"^fleet.csv: line 1: no column 'log'"),
        ("log,joint-unti\n", r"^fleet.csv: line 1, column 2: 'joint-unti' is no column.*did you mean joint-unit\?"),
        ("log,log\n", r"^fleet.csv: line 1, column 2: 'log' stands there twice"),
        ("log,jobs\n", r"^fleet.csv: line 1, column 2: 'jobs' is no column"),
        ("robot,log\nr01,\n", r"^fleet.csv: line 2, column 'log': is empty"),
        ("log\na.mcap,b\n", r"^fleet.csv: line 2, column 2: more cells than columns"),
        ("robot,log\n../r01,a.mcap\n", r"^fleet.csv: line 2, column 'robot': '../r01' cannot name a folder"),
        ("log,joint-unit\na.mcap,deg\nb.mcap,dge\n", r"^fleet.csv: line 3, column 'joint-unit': invalid choice: 'dge'"),
        (
            "log,ticks-per-turn\na.mcap,many\n",
            r"^fleet.csv: line 2, column 'ticks-per-turn': invalid float value: 'many'",
        ),
        (
            "log,reverse-left\na.mcap,perhaps\n",
            r"^fleet.csv: line 2, column 'reverse-left': 'perhaps' is neither yes nor",
        ),
        ("log\nx/a.mcap\ny/a.mcap\n", r"^fleet.csv: line 3, column 'log': robot a stands in line 2 already"),
        ('log\n"a.mcap\n', r"^fleet.csv: line \d: "),
        (b"log\n\xff.mcap\n", r"^fleet.csv: line 2: not UTF-8"),
    ],
)
def test_a_fault_of_a_manifest_is_said_with_line_and_column(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(CalibError, match=message) as caught:
        read_manifest(_written(tmp_path, text), options())
    assert "\n" not in str(caught.value)


def test_robots_of_one_manifest_drive_around_one_box(tmp_path: Path) -> None:
    rows = read_manifest(_written(tmp_path, "log,target\na.mcap,box/target.json\nb.mcap,\n"), options())
    assert one_target(rows) == tmp_path / "box/target.json"
    rows = read_manifest(_written(tmp_path, "log,target\na.mcap,1.json\nb.mcap,2.json\n"), options())
    with pytest.raises(CalibError, match=r"^fleet.csv: line 3, column 'target': another box than in line 2"):
        one_target(rows)


def test_a_manifest_stands_alone(tmp_path: Path) -> None:
    path = _written(tmp_path, "log\na.mcap\n")
    args = options().parse_args([str(path), "b.mcap"])
    with pytest.raises(CalibError, match="a manifest stands alone"):
        given_manifest(args, options())
