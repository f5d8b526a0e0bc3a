"""The guide: its QR code leads back to the target, its words are right, its marks stay where printers print."""

import base64
import re
import shlex
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from boxcal.target import cli
from boxcal.target.box import Box, make_target
from boxcal.target.files.target_json import load_target, target_sha256
from boxcal.target.measure.measured_size import SIZES, Measured
from boxcal.target.print.card import card_text
from boxcal.target.print.guide import guide_pdf
from boxcal.target.print.ink import design_id
from boxcal.target.print.papers import PAPERS

pypdfium2 = pytest.importorskip("pypdfium2", reason="needs the renderer pypdfium2")

ODD: dict[str, Any] = {
    "width": 0.3012,
    "depth": 0.2604,
    "height": 0.21,
    "columns": 5,
    "rows": 3,
    "tag_size": 0.0301,
    "pitch": 0.0417,
    "first_id": 11,
    "dictionary": "DICT_5X5_250",
}


def page(pdf: bytes, number: int, dpi: int) -> NDArray[np.uint8]:
    with pypdfium2.PdfDocument(pdf) as document:
        image = np.array(document[number].render(scale=dpi / 72, grayscale=True).to_numpy())
    return image.reshape(image.shape[:2])


def words(pdf: bytes, number: int) -> str:
    with pypdfium2.PdfDocument(pdf) as document:
        return " ".join(document[number].get_textpage().get_text_bounded().split())


@pytest.mark.parametrize("figures", [{}, ODD], ids=["default", "odd figures"])
@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_the_cards_code_makes_the_same_target_again(tmp_path: Path, paper: str, figures: dict[str, Any]) -> None:
    target = make_target(Box(**figures))
    image = page(guide_pdf(target, PAPERS[paper]), 1, 200)
    text, _, _ = cv2.QRCodeDetector().detectAndDecode(image)
    name, command, *options = re.split(": | ", text.removeprefix("boxcal target "))
    assert (name, command) == (target_sha256(target)[:8], "make-target")
    assert cli.main([str(tmp_path), *shlex.split(" ".join(options)), "--paper", "a3"]) == 0
    assert target_sha256(load_target(tmp_path / "target.json")) == target_sha256(target)


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_the_card_asks_for_the_four_lengths_that_measure_target_takes(paper: str) -> None:
    text = words(guide_pdf(make_target(Box(**ODD)), PAPERS[paper]), 1)
    for row in (
        "bar across a sheet --bar-x 100",
        "bar up a sheet --bar-y 100",
        "width, face 2 to 0 --width 301.2",
        "depth, face 3 to 1 --depth 260.4",
        "301.2 x 260.4 x 210 mm",
        "5 x 3 tags of 30.1 mm a face, pitch 41.7 mm",
        "5X5_250, ids 11 – 70",
        "196.9 mm across and 113.5 mm up",
    ):
        assert row in text, row


def test_the_assembly_page_names_its_steps_and_the_boxs_own_lengths() -> None:
    text = words(guide_pdf(make_target(Box(**ODD)), PAPERS["a4"]), 0)
    for step in (
        "1 Print and check",
        "2 Cut and glue",
        "3 Which face where",
        "4 Which way up",
        "5 Check that it is square",
        "6 Measure it",
        "both diagonals measure 398.2 mm",
        "the lower edge flush with the base",
        "depth 260.4",
        "width 301.2",
        "height 210",
        *(f"Face {face}" for face in range(4)),
    ):
        assert step in text, step


@pytest.mark.parametrize("paper", ["a4", "letter"])
@pytest.mark.parametrize(
    "figures",
    [
        {},
        ODD,
        {"width": 0.06, "depth": 0.4, "height": 0.06, "columns": 1, "rows": 1},
        {"width": 0.1, "depth": 0.1, "height": 0.8, "columns": 2, "rows": 9},
    ],
    ids=["default", "odd", "flat", "tower"],
)
def test_the_guide_of_any_box_stays_inside_the_printable_page(paper: str, figures: dict[str, Any]) -> None:
    pdf = guide_pdf(make_target(Box(**figures)), PAPERS[paper])
    for number in range(2):
        image = page(pdf, number, 72)
        margin = int(0.006 / 0.0254 * 72)
        inside = image[margin:-margin, margin:-margin]
        assert inside.min() < 50
        assert (image < 250).sum() == (inside < 250).sum()


def test_paper_shows_the_design_whatever_was_measured() -> None:
    design = make_target()
    figures = dict(zip(SIZES, (0.99, 0.99, 0.251, 0.249, 0.2), strict=True))
    measured = make_target(design.box, Measured(**figures, cov=np.eye(5) * 1e-8))
    assert target_sha256(measured) != target_sha256(design)
    assert design_id(measured) == design_id(design)
    assert card_text(measured) == card_text(design)
    assert guide_pdf(measured, PAPERS["a4"]) == guide_pdf(design, PAPERS["a4"])


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_the_stored_guide_is_what_make_target_writes_today(paper: str) -> None:
    stored = Path(__file__).resolve().parents[2] / "printables" / f"guide-{paper}.pdf"

    def unpacked(pdf: bytes) -> list[bytes]:
        packed = re.findall(rb"stream\r?\n(.*?)\s*endstream", pdf, flags=re.DOTALL)
        streams = [zlib.decompress(base64.a85decode(s, adobe=True)) for s in packed if s.endswith(b"~>")]
        return [content for content in streams if content.startswith(b"1 0 0 1 0 0 cm")]

    assert unpacked(stored.read_bytes()) == unpacked(guide_pdf(make_target(), PAPERS[paper]))
