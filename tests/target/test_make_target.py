import dataclasses
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pytest

from boxcal.target import cli
from boxcal.target.box import Box, Target
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically, write_together
from boxcal.target.files.target_json import load_target
from boxcal.target.measure import cli as ruler_cli
from boxcal.target.models import products as models
from boxcal.target.models.products import Product
from boxcal.target.presets import PRESETS
from boxcal.target.print.papers import PAPERS
from boxcal.target.print.sheets import sheets_pdf

FILES = ["box-a4.pdf", "box-letter.pdf", "guide-a4.pdf", "guide-letter.pdf", "target.json"]
SMALL = ["--width", "120", "--depth", "125", "--height", "130", "--columns", "3", "--rows", "2"]


def written(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def refused(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must fail with 1; return its one line of error."""
    assert cli.main(argv) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert re.fullmatch(r"make-target: .+\n", captured.err)
    return captured.err


def test_the_default_box_is_written_without_any_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main([]) == 0
    assert written(tmp_path / "box") == FILES
    target = load_target(tmp_path / "box" / "target.json")
    assert target.box == Box()
    for paper in ("a4", "letter"):
        assert (tmp_path / "box" / f"box-{paper}.pdf").read_bytes() == sheets_pdf(target, PAPERS[paper])
    captured = capsys.readouterr()
    assert captured.err == ""
    lines = captured.out.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == [
        str(Path("box") / name) for name in ("target.json", "box-a4.pdf", "box-letter.pdf")
    ]
    assert [line.split(":")[0] for line in lines[3:-1]] == [
        str(Path("box") / name) for name in ("guide-a4.pdf", "guide-letter.pdf")
    ]
    assert "140 tags, ids 0 to 139" in lines[0]
    assert re.search("print .* at 100 %.*measure .*100 mm", lines[-1])


def test_options_are_millimetres_and_reach_the_box(tmp_path: Path) -> None:
    options = [*SMALL, "--tag-size", "30.1", "--pitch", "36.4", "--first-id", "7", "--dictionary", "DICT_5X5_100"]
    assert cli.main([str(tmp_path), *options]) == 0
    assert load_target(tmp_path / "target.json").box == Box(
        width=0.12,
        depth=0.125,
        height=0.13,
        columns=3,
        rows=2,
        tag_size=0.0301,
        pitch=0.0364,
        first_id=7,
        dictionary="DICT_5X5_100",
    )


@pytest.mark.parametrize("paper", list(PAPERS))
def test_only_the_paper_that_is_asked_for_is_written(tmp_path: Path, paper: str) -> None:
    assert cli.main([str(tmp_path / "new" / "folder"), "--paper", paper]) == 0
    guide = "guide-letter.pdf" if paper == "letter" else "guide-a4.pdf"
    assert written(tmp_path / "new" / "folder") == [f"box-{paper}.pdf", guide, "target.json"]


def test_the_same_box_can_be_written_again_into_its_folder(tmp_path: Path) -> None:
    assert cli.main([str(tmp_path), "--paper", "a4"]) == 0
    before = (tmp_path / "target.json").read_bytes()
    assert cli.main([str(tmp_path)]) == 0
    assert written(tmp_path) == FILES
    assert (tmp_path / "target.json").read_bytes() == before


def test_another_box_never_replaces_one_that_may_be_printed_already(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([str(tmp_path), "--paper", "a4"]) == 0
    before = (tmp_path / "target.json").read_bytes()
    capsys.readouterr()
    assert "describes a box with other dimensions" in refused([str(tmp_path), "--first-id", "140"], capsys)
    assert written(tmp_path) == ["box-a4.pdf", "guide-a4.pdf", "target.json"]
    assert (tmp_path / "target.json").read_bytes() == before


def test_a_target_json_of_someone_elses_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "target.json").write_text('{"compile": true}')
    assert "stands there already and is no target" in refused([str(tmp_path)], capsys)
    assert (tmp_path / "target.json").read_text() == '{"compile": true}'
    assert written(tmp_path) == ["target.json"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--tag-size", "0"], "tag_size is 0.0: a length between"),
        (["--width", "nan"], "width is nan"),
        (["--height", "inf"], "height is inf"),
        (["--depth", "1e300"], "depth is 1e+297"),
        (["--pitch", "30"], "leave 2 mm between them"),
        (["--columns", "8"], "the face has 250 mm; enlarge width and depth"),
        (["--rows", "0"], "7 columns by 0 rows"),
        (["--rows", "1" + "0" * 30], "at most 10000 tags a face"),
        (["--first-id", "500"], "ids 500 to 639: DICT_APRILTAG_36h11 has ids 0 to 586"),
        (["--dictionary", "36h11"], "dictionary '36h11': no such tag family; use one of DICT_4X4_100"),
        (
            ["--height", "205"],
            "A4 (297 x 210 mm): the height of face 0 is 205 mm, 202 mm fit this paper; reduce height",
        ),
        (["--width", "280", "--paper", "letter"], "US Letter (279.4 x 215.9 mm): the width of face 1 is 280 mm"),
    ],
)
def test_a_box_that_cannot_be_made_or_printed_is_one_line_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert message in refused([str(tmp_path / "box"), *options], capsys)
    assert not (tmp_path / "box").exists()


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "box").write_text("mine")
    for folder in (tmp_path / "box", tmp_path / "box" / "below"):
        error = refused([str(folder)], capsys)
        assert f"{folder}: cannot be written" in error
        assert "name another FOLDER" in error
    assert (tmp_path / "box").read_text() == "mine"


def test_a_folder_in_the_place_of_one_file_keeps_all_files_from_being_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "box-letter.pdf").mkdir()
    assert "box-letter.pdf: is a folder" in refused([str(tmp_path)], capsys)
    assert written(tmp_path) == ["box-letter.pdf"]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs a user whom permissions bind")
def test_a_folder_without_permission_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tmp_path.chmod(0o500)
    try:
        assert "cannot be written" in refused([str(tmp_path / "box")], capsys)
    finally:
        tmp_path.chmod(0o700)


def test_a_disk_that_fills_up_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:

    def full_after_the_first(path: Path, content: bytes) -> None:
        if path.name != "target.json":
            raise OSError(28, "No space left on device")
        write_atomically(path, content)

    monkeypatch.setattr("boxcal.target.files.atomic_write.write_atomically", full_after_the_first)
    assert "cannot be written (No space left on device)" in refused([str(tmp_path)], capsys)
    assert written(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--heigth", "200"], "unrecognized arguments: --heigth 200"),
        (["--wid", "200"], "unrecognized arguments: --wid 200"),
        (["--paper", "a5"], "argument --paper: invalid choice: 'a5'"),
        (["--net", "a9"], "argument --net: invalid choice: 'a9'"),
        (["--preset", "huge"], "argument --preset: invalid choice: 'huge'"),
        (["--width", "wide"], "argument --width: invalid float value: 'wide'"),
        (["--columns", "2.5"], "argument --columns: invalid int value: '2.5'"),
        (["--width"], "argument --width: expected one argument"),
    ],
)
def test_a_slip_in_the_options_is_usage_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    with pytest.raises(SystemExit) as exit_info:
        cli.main([str(tmp_path / "box"), *options])
    assert exit_info.value.code == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert f"make-target: error: {message}" in captured.err
    assert not (tmp_path / "box").exists()


def help_text(capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as exit_info:
        cli.main(["--help"])
    assert exit_info.value.code == 0
    return capsys.readouterr().out


def test_every_example_of_the_help_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    examples = re.findall(r"^  make-target (.*?)(?:  .*)?$", help_text(capsys), flags=re.MULTILINE)
    assert len(examples) == 3
    for example in examples:
        assert cli.main(shlex.split(example)) == 0
    assert written(tmp_path / "box") == FILES
    assert written(tmp_path / "small") == ["box-a4.pdf", "guide-a4.pdf", "target.json"]
    assert written(tmp_path) == ["box", "small"], "a list writes nothing"


def test_help_names_each_figure_of_the_box_with_its_unit_and_default(capsys: pytest.CaptureFixture[str]) -> None:
    text = " ".join(help_text(capsys).split())
    for words in (
        "--width MM along x, in mm (default: 250)",
        "--depth MM along y, in mm (default: 250)",
        "--height MM along z, in mm (default: 200)",
        "--tag-size MM outer edge of a tag's black border, in mm (default: 28)",
        "along both axes, in mm (default: 35)",
        "--columns N tags across a face (default: 7)",
        "--rows N tags down a face (default: 5)",
        "(default: 0)",
        "(default: DICT_APRILTAG_36h11)",
        "(default: both; for the large preset a3 and a4)",
        "(default: 300)",
        *("--preset {default,large}", "--tile ", "--net {a4,letter,a3,a2,a1,a0}", "--models ", "--all ", "--list "),
        "large: 500 x 500 x 380 mm",
    ):
        assert words in text


def test_help_does_not_wait_for_heavy_modules() -> None:
    code = (
        "import sys\nfrom boxcal.target.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print([m for m in ('cv2', 'reportlab', 'scipy') if m in sys.modules], file=sys.stderr)"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stderr.strip() == "[]"
    assert result.stdout.startswith("usage: make-target")


def test_the_default_preset_is_the_default_box() -> None:
    assert PRESETS["default"].figures == {f.name: f.default for f in dataclasses.fields(Box)}


def test_the_large_preset_is_half_a_metre_in_tiles(tmp_path: Path) -> None:
    assert cli.main([str(tmp_path), "--preset", "large", "--first-id", "192"]) == 0
    assert written(tmp_path) == ["box-a3-tiles.pdf", "box-a4-tiles.pdf", "guide-a4.pdf", "target.json"]
    target = load_target(tmp_path / "target.json")
    assert (target.box.width, target.box.depth) == (0.5, 0.5)
    assert (target.tag_ids[0], target.tag_ids[-1]) == (192, 383)


def test_a_face_that_fits_the_paper_is_never_cut_into_tiles(tmp_path: Path) -> None:
    assert cli.main([str(tmp_path), "--tile", "--paper", "a4"]) == 0
    assert written(tmp_path) == ["box-a4.pdf", "guide-a4.pdf", "target.json"]


@pytest.mark.parametrize("options", [[], ["--models"], ["--all"], ["--net", "a2"], ["--preset", "large"]])
def test_a_list_names_what_is_written_then_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], options: list[str]
) -> None:
    small = [Product(name=p.name, extra="", what=p.what, make=partial(two_files, p.name)) for p in models.products()]
    monkeypatch.setattr(cli, "products", lambda *, dpi: small)
    assert cli.main([str(tmp_path / "box"), "--list", *options]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert not (tmp_path / "box").exists()
    assert cli.main([str(tmp_path / "box"), *options]) == 0
    said = capsys.readouterr().out.splitlines()[:-1]
    assert said == [str(tmp_path / "box" / line) for line in listed]
    assert sorted(line.split(":")[0] for line in listed) == written(tmp_path / "box")
    wants_models = bool({"--models", "--all"} & set(options))
    assert wants_models == (tmp_path / "box" / "mujoco" / "b.xml").exists()


def two_files(name: str, target: Target) -> Mapping[str, bytes]:
    return {f"{name}/a.txt": str(target.tag_ids.size).encode(), f"{name}/b.xml": b"<b/>"}


def test_products_without_their_extra_are_left_out_with_one_line_that_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with_extra = Product(name="box.step", extra="cad", what="solid", make=partial(two_files, "never"))
    without = Product(name="free", extra="", what="model", make=partial(two_files, "free"))
    monkeypatch.setattr(cli, "products", lambda *, dpi: (with_extra, without))
    monkeypatch.setattr(models, "EXTRAS", {"cad": ("no_such_module",)})
    argv = [str(tmp_path), "--models", "--paper", "a4"]
    assert cli.main(argv) == 1
    assert written(tmp_path) == ["box-a4.pdf", "free", "guide-a4.pdf", "target.json"]
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == "make-target: left out box.step: not installed; pip install 'boxcal[cad]'"
    assert cli.main([*argv, "--list"]) == 0
    assert "left out box.step" in capsys.readouterr().err


def test_dpi_reaches_the_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def note(*, dpi: float) -> tuple[Product, ...]:
        asked.append(dpi)
        return ()

    monkeypatch.setattr(cli, "products", note)
    assert cli.main([str(tmp_path), "--models", "--dpi", "150", "--paper", "a4"]) == 0
    assert set(asked) == {150.0}


def test_nothing_imports_cad_before_it_is_needed(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom boxcal.target.cli import main\n"
        f"main([{str(tmp_path / 'box')!r}, '--net', 'a2'])\n"
        f"main([{str(tmp_path / 'box')!r}, '--all', '--list'])\n"
        "print([m for m in ('cadquery', 'ezdxf', 'manifold3d', 'scipy') if m in sys.modules], file=sys.stderr)"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stderr.splitlines()[-1] == "[]"


def test_a_measured_target_is_kept_when_its_sheets_are_written_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([str(tmp_path), "--paper", "a4"]) == 0
    assert ruler_cli.main([str(tmp_path / "target.json"), "--bar-x", "99.7"]) == 0
    before = (tmp_path / "target.json").read_bytes()
    sheets = (tmp_path / "box-a4.pdf").read_bytes()
    capsys.readouterr()
    assert cli.main([str(tmp_path)]) == 0
    assert "kept as it was measured" in capsys.readouterr().out
    assert (tmp_path / "target.json").read_bytes() == before
    assert (tmp_path / "box-a4.pdf").read_bytes() == sheets
    assert sheets_pdf(load_target(tmp_path / "target.json"), PAPERS["a4"]) == sheets, "sheets show the design"


def test_files_in_folders_are_written_together_or_not_at_all(tmp_path: Path) -> None:
    write_together(tmp_path, {"a/b/c.txt": b"c", "d.txt": b"d"})
    assert (tmp_path / "a/b/c.txt").read_bytes() == b"c"
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OSError, match="file"):
        write_together(tmp_path, {"new.txt": b"n", "file/below.txt": b"x"})
    with pytest.raises(TargetError, match="is a folder"):
        write_together(tmp_path, {"new.txt": b"n", "a": b"x"})
    assert written(tmp_path) == ["a", "d.txt", "file"]
