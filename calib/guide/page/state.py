"""The state of a session as the page shows it: plain numbers and sentences."""

import time
from math import degrees, isfinite, log10
from typing import Any

import numpy as np

from boxcal.calib.guide.drive.glance import Glance
from boxcal.calib.guide.drive.live_drive import HOLD_S
from boxcal.calib.guide.drive.warnings import Warned, sharpness, warnings_of_estimate, warnings_of_picture
from boxcal.calib.guide.drive.whereabouts import Whereabouts, whereabouts
from boxcal.calib.guide.estimate.advice import Place, route_to
from boxcal.calib.guide.session import Session
from boxcal.calib.planning.goal import Bar
from boxcal.detect.stops import MIN_STOPS

_TAKEN_S = 2.5
"""Time for which the page says that a stop was taken, s."""
_AT_PLACE_M, _AT_PLACE_DEG = 0.12, 12.0
_DECADES = 1.5
"""Decades above the goal at which a bar is empty."""
_OLD_S = 2.0
MOST_CAMERAS = 24
_REACH_M = 0.12
"""Reach of a robot of which nothing is known yet."""


def state_of(session: Session) -> dict[str, Any]:
    """Return all that the page shows."""
    drive, outlook = session.progress.drive, session.progress.outlook
    stands = drive.stands
    here = whereabouts(
        outlook.seen,
        session.progress.running.estimate,
        session.progress.running.drive,
        None if drive.samples is None else drive.samples.wheels,
        stands.now_ns if stands is not None else 0,
    )
    places = [_place(session, p, here if k == 0 else None) for k, p in enumerate(session.progress.places)]
    return {
        "robot": session.options.robot,
        "source": session.link.name,
        "connected": session.link.connected,
        "said": session.link.said,
        "compiling": session.compiling,
        "banner": _banner(session, places),
        "stops": drive.stops_taken,
        "picture": _picture(session),
        "cameras": {
            "chosen": session.link.selection.camera,
            "all": list(session.link.selection.cameras[:MOST_CAMERAS]),
        },
        "plan": _plan(session, here, places),
        "bars": [_bar(bar) for bar in outlook.bars],
        "bars_note": "" if outlook.bars else session.progress.running.problem,
        "warnings": [w._asdict() for w in _warnings(session)],
        "verdict": session.progress.full.verdict,
        "finished": {**session.progress.full.written, "report": "report/"} if session.progress.full.written else {},
        "calibrating": session.tasks.is_calibrating,
        "failed": session.progress.full.failed,
        "enough": session.progress.enough,
        "can_calibrate": drive.stops_taken >= MIN_STOPS,
        "recording": _recording(session),
        "latency_ms": round(1000 * outlook.latency),
        "update_ms": round(1000 * session.progress.running.seconds),
    }


def _banner(session: Session, places: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the driver should do now."""
    stands = session.progress.drive.stands
    at_end = _missing(session) or _at_the_end(session)
    if at_end is not None or stands is None:
        return at_end or _said("wait", "Waiting for the wheels", "")
    then = _then(places)
    if stands.standing and not session.progress.drive.stands_taken:
        return _standing(session, stands.seconds, then)
    taken, count = session.progress.outlook.taken_at
    if stands.standing and time.monotonic() - taken < _TAKEN_S:
        return _said("taken", f"Stop {count} taken", then)
    title = places[0]["title"] if places else "Drive around the box"
    return _said("go", title, then)


def _at_the_end(session: Session) -> dict[str, Any] | None:
    """Return that it is enough, that the calibration is under way, or what came of it, if anything."""
    finished, count = session.progress.full.written, session.progress.drive.stops_taken
    if session.tasks.is_calibrating:
        return _said("wait", "Calibrating", f"{count} stops are solved in full")
    if finished and finished["stops"] == count:
        kind = {"good": "done", "usable": "care"}.get(finished["level"], "bad")
        return _said(kind, f"Calibrated: {finished['level']}", f"{finished['headline']} The report is below.")
    if session.progress.enough:
        return _said("done", "Enough: calibrate", f"all goals are reached with {count} stops")
    if session.progress.is_checking:
        return _said(
            "wait", "All goals are reached", f"stay here: the full calibration of {count} stops is being checked"
        )
    return None


def _missing(session: Session) -> dict[str, Any] | None:
    """Return what is missing before anything can be said of the drive; None if nothing is."""
    link, drive = session.link, session.progress.drive
    if not link.connected and not (drive.stands is not None and link.said.startswith("the recording")):
        return _said("bad", "Not connected", link.said or f"looking for {link.name}")
    if session.compiling:
        return _said("wait", "Getting ready", session.compiling)
    if drive.stands is None:
        said = link.said or (drive.wheels.problem if drive.wheels.heard else "nothing was heard of them yet")
        return _said("wait", "Waiting for the wheels", said)
    if drive.newest is None:
        return _said("wait", "Waiting for the camera", link.said or "no picture has come yet")
    return None


def _standing(session: Session, seconds: float, then: str) -> dict[str, Any]:
    """Return how long a robot that stands at a place which was not taken yet has to go on standing."""
    seen = _looked_at_now(session)
    if seen is not None and not len(seen.corners):
        return _said("go", "Turn towards the box", then)
    left = max(HOLD_S - seconds, 0.0)
    detail = f"{left:.1f} s more" if left > 0 else "measuring ..."
    return _said("hold", "Stand still", detail, progress=min(seconds / HOLD_S, 1.0))


def _said(kind: str, title: str, detail: str, progress: float = 0.0) -> dict[str, Any]:
    return {"kind": kind, "title": title, "detail": detail, "progress": round(progress, 2)}


def _then(places: list[dict[str, Any]]) -> str:
    if not places:
        return "the next stop is being planned ..."
    steps = ", ".join(places[0]["steps"])
    return f"next: {steps}" if steps else places[0]["text"]


def _place(session: Session, place: Place, here: Whereabouts | None) -> dict[str, Any]:
    at = f"x {place.x:+.2f} m, y {place.y:+.2f} m, heading {degrees(place.heading) % 360:.0f}\N{DEGREE SIGN}"
    shown = {
        "x": round(place.x, 3),
        "y": round(place.y, 3),
        "heading": round(place.heading, 4),
        "whole_turns": place.whole_turns,
        "text": at,
        "gain": place.gain,
        "title": "Drive to the next stop",
        "steps": [],
        "points": [],
    }
    if here is None or here.source == "camera":
        return shown
    estimate = session.progress.running.estimate
    reach = _REACH_M if estimate is None else max(estimate.b / 2, float(np.hypot(*estimate.T_body_cam[:2, 3])))
    route = route_to(place, here, session.options.target, reach)
    shown["steps"] = list(route.steps)
    shown["points"] = [[round(x, 3), round(y, 3)] for x, y in route.points]
    turned = abs((degrees(place.heading - here.heading) + 180) % 360 - 180)
    near = np.hypot(place.x - here.x, place.y - here.y) < _AT_PLACE_M and turned < _AT_PLACE_DEG
    if near and not session.progress.drive.stands_taken:
        shown["title"] = "You are there: stand still"
    return shown


def _picture(session: Session) -> dict[str, Any]:
    seen = session.progress.outlook.seen
    if seen is None:
        return {"number": 0}
    tags = len(seen.corners)
    faces = f"{len(seen.faces)} face{'s' if len(seen.faces) != 1 else ''}"
    newest = session.progress.drive.newest
    return {
        "number": seen.t_ns,
        "width": seen.size[0],
        "height": seen.size[1],
        "tags": np.round(seen.corners, 4).reshape(-1, 8).tolist(),
        "seen": f"{tags} tag{'s' if tags != 1 else ''} on {faces}" if tags else "no tags",
        "sharp": sharpness(seen),
        "edge_px": round(seen.edge_px, 1) if isfinite(seen.edge_px) else None,
        "old": newest is not None and newest.t_ns - seen.t_ns > _OLD_S * 1e9,
    }


def _looked_at_now(session: Session) -> Glance | None:
    """Return the last look at an image, if that was taken a moment ago, and of a robot that stands, since then."""
    seen, newest, stands = session.progress.outlook.seen, session.progress.drive.newest, session.progress.drive.stands
    if seen is None or newest is None or newest.t_ns - seen.t_ns > _OLD_S * 1e9:
        return None
    moved_since = stands is not None and stands.standing and seen.t_ns < stands.stops[-1].t_start_ns
    return None if moved_since else seen


def _plan(session: Session, here: Whereabouts | None, places: list[dict[str, Any]]) -> dict[str, Any]:
    box = session.options.target.box
    found = session.progress.running.estimate
    stops = []
    if found is not None:
        for k, T in zip(found.drives[0].stops, found.drives[0].T_box_body, strict=True):
            heading = float(np.arctan2(T[1, 0], T[0, 0]))
            stops.append({"n": k + 1, "x": round(T[0, 3], 3), "y": round(T[1, 3], 3), "heading": round(heading, 3)})
    robot = None
    if here is not None:
        robot = {"x": round(here.x, 3), "y": round(here.y, 3), "heading": round(here.heading, 3), "source": here.source}
    return {
        "box": [box.width, box.depth],
        "stops": stops,
        "robot": robot,
        "next": places,
        "size": 0.12 if found is None else round(found.b, 3),
    }


def _bar(bar: Bar) -> dict[str, Any]:
    """Return a bar; full where its goal is reached, empty where it is thirty times as much."""
    known = isfinite(bar.value) and bar.value > 0
    fraction = 1 - log10(max(bar.ratio, 1e-9)) / _DECADES if known else 0.0
    return {
        "name": bar.name,
        "label": bar.label,
        "value": _figure(bar.value, bar.unit) if known else "unknown",
        "goal": _figure(bar.goal, bar.unit),
        "reached": bar.reached,
        "share": round(min(max(fraction, 0.0), 1.0), 3),
    }


def _figure(value: float, unit: str) -> str:
    if unit == "rad":
        return f"{degrees(value):.2g}\N{DEGREE SIGN}"
    if unit == "px":
        return f"{value:.2g} px"
    if value >= 1:
        return f"{value:.2g} m"
    return f"{100 * value:.2g} cm" if value >= 0.01 else f"{1000 * value:.2g} mm"


def _warnings(session: Session) -> list[Warned]:
    drive = session.progress.drive
    found: list[Warned] = []
    recorder = session.recorder
    if recorder is not None and recorder.problem:
        found.append(Warned("bad", recorder.problem))
    found += [Warned("bad", text) for text in session.progress.problems.values() if text]
    if session.link.connected and session.link.said:
        found.append(Warned("bad", session.link.said))
    if session.progress.full.failed:
        found.append(Warned("care", session.progress.full.failed))
    if drive.damaged or drive.taken.undecoded:
        found.append(Warned("care", drive.damaged or drive.taken.undecoded))
    found += [Warned("care", note) for note in drive.wheels.notes]
    if drive.clock_offset:
        found.append(
            Warned("care", f"the camera's clock is {drive.clock_offset:+.1f} s off the wheels'; it is put right")
        )
    seen = _looked_at_now(session)
    if seen is not None:
        found += warnings_of_picture(
            seen,
            planned=session.progress.running.estimate is not None,
            moving=drive.stands is not None and not drive.stands.standing,
        )
    if session.progress.running.estimate is not None:
        found += warnings_of_estimate(session.progress.running.estimate)
    if session.progress.full.verdict and session.progress.full.verdict["level"] != "good":
        found += [Warned("care", text) for label, text in session.progress.full.verdict["lines"] if label == "why"]
    return list(dict.fromkeys(found))


def _recording(session: Session) -> dict[str, Any]:
    recorder, inbox = session.recorder, session.link.inbox
    if recorder is None:
        return {"file": "", "problem": ""}
    return {
        "file": recorder.path.name,
        "size": f"{recorder.size / 1e6:.1f} MB",
        "messages": recorder.messages,
        "problem": recorder.problem,
        "dropped": session.link.pictures_left_out + recorder.unkept_pictures,
        "lost": recorder.lost + inbox.dropped_others,
    }
