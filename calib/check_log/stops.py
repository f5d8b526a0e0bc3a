"""Findings on the stops: the box at each, sharpness, light, and how far the wheels went between."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from boxcal.calib.check_log.findings import LogFinding, fine, listed_stops, look, wrong
from boxcal.calib.planning.candidates import enough_tags
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.recording import Recording
from boxcal.target.arrays import Array
from boxcal.target.box import CORNERS, FACES, Target

_GOOD_STOPS = 8
_SHORT_S = 1.0
_SHARP_PX = 0.25
"""Standard deviation of a corner beyond which an image of 640 px is blurred or noisy."""
_BLURRED = 3.0
"""The same relative to the drive's median."""
_DARK, _BRIGHT, _CLIPPED = 70.0, 253.0, 0.3
_SMALL_PX = 16.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """Light at one stop: grey levels of the box's paper and ink, 0 to 255, and the fraction that is saturated."""

    paper: float
    ink: float
    clipped: float


def light_at_stops(recording: Recording, drive: Correspondences) -> tuple[Light | None, ...]:
    """Return the light on the box at each stop from one of its images; None where there is none."""
    rows = []
    for stop in drive.stops:
        frames = recording.frames_between(stop.t_start_ns, stop.t_end_ns)
        rows.append(int(frames[frames.size // 2]) if frames.size else -1)
    wanted = {int(recording.frame_t_ns[row]): k for k, row in enumerate(rows) if row >= 0}
    out: list[Light | None] = [None] * len(rows)
    for t_ns, grey in recording.read_frames(row for row in rows if row >= 0):
        k = wanted[t_ns]
        low = np.clip(np.floor(drive.stops[k].uv_px.min(axis=0)), 0, None).astype(int)
        high = np.ceil(drive.stops[k].uv_px.max(axis=0)).astype(int) + 1
        patch = grey[low[1] : high[1], low[0] : high[0]]
        if patch.size:
            ink, paper = np.percentile(patch, (5, 90))
            out[k] = Light(paper=float(paper), ink=float(ink), clipped=float(np.mean(patch >= _BRIGHT)))
    return tuple(out)


def stop_findings(
    drive: Correspondences, target: Target, light: Sequence[Light | None] = (), stands: int | None = None
) -> list[LogFinding]:
    """Return what the stops of a drive say.

    Parameters
    ----------
    drive, target
        Stops that see the box, and the box.
    light
        Of each stop, where images are at hand.
    stands
        How often the robot stood, with or without the box in view.
    """
    if not drive.stops:
        return [wrong("stops", "No stop sees the box.", "Stop at a dozen places around it.")]
    return [
        *_count(drive, stands),
        *_box(drive, target),
        *_sharpness(drive),
        *(_light(light) if light else ()),
        *_travel(drive),
    ]


def _count(drive: Correspondences, stands: int | None) -> list[LogFinding]:
    count = len(drive.stops)
    seconds = np.array([(stop.t_end_ns - stop.t_start_ns) / 1e9 for stop in drive.stops])
    text = f"{count} stops see the box"
    if stands is not None and stands > count:
        text += f", {stands - count} more do not"
    text += f"; the robot stood {seconds.min():.1f} to {seconds.max():.1f} s."
    found = [fine("stops", text) if count >= _GOOD_STOPS else look("stops", text, "Stop at a dozen places.")]
    short = np.flatnonzero(seconds < _SHORT_S)
    if len(short):
        found.append(look("stops", f"{listed_stops(short)}: shorter than 1 s.".capitalize(), "Stand still for 2 s."))
    return found


def tags_a_face(drive: Correspondences) -> Array:
    """Return how many tags of each face each stop shows, (P, FACES)."""
    return np.array([np.bincount(stop.faces, minlength=FACES)[:FACES] / CORNERS for stop in drive.stops])


def _box(drive: Correspondences, target: Target) -> list[LogFinding]:
    faces = tags_a_face(drive)
    need = enough_tags(target)
    well = faces >= need / 2
    each = ", ".join(f"face {f} at {int(np.count_nonzero(well[:, f]))}" for f in range(FACES))
    two = int(np.count_nonzero(well.sum(axis=1) > 1))
    found = [fine("box", f"{each} stops; two faces at once at {two}.")]
    unseen = [f for f in range(FACES) if not np.any(well[:, f])]
    if unseen:
        names = " and ".join(map(str, unseen))
        found.append(
            look(
                "box",
                f"Face{'s' if len(unseen) > 1 else ''} {names} never seen well.",
                "Drive all the way round the box.",
            )
        )
    if not two:
        found.append(look("box", "No stop shows two faces.", "Stop where two faces are in view: at the box's corners."))
    few = np.flatnonzero(faces.sum(axis=1) < need / 2)
    if len(few):
        found.append(
            look("box", f"{listed_stops(few)}: few tags only.".capitalize(), "Go nearer, with the box in the middle.")
        )
    small = [k for k, stop in enumerate(drive.stops) if _tag_side(stop.uv_px) < _SMALL_PX]
    if small:
        found.append(look("box", f"{listed_stops(small)}: tags are small.".capitalize(), "Go nearer."))
    return found


def _tag_side(uv_px: Array) -> float:
    tags = uv_px[: len(uv_px) // CORNERS * CORNERS].reshape(-1, CORNERS, 2)
    return float(np.median(np.linalg.norm(tags - np.roll(tags, -1, axis=1), axis=2)))


def _sharpness(drive: Correspondences) -> list[LogFinding]:
    sigma = np.array([np.sqrt(np.median(np.trace(stop.cov_px2, axis1=1, axis2=2)) / 2) for stop in drive.stops])
    usual, limit = float(np.median(sigma)), _SHARP_PX * drive.image_size[0] / 640
    text = f"Corners are seen to {usual:.3f} px."
    found = [fine("sharpness", text)]
    if usual > limit:
        found = [
            look(
                "sharpness", f"{text} That is a lot.", "Look for blur, noise, little light, and tags that are far away."
            )
        ]
    odd = np.flatnonzero((sigma > _BLURRED * usual) & (sigma > limit / 2))
    if len(odd):
        found.append(
            look(
                "sharpness",
                f"{listed_stops(odd)}: much less sharp than the others.".capitalize(),
                "Stand still, no farther away.",
            )
        )
    return found


def _light(light: Sequence[Light | None]) -> list[LogFinding]:
    known = [(k, at) for k, at in enumerate(light) if at is not None]
    if not known:
        return []
    paper = np.array([at.paper for _, at in known])
    found = [fine("light", f"The box's paper is at grey {paper.min():.0f} to {paper.max():.0f} of 255.")]
    dark = [k for k, at in known if at.paper < _DARK]
    if dark:
        found.append(look("light", f"{listed_stops(dark)}: dark.".capitalize(), "More light, or a longer exposure."))
    bright = [k for k, at in known if at.clipped > _CLIPPED]
    if bright:
        found.append(look("light", f"{listed_stops(bright)}: the paper is burnt out.".capitalize(), "Expose less."))
    return found


def _travel(drive: Correspondences) -> list[LogFinding]:
    ends = np.array([[stop.phi_R, stop.phi_L] for stop in drive.stops])
    legs = np.diff(ends, axis=0) / (2 * np.pi)
    if not len(legs):
        return [wrong("wheels", "The box was seen at one stop only.", "Stop at a dozen places.")]
    turns = np.abs(legs)
    text = (
        f"The wheels turned {turns.mean(axis=1).sum():.1f} times from the first stop to the last; "
        f"{np.count_nonzero(legs[:, 0] > legs[:, 1])} legs turn left, "
        f"{np.count_nonzero(legs[:, 0] < legs[:, 1])} right."
    )
    found = [fine("wheels", text)]
    uncovered = np.flatnonzero(~drive.legs_covered)
    if len(uncovered):
        legs_said = ", ".join(f"{k + 1} to {k + 2}" for k in uncovered[:6])
        found.append(look("wheels", f"From stop {legs_said} the wheels do not cover the whole path."))
    still = np.flatnonzero(turns.max(axis=1) == 0)
    if len(still):
        found.append(look("wheels", f"Between {listed_stops(still)} and the next no wheel turned."))
    return found
