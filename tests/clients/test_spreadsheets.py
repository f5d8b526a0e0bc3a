"""The fleet's table in LibreOffice under German, which writes decimal commas, and in pandas."""

import io
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from boxcal.calib.exports.fleet_csv import COLUMNS, TEXTS, fleet_csv, fleet_rows
from boxcal.calib.exports.fleet_xlsx import fleet_xlsx
from boxcal.calib.results.calibration import Calibration

OFFICE = shutil.which("soffice")
DOCUMENTED = "CSV:44,34,76,1,,1033,false,true,false"
"""Separator comma, quotes, UTF-8, from line 1, language English (USA), special numbers: as docs/report.md has it."""
GERMAN = """<?xml version="1.0" encoding="UTF-8"?>
<oor:items xmlns:oor="http://openoffice.org/2001/registry">
<item oor:path="/org.openoffice.Setup/L10N">
<prop oor:name="ooSetupSystemLocale" oor:op="fuse"><value>de-DE</value></prop>
</item></oor:items>
"""
NS = "{urn:oasis:names:tc:opendocument:xmlns:%s:1.0}"


def opened(content: bytes, name: str, folder: Path, *options: str) -> list[list[str | float | None]]:
    """The cells of the first sheet, as LibreOffice holds them: numbers, texts, None."""
    profile = folder / "profile"
    (profile / "user").mkdir(parents=True, exist_ok=True)
    (profile / "user" / "registrymodifications.xcu").write_text(GERMAN)
    (folder / name).write_bytes(content)
    words = [str(OFFICE), f"-env:UserInstallation={profile.as_uri()}", "--headless", *options]
    words += ["--convert-to", "fods", "--outdir", str(folder / "out"), str(folder / name)]
    subprocess.run(words, check=True, capture_output=True, timeout=240)
    root = ET.parse(folder / "out" / f"{Path(name).stem}.fods").getroot()
    table = root.find(f".//{NS % 'table'}table")
    assert table is not None
    rows = []
    for row in table.iter(f"{NS % 'table'}table-row"):
        cells: list[str | float | None] = []
        for cell in row.iter(f"{NS % 'table'}table-cell"):
            kind = cell.get(f"{NS % 'office'}value-type")
            value: str | float | None = None
            if kind == "float":
                value = float(cell.get(f"{NS % 'office'}value", ""))
            elif kind is not None:
                value = "".join(cell.itertext()).strip()
            cells += [value] * min(int(cell.get(f"{NS % 'table'}number-columns-repeated", "1")), len(COLUMNS))
        rows.append(cells[: len(COLUMNS)])
    return rows


@pytest.mark.skipif(OFFICE is None, reason="LibreOffice is not installed (apt-get install libreoffice-calc)")
@pytest.mark.parametrize("kind", ["xlsx", "csv, imported as documented"])
def test_numbers_are_numbers_where_decimal_commas_are_written(kind: str, made: Calibration, tmp_path: Path) -> None:
    rows = fleet_rows([made])
    if kind == "xlsx":
        cells = opened(fleet_xlsx(rows), "fleet.xlsx", tmp_path)
    else:
        cells = opened(fleet_csv(rows), "fleet.csv", tmp_path, f"--infilter={DOCUMENTED}")
    assert cells[0] == list(COLUMNS)
    found = dict(zip(COLUMNS, cells[1], strict=True))
    for name, text in rows[0].items():
        if name not in TEXTS and text:
            assert found[name] == pytest.approx(float(text), rel=1e-12), name
    assert found["robot"] == "r01"


def test_pandas_reads_the_table_as_it_is(made: Calibration) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed (pip install pandas)")
    frame = pandas.read_csv(io.BytesIO(fleet_csv(fleet_rows([made]))))
    assert list(frame.columns) == list(COLUMNS)
    assert frame["b_m"].iloc[0] == made.wheels.b
    assert frame["robot"].iloc[0] == "r01"
