"""Faults of a simulated robot, its box and its floor as command-line options."""

from dataclasses import dataclass, field, replace

import numpy as np

from boxcal.calib.errors import CalibError
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import hand_made
from boxcal.calib.simulate.imperfections import Imperfections
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.violation import STOPS, Violation
from boxcal.calib.simulate.violations import HARMLESS, VIOLATIONS


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedFaults:
    """Faults that were asked for.

    Attributes
    ----------
    hand_made
        Whether box, print, floor and lens are what a careful user has.
    lean : rad
        Standard deviation of the robot's roll and pitch from stop to stop; None leaves it to the others.
    tilt : rad
        Standard deviation of the floor's slope about x and about y; None leaves it to the others.
    violations
        Names from the catalogue, with sizes in its units; None for the largest there.
    """

    hand_made: bool = False
    lean: float | None = None
    tilt: float | None = None
    violations: tuple[tuple[str, float | None], ...] = field(default_factory=tuple)

    @property
    def note(self) -> str:
        """In words."""
        words = ["a careful user's box, floor and lens"] if self.hand_made else []
        words += [f"leans by {np.degrees(self.lean):.3g} deg a stop"] if self.lean else []
        words += [f"floor tilted by {np.degrees(self.tilt):.3g} deg"] if self.tilt else []
        for name, size in self.violations:
            found = named_violation(name)
            words.append(f"{name}: {found.sizes[-1] if size is None else size:g} {found.unit}".strip())
        return "; ".join(words)

    def draw(self, robot: Robot, options: DriveOptions, rng: np.random.Generator) -> Imperfections | None:
        """Return what is not exact about one robot's drive; None where all is.

        Raises
        ------
        CalibError
            If a violation is not in the catalogue, or the drive is too short for it.
        """
        if self == AskedFaults():
            return None
        faults = hand_made(rng) if self.hand_made else Imperfections()
        faults = replace(faults, wheels=replace(faults.wheels, slip=options.slip))
        if self.lean is not None:
            faults = replace(faults, lean=self.lean)
        if self.tilt is not None:
            x, y = self.tilt * rng.standard_normal(2)
            faults = replace(faults, tilt=(float(x), float(y)))
        for name, size in self.violations:
            found = named_violation(name)
            faults = found.draw(faults, found.sizes[-1] if size is None else size, robot, rng)
        at = [f[0] for f in (faults.wheels.slipped, faults.wheels.carried, faults.wheels.restart) if f]
        at += [f[0] for f in (faults.camera.knocked, faults.camera.focus, faults.box.moved) if f]
        if at and options.stops < STOPS:
            raise CalibError(
                f"{options.stops} stops, {STOPS} are needed for what happens at one of them", remedy="add --stops 14"
            )
        return faults


def named_violation(name: str) -> Violation:
    """Return a violation of the catalogue.

    Raises
    ------
    CalibError
        If it has none of that name.
    """
    known = {v.name: v for v in (*VIOLATIONS, *HARMLESS)}
    if name not in known:
        raise CalibError(f"no violation {name[:40]!r}", needed=f"one of {', '.join(known)} is needed")
    return known[name]
