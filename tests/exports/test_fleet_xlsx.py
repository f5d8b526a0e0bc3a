"""The fleet's spreadsheet holds the table of fleet.csv, numbers as numbers."""

import csv
import io

import openpyxl
import pytest
from made_up import EVIL, calibration, detail

from boxcal.calib.exports.fleet_csv import COLUMNS, fleet_csv, fleet_rows
from boxcal.calib.exports.fleet_xlsx import fleet_xlsx


def test_spreadsheet_and_csv_say_the_same() -> None:
    made = [calibration(detail=detail()), calibration(robot=EVIL), calibration(robot="=1+1")]
    rows = fleet_rows(made, errors={"r09": "no stops"}, stale={"r01": "the box was measured anew"})
    book = openpyxl.load_workbook(io.BytesIO(fleet_xlsx(rows)))
    cells = [[cell.value for cell in row] for row in book["fleet"].iter_rows()]
    table = list(csv.reader(io.StringIO(fleet_csv(rows).decode())))
    assert cells[0] == table[0] == list(COLUMNS)
    assert len(cells) == len(table) == 5
    for name, found, text in zip(COLUMNS, zip(*cells[1:], strict=True), zip(*table[1:], strict=True), strict=True):
        for value, word in zip(found, text, strict=True):
            if isinstance(value, float | int):
                assert value == pytest.approx(float(word), rel=1e-15), name
            else:
                assert (value or "") == word, name
    kinds = {
        name: {type(value) for value in column if value is not None}
        for name, column in zip(COLUMNS, zip(*cells[1:], strict=True), strict=True)
    }
    assert kinds["b_m"] <= {float, int}
    assert kinds["robot"] == {str}
    assert all(cell.data_type != "f" for row in book["fleet"].iter_rows() for cell in row)  # no formula
    legend = {row[0].value: row[1].value for row in book["columns"].iter_rows(min_row=2)}
    assert legend.keys() == COLUMNS.keys()
