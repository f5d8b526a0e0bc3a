"""Tables that a benchmark prints and keeps in the documentation, between markers of its own."""

from collections.abc import Sequence
from pathlib import Path

from boxcal.target.files.atomic_write import write_atomically


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table whose columns line up; the first is set left, the others right."""
    widths = [max(len(cell) for cell in column) for column in zip(head, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        first, *others = (
            c.ljust(w) if k == 0 else c.rjust(w) for k, (c, w) in enumerate(zip(cells, widths, strict=True))
        )
        return "| " + " | ".join([first, *others]) + " |"

    rule = "|" + "|".join("-" * (w + 2) if k == 0 else "-" * (w + 1) + ":" for k, w in enumerate(widths)) + "|"
    return "\n".join([line(head), rule, *map(line, rows)])


def fill(path: Path, name: str, text: str) -> None:
    """Put text between ``<!-- name -->`` and ``<!-- end -->`` of a Markdown file; append what is missing."""
    begin, end = f"<!-- {name} -->", "<!-- end -->"
    page = path.read_text(encoding="utf-8") if path.exists() else ""
    block = f"{begin}\n{text}\n{end}"
    if begin in page:
        before, rest = page.split(begin, 1)
        after = rest.split(end, 1)[1]
        page = before + block + after
    else:
        page = f"{page}\n{block}\n" if page else f"{block}\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, page.encode())
