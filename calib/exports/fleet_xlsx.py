"""``fleet.xlsx``: the table of a fleet as a spreadsheet, whose numbers are numbers in every language."""

import io
from collections.abc import Iterable, Mapping
from math import isfinite

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.fleet_csv import COLUMNS, TEXTS

_WIDTH = 14
"""Of a column, in characters."""


def fleet_xlsx(rows: Iterable[Mapping[str, str]]) -> bytes:
    """Return the spreadsheet: the table, and on a second sheet what its columns are; no cell is a formula or a link.

    Parameters
    ----------
    rows
        As :func:`boxcal.calib.exports.fleet_csv.fleet_rows` returns them.

    Raises
    ------
    CalibError
        If the extra ``report`` is not installed.
    """
    try:
        import xlsxwriter  # noqa: PLC0415  an extra
    except ImportError as error:
        raise CalibError(
            "fleet.xlsx needs xlsxwriter", remedy="install it with: pip install 'boxcal[report]'"
        ) from error
    out = io.BytesIO()
    plain = {
        "constant_memory": True,
        "strings_to_formulas": False,
        "strings_to_urls": False,
        "strings_to_numbers": False,
    }
    with xlsxwriter.Workbook(out, plain) as book:
        bold = book.add_format({"bold": True})
        table = book.add_worksheet("fleet")
        table.freeze_panes(1, 1)
        table.set_column(0, len(COLUMNS) - 1, _WIDTH)
        for column, name in enumerate(COLUMNS):
            table.write_string(0, column, name, bold)
        line = 0
        for line, row in enumerate(rows, start=1):  # a row after the other: those written are not kept in memory
            for column, name in enumerate(COLUMNS):
                text = row.get(name, "")
                if name not in TEXTS and text and isfinite(float(text)):
                    table.write_number(line, column, float(text))
                elif text:
                    table.write_string(line, column, text)
        table.autofilter(0, 0, max(line, 1), len(COLUMNS) - 1)
        legend = book.add_worksheet("columns")
        legend.set_column(0, 1, 2 * _WIDTH)
        for line, cells in enumerate([("column", "meaning"), *COLUMNS.items()]):
            for column, text in enumerate(cells):
                legend.write_string(line, column, text, bold if line == 0 else None)
    return out.getvalue()
