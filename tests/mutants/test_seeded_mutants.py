"""The list of seeded bugs is true to the code; whether the tests notice them is asked by ``make mutants``."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

HERE = Path(__file__).parent


def _load(name: str) -> ModuleType:
    """Import a module beside this file, which is in no package."""
    spec = importlib.util.spec_from_file_location(f"boxcal_{name}", HERE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


seeded = _load("seeded")
MUTANTS = seeded.seeded_mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: m.name)
def test_seeded_bug_still_has_its_place_in_the_code(mutant: Any) -> None:
    text = (seeded.ROOT / mutant.file).read_text()
    changed = mutant.apply(text)
    assert changed != text
    compile(changed, mutant.file, "exec")
    assert mutant.tests
    for test in mutant.tests:
        path, _, name = test.partition("::")
        source = (seeded.ROOT / path).read_text()
        assert not name or f"def {name.partition('[')[0]}(" in source, f"{mutant.name}: no test {test}"


def test_there_are_forty_seeded_bugs_of_different_names() -> None:
    assert len({m.name for m in MUTANTS}) == len(MUTANTS) >= 40


def test_a_bug_whose_text_has_gone_is_an_error() -> None:
    gone = seeded.Mutant(name="gone", file="x.py", old="a + b", new="a - b", tests=("t",))
    with pytest.raises(ValueError, match=r"stands 0 times in x\.py"):
        gone.apply("a * b")
    with pytest.raises(ValueError, match="stands 2 times"):
        gone.apply("a + b; a + b")
    assert gone.apply("x = a + b") == "x = a - b"
