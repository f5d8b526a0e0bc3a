"""Commands of README and tutorial: run in order, compared with what the pages show, or written into them.

``python docs/site/outputs.py`` (``make outputs``) runs them in an empty folder and writes what they print into the
pages; with ``--check`` it compares instead and exits with 1 if anything differs.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("docs/tutorial.md", "README.md")
_SHOWN = re.compile(r"(<!-- output of: (.*?) -->\n```text\n)(.*?)(```)", flags=re.DOTALL)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
SIGMA_TOLERANCE = 0.05
"""How far a standard deviation may be from the one shown, relative."""
VALUE_TOLERANCE = 0.2
"""How far an estimate may be from the one shown, in its standard deviations."""
COUNT_TOLERANCE = 0.005
"""How far a count may be, relative to itself or to the whole it is a part of ("8 of 2964"): stops are equal, of some
thousand landmarks a dozen may differ."""
OTHER_TOLERANCE = 0.03
"""How far any other number may be, relative."""
ERROR_DIGITS = 3
"""How far an error against the truth may be, in units of its last digit."""


def commands(text: str) -> list[str]:
    """Return the commands of a page in order; those of make are not among them, for they install and test."""
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.strip() and not line.startswith("#")]
    return [line for line in lines if not line.startswith("make ")]


def shown(text: str) -> list[tuple[str, str]]:
    """Return the commands whose output a page shows, with that output."""
    return [(match[2], match[3]) for match in _SHOWN.finditer(text)]


def run(lines: Iterable[str], folder: Path, programs: Path) -> dict[str, str]:
    """Run commands one after the other in a folder; returns what each prints, an equal one only once.

    Raises
    ------
    RuntimeError
        If one of them fails.
    """
    env = {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "120"}
    printed: dict[str, str] = {}
    for line in lines:
        if line not in printed:
            done = subprocess.run(
                ["bash", "-c", line], cwd=folder, env=env, capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise RuntimeError(f"{line}: exit status {done.returncode}\n{done.stdout}{done.stderr}")
            printed[line] = done.stdout
    return printed


def differences(wanted: str, found: str) -> list[str]:
    """Return what differs between an output that a page shows and what was printed; nothing if they agree.

    Words must be equal. A number behind ``±`` is a standard deviation, held to SIGMA_TOLERANCE; the one before it an
    estimate, held to VALUE_TOLERANCE of that deviation. In a table of errors a number is held to ERROR_DIGITS, a count
    to COUNT_TOLERANCE, any other number to OTHER_TOLERANCE. The last digit that is shown may round otherwise. The same
    versions of the libraries give the same numbers.
    """
    a, b = wanted.strip().splitlines(), found.strip().splitlines()
    if len(a) != len(b):
        return [f"{len(a)} lines shown, {len(b)} printed"]
    out, errors = [], False
    for line, printed in zip(a, b, strict=True):
        errors = line.startswith("error against truth") or (errors and bool(line.strip()))
        if not _agree(line, printed, errors=errors):
            out.append(f"shown   {line}\nprinted {printed}")
    return out


def _agree(line: str, printed: str, *, errors: bool) -> bool:
    words, others = line.split(), printed.split()
    if [_NUMBER.sub("#", word) for word in words] != [_NUMBER.sub("#", other) for other in others]:
        return False
    for place, (word, other) in enumerate(zip(words, others, strict=True)):
        is_sigma = place > 0 and words[place - 1] in {"±", "+-"}
        sigma = _NUMBER.match(words[place + 2]) if words[place + 1 : place + 2] in (["±"], ["+-"]) else None
        for x, y in zip(_NUMBER.findall(word), _NUMBER.findall(other), strict=True):
            value, last_digit = float(x), 10.0 ** -len(x.partition(".")[2])
            room = OTHER_TOLERANCE * abs(value) + last_digit
            if is_sigma:
                room = SIGMA_TOLERANCE * abs(value) + last_digit
            elif sigma is not None:
                room = VALUE_TOLERANCE * float(sigma[0]) + last_digit
            elif errors:
                room = ERROR_DIGITS * last_digit
            elif "." not in x:
                room = COUNT_TOLERANCE * max(abs(value), _of_how_many(words, place))
            if abs(value - float(y)) > room + 1e-9:
                return False
    return True


def _of_how_many(words: Sequence[str], place: int) -> float:
    """Return the whole that a count is a part of, as in "8 of 2964 corners"; 0 if none is told."""
    whole = words[place + 2] if words[place + 1 : place + 2] == ["of"] and len(words) > place + 2 else ""
    return float(whole) if whole.isdecimal() else 0.0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the commands of the pages; write or compare what they print. Returns the exit status."""
    check = "--check" in (sys.argv[1:] if argv is None else argv)
    texts = {name: (ROOT / name).read_text() for name in PAGES}
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        lines = [line for text in texts.values() for line in commands(text)]
        printed = run(lines, Path(folder), Path(sys.executable).parent)
    for name, text in texts.items():
        if check:
            wrong += [f"{name}: {line}\n{d}" for line, out in shown(text) for d in differences(out, printed[line])]
        else:
            new = _SHOWN.sub(lambda m: f"{m[1]}{printed[m[2]].strip()}\n{m[4]}", text)
            (ROOT / name).write_text(new)
    for what in wrong:
        sys.stderr.write(what + "\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
