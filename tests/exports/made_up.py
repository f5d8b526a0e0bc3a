"""Made-up calibrations: one by hand, and random ones."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from boxcal.calib.geometry.diff_drive import Wheels
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood.estimate import NoiseLevels
from boxcal.calib.results.calibration import Calibration, Provenance, Quality, StopResult
from boxcal.calib.results.diagnostics import Covariance, Detail, Ground
from boxcal.calib.results.rig import Rig, RigCamera
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel

SIGMA = np.array([0.5, 0.5, 0.4, 0.4, 1e-3, 2e-6, 2e-6, 2e-5, 3e-4, 3e-4, 3e-4, 2e-4, 2e-4, 2e-4])
EVIL = "<script>alert(1)</script>/../../x\n--> \"'; rm -rf ~ # ${1+1} =1+1"


def calibration(**changes: Any) -> Calibration:
    """A calibration of a robot whose camera looks ahead and 10 deg down."""
    R = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]) @ exp_so3(np.array([0.17, 0.02, -0.01]))
    made = Calibration(
        robot="r01",
        image_size=(640, 480),
        camera=camera(),
        wheels=Wheels(rR=0.03301, rL=0.03297, b=0.1602),
        T_body_cam=rigid(R, np.array([0.051, -0.002, 0.118])),
        quality=Quality(
            stops=1,
            landmarks=140,
            reprojection_rms_px=0.08,
            heading_rms_rad=1e-3,
            sigma5_sigma4=1e-3,
            sigma4_sigma3=0.7,
            up_error_rad=1e-3,
        ),
        stops=(
            StopResult(
                t_start_ns=1_000_000_000,
                t_end_ns=3_000_000_000,
                landmarks=140,
                reprojection_rms_px=0.08,
                T_box_cam=rigid(R, np.array([-0.7, 0.0, 0.118])),
            ),
        ),
        notes=("all well",),
        provenance=Provenance(version="0.1.0", command="fleet-calibrate r01.mcap", created="2026-01-02T03:04:05+00:00"),
    )
    return replace(made, **changes)


def camera(kind: str = "radial", **further: float) -> CameraModel:
    """The camera of :func:`calibration`, or one like it of another kind."""
    return CameraModel(fu=600.25, fv=601.5, cu=320.125, cv=238.75, kr=-0.0875, kind=CameraKind(kind), **further)


def detail(sigma: Array = SIGMA) -> Detail:
    """What the likelihood adds, with a covariance whose neighbours correlate by 0.5."""
    correlation = 0.5 ** np.abs(np.subtract.outer(np.arange(len(ORDER)), np.arange(len(ORDER))))
    return Detail(
        covariance=Covariance(matrix=correlation * np.outer(sigma, sigma)),
        noise=NoiseLevels(
            pixel_factor=1.0, pixel_factor_sigma=0.1, pixel_px=0.1, slip=1e-3, slip_sigma=1e-4, encoder_step=0.0
        ),
        extra={},
        extra_sigma={},
        legs=(),
        flagged_legs=(),
        flagged_corners=(),
        directions=(),
        ground=Ground(
            straight_heading=0.01,
            straight_position=0.05,
            turn_heading=0.002,
            distance=1.0,
            projection_mean_px=0.3,
            projection_worst_px=0.6,
        ),
    )


def with_cameras(**others: tuple[Array, CameraModel]) -> Calibration:
    """The calibration of one robot whose first camera is called left, each camera as sure as the first."""
    made = calibration(detail=detail())
    every = {"left": (made.T_body_cam, made.camera), **others}
    cameras = tuple(
        RigCamera(
            name=name,
            topic=f"/{name}/image_raw",
            frame=f"{name}_optical_frame",
            image_size=made.image_size,
            camera=model,
            T_body_cam=T,
            stops=9,
            reprojection_rms_px=0.1,
            landmarks=900,
            verdict="good",
            covariance=detail().covariance,
        )
        for name, (T, model) in every.items()
    )
    return replace(made, rig=Rig(cameras=cameras, covariance=1e-8 * np.eye(6 * len(cameras))))


def _floats(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


_ROTATIONS = st.one_of(
    st.tuples(_floats(-3, 3), _floats(-3, 3), _floats(-3, 3)).map(lambda w: exp_so3(np.array(w))),
    # the camera's view or one of its axes exactly along an axis of the body, also straight up and down
    st.sampled_from([np.roll(np.diag(s), k, 0) for k in range(3) for s in ([1.0, 1, 1], [1.0, -1, -1], [-1.0, -1, 1])]),
)
RANDOM = st.builds(
    lambda robot, camera, wheels, R, t, size, made, notes: calibration(
        robot=robot,
        camera=CameraModel(fu=camera[0], fv=camera[1], cu=camera[2], cv=camera[3], kr=camera[4]),
        wheels=Wheels(rR=wheels[0], rL=wheels[1], b=wheels[2]),
        T_body_cam=rigid(R, np.array(t)),
        image_size=size,
        detail=made,
        notes=notes,
    ),
    robot=st.one_of(st.text(max_size=30), st.just(EVIL), st.just("r01")),
    camera=st.tuples(_floats(1e-3, 1e5), _floats(1, 1e5), _floats(-1e4, 1e4), _floats(-1e4, 1e4), _floats(-2, 2)),
    wheels=st.tuples(_floats(1e-4, 1), _floats(1e-4, 1), _floats(1e-4, 10)),
    R=_ROTATIONS,
    t=st.tuples(*[_floats(-2, 2)] * 3),
    size=st.tuples(st.integers(1, 10_000), st.integers(1, 10_000)),
    made=st.sampled_from([None, detail(), detail(np.where(np.arange(14) == 5, np.inf, SIGMA))]),
    notes=st.lists(st.text(max_size=20), max_size=2).map(tuple),
)
"""Random calibrations: any name, any notes, cameras that look anywhere."""


def matrix_of(xyz: Array, q: Array) -> Array:
    """(4, 4) of a translation and a quaternion x, y, z, w: written out, independent of the exporter's library."""
    x, y, z, w = q
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return rigid(np.array(R), np.asarray(xyz))
