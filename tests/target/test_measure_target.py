"""``measure-target``: what readings say, that its covariance holds, and its command line."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from boxcal.target import cli as make_cli
from boxcal.target.box import Box, make_target
from boxcal.target.files.target_json import load_target, save_target
from boxcal.target.measure import cli
from boxcal.target.measure.ruler import SCALE_PRIOR, SIZE_PRIOR, Readings, lengths, measure

BOX = Box()
READ = ["--bar-x", "99.7", "--bar-y", "99.6", "--width", "250.4", "--depth", "249.8", "--height", "200.3"]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save_target(make_target(BOX), tmp_path / "target.json")
    return tmp_path / "target.json"


def reading(*values: float, sigma: float = 2e-4) -> Readings:
    return Readings(values=values, sigma=sigma)


def test_a_bar_gives_the_scale_and_its_sigma() -> None:
    result = measure(BOX, {"bar_x": reading(0.0997)}, ruler_sigma=0).measured
    assert result.sx == pytest.approx(0.997, rel=1e-12)
    assert result.cov[0, 0] ** 0.5 == pytest.approx(0.002, rel=1e-12)


def test_what_was_not_measured_is_as_designed_with_a_builders_usual_error() -> None:
    conclusion = measure(BOX, {"bar_x": reading(0.0997)}, ruler_sigma=0.01)
    result = conclusion.measured
    assert (result.sy, result.width, result.depth, result.height) == (1, 0.25, 0.25, 0.2)
    assert np.sqrt(np.diag(result.cov))[1:] == pytest.approx([SCALE_PRIOR, *[SIZE_PRIOR] * 3])
    assert conclusion.read == {"sx"}
    assert result.cov[0, 1] == 0, "the ruler's error is not in what it did not read"


def test_a_rulers_own_error_is_common_to_all_that_it_read() -> None:
    readings = {name: reading(length.designed, sigma=1e-9) for name, length in lengths(BOX).items()}
    conclusion = measure(BOX, readings, ruler_sigma=1e-3)
    sigma = np.sqrt(np.diag(conclusion.measured.cov))
    assert conclusion.measured.cov / np.outer(sigma, sigma) == pytest.approx(np.ones((5, 5)), abs=1e-6)
    assert conclusion.scale_sigma == pytest.approx(1e-3, rel=1e-6)
    assert conclusion.ruler == pytest.approx(1, rel=1e-6)


def test_readings_that_scatter_more_than_they_should_raise_their_sigma() -> None:
    calm = measure(BOX, {"width": reading(0.2501, 0.2502, 0.2503)}, ruler_sigma=0).measured
    wild = measure(BOX, {"width": reading(0.2486, 0.2502, 0.2518)}, ruler_sigma=0).measured
    assert calm.width == pytest.approx(wild.width)
    assert calm.cov[2, 2] ** 0.5 == pytest.approx(2e-4 / 3**0.5)
    assert wild.cov[2, 2] ** 0.5 == pytest.approx(0.0016 / 3**0.5)


def test_readings_recover_known_figures_within_their_predicted_covariance() -> None:
    """600 boxes read with noise: the normalised error has the chi-square mean of 5 (two-sided, 4 sigma)."""
    rng = np.random.default_rng(3)
    truth = np.array([0.996, 0.998, 0.2513, 0.2494, 0.2004])
    errors = []
    for _ in range(600):
        ruler = 1 + 2e-3 * rng.standard_normal()
        true = {"sx": truth[0], "sy": truth[1]} | {
            n: v / getattr(BOX, n) for n, v in zip(("width", "depth", "height"), truth[2:], strict=True)
        }
        readings = {
            name: Readings(
                values=tuple(length.designed * true[length.figure] * ruler + 3e-4 * rng.standard_normal(1)), sigma=3e-4
            )
            for name, length in lengths(BOX).items()
            if name not in {"tags_x", "bar_y"}
        }
        result = measure(BOX, readings, ruler_sigma=2e-3).measured
        off = np.array([result.sx, result.sy, result.width, result.depth, result.height]) - truth
        errors.append(off @ np.linalg.solve(result.cov, off))
    assert np.mean(errors) == pytest.approx(5, abs=4 * (2 * 5 / 600) ** 0.5)


def test_longer_lengths_and_more_readings_count_for_more() -> None:
    both = measure(BOX, {"bar_x": reading(0.100), "tags_x": reading(0.238 * 0.99)}, ruler_sigma=0).measured
    weight = 0.238**2 / (0.238**2 + 0.1**2)
    assert both.sx == pytest.approx(1 - 0.01 * weight, rel=1e-9)


def test_the_command_corrects_the_file_in_place(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([str(path), *READ]) == 0
    target = load_target(path)
    assert target.box == BOX
    assert target.measured is not None
    figures = [getattr(target.measured, name) for name in ("sx", "sy", "width", "depth", "height")]
    assert figures == pytest.approx([0.997, 0.996, 0.2504, 0.2498, 0.2003], rel=1e-12)
    sigma = np.sqrt(np.diag(target.measured.cov))
    assert sigma == pytest.approx([0.002, 0.002, 0.0003, 0.0003, 0.0003], rel=0.02)
    out, err = capsys.readouterr()
    assert err == ""
    assert "print scale across    99.70 +- 0.20 %\n" in out
    assert re.search(r"width \(x\) +250.40 \+- 0.30 mm, designed 250\n", out)
    assert re.search(r"the box as a whole +99.92 \+- 0.08 % of its design", out)
    assert "measure better: --tags-x" in out
    assert out.splitlines()[-1].startswith(f"{path}: 140 tags")


def test_measuring_again_starts_from_the_design(path: Path) -> None:
    assert cli.main([str(path), *READ]) == 0
    once = path.read_bytes()
    assert cli.main([str(path), "--bar-x", "100.4"]) == 0
    assert path.read_bytes() != once
    assert cli.main([str(path), *READ]) == 0
    assert path.read_bytes() == once


def test_each_sigma_option_reaches_its_figure(tmp_path: Path, path: Path) -> None:
    names = ["bar-x", "bar-y", "width", "depth", "height"]
    sigmas = [0.1, 0.12, 0.2, 0.22, 0.24]
    options = [text for n, s in zip(names, sigmas, strict=True) for text in (f"--{n}-sigma", str(s))]
    out = tmp_path / "new" / "measured.json"
    assert cli.main([str(path), *READ, *options, "--ruler-percent", "0", "--out", str(out)]) == 0
    found = load_target(out).measured
    assert found is not None
    assert np.sqrt(np.diag(found.cov)) == pytest.approx([0.001, 0.0012, 0.0002, 0.00022, 0.00024], rel=1e-9)
    assert load_target(path).measured is None
    assert (
        cli.main([str(path), "--tags-x", "238", "--tags-y", "168", "--tags-x-sigma", ".1", "--tags-y-sigma", ".3"]) == 0
    )
    found = load_target(path).measured
    assert found is not None
    assert np.sqrt(np.diag(found.cov))[:2] == pytest.approx([0.1 / 238, 0.3 / 168], rel=0.15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "no length was given; read at least the bars"),
        (
            ["--bar-x", "94.2"],
            r'--bar-x: 94.2 mm was read, 100 mm was designed: -5.8% off.*"fit to page"\? print again',
        ),
        (["--bar-y", "100", "106"], '--bar-y: 106 mm was read.*"fit to page"'),
        (["--tags-x", "9.5"], "--tags-x: 9.5 mm was read, 238 mm was designed"),
        (["--width", "25.1"], "--width: 25.1 mm was read, 250 mm was designed: -90.0% off.*its unit|unit"),
        (["--height", "nan"], "--height: nan mm was read"),
        (["--depth", "inf"], "--depth: inf mm was read"),
        (["--bar-x", "100", "--bar-x-sigma", "0"], "--bar-x: its sigma is 0 mm, between 0 and 5 mm is needed"),
        (["--bar-x", "100", "--bar-x-sigma", "6"], "--bar-x: its sigma is 6 mm"),
        (["--bar-x", "100", "--bar-x-sigma", "nan"], "--bar-x: its sigma is nan mm"),
        (["--bar-x", "100", "--ruler-percent", "-1"], "ruler's error is -1 %"),
        (["--bar-x", "100", "--ruler-percent", "nan"], "ruler's error is nan %"),
    ],
)
def test_a_reading_that_cannot_be_is_one_line_and_changes_nothing(
    path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    before = path.read_bytes()
    assert cli.main([str(path), *options]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(rf"measure-target: .*({message}).*\n", err)
    assert path.read_bytes() == before


def test_a_file_that_cannot_be_read_or_written_is_one_line(
    tmp_path: Path, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    for argv, message in (
        ([str(tmp_path / "none.json"), *READ], "none.json: cannot be read"),
        ([str(tmp_path / "file"), *READ], "file: not a whole JSON file"),
        ([str(path), *READ, "--out", str(tmp_path / "file" / "t.json")], "cannot be written .*; name another --out"),
        ([str(path), *READ, "--out", str(tmp_path)], "cannot be written"),
    ):
        assert cli.main(argv) == 1
        assert re.fullmatch(rf"measure-target: .*{message}.*\n", capsys.readouterr().err)


def test_sheets_higher_than_the_box_are_pointed_out(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([str(path), *READ, "--height", "195"]) == 0
    assert (
        "the prints are 4.2 mm higher than the box; glue them with their lower edges on its base"
        in capsys.readouterr().out
    )


def test_a_caliper_makes_the_ruler_the_weakest_part(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fine = [t for n in ("tags-x", "tags-y", "width", "depth") for t in (f"--{n}-sigma", "0.01")]
    read = ["--tags-x", "238", "--tags-y", "168", "--width", "250", "--depth", "250"]
    assert cli.main([str(path), *read, *fine, "--ruler-percent", "0.1"]) == 0
    assert "measure better: with a truer ruler" in capsys.readouterr().out


def test_every_example_of_the_help_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert make_cli.main(["box", "--paper", "a4"]) == 0
    capsys.readouterr()
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    text = capsys.readouterr().out
    examples = re.findall(r"^  measure-target (.*)$", text, flags=re.MULTILINE)
    assert len(examples) == 2
    for example in examples:
        assert cli.main(shlex.split(example)) == 0
    assert load_target(Path("box/measured.json")).measured is not None
    for option in ("--bar-x", "--bar-y", "--tags-x", "--tags-y", "--width", "--depth", "--height"):
        assert f"{option} MM [MM ...]" in text
        assert f"{option}-sigma MM" in text
