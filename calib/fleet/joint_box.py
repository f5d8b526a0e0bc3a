"""One box, solved by all robots of a run: the refined target beside their results, and their results made anew."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from boxcal.calib.fleet.batch import calibrate_fleet
from boxcal.calib.fleet.engine.calls import Call, Engine
from boxcal.calib.joint_box.one_of_many import Member, calibrated
from boxcal.calib.joint_box.robots import LOST
from boxcal.calib.joint_box.together import JointBox, solve_box
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.fingerprint import JOINT
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.settings import CORRESPONDENCES, Outcome
from boxcal.detect.log.safe_text import listed
from boxcal.target.box import Target
from boxcal.target.errors import BoxcalError
from boxcal.target.files.target_json import save_target, target_sha256

REFINED = "target.json"
"""Name of the refined target in a folder of results."""
_LISTED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Refined:
    """Results after all robots were solved together.

    Attributes
    ----------
    outcomes
        Of all robots, in their order: made anew with the refined box where that could be.
    lines
        What is to be said of it.
    failed
        Whether some box could not be solved for.
    """

    outcomes: list[Outcome]
    lines: list[str]
    failed: bool


def refine(outcomes: Sequence[Outcome], engine: Engine, folder: Path, said: str) -> Refined:
    """Solve the boxes of a run, each by all robots that drove around it, and calibrate those robots with it.

    A robot that takes no part keeps the calibration that it has by itself; if what it has is of an earlier joint
    solution, it is calibrated anew.

    Parameters
    ----------
    outcomes
        Of every robot, by itself or of an earlier joint solution; what was saved of their logs is in their folders.
    engine
        Where the work is done.
    folder
        Gets the refined targets; those of boxes after the first are named after the id of their first tag.
    said
        That folder, for messages.
    """
    prepare_all(_silent)
    boxes: dict[str, list[int]] = {}
    for k, outcome in enumerate(outcomes):
        if outcome.calibration is not None:
            boxes.setdefault(target_sha256(outcome.job.target.unrefined), []).append(k)
    new, lines, failed = list(outcomes), list[str](), False
    for number, rows in enumerate(boxes.values()):
        box = outcomes[rows[0]].job.target.box
        name = REFINED if number == 0 else f"target-{box.first_id}.json"
        try:
            joint = solve_box([_member(outcomes[k]) for k in rows], _run_on(engine))
            save_target(joint.target, folder / name)
        except (BoxcalError, OSError) as error:
            failed = True
            lines.append(f"joint box: {error}")
            lines += [f"  {said}/{name} is of an earlier run"] if (folder / name).exists() else []
            continue
        lines += _said(joint, f"{said}/{name}")
        for k, outcome, line in _made_anew(joint, [outcomes[k] for k in rows], engine):
            new[rows[k]] = outcome
            lines += [line] if line else []
    stale = [k for k, outcome in enumerate(new) if outcome is outcomes[k] and _joint(outcome)]
    for k, outcome in zip(stale, _by_themselves([outcomes[k] for k in stale], engine), strict=True):
        new[k] = outcome
    if stale:
        names = listed([outcomes[k].job.robot for k in stale])
        lines.append(f"  calibrated anew by themselves, since their results were of an earlier joint solution: {names}")
    if not boxes:
        failed = True
        lines.append("joint box: no robot was calibrated that could take part")
    return Refined(outcomes=new, lines=lines, failed=failed)


def _joint(outcome: Outcome) -> bool:
    """Return whether a robot's result is of an earlier joint solution."""
    found = outcome.calibration
    return found is not None and found.provenance.fingerprint.endswith(JOINT)


def _by_themselves(outcomes: Sequence[Outcome], engine: Engine) -> Iterator[Outcome]:
    """Yield robots calibrated by themselves: what an earlier joint solution made of them does not hold any more."""
    if outcomes:
        found = {o.job.robot: o for o in calibrate_fleet([o.job for o in outcomes], engine=engine)}
        yield from (found[outcome.job.robot] for outcome in outcomes)


def _silent(_: str) -> None:
    return


def _member(outcome: Outcome) -> Member:
    """Return a robot with what was saved of its logs when it was calibrated by itself."""
    own = outcome.calibration.provenance.fingerprint if outcome.calibration is not None else ""
    job = replace(outcome.job, fingerprint=own and own.removesuffix(JOINT) + JOINT)
    if job.out is None:
        return Member(job=job)
    numbers = [f"-{k + 1}" for k in range(len(job.logs))] if len(job.logs) > 1 else [""]
    return Member(job=job, saved=tuple(job.out / job.robot / f"correspondences{n}{CORRESPONDENCES}" for n in numbers))


def _run_on(engine: Engine) -> Callable[..., Iterable[Any]]:
    """Return what does work on many robots on an engine, results in their order; None where one was lost."""

    def run(work: Callable[..., Any], *each: Iterable[Any]) -> Iterator[Any]:
        calls = (Call(key=str(k), function=work_on, arguments=(work, a)) for k, a in enumerate(zip(*each, strict=True)))
        early: dict[int, Any] = {}
        following = 0
        for done in engine.run(calls):
            early[int(done.call.key)] = done.result
            while following in early:
                yield early.pop(following)
                following += 1

    return run


def work_on(work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Return what some work gives: a call that an engine can make."""
    return work(*arguments)


def _made_anew(joint: JointBox, outcomes: Sequence[Outcome], engine: Engine) -> Iterator[tuple[int, Outcome, str]]:
    """Yield the robots that took part: their number, their outcome with the refined box, and what is to be said."""
    taking = [k for k, block in enumerate(joint.blocks) if block is not None]
    members = (joint.members[k] for k in taking)
    boxes = (joint.without(k) for k in taking)
    results = _run_on(engine)(made_anew, members, boxes, (joint.target for _ in taking))
    for k, result in zip(taking, results, strict=True):
        before = outcomes[k]
        job = replace(before.job, target=joint.target)
        if isinstance(result, Calibration):
            yield k, replace(before, job=job, calibration=result), ""
        else:
            why = result or LOST
            yield k, before, f"  {job.robot}: keeps the calibration that it has by itself ({why})"


def made_anew(member: Member, box: Target | BoxcalError, known_as: Target) -> Calibration | BoxcalError:
    """Return a robot's calibration with the box that the others found, written, without its drive; or why not."""
    found = calibrated(member, box, known_as)
    return without_drive(found) if isinstance(found, Calibration) else found


def _said(joint: JointBox, name: str) -> list[str]:
    """Return what a joint solution amounts to, line by line."""
    before, after = joint.before, joint.after
    lines = [
        f"joint box: {joint.robots} of {len(joint.members)} robots agree on one box; its shape is known to "
        f"{1e3 * after.shape:.3f} mm (a robot alone: {1e3 * before.shape:.3f} mm)",
        f"  its size as a whole, {after.scale:.2%}, stays common to all lengths of all robots: no image shows it; "
        "measure-target does",
        f"  {name} holds the refined box with its covariance: give it to --target for other robots",
    ]
    if not joint.joined.converged:
        lines.append(f"  the shape had not settled after {joint.joined.rounds} rounds: take it with care")
    out = [f"  {robot}: {why}" for robot, why in joint.left_out.items()]
    more = [f"  likewise left out: {', '.join(list(joint.left_out)[_LISTED:])}"] if len(out) > _LISTED else []
    return [*lines, *out[:_LISTED], *more]
