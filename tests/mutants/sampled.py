"""Random small changes to the code of the estimator: comparisons, signs, operators, constants, slices, indices.

A mutation tester of our own: folders and import names differ in this project, and each file is put to the tests that
are about it rather than to all of them.
"""

import ast
import random
from collections.abc import Iterator, Sequence
from pathlib import Path

from seeded import ROOT, Mutant

FOLDERS = ("calib/four_steps", "calib/likelihood")
TESTS = {
    "calib/four_steps": ("tests/calib/test_four_steps.py", "tests/calib/test_guards_four_steps.py"),
    "calib/likelihood": (  # the quickest and the most likely to notice first
        "tests/calib/test_estimate_jacobians.py",
        "tests/calib/test_guards_likelihood.py",
        "tests/calib/test_estimate.py",
        "tests/calib/test_estimate_options.py",
        "tests/calib/test_estimate_faults.py",
        "tests/calib/test_estimate_few_stops.py",
    ),
}
_COMPARE = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
_BINARY = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
_BOOL = {ast.And: "or", ast.Or: "and"}


def sampled_mutants(count: int, seed: int, files: Sequence[str] | None = None) -> tuple[Mutant, ...]:
    """Return ``count`` random changes for each file, always the same ones for a seed."""
    paths = files or sorted(str(p.relative_to(ROOT)) for folder in FOLDERS for p in (ROOT / folder).glob("*.py"))
    return tuple(mutant for path in paths for mutant in _of_file(path, count, random.Random(f"{seed} {path}")))


def _of_file(path: str, count: int, rng: random.Random) -> list[Mutant]:
    text = (ROOT / path).read_text()
    changes = sorted(set(_changes(ast.parse(text), text.splitlines(keepends=True))))
    tests = next((t for folder, t in TESTS.items() if path.startswith(folder)), ())
    out = []
    for start, end, new in rng.sample(changes, min(count, len(changes))):
        old, shown = _unique(text, start, end, new)
        line = text.count("\n", 0, start) + 1
        name = f"{Path(path).stem}:{line} {text[start:end]} -> {new or 'nothing'}"
        out.append(Mutant(name=name, file=path, old=old, new=shown, tests=tests))
    return out


def _unique(text: str, start: int, end: int, new: str) -> tuple[str, str]:
    """Return the changed place and what it becomes, with as much text around it as makes it the only one."""
    a, b = text.rfind("\n", 0, start) + 1, text.find("\n", end)
    while text.count(text[a:b]) > 1 and a > 0:
        a = text.rfind("\n", 0, a - 1) + 1
    return text[a:b], text[a:start] + new + text[end:b]


def _changes(tree: ast.Module, lines: list[str]) -> Iterator[tuple[int, int, str]]:
    """Yield (start, end, new text) of every change, places counted in characters."""
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))

    def place(line: int, column: int) -> int:
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    def span(node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)

    text = "".join(lines)

    def operator(left: ast.expr, right: ast.expr, old: str, new: str) -> Iterator[tuple[int, int, str]]:
        gap_start, gap_end = span(left)[1], span(right)[0]
        at = text[gap_start:gap_end].find(old)
        if at >= 0:
            yield gap_start + at, gap_start + at + len(old), new

    signs = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
    words = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
    for node in _code(tree):
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARE:
            kind = type(node.ops[0])
            yield from operator(node.left, node.comparators[0], signs[kind], _COMPARE[kind])
        elif isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            yield from operator(node.left, node.right, words[type(node.op)], _BINARY[type(node.op)])
        elif isinstance(node, ast.BoolOp):
            kind = "and" if isinstance(node.op, ast.And) else "or"
            yield from operator(node.values[0], node.values[1], kind, _BOOL[type(node.op)])
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
            start, _ = span(node)
            yield start, start + (1 if isinstance(node.op, ast.USub) else len("not ")), ""
        elif isinstance(node, ast.Constant) and type(node.value) in {int, float}:
            start, end = span(node)
            yield start, end, str(node.value + 1) if isinstance(node.value, int) else repr(node.value * 2 + 1e-3)


def _code(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes of a module that run: no annotations, no messages of errors."""
    todo: list[ast.AST] = [tree]
    while todo:
        node = todo.pop()
        yield node
        for name, value in ast.iter_fields(node):
            if name not in {"annotation", "returns", "exc", "decorator_list"}:
                parts = value if isinstance(value, list) else [value]
                todo += [part for part in parts if isinstance(part, ast.AST) and not isinstance(part, ast.JoinedStr)]
