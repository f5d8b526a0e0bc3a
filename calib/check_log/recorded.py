"""Findings on a recording as such: topics, rates, gaps and clocks."""

from collections.abc import Sequence

import numpy as np

from boxcal.calib.check_log.findings import LogFinding, fine, look, sentence
from boxcal.detect.log.clocks import LEAST_OFFSET_S
from boxcal.detect.log.recording import Recording
from boxcal.detect.log.safe_text import counted, listed, printable
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Ids

_GAP = 5.0
"""Periods without a message that make a gap."""
_LEAST_GAP_NS = 300_000_000
_SLOW_WHEELS_HZ = 8.0
_BELATED_NS = 5_000_000
_CLOCK_NOTE = "the camera's clock is"
"""Notes that begin so are said as findings on the clock."""


def gaps(t_ns: Ids) -> tuple[tuple[int, int], ...]:
    """Return the times (start, end), ns, in which no message came for much longer than usual."""
    if len(t_ns) < 3:
        return ()
    apart = np.diff(t_ns)
    rows = np.flatnonzero(apart > max(_GAP * float(np.median(apart)), _LEAST_GAP_NS))
    return tuple((int(t_ns[k]), int(t_ns[k + 1])) for k in rows)


def rate_hz(t_ns: Ids) -> float:
    """Return the usual rate of messages, Hz; 0 of fewer than two."""
    return 1e9 / float(np.median(np.diff(t_ns))) if len(t_ns) > 1 else 0.0


def recording_findings(recording: Recording) -> list[LogFinding]:
    """Return what topics, rates, gaps and clocks of a recording say."""
    wheels = wheels_findings(recording.wheels, recording.wheel_topics, recording.quantity)
    found = [*wheels, *_camera(recording), *_clock(recording)]
    notes = [note for note in recording.notes if not note.startswith(_CLOCK_NOTE)]
    return [*found, *(look("recording", sentence(note)) for note in notes)]


def wheels_findings(wheels: WheelSamples, topics: Sequence[str], quantity: str) -> list[LogFinding]:
    """Return what rates and gaps of the wheels' samples say.

    Parameters
    ----------
    wheels
        At least one sample.
    topics, quantity
        Where they come from, and what they are.
    """
    where = listed(topics)
    seconds = (int(wheels.t_ns[-1]) - int(wheels.t_ns[0])) / 1e9
    rate = rate_hz(wheels.t_ns)
    text = f"{where}: {quantity} at {rate:.0f} Hz over {seconds:.0f} s."
    steps = [np.degrees(s) for s in wheels.encoder_steps if s > 0]
    if steps:
        text += f" Encoder step {max(steps):.3g}\N{DEGREE SIGN}."
    found = [fine("wheels", text) if rate >= _SLOW_WHEELS_HZ else look("wheels", text, "Record them at 20 Hz or more.")]
    holes = gaps(wheels.t_ns)
    if holes:
        longest = max(b - a for a, b in holes) / 1e9
        when = ", ".join(f"{(a - int(wheels.t_ns[0])) / 1e9:.0f} s" for a, _ in holes[:5])
        found.append(
            look(
                "wheels",
                f"{len(holes)} gap{'s' if len(holes) > 1 else ''} without readings, up to {longest:.1f} s long (at "
                f"{when}); legs with one carry no information about the wheels.",
            )
        )
    lost = int(np.count_nonzero(~wheels.covered)) - len(holes)
    if lost > 0:
        found.append(
            look("wheels", f"{lost} readings do not follow from those before (a counter that was reset, or strays).")
        )
    for side, phi in (("right", wheels.phi_R), ("left", wheels.phi_L)):
        if not np.ptp(phi) > 0:
            found.append(look("wheels", f"The {side} wheel's reading never changes.", "Name its joint or topic."))
    return found


def _camera(recording: Recording) -> list[LogFinding]:
    t_ns, where = recording.frame_t_ns, printable(recording.camera_topic)
    rate = rate_hz(t_ns)
    text = f"{where}: {counted(len(t_ns), 'image')} at {rate:.1f} Hz."
    found = [fine("camera", text)]
    holes = gaps(t_ns)
    if holes:
        longest = max(b - a for a, b in holes) / 1e9
        found.append(fine("camera", f"{counted(len(holes), 'time')} without images, up to {longest:.1f} s."))
    return found


def _clock(recording: Recording) -> list[LogFinding]:
    offset = recording.clock_offset_ns / 1e9
    if abs(recording.clock_offset_ns) > _BELATED_NS:
        side = "ahead of" if offset > 0 else "behind"
        return [
            look(
                "clock",
                f"The camera's clock is {abs(offset):.2f} s {side} the wheels'; it was put right.",
                "Let both stamp by one clock.",
            )
        ]
    images, wheels = recording.frame_t_ns, recording.wheels.t_ns
    if max(images[0], wheels[0]) > min(images[-1], wheels[-1]):  # refused for that
        return []
    late = (max(int(images[0]) - int(wheels[0]), 0) + max(int(wheels[-1]) - int(images[-1]), 0)) / 1e9
    text = f"No difference of {LEAST_OFFSET_S:g} s or more between the clocks of images and wheels is seen."
    return [fine("clock", text if late < 5 else f"{text} Images cover all but {late:.0f} s of the wheels' time.")]
