"""Errors of the target package, and what the errors of all packages have in common."""

from typing import Self


def one_line(text: str) -> str:
    """Return a name or a sentence that came with a file as one line without control characters, whole."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


class BoxcalError(ValueError):
    """An input that cannot be used, said in one line: **which input: found, needed; what to do**.

    Parameters
    ----------
    found
        What was found.
    source
        Which input: a file (name or path), a topic, an option.
    needed
        What was needed, where what was found does not say it.
    remedy
        What to do, without a full stop.
    """

    def __init__(self, found: str, *, source: object = "", needed: str = "", remedy: str = "") -> None:
        found, needed, remedy = map(one_line, (found, needed, remedy))  # they may quote what an input says
        self.found, self.source, self.needed, self.remedy = found, one_line(str(source)), needed, remedy
        text = f"{found}, {needed}" if needed else found
        text = f"{text}; {remedy}" if remedy else text
        super().__init__(f"{self.source}: {text}" if self.source else text)

    def of(self, source: str) -> Self:
        """Return the same error, said of an input that whoever raised it may not have known."""
        known = self.source == source or self.source.startswith(f"{source}: ")
        inner = self.source if known else f"{source}: {self.source}" if self.source else source
        return type(self)(self.found, source=inner, needed=self.needed, remedy=self.remedy)


class TargetError(BoxcalError):
    """A box, a target file or a sheet that cannot be made or read."""
