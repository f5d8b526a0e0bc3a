"""The argument parser that all commands share: a version, and suggestions for what was mistyped."""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from math import isfinite
from typing import NoReturn

from boxcal.one_thread import hold_process_to_one_thread


class CommandParser(argparse.ArgumentParser):
    """An argument parser with ``--version`` that suggests the option, choice or command that was meant.

    Help keeps the line breaks of its description and epilog. Options are never abbreviated, so that an option added
    later cannot change what a script means.

    Parameters
    ----------
    prog
        Name of the command.
    usage, description, epilog
        As argparse has them.
    """

    def __init__(
        self, prog: str, *, usage: str | None = None, description: str | None = None, epilog: str | None = None
    ) -> None:
        hold_process_to_one_thread()
        super().__init__(
            prog=prog,
            usage=usage,
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self.add_argument("--version", action=_Version)
        self._words: list[str] = []

    def parse_args(self, args: Sequence[str] | None = None, namespace: None = None) -> argparse.Namespace:  # type: ignore[override]
        """Return the arguments; an unknown option ends the program with status 2 and a suggestion."""
        self._words = list(sys.argv[1:] if args is None else args)
        found, unknown = self.parse_known_args(self._words, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found

    def error(self, message: str) -> NoReturn:
        """Print usage and the message, with a suggestion for what was mistyped, and exit with status 2."""
        choice = re.search(r"invalid choice: '(.*)' \(choose from (.*)\)$", message, flags=re.DOTALL)
        if choice:
            hints = [did_you_mean(choice[1], [word.strip(" '") for word in choice[2].split(",")])]
        else:
            known = [option for action in self._actions for option in action.option_strings]
            options = [word.partition("=")[0] for word in self._words if word.startswith("--")]
            hints = [did_you_mean(word, known) for word in options if word not in known]
        super().error("; ".join([message, *filter(None, hints)]))


def probability(text: str) -> float:
    """Return an option's value as a probability, between 0 and 1; argparse says what is wrong with another."""
    value = float(text)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{value:g} is not between 0 and 1")
    return value


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return what reads a whole number within limits from an option; argparse says what is wrong with another."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text[:40]!r}: a whole number from {low} to {high} is needed")
        return value

    return parse


def number(low: float, high: float) -> Callable[[str], float]:
    """Return what reads a number within limits from an option; argparse says what is wrong with another."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not (isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"{text[:40]!r}: a number from {low:g} to {high:g} is needed")
        return value

    return parse


def image_size(text: str) -> tuple[int, int]:
    """Return an option's value as width and height in px, such as 640x480."""
    side = whole_number(64, 8192)
    width, by, height = text.lower().partition("x")
    if not by:
        raise argparse.ArgumentTypeError(f"{text[:40]!r}: width and height are needed, such as 640x480")
    return side(width), side(height)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a question that names the known word most like this one, or an empty text if none is like it."""
    close = get_close_matches(word.partition("=")[0], list(known), n=1)
    return f"did you mean {close[0]}?" if close else ""


class _Version(argparse.Action):
    """Prints the version and leaves; it is looked up only when asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print the version and leave")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from boxcal.version import installed_version

        sys.stdout.write(f"boxcal {installed_version()}\n")
        parser.exit()
