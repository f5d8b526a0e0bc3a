"""From the signals that are the wheels to wheel samples: times, units, cleaning, one time base."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from boxcal.detect.errors import DetectError
from boxcal.detect.log.clocks import usable_stamps, without_own_jumps
from boxcal.detect.log.encoder import MAX_ANGLE, Encoder, averaged, clean, join
from boxcal.detect.log.encoder_step import encoder_step
from boxcal.detect.log.losses import MOST_STRAYS, Loss, LossKind
from boxcal.detect.log.odometry import ASSUMED_RADIUS, ASSUMED_SEPARATION, virtual_wheels
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.signals import OdometrySignal, Quantity, Signal
from boxcal.detect.log.wheel_choice import WheelChoice
from boxcal.detect.log.wheel_samples import JointUnit, WheelSamples, WheelUnits
from boxcal.target.arrays import Array, Ids

SLOWEST_HZ = 3.0
"""Wheel readings that come more rarely carry no information about the path between two of them."""
_COUNTERS = (2.0**16, 2.0**32)
"""Ranges of the counters in encoder messages, ticks."""
_TWO_PUBLISHERS = 0.1
"""Two publishers share a topic if at least this part of the readings is one and the same number in between others."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AssembledWheels:
    """The wheels of a recording.

    Attributes
    ----------
    wheels
        Samples of both.
    log_ns : (N,) ns
        When the right wheel's messages were recorded, and
    stamp_ns : (N,) ns
        what they are stamped.
    units
        What the readings were taken for: as the user said, else ticks where the message type says so.
    nominal : m
        Radius and separation that odometry was taken apart with, None if there are wheels.
    notes
        What a user should know.
    losses
        What of that no good calibration has.
    """

    wheels: WheelSamples
    log_ns: Ids
    stamp_ns: Ids
    units: WheelUnits
    nominal: tuple[float, float] | None
    notes: tuple[str, ...]
    losses: tuple[Loss, ...] = ()


def assemble_wheels(
    name: str, choice: WheelChoice, units: WheelUnits, nominal: tuple[float, float] | None
) -> AssembledWheels:
    """Return the wheel samples of the signals that were chosen.

    Parameters
    ----------
    name
        Of the recording, for messages.
    choice
        The signals.
    units
        What the readings mean.
    nominal : m
        The odometry driver's wheel radius and separation, None if they are not known.

    Raises
    ------
    DetectError
        If readings are too few or too rare, or ticks come without their number in a turn.
    """
    if choice.odometry is not None:
        return _of_odometry(name, choice.odometry, nominal, choice.notes)
    notes = list(choice.notes)
    ticks = _ticks_per_turn(name, choice, units)
    if ticks is not None and units.unit is not JointUnit.TICKS:
        units = WheelUnits(
            unit=JointUnit.TICKS,
            ticks_per_turn=ticks,
            reverse_left=units.reverse_left,
            reverse_right=units.reverse_right,
        )
        notes.append(
            f"{printable(choice.right[0].topic)} counts {ticks:g} ticks a turn (--ticks-per-turn changes that)"
        )
    said, losses = _no_numbers((*choice.right, *choice.left))
    notes += said
    sides: list[Encoder] = []
    for signals, factor in zip((choice.right, choice.left), units.factors, strict=True):
        encoders = [_encoder(name, s, factor, notes) for s in signals]
        sides.append(averaged(encoders, name))
    wheels = join(sides[0], sides[1], name)
    _refuse_rare(name, wheels, choice.right[0])
    first = choice.right[0]
    return AssembledWheels(
        wheels=wheels,
        log_ns=first.log_ns,
        stamp_ns=without_own_jumps(first.t_ns, first.log_ns)[0],
        units=units,
        nominal=None,
        notes=tuple(notes),
        losses=losses,
    )


def _no_numbers(signals: Sequence[Signal]) -> tuple[list[str], tuple[Loss, ...]]:
    """Return what is said of readings that are no numbers; many, after a wheel's first number, are a loss.

    Drivers publish NaN until the motors have answered; that costs nothing.
    """
    notes, losses = [], []
    for signal in signals:
        if not signal.dropped:
            continue
        total = signal.count + signal.dropped
        text = (
            f"{signal.dropped} of {total} readings of {printable(signal.name)} are no numbers, "
            "or they or their times are beyond all measure; they were left out"
        )
        notes.append(text)
        if signal.dropped - signal.dropped_first > MOST_STRAYS * (total - signal.dropped_first):
            losses.append(Loss(kind=LossKind.NO_NUMBERS, text=text))
    return notes, tuple(losses)


def _encoder(name: str, signal: Signal, factor: float, notes: list[str]) -> Encoder:
    """Return one signal as an encoder: in rad, in order, put right."""
    who = f"{name}: joint {printable(signal.name)} in {printable(signal.topic)}"
    values = signal.values
    times = usable_stamps(signal.t_ns, signal.log_ns, f"the messages in {printable(signal.topic)}")
    if not signal.stamped:
        times = replace(
            times,
            note=f"the messages in {printable(signal.topic)} carry no stamps, the times of their recording were taken",
        )
    t_ns, log_ns = times.t_ns, signal.log_ns
    stamped = t_ns != 0
    if np.any(stamped) and not np.all(stamped):
        t_ns, log_ns, values = t_ns[stamped], log_ns[stamped], values[stamped]
    if not times.note:
        t_ns, jumped = _of_one_clock(t_ns, log_ns, signal.topic)
        notes += [note for note in jumped if note not in notes]
    other = _second_publisher(t_ns, values)
    if np.any(other):
        notes.append(
            f"{printable(signal.topic)} has two publishers: {int(np.sum(other))} readings of {printable(signal.name)} "
            f"are always {values[other][0]:g} and were left out"
        )
        t_ns, values = t_ns[~other], values[~other]
    wild = np.abs(values) > MAX_ANGLE / abs(factor)
    if np.any(wild):
        if np.mean(wild) > MOST_STRAYS:
            raise DetectError(
                f"position {np.max(np.abs(values)):.3g}",
                source=who,
                needed="angles in rad are needed",
                remedy="check the driver",
            )
        notes.append(f"{printable(signal.name)}: {int(np.sum(wild))} impossible readings dropped")
        t_ns, values = t_ns[~wild], values[~wild]
    if signal.quantity is Quantity.VELOCITY:
        t_ns, values = _integrated(t_ns, values)
    periods = tuple(c * abs(factor) for c in _COUNTERS) if signal.quantity is Quantity.TICKS else ()
    step = None
    if signal.quantity is Quantity.TICKS and np.array_equal(values, np.round(values)):
        step = max(round(encoder_step(values)), 1) * abs(factor)  # exact, however large the counter is
    encoder = clean(t_ns, values * factor, who, periods, step)
    if signal.quantity is Quantity.VELOCITY:
        encoder = replace(encoder, step=0.0)
    added = [f"{printable(signal.name)}: {note}" for note in encoder.notes]
    notes += [n for n in (times.note, *added) if n and n not in notes]
    return encoder


def _of_one_clock(t_ns: Ids, log_ns: Ids, topic: str) -> tuple[Ids, list[str]]:
    """Return stamps (N,), ns, with jumps of the wheels' clock taken out, and what is said of them."""
    right, jumps = without_own_jumps(t_ns, log_ns)
    return right, [
        f"the wheels' clock ({printable(topic)}) jumps by {jump.later_s:+.1f} s against the times of recording, "
        f"{(jump.at_ns - log_ns[0]) / 1e9:.0f} s after the first reading; its stamps were put right by that"
        for jump in jumps
    ]


def _ticks_per_turn(name: str, choice: WheelChoice, units: WheelUnits) -> float | None:
    """Return the ticks a turn of tick signals; None where the readings are no ticks."""
    if units.unit is JointUnit.TICKS or units.unit is not JointUnit.RADIANS:
        return units.ticks_per_turn
    signals = (*choice.right, *choice.left)
    per_turn = {s.ticks_per_turn for s in signals}
    if choice.quantity is Quantity.TICKS and None not in per_turn:
        return max(t for t in per_turn if t is not None)
    whole = all(np.array_equal(s.values, np.round(s.values)) for s in signals)
    if (
        choice.quantity in {Quantity.TICKS, Quantity.POSITION}
        and whole
        and any(s.high - s.low > 2 * pi for s in signals)
    ):
        raise DetectError(
            f"the wheel readings in {printable(signals[0].topic)} are whole numbers ({signals[0].low:g} to "
            f"{signals[0].high:g}): encoder ticks, not radians",
            source=name,
            needed="the ticks in a turn of the wheel are needed",
            remedy="give --joint-unit ticks --ticks-per-turn N",
        )
    return None


def _second_publisher(t_ns: Ids, values: Array) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Return which readings are a second publisher's: one number that comes again and again in between others."""
    order = np.argsort(t_ns, kind="stable")
    sorted_values = values[order]
    levels, counts = np.unique(values, return_counts=True)
    out = np.zeros(values.size, dtype=np.bool_)
    common = levels[int(np.argmax(counts))]
    same = sorted_values == common
    part = float(np.mean(same))
    if values.size < 20 or not _TWO_PUBLISHERS < part < 1 - _TWO_PUBLISHERS:
        return out
    changes = int(np.sum(same[1:] != same[:-1]))
    others = sorted_values[~same]
    jump = float(np.median(np.abs(sorted_values[1:] - sorted_values[:-1])[same[1:] != same[:-1]])) if changes else 0.0
    usual = float(np.quantile(np.abs(np.diff(others)), 0.9)) if others.size > 2 else 0.0
    if changes > min(np.sum(same), np.sum(~same)) and jump > 3 * usual:
        out[order] = same
    return out


def _integrated(t_ns: Ids, speed: Array) -> tuple[Ids, Array]:
    """Return angles by the trapezoidal rule from speeds, from 0 on."""
    t_ns, last = np.unique(t_ns[::-1], return_index=True)
    speed = speed[::-1][last]
    dt = np.diff(t_ns) / 1e9
    return t_ns, np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * dt)])


def _refuse_rare(name: str, wheels: WheelSamples, signal: Signal) -> None:
    usual = float(np.median(np.diff(wheels.t_ns))) / 1e9
    if usual > 1.001 / SLOWEST_HZ:
        raise DetectError(
            f"the wheel readings in {printable(signal.topic)} come at {1 / usual:.2g} Hz",
            source=name,
            needed=f"{SLOWEST_HZ:g} Hz at least, better 20 Hz, are needed to follow the path between stops",
            remedy="raise the rate of the driver or of the recorder",
        )


def _of_odometry(
    name: str, signal: OdometrySignal, nominal: tuple[float, float] | None, notes: tuple[str, ...]
) -> AssembledWheels:
    t_ns, log_ns = np.array(signal.t_ns, dtype=np.int64), np.array(signal.log_ns, dtype=np.int64)
    what = printable(signal.topic)
    times = usable_stamps(t_ns, log_ns, f"the messages in {what}")
    used = nominal or (ASSUMED_RADIUS, ASSUMED_SEPARATION)
    right, jumped = (times.t_ns, []) if times.note else _of_one_clock(t_ns, log_ns, signal.topic)
    wheels = virtual_wheels(signal, right, used, f"{name}: odometry in {what}")
    sizes = f"{used[0]:g} m radius, {used[1]:g} m separation"
    if nominal is None:
        note = (
            f"no wheel readings: wheels of {sizes} stand for the driver's own, which {what} was reckoned with; the "
            "ratios to these are the corrections, the sizes mean nothing (give the driver's own with --nominal)"
        )
    else:
        note = (
            f"no wheel readings: {what} was taken apart with the driver's own wheels ({sizes}); what comes out are the "
            "corrections to these"
        )
    _refuse_rare(name, wheels, Signal(topic=signal.topic, name="", quantity=Quantity.ODOMETRY))
    return AssembledWheels(
        wheels=wheels,
        log_ns=log_ns,
        stamp_ns=t_ns if times.note else right,
        units=WheelUnits(),
        nominal=used,
        notes=tuple(n for n in (*notes, note, times.note, *jumped) if n),
        losses=(Loss(kind=LossKind.SIZES_UNKNOWN, text=note),) if nominal is None else (),
    )
