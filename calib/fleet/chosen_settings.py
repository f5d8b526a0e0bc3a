"""Settings of a run as the options of ``fleet-calibrate`` ask for them."""

from argparse import Namespace
from math import radians

from boxcal.calib.exports.nominal import load_nominal
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.likelihood import CameraKind
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.settings import Settings
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
from boxcal.target.box import Target


def chosen_settings(args: Namespace, target: Target, *, report: bool) -> Settings:
    """Return the settings: options in SI units, what was not given left to the data.

    Parameters
    ----------
    args
        As :func:`boxcal.calib.fleet.options.options` parses them.
    target
        The box; a prior of its faces' angles follows from its size.
    report
        Whether reports are written.

    Raises
    ------
    CalibError
        If the file of ``--nominal`` cannot be used.
    """
    half_face = max(target.box.width, target.box.depth) / 2
    face = None if args.face_prior_mm is None else args.face_prior_mm * 1e-3
    return Settings(
        topics=chosen_topics(args),
        cameras=tuple(named) if len(named := _cameras_named(args)) > 1 else (),
        all_cameras=args.all_cameras,
        wheel_units=chosen_units(args),
        bits=args.bits,
        camera_mode=CameraMode.PER_STOP if args.per_stop else CameraMode.JOINT,
        closed_form=args.closed_form,
        validate=args.validate,
        lens=None if args.lens == "auto" else CameraKind(args.lens),
        tilt_prior=radians(args.tilt_prior_deg),
        ink_prior=args.ink_prior_mm * 1e-3,
        rigid_floor=args.floor == "rigid",
        scale_prior=None if args.scale_prior_percent is None else args.scale_prior_percent * 1e-2,
        size_prior=args.size_prior_mm * 1e-3,
        face_prior=None if face is None else (face / half_face, face),
        bow_prior=None if args.bow_prior_mm is None else args.bow_prior_mm * 1e-3,
        encoder_step=None if args.encoder_step_deg is None else radians(args.encoder_step_deg),
        moving=Moving(args.moving),
        slip=None if args.slip_mm is None else args.slip_mm * 1e-3,
        report=report,
        draw=args.draw,
        base_frame=args.base_frame,
        camera_frame=args.camera_frame,
        prefix=args.prefix or "",
        controller=args.controller,
        nominal=load_nominal(args.nominal) if args.nominal else None,
        rerun=args.rerun,
        results_mcap=args.results_mcap,
        hardware=args.hardware,
    )


def chosen_topics(args: Namespace) -> Topics:
    """Return where images and wheels are, as :func:`boxcal.calib.fleet.options.topic_options` has it."""
    return Topics(
        camera_topic=named[0] if len(named := _cameras_named(args)) == 1 else None,
        joint_topic=args.joint_topic,
        left_joint=args.left_joint,
        right_joint=args.right_joint,
    )


def _cameras_named(args: Namespace) -> list[str]:
    """Return the cameras' topics that were given, each once."""
    given = args.camera_topic or []
    return list(dict.fromkeys([given] if isinstance(given, str) else given))


def chosen_units(args: Namespace) -> WheelUnits:
    """Return what wheel readings mean, likewise."""
    return WheelUnits(
        unit=JointUnit(args.joint_unit),
        ticks_per_turn=args.ticks_per_turn,
        reverse_left=args.reverse_left,
        reverse_right=args.reverse_right,
    )
