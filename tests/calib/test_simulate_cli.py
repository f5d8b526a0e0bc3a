"""The command simulate-fleet: files, seeds, errors and exit status."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from boxcal.calib.simulate.cli import main
from boxcal.target.box import Box, make_target
from boxcal.target.files.target_json import save_target

QUICK = ("--stops", "3", "--frames", "1", "--moving-frames", "0", "--jobs", "1")
ROOT = Path(__file__).resolve().parents[2]


def run(folder: Path, *options: str) -> int:
    return main([str(folder), *QUICK, *options])


def test_robots_differ_and_each_has_a_log_and_a_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path / "fleet", "--robots", "2") == 0
    assert sorted(p.name for p in (tmp_path / "fleet").iterdir()) == [
        "r01.mcap",
        "r01.truth.json",
        "r02.mcap",
        "r02.truth.json",
    ]
    truths = [json.loads((tmp_path / "fleet" / f"r0{k}.truth.json").read_bytes()) for k in (1, 2)]
    assert [t["robot"] for t in truths] == ["r01", "r02"]
    for key in ("rR", "rL", "b", "camera", "T_vehicle_camera"):
        assert truths[0][key] != truths[1][key]
    out, err = capsys.readouterr()
    assert [line.split(":")[0] for line in out.splitlines()] == [
        str(tmp_path / "fleet" / f"{name}.mcap") for name in ("r01", "r02")
    ]
    assert "2 of 2 robots done" in err


def test_same_seed_gives_the_same_bytes_whatever_runs_beside_it(tmp_path: Path) -> None:
    assert run(tmp_path / "a", "--robots", "1", "--seed", "7") == 0
    assert run(tmp_path / "b", "--robots", "2", "--seed", "7", "--jobs", "2") == 0
    assert run(tmp_path / "c", "--robots", "1", "--seed", "8") == 0
    for name in ("r01.mcap", "r01.truth.json"):
        a, b, c = ((tmp_path / folder / name).read_bytes() for folder in "abc")
        assert a == b
        assert a != c


def test_options_reach_the_log(tmp_path: Path) -> None:
    save_target(make_target(Box(first_id=100)), tmp_path / "target.json")
    options = ("--robots", "1", "--target", str(tmp_path / "target.json"), "--encoder-step-deg", "0", "--slip", "1.5")
    options += ("--joint-rate-hz", "100", "--image", "raw", "--compression", "none", "--image-size", "800x600")
    assert run(tmp_path, *options) == 0
    truth = json.loads((tmp_path / "r01.truth.json").read_bytes())
    assert (truth["tick_deg"], truth["slip"]) == (0, 0.0015)
    assert (truth["camera"]["width"], truth["camera"]["height"]) == (800, 600)
    with (tmp_path / "r01.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = {summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()}
    assert counts["/camera/image_raw"] == 3
    assert counts["/joint_states"] == pytest.approx(truth["stops"][-1]["t_end"] * 100, abs=2)
    assert {c.compression for c in summary.chunk_indexes} == {""}


def test_existing_files_are_replaced(tmp_path: Path) -> None:
    (tmp_path / "r01.mcap").write_bytes(b"old")
    (tmp_path / "r01.truth.json").write_bytes(b"old")
    assert run(tmp_path, "--robots", "1") == 0
    assert (tmp_path / "r01.mcap").read_bytes()[:8] == b"\x89MCAP0\r\n"
    assert json.loads((tmp_path / "r01.truth.json").read_bytes())["robot"] == "r01"
    assert len(list(tmp_path.iterdir())) == 2


def test_robot_that_cannot_see_the_box_fails_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, "--robots", "1", "--image-size", "100x80") == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[0].startswith("simulate-fleet: r01: no place found")
    assert list(tmp_path.iterdir()) == []


def test_one_robot_that_fails_does_not_stop_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "r01.mcap").mkdir()
    assert run(tmp_path, "--robots", "2") == 1
    assert (tmp_path / "r02.truth.json").exists()
    assert not (tmp_path / "r01.truth.json").exists()
    out, err = capsys.readouterr()
    assert "r01" not in out
    assert "r01.mcap: cannot be written" in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--target", "missing.json"), "missing.json: cannot be read"),
        (("--target", "broken.json"), "broken.json: not a whole JSON file"),
    ],
)
def test_target_that_cannot_be_read_fails_with_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.json").write_text("{")
    assert run(tmp_path / "out", *options) == 1
    err = capsys.readouterr().err
    assert message in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_folder_that_is_a_file_fails_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert run(tmp_path / "file") == 1
    assert "file: cannot be made" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [
        ("--robots", "0"),
        ("--stops", "2"),
        ("--seed", "-1"),
        ("--slip", "nan"),
        ("--joint-rate-hz", "0"),
        ("--image-size", "640"),
        ("--image-size", "640x9999999"),
        ("--quality", "101"),
        ("--image", "gif"),
        ("--noise", "-1"),
        ("--frames", "1.5"),
        ("--unknown",),
    ],
)
def test_wrong_usage_exits_with_2(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(tmp_path / "out", *options)
    assert exit_.value.code == 2
    assert options[0] in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_help_opens_with_an_example_and_loads_nothing_heavy() -> None:
    code = (
        "import sys\nfrom boxcal.calib.simulate.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit as e:\n"
        "    print(e.code, [m for m in ('cv2', 'numpy', 'scipy', 'mcap', 'rosbags') if m in sys.modules])\n"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "0 []"
    text = result.stdout.split("\n\n")[1]
    assert text.startswith("example:\n  simulate-fleet robots --robots 3 --stops 10 ")


def test_each_camera_can_have_its_own_clock_size_and_number_of_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = ("--robots", "1", "--cameras", "2", "--rig", "stereo")
    own = ("--camera-clock-offsets-ms", "30", "-20", "--camera-image-sizes", "640x480", "320x240")
    assert run(tmp_path, *both, *own, "--camera-frames", "2", "5") == 0
    truth = json.loads((tmp_path / "r01.truth.json").read_bytes())
    first, second = truth["camera"], truth["cameras"][0]
    assert (first["width"], second["width"], second["height"]) == (640, 320, 240)
    assert abs(second["fu"] / (1.01 * first["fu"] / 2) - 1) < 1e-12
    assert (truth["camera_stamp_offset_s"], second["camera_stamp_offset_s"]) == (0.03, -0.02)
    assert "3 stops, 21 pictures" in capsys.readouterr().out
    with pytest.raises(SystemExit) as left:
        run(tmp_path, *both, "--camera-frames", "2", "5", "6")
    assert left.value.code == 2
    assert "--camera-frames: one value for each of 2 cameras is needed, and 3 are given" in capsys.readouterr().err
