"""The house's rules: short functions, few arguments, few loose files, first lines that a stranger understands."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("boxcal", "target", "detect", "calib")
MAX_LINES, MAX_ARGUMENTS, MAX_LOOSE = 60, 8, 5
KERNELS = "detect/alignment/numba/"
"""Compiled functions take arrays and scalars, which numba knows, where others take dataclasses."""

LONG: dict[str, str] = {
    "target/cli.py:_parser": "a list of options, one a line",
}
"""Functions of more lines, and why; one that has become short must leave the list."""
WIDE: dict[str, str] = {
    "detect/alignment/box_pose.py:_refine": "calls the kernel with what it takes",
    "detect/alignment/registration/align.py:align": "to be split",
}
"""Functions of more arguments, and why."""


SAME_LINES = 6
TWICE: dict[str, str] = {}
"""Files that share code, and why."""


@cache
def _sources() -> list[tuple[str, ast.Module]]:
    files = [path for part in PARTS for path in sorted((ROOT / part).rglob("*.py"))]
    return [(path.relative_to(ROOT).as_posix(), ast.parse(path.read_text())) for path in files]


def _functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    for name, tree in _sources():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                yield f"{name}:{node.name}", node


def _lines(node: ast.FunctionDef) -> int:
    """Lines of code from the signature on, without the docstring."""
    first = node.body[0]
    is_text = (
        isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)
    )
    text = (first.end_lineno or 0) - first.lineno + 1 if is_text else 0
    return (node.end_lineno or 0) - node.lineno + 1 - text


def _arguments(node: ast.FunctionDef) -> int:
    found = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return len(found) - (found[:1] in (["self"], ["cls"]))


def test_functions_are_short() -> None:
    found = {name for name, node in _functions() if _lines(node) > MAX_LINES}
    assert found == set(LONG)


def test_functions_take_few_arguments() -> None:
    found = {name for name, node in _functions() if _arguments(node) > MAX_ARGUMENTS and not name.startswith(KERNELS)}
    assert found == set(WIDE)


def _statements(tree: ast.Module, source: str) -> list[str]:
    """Lines of code without imports, docstrings, comments, declared fields and arguments, and lone brackets."""
    left_out: set[int] = set()
    for node in ast.walk(tree):
        text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        declared = isinstance(node, ast.AnnAssign) and node.value is None
        imported = isinstance(node, (ast.Import, ast.ImportFrom))
        if isinstance(node, ast.stmt) and (text or declared or imported):
            left_out |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    lines = [line.strip() for n, line in enumerate(source.splitlines(), 1) if n not in left_out]
    arguments = re.compile(r"\w+: .*,")
    return [line for line in lines if re.search(r"\w", line) and line[0] != "#" and not arguments.fullmatch(line)]


def test_no_code_stands_twice() -> None:
    """No six lines of code are the same in two places, but for those that are listed with a reason."""
    places: dict[tuple[str, ...], list[str]] = {}
    for name, tree in _sources():
        lines = _statements(tree, (ROOT / name).read_text())
        for k in range(len(lines) - SAME_LINES + 1):
            places.setdefault(tuple(lines[k : k + SAME_LINES]), []).append(name)
    twice = {" and ".join(sorted(set(names))) for names in places.values() if len(names) > 1}
    assert twice == set(TWICE)


@pytest.mark.parametrize("part", ["target", "detect", "calib"])
def test_few_files_lie_loose(part: str) -> None:
    """What a folder is about stands in its rooms; only what belongs to all of them lies in the folder itself."""
    assert len([path for path in (ROOT / part).glob("*.py") if path.name != "__init__.py"]) <= MAX_LOOSE


def test_every_folder_says_in_one_line_what_lives_there() -> None:
    for name, tree in _sources():
        if name.endswith("__init__.py"):
            text = ast.get_docstring(tree) or ""
            assert re.fullmatch(r"[A-Z].*\.", text.partition("\n")[0]), name


def test_first_lines_of_docstrings_say_what_a_thing_is() -> None:
    """No first line begins like a question: a stranger reads it without its neighbours, in a listing."""
    for name, tree in _sources():
        for node in ast.walk(tree):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                first = (ast.get_docstring(node) or "").partition("\n")[0]
                where = f"{name}, {getattr(node, 'name', 'module')}: {first}"
                assert not re.match(r"(How|Where|What|Which|When|Why|Of|If)\b", first), where
                assert isinstance(node, ast.FunctionDef) or not first.startswith("Whether "), where


def test_decisions_are_numbered_once_each_and_stand_in_sections() -> None:
    """Others refer to decisions by their numbers, which nobody else must give anew."""
    page = (ROOT / "docs" / "decisions.md").read_text()
    numbers = [int(n) for n in re.findall(r"^\*\*(\d+)\. ", page, flags=re.MULTILINE)]
    assert sorted(numbers) == list(range(1, len(numbers) + 1))
    assert not re.findall(r"^\d+\. .*", page, flags=re.MULTILINE)
