"""Sequential watch over one robot: changes, found at a false-alarm rate that is the fleet's, over all its days.

Each part of a robot (wheels, camera extrinsics, camera) has a weighted Shiryaev-Roberts statistic

    M_k = sum over onsets c <= k of w_c LR_c(k),    w_c = (years since the session before c) / (robots then)

with LR_c(k) the mean, over the part's quantities and shapes of change, of likelihood ratios that are martingales of
mean 1 while nothing changes (``evidence.py``). M_k less the sum of its weights is a martingale then, so by Doob's
inequality the chance that M ever reaches 1/alpha within T years is at most alpha times the sum of the weights: over all
robots and parts alpha T. ``alpha`` is the rate of false alarms, a year and a fleet, however many robots there are,
however often they are calibrated and looked at (an e-detector: Shin, Ramdas and Rinaldo 2024,
doi:10.51387/23-NEJSDS51).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.history.channels import CHANNELS, GROUPS, Series
from boxcal.calib.history.evidence import log_ratios
from boxcal.target.arrays import Array, Mask

LEVEL = 0.02
"""False alarms a fleet and a year, at most, by default: one in fifty fleet-years."""
_LONGEST = 120
"""Sessions of a stretch that onsets are looked for in: a change further back was found long ago."""
_BLOCK = 64
"""Sessions that are looked at together."""
_NEARLY = 3.0
"""Difference of log likelihood ratios within which two shapes of a change are nearly as likely."""
_ODD = 6.0
"""Standard deviations by which one session, alone, may be off before it is left aside."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A change of a robot beyond chance.

    Attributes
    ----------
    group, channel
        Part of the robot, and the quantity (number in ``CHANNELS``) with the strongest evidence.
    drift
        Whether it is a drift that set in, rather than a step.
    onset
        Number of the first session after it, among the robot's sessions.
    found
        Number of the session that revealed it.
    evidence
        The statistic: 1/alpha is where it counts.
    """

    group: str
    channel: int
    drift: bool
    onset: int
    found: int
    evidence: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Watched:
    """All that a watch over one robot found.

    Attributes
    ----------
    changes
        In the order in which they were found.
    pending
        Parts in which the last session alone differs beyond chance: one more decides.
    start : (J,)
        Session from which on each channel is as it is now.
    sloped : (J,)
        Whether a drift was found of it since.
    odd : (n, J)
        Sessions that lie alone, far from those before and after.
    """

    changes: tuple[Change, ...]
    pending: tuple[str, ...]
    start: tuple[int, ...]
    sloped: Mask
    odd: Mask


def watch(series: Series, component: Array, prior_dof: float, robots: Array, *, level: float = LEVEL) -> Watched:
    """Return what changed of a robot, replaying its sessions one by one.

    Parameters
    ----------
    series
        Its sessions.
    component : (J,)
        Scatter between sessions.
    prior_dof
        As :class:`Scatter` has it.
    robots : (n,)
        Robots that the fleet had at each session.
    level
        False alarms a year and a fleet.
    """
    gaps = np.diff(series.years, prepend=series.years[:1]) / np.maximum(robots, 1)
    variances = series.variances + component
    odd = np.zeros_like(variances, dtype=bool)
    for group in GROUPS:  # a drive that went wrong says nothing of the part any more, once the next one is there
        own = [j for j, c in enumerate(CHANNELS) if c.group == group]
        odd[:, own] = np.any([_outliers(series.values[:, j], variances[:, j]) for j in own], axis=0)[:, None]
    variances = np.where(odd, np.inf, variances)
    changes: list[Change] = []
    pending: list[str] = []
    start = [0] * len(CHANNELS)
    sloped = np.zeros(len(CHANNELS), dtype=bool)
    for group in GROUPS:
        own = [j for j, c in enumerate(CHANNELS) if c.group == group]
        part = _Part(series=series, variances=variances, prior_dof=prior_dof, gaps=gaps, group=group, level=level)
        begun, fresh = 0, 1
        while (change := part.first_change(begun, fresh, sloped)) is not None:
            changes.append(change)
            fresh = change.found + 1
            begun = max(begun, change.onset - 1) if change.drift else change.onset
            if change.drift:
                sloped[own] |= [CHANNELS[j].wears for j in own]
        if part.pending(begun, fresh, sloped):
            pending.append(group)
        for j in own:
            start[j] = begun
    return Watched(
        changes=tuple(sorted(changes, key=lambda c: (c.found, c.group))),
        pending=tuple(pending),
        start=tuple(start),
        sloped=sloped,
        odd=odd,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """The statistic of one part of a robot."""

    series: Series
    variances: Array
    prior_dof: float
    gaps: Array
    group: str
    level: float

    def first_change(self, begun: int, fresh: int, slopes: Mask) -> Change | None:
        """Return the first change reported after session ``fresh`` by an onset from there on; None if none is."""
        for k0 in range(fresh, len(self.series.years), _BLOCK):
            for change in self._looks(begun, fresh, slice(k0, min(k0 + _BLOCK, len(self.series.years))), slopes):
                if self._confirmed(change, begun, slopes):
                    return change
        return None

    def pending(self, begun: int, fresh: int, slopes: Mask) -> bool:
        """Return whether the last session differs beyond chance, with no second one yet to confirm it."""
        n = len(self.series.years)
        return fresh < n and bool(self._looks(begun, fresh, slice(n - 1, n), slopes))

    def _looks(self, begun: int, fresh: int, looks: slice, slopes: Mask) -> list[Change]:
        """Return, for each look after which the statistic counts, the changes that are nearly as likely as any."""
        first = max(begun, looks.start - _LONGEST)
        span = slice(first, looks.stop)
        onsets = np.arange(max(fresh, first + 1), looks.stop)
        own = [j for j, c in enumerate(CHANNELS) if c.group == self.group and c.watched]
        wears = np.array([CHANNELS[j].wears for j in own])
        if len(onsets) == 0:
            return []
        ratios = log_ratios(
            self.series.years[span],
            self.series.values[span][:, own],
            self.variances[span][:, own],
            self.prior_dof,
            slope=slopes[own],
            looks=slice(looks.start - first, looks.stop - first),
        )
        with np.errstate(divide="ignore"):
            weights = np.log(self.gaps[onsets] / sum(c.watched for c in CHANNELS))[None, :, None]
            halves = np.where(wears, np.log(0.5), 0.0)
            table = np.stack(
                [
                    ratios.step[:, onsets - first] + weights + halves,
                    np.where(wears, ratios.drift[:, onsets - first] + weights + halves, -np.inf),
                ],
                axis=-1,
            )
            table = np.where(
                onsets[None, :, None, None] > np.arange(looks.start, looks.stop)[:, None, None, None], -np.inf, table
            )
            told = np.logaddexp.reduce(table.reshape(len(table), -1), axis=1)
        found = []
        for row in np.flatnonzero(told >= -np.log(self.level)):
            for c, j, shape in _likeliest(table[row]):
                found.append(
                    Change(
                        group=self.group,
                        channel=own[j],
                        drift=bool(shape),
                        onset=int(onsets[c]),
                        found=looks.start + int(row),
                        evidence=float(np.exp(min(told[row], 700.0))),
                    )
                )
        return found

    def _confirmed(self, change: Change, begun: int, slopes: Mask) -> bool:
        """Return whether sessions after it agree on a change: one alone may be odd by itself.

        Two after a step lie beyond half of it; three after the onset of a drift, each left out in turn, leave half of
        it.
        """
        j, c = change.channel, change.onset
        known = np.isfinite(self.variances[:, j])
        before = [i for i in range(begun, c) if known[i]]
        after = [i for i in range(c, change.found + 1) if known[i]]
        if len(after) < (3 if change.drift else 2) or not before:
            return False
        years, values = self.series.years, self.series.values[:, j]
        if slopes[j] and len(before) > 2:
            line = np.polyfit(years[before], values[before], 1)
            values = values - np.polyval(line, years)
        off = values[after] - np.median(values[before])
        if not change.drift:
            step = float(np.mean(off))
            return bool(np.sum(off * np.sign(step) > 0.5 * abs(step)) >= 2)
        t = years[after] - years[before[-1]]
        top, bottom = t * off, t * t
        rate = np.sum(top) / np.sum(bottom)
        without = (np.sum(top) - top) / (np.sum(bottom) - bottom)
        return bool(np.all(without * np.sign(rate) > 0.5 * abs(rate)))


def _likeliest(ratios: Array) -> list[tuple[int, int, int]]:
    """Return onset, quantity and shape (1: drift) by log ratios (onsets, quantities, 2), in the order to be believed.

    Wheels wear, and a drift looks like a step for a while: where both are nearly as likely the drift comes first, from
    the earliest onset that is.
    """
    least, out = float(np.max(ratios)) - _NEARLY, []
    drifts = np.argwhere(ratios[..., 1] >= least)
    if len(drifts):
        onset = int(np.min(drifts[:, 0]))
        out.append((onset, int(np.argmax(ratios[onset, :, 1])), 1))
    if np.max(ratios[..., 0]) >= least:
        c, j = np.unravel_index(int(np.argmax(ratios[..., 0])), ratios.shape[:2])
        out.append((int(c), int(j), 0))
    return out


def _outliers(values: Array, variances: Array) -> Mask:
    """Return which sessions lie far from those before and after, which agree with each other."""
    known = np.flatnonzero(np.isfinite(variances))
    out = np.zeros(len(values), dtype=bool)
    if len(known) > 2:
        v, own = values[known], variances[known]
        step, spread = np.abs(np.diff(v)), np.sqrt(own[1:] + own[:-1])
        far = step > _ODD * spread
        alike = np.abs(v[2:] - v[:-2]) < _ODD / 2 * np.sqrt(own[2:] + own[:-2])
        out[known[1:-1]] = far[:-1] & far[1:] & alike
    return out


def fleet_sizes(starts: Sequence[float], years: Array) -> Array:
    """Return how many robots the fleet had at times (n,) yr, from when each was calibrated first."""
    return np.searchsorted(np.sort(np.asarray(starts)), years, side="right").astype(float)
