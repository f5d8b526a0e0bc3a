"""A drive of a robot that is not exact, as correspondences: no pictures are made, so hundreds take a minute."""

from dataclasses import dataclass, replace
from math import radians

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_se3, exp_so3, inverse, planar, rigid
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfections import BoxFaults, CameraFaults, Imperfections, WheelFaults
from boxcal.calib.simulate.kinematics import slipped, wheel_turns
from boxcal.calib.simulate.robot import Robot
from boxcal.calib.simulate.route import KeepOut, route
from boxcal.calib.simulate.viewpoints import choose_stops, decodable_tags
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array, Ids
from boxcal.target.box import CORNERS, FACES, Target
from boxcal.target.camera.camera_model import CameraKind, project_with_jacobians

FRAMES = 3
"""Pictures of a stop, spread evenly over it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImperfectDrive:
    """A drive of a robot that is not exact, and what it was.

    Attributes
    ----------
    seen
        What a calibration gets.
    robot
        The robot as it is; where the camera was knocked, before that.
    faults
        What was wrong.
    """

    seen: Correspondences
    robot: Robot
    faults: Imperfections


def imperfect_drive(
    robot: Robot, target: Target, options: DriveOptions, faults: Imperfections, rng: np.random.Generator
) -> ImperfectDrive:
    """Drive a robot around the box, as :func:`boxcal.calib.simulate.drive.simulate_drive` does, with faults.

    ``options.slip`` is not used: the faults have their own.
    """
    step_s = options.joint_period_s / options.steps_per_sample
    gap = options.clearance + robot.reach
    keep_out = KeepOut.around(target.box, gap)
    goals = choose_stops(robot, target, options.stops, gap, rng)
    phi = [rng.uniform(-15, 15, (1, 2))]
    path, ends, before = [goals[:1]], [], np.zeros(2)
    jumps: list[tuple[int, float]] = []
    for j, goal in enumerate(goals):
        if j > 0:
            arcs = route(path[-1][-1], goal, keep_out, rng, exact_heading=False)
            turns = wheel_turns(arcs, rR=robot.rR, rL=robot.rL, b=robot.b, max_speed=options.max_speed, step_s=step_s)
            dphi = np.stack(turns, axis=1)
            angle = phi[-1][-1] + np.cumsum(dphi, axis=0)
            rolled, before = _rolled(robot, faults.wheels, phi[-1][-1], dphi, before)
            spread = float(np.exp(faults.wheels.slip_spread * rng.standard_normal()))
            travel = np.stack([slipped(r, spread * faults.wheels.slip, rng) for r in rolled.T], axis=1)
            path.append(_path(path[-1][-1], travel, robot.b, faults.wheels, leg=j - 1))
            if faults.wheels.restart is not None and faults.wheels.restart[0] == j - 1:
                jumps.append((sum(map(len, phi)) + len(dphi) // 2, faults.wheels.restart[1]))
            phi.append(angle)
        stand = max(round(rng.uniform(*options.stand_s) / step_s), 1)
        begun = sum(map(len, phi)) - 1
        phi.append(np.repeat(phi[-1][-1:], stand, axis=0))
        path.append(np.repeat(path[-1][-1:], stand, axis=0))
        ends.append((begun, begun + stand))
    every = slice(None, None, options.steps_per_sample)
    t_ns = options.t0_ns + np.rint(np.arange(sum(map(len, phi))) * step_s * 1e9).astype(np.int64)
    read = np.concatenate(phi)
    for at, by in jumps:
        read[at:] -= by
    read = read[every]
    if options.encoder_step:
        read = np.floor(read / options.encoder_step) * options.encoder_step
    read = read * faults.wheels.counts
    wheels = WheelSamples(t_ns=t_ns[every], phi_R=read[:, 0].copy(), phi_L=read[:, 1].copy())
    motion = _Motion(t_ns=t_ns, path=np.concatenate(path), ends=np.array(ends), wheels=wheels)
    stops = _stops(robot, target, faults, motion, rng)
    seen = Correspondences(robot=robot.name, image_size=robot.image_size, wheels=wheels, stops=stops)
    return ImperfectDrive(seen=seen, robot=robot, faults=faults)


def _rolled(robot: Robot, w: WheelFaults, first: Array, dphi: Array, before: Array) -> tuple[Array, Array]:
    """Return how far each wheel rolls in each step (N, 2), m, and the way each turned last (2,)."""
    radius = np.array([robot.rR, robot.rL])
    start = first + np.concatenate([np.zeros((1, 2)), np.cumsum(dphi, axis=0)])
    turned = dphi.copy()
    way = np.sign(dphi)
    last = before.copy()
    for k in (0, 1):
        moving = np.flatnonzero(way[:, k])
        ways = np.concatenate([before[k : k + 1], way[moving, k]])
        for i in np.flatnonzero((ways[1:] != ways[:-1]) & (ways[:-1] != 0)):
            _take(turned[:, k], moving[i:], w.backlash)
        last[k] = ways[-1]
    cosine, sine = np.array(w.eccentric[0::2]), np.array(w.eccentric[1::2])
    u = radius * (turned + cosine * np.diff(np.sin(start), axis=0) - sine * np.diff(np.cos(start), axis=0))
    u = u * np.where(dphi < 0, 1 + w.backward, 1.0)
    outer = np.sign(np.abs(u[:, :1]) - np.abs(u[:, 1:])) * (1.0, -1.0)
    return u * (1 + w.outer / 2 * outer), last


def _take(turned: Array, rows: Ids, backlash: float) -> None:
    """Take dead travel off the first steps after a reversal."""
    for row in rows:
        if backlash <= 0:
            return
        lost = min(backlash, abs(turned[row]))
        turned[row] -= np.sign(turned[row]) * lost
        backlash -= lost


def _path(start: Array, travel: Array, b: float, w: WheelFaults, leg: int) -> Array:
    """Return the poses (N, 3) after each step."""
    if w.slipped is not None and w.slipped[0] == leg:
        travel = travel.copy()
        travel[len(travel) // 2] -= w.slipped[1:]
    distance, turn = travel.mean(axis=1), (travel[:, 0] - travel[:, 1]) / b
    left, right, spot = w.scrub
    bend = np.abs(distance) < 0.1 * np.abs(travel[:, 0] - travel[:, 1])
    turn = turn * (1 - np.where(turn > 0, left, right) - spot * bend)
    heading = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    if w.carried is not None and w.carried[0] == leg:
        heading[len(travel) // 2 :] += w.carried[3]
    middle = (heading[:-1] + heading[1:]) / 2
    chord, aside = distance * np.sinc(turn / 2 / np.pi), w.drift * np.abs(turn)
    step = np.stack(
        [chord * np.cos(middle) - aside * np.sin(middle), chord * np.sin(middle) + aside * np.cos(middle)], 1
    )
    if w.carried is not None and w.carried[0] == leg:
        c, s = np.cos(heading[len(travel) // 2]), np.sin(heading[len(travel) // 2])
        x, y = w.carried[1:3]
        step[len(travel) // 2] += (c * x - s * y, s * x + c * y)
    return np.concatenate([start[:2] + np.cumsum(step, axis=0), heading[1:, None]], axis=1)


def as_built(target: Target, box: BoxFaults) -> Target:
    """Return the landmarks where they really are."""
    design = box.other or target.box
    grid = design.grid_corners()
    count, n = design.tags_a_face, FACES * design.tags_a_face
    corners, faces = np.zeros((n, CORNERS, 3)), np.zeros(n, dtype=np.int64)
    place = np.zeros((FACES, 3)) if box.place is None else box.place
    pose = np.zeros((FACES, 6)) if box.pose is None else box.pose
    for f, sheet in enumerate(box.order):
        g = grid * box.scale
        g = -g if sheet in box.turned else g
        c, s = np.cos(place[f, 2]), np.sin(place[f, 2])
        g = g @ np.array([[c, s], [-s, c]]) + place[f, :2]
        out = box.bow[f] * (1 - (2 * g[..., 0] / design.face_width(f)) ** 2)
        p = np.concatenate([g, out[..., None]], axis=2)
        T = design.T_box_face(f) @ exp_se3(pose[f])
        rows = slice(sheet * count, (sheet + 1) * count)
        corners[rows], faces[rows] = p @ T[:3, :3].T + T[:3, 3], f
    return replace(target, tag_corners=corners, tag_faces=faces)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Motion:
    """Where the robot was (M, 3) at times (M,), ns; first and last row of each stop (P, 2); what the wheels read."""

    t_ns: Ids
    path: Array
    ends: Ids
    wheels: WheelSamples


def _stops(
    robot: Robot, target: Target, faults: Imperfections, motion: _Motion, rng: np.random.Generator
) -> tuple[StopObservation, ...]:
    t_ns, path, wheels = motion.t_ns, motion.path, motion.wheels
    built = as_built(target, faults.box)
    floor = rigid(exp_so3(np.array([*faults.tilt, 0.0])), np.zeros(3))
    T_floor_box = np.eye(4) if faults.box.standing is None else faults.box.standing
    out = []
    for j, (a, b) in enumerate(motion.ends):
        lean = rigid(exp_so3(np.array([*(faults.lean * rng.standard_normal(2)), 0.0])), np.zeros(3))
        T_body_cam = robot.T_body_cam
        if faults.camera.knocked is not None and j >= faults.camera.knocked[0]:
            T_body_cam = T_body_cam @ exp_se3(np.array(faults.camera.knocked[1]))
        if faults.box.moved is not None and j == faults.box.moved[0]:
            T_floor_box = planar(*faults.box.moved[1:]) @ T_floor_box
        when = t_ns[a] + (t_ns[b] - t_ns[a]) * np.arange(1, FRAMES + 1) / (FRAMES + 1)
        late = faults.camera.late + faults.camera.drift * (t_ns[a] - t_ns[0]) * 1e-9
        rows = np.clip(np.searchsorted(t_ns, when - late * 1e9), 0, len(path) - 1)
        views = [inverse(T_floor_box) @ floor @ planar(*path[k]) @ lean @ T_body_cam for k in rows]
        seen = _look(robot, built, (faults.camera, j), views, rng)
        if seen is None:
            continue
        first = int(np.searchsorted(wheels.t_ns, t_ns[a], side="left"))
        last = int(np.searchsorted(wheels.t_ns, t_ns[b], side="right")) - 1
        ids, uv, cov = seen
        out.append(
            StopObservation(
                t_start_ns=int(t_ns[a]),
                t_end_ns=int(t_ns[b]),
                first_sample=first,
                last_sample=last,
                phi_R=float(wheels.phi_R[first]),
                phi_L=float(wheels.phi_L[first]),
                landmark_ids=ids,
                p_box=target.p_box(ids),
                uv_px=uv,
                cov_px2=cov,
                frames=FRAMES,
            )
        )
    return tuple(out)


def _look(
    robot: Robot, built: Target, at: tuple[CameraFaults, int], views: list[Array], rng: np.random.Generator
) -> tuple[Ids, Array, Array] | None:
    """Return landmarks, pixels and their covariances, mean over the pictures of one stop; None if no tag is seen."""
    camera, stop = at
    values = np.array([*(getattr(robot.camera, n) for n in ("fu", "fv", "cu", "cv", "kr")), *camera.lens])
    scale, right, down = (1.0, 0.0, 0.0) if camera.focus is None or stop < camera.focus[0] else camera.focus[1:]
    scale *= 1 + camera.autofocus * rng.standard_normal()
    centre = (np.array(robot.image_size) - 1) / 2
    values[:2] *= scale
    values[2:4] = centre + scale * (values[2:4] - centre) + (right, down)
    tags = [set(decodable_tags(robot, built, T).tolist()) for T in views]
    ids = np.array(sorted(set.intersection(*tags)), dtype=np.int64)
    if not len(ids):
        return None
    p = built.tag_corners[np.searchsorted(built.tag_ids, ids)].reshape(-1, 3)
    frames = []
    for T in views:
        T_cam_box = inverse(T)
        frames.append(project_with_jacobians(CameraKind.BROWN, values, p @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])[0])
    uv = np.mean(frames, axis=0)
    motion = np.mean([(f - uv) ** 2 for f in frames], axis=(0, 2))
    tag = uv.reshape(-1, CORNERS, 2)
    outward = tag - tag.mean(axis=1, keepdims=True)
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    uv = uv + camera.noise * rng.standard_normal(uv.shape) + camera.shift * rng.standard_normal(2)
    uv = uv + camera.spread * rng.standard_normal() * outward.reshape(-1, 2)
    cov = np.eye(2) * (camera.noise**2 + motion)[:, None, None]
    return (CORNERS * ids[:, None] + np.arange(CORNERS)).ravel(), uv, cov


def hand_made(rng: np.random.Generator, *, lean: float = radians(0.05)) -> Imperfections:
    """Return what a careful user has: sheets and faces off by 0.3 mm and 0.15 deg, a bow of 0.3 mm, a real lens."""
    place = rng.standard_normal((FACES, 3)) * (3e-4, 3e-4, radians(0.1))
    pose = np.zeros((FACES, 6))
    pose[:, :2], pose[:, 5] = radians(0.15) * rng.standard_normal((FACES, 2)), 3e-4 * rng.standard_normal(FACES)
    k2, p1, p2 = rng.normal(0, 0.05), *rng.normal(0, 5e-4, 2)
    return Imperfections(
        wheels=WheelFaults(slip=3e-4),
        camera=CameraFaults(lens=(k2, p1, p2, 0.0), shift=0.01, spread=0.01),
        box=BoxFaults(
            scale=(1 + 7e-4 * rng.standard_normal(), 1 + 7e-4 * rng.standard_normal()),
            place=place,
            pose=pose,
            bow=tuple((3e-4 * rng.standard_normal(FACES)).tolist()),
        ),
        lean=lean,
        tilt=(radians(0.3) * rng.standard_normal(), radians(0.3) * rng.standard_normal()),
    )
