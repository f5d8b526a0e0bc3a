"""Named cause of misfit in a drive, with its size and what to do about it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A named cause of what noise does not explain.

    Attributes
    ----------
    cause
        Its name in the catalogue of explanations, such as ``eccentric-right``; stable, for programs.
    text
        One sentence: cause, size, standard deviation and unit.
    advice
        What to do about it; empty where nothing is to be done.
    adopted
        Whether it was solved for, so that the result allows for it.
    blocks
        Whether the result must not be used: sheets exchanged, a camera below its floor.
    stops
        Numbers of the stops that it concerns, from 0.
    size, sigma
        How large it is, in ``unit``; NaN where it has no one size.
    unit
        Of both; empty where they have none.
    p_value
        Chance of data as odd as these without the cause; NaN where no test was made.
    probability
        Probability that the cause is at work; below 1 it is too little to solve for it, and the standard deviations
        allow for it instead.
    """

    cause: str
    text: str
    advice: str = ""
    adopted: bool = False
    blocks: bool = False
    stops: tuple[int, ...] = ()
    size: float = float("nan")
    sigma: float = float("nan")
    unit: str = ""
    p_value: float = float("nan")
    probability: float = 1.0

    @property
    def allowed_for(self) -> bool:
        """Whether the result allows for the cause: it was solved for, or the standard deviations are wider for it."""
        return self.adopted or self.probability < 1

    @property
    def remedy(self) -> str:
        """The advice as the end of an error, whose last sentence it is."""
        return self.advice[:1].lower() + self.advice[1:].rstrip(".")
