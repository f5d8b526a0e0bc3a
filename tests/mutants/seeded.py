"""The list of seeded bugs: small changes to the code that the tests must notice."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("seeded.toml")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One change to one file.

    Attributes
    ----------
    name
        Unique; says what the bug does.
    file
        Path from the project's root.
    old, new
        Text that stands once in the file, and what replaces it.
    tests
        What is run: files, or node ids, of the tests that must fail.
    """

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    def apply(self, text: str) -> str:
        """Return the file's text with the bug in it.

        Raises
        ------
        ValueError
            If the old text does not stand once in the file: the list has to follow the code.
        """
        count = text.count(self.old)
        if count != 1:
            raise ValueError(f"{self.name}: its text stands {count} times in {self.file}, not once: {self.old}")
        return text.replace(self.old, self.new)


def seeded_mutants() -> tuple[Mutant, ...]:
    """Return the mutants of ``seeded.toml``."""
    with LIST.open("rb") as file:
        entries = tomllib.load(file)["mutant"]
    return tuple(Mutant(**{**entry, "tests": tuple(entry["tests"])}) for entry in entries)
