"""Quantities of a robot that are watched over time, as sessions have them: relative lengths, turns, shifts."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import log_so3
from boxcal.calib.history.session import Session
from boxcal.target.arrays import Array

YEAR_NS = 365.25 * 86_400e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One quantity over time.

    Attributes
    ----------
    key, name, unit
        As it is called and shown.
    scale
        What makes its unit of radians, metres, pixels or a relative change.
    group
        Part of the robot: what changes together.
    wears
        Whether a slow drift is to be expected of it.
    watched
        Whether changes of it are looked for; of both radii the mean and the difference are.
    """

    key: str
    name: str
    unit: str
    scale: float
    group: str
    wears: bool = False
    watched: bool = True


WHEELS, EXTRINSICS, CAMERA = "wheels", "camera extrinsics", "camera"
GROUPS = (WHEELS, EXTRINSICS, CAMERA)
_DEG = degrees(1.0)
CHANNELS = (
    Channel(key="r", name="wheel radii", unit="%", scale=100, group=WHEELS, wears=True),
    Channel(key="d", name="left radius over right", unit="%", scale=100, group=WHEELS, wears=True),
    Channel(key="b", name="wheel separation", unit="%", scale=100, group=WHEELS),
    Channel(key="rx", name="camera's pitch", unit="°", scale=_DEG, group=EXTRINSICS),
    Channel(key="ry", name="camera's yaw", unit="°", scale=_DEG, group=EXTRINSICS),
    Channel(key="rz", name="camera's roll", unit="°", scale=_DEG, group=EXTRINSICS),
    Channel(key="tx", name="camera forward", unit="mm", scale=1e3, group=EXTRINSICS),
    Channel(key="ty", name="camera to the left", unit="mm", scale=1e3, group=EXTRINSICS),
    Channel(key="tz", name="camera's height", unit="mm", scale=1e3, group=EXTRINSICS),
    Channel(key="f", name="focal length", unit="%", scale=100, group=CAMERA),
    Channel(key="cu", name="principal point across", unit="px", scale=1, group=CAMERA),
    Channel(key="cv", name="principal point down", unit="px", scale=1, group=CAMERA),
    Channel(key="rL", name="left radius", unit="%", scale=100, group=WHEELS, wears=True, watched=False),
    Channel(key="rR", name="right radius", unit="%", scale=100, group=WHEELS, wears=True, watched=False),
)
KEYS = tuple(c.key for c in CHANNELS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """The sessions of one robot by channel, in the order of time.

    Attributes
    ----------
    robot
        Its name.
    years : (n,)
        When each was driven, in years since 1970.
    values : (n, J)
        Change since the first session: relative of lengths, rad, m or px, in the order of ``CHANNELS``.
    variances : (n, J)
        What each calibration claims; infinite where it does not say, or is of another camera model.
    """

    robot: str
    years: Array
    values: Array
    variances: Array


def series_of(sessions: Sequence[Session]) -> Series:
    """Return one robot's sessions as a series; those that do not count carry no information.

    Turns are the logarithm of the rotation since the first session, about the camera's own axes, in which covariances
    are given too. Cameras are compared within the kind and image size that most sessions have.
    """
    ordered = sorted(sessions, key=lambda s: (s.t_ns, s.key))
    first = next((s for s in ordered if s.counts), ordered[0])
    kinds = [(s.camera_kind, s.image_size) for s in ordered if s.counts]
    usual = max(dict.fromkeys(kinds), key=kinds.count) if kinds else None
    values, variances = [], []
    for s in ordered:
        values.append(_change(s, first))
        own = _variances(s) if s.counts else np.full(len(CHANNELS), np.inf)
        if (s.camera_kind, s.image_size) != usual:
            own[[c.group == CAMERA for c in CHANNELS]] = np.inf
        variances.append(own)
    return Series(
        robot=first.robot,
        years=np.array([s.t_ns / YEAR_NS for s in ordered]),
        values=np.array(values),
        variances=np.array(variances),
    )


def _change(s: Session, first: Session) -> Array:
    right, left, apart = np.log(s.wheels / first.wheels)
    turned = log_so3(first.T_body_cam[:3, :3].T @ s.T_body_cam[:3, :3])
    shift = s.T_body_cam[:3, 3] - first.T_body_cam[:3, 3]
    focal = float(np.mean(np.log(s.camera[:2] / first.camera[:2])))
    centre = s.camera[2:4] - first.camera[2:4]
    return np.array([(right + left) / 2, left - right, apart, *turned, *shift, focal, *centre, left, right])


def _variances(s: Session) -> Array:
    """Return the channels' variances, (J,); infinite where a parameter in it is not determined."""
    at = {name: k for k, name in enumerate(ORDER)}
    A = np.zeros((len(CHANNELS), len(ORDER)))
    right, left, apart = 1 / s.wheels
    for row, entries in enumerate(
        (
            {"rR": right / 2, "rL": left / 2},
            {"rR": -right, "rL": left},
            {"b": apart},
            *({name: 1.0} for name in ("rx", "ry", "rz", "tx", "ty", "tz")),
            {"fu": 0.5 / s.camera[0], "fv": 0.5 / s.camera[1]},
            {"cu": 1.0},
            {"cv": 1.0},
            {"rL": left},
            {"rR": right},
        )
    ):
        for name, factor in entries.items():
            A[row, at[name]] = factor
    unknown = ~np.isfinite(np.diag(s.covariance)) | (np.diag(s.covariance) < 0)
    cov = np.where(unknown[:, None] | unknown[None, :], 0.0, s.covariance)
    out = np.einsum("ij,jk,ik->i", A, np.nan_to_num(cov), A)
    out[np.any((A != 0) & unknown, axis=1)] = np.inf
    return np.asarray(np.where(out >= 0, out, np.inf))
