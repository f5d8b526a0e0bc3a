"""``fleet.xlsx``: the table of a fleet as a spreadsheet, whose numbers are numbers in every language."""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.fleet_csv import COLUMNS, TEXTS

_WIDTH = 14
"""Of a column, in characters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """One table of a spreadsheet.

    Attributes
    ----------
    name
        On its tab.
    columns
        Name of each column, with its meaning.
    texts
        Columns of text; the others hold numbers.
    rows
        By column.
    """

    name: str
    columns: Mapping[str, str]
    texts: frozenset[str]
    rows: Iterable[Mapping[str, str]]


def fleet_xlsx(rows: Iterable[Mapping[str, str]], more: Sequence[Sheet] = ()) -> bytes:
    """Return the spreadsheet: the tables, and on a last sheet what their columns are; no cell is a formula or a link.

    Parameters
    ----------
    rows
        As :func:`boxcal.calib.exports.fleet_csv.fleet_rows` returns them.
    more
        Further tables.

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
    sheets = [Sheet(name="fleet", columns=COLUMNS, texts=TEXTS, rows=rows), *more]
    with xlsxwriter.Workbook(out, plain) as book:
        bold = book.add_format({"bold": True})
        for sheet in sheets:
            _write(book.add_worksheet(sheet.name), sheet, bold)
        legend = book.add_worksheet("columns")
        legend.set_column(0, 1, 2 * _WIDTH)
        meanings = {name: text for sheet in reversed(sheets) for name, text in sheet.columns.items()}
        ordered = {name: meanings[name] for sheet in sheets for name in sheet.columns}
        for line, cells in enumerate([("column", "meaning"), *ordered.items()]):
            for column, text in enumerate(cells):
                legend.write_string(line, column, text, bold if line == 0 else None)
    return out.getvalue()


def _write(table: Any, sheet: Sheet, bold: Any) -> None:
    table.freeze_panes(1, 1)
    table.set_column(0, len(sheet.columns) - 1, _WIDTH)
    for column, name in enumerate(sheet.columns):
        table.write_string(0, column, name, bold)
    line = 0
    for line, row in enumerate(sheet.rows, start=1):  # a row after the other: those written are not kept in memory
        for column, name in enumerate(sheet.columns):
            text = row.get(name, "")
            if name not in sheet.texts and text and isfinite(float(text)):
                table.write_number(line, column, float(text))
            elif text:
                table.write_string(line, column, text)
    table.autofilter(0, 0, max(line, 1), len(sheet.columns) - 1)
