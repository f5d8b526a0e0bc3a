"""Cameras of a robot as files for other programs take them: each as a calibration of its own, under its own names."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.exports.names import Names, valid_frame, valid_topic
from boxcal.calib.results.calibration import Calibration


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedCamera:
    """One camera of a robot with its names.

    Attributes
    ----------
    name
        Of the camera; empty for the only one.
    calibration
        The robot's, with this camera.
    names
        Of its frames and topic.
    """

    name: str
    calibration: Calibration
    names: Names


def named_cameras(calibration: Calibration, names: Names | None = None) -> Sequence[NamedCamera]:
    """Return the cameras of a robot, the calibration's own first; no two have the same frames.

    A calibration of another camera than the robot's first stands for that one alone.

    Parameters
    ----------
    calibration
        The robot's.
    names
        Of its first camera; frames and topics of the others are their logs' own.
    """
    names, rig = names or Names(), calibration.rig
    if rig is None or len(rig.cameras) == 1 or not np.array_equal(rig.cameras[0].T_body_cam, calibration.T_body_cam):
        return [NamedCamera(name="", calibration=calibration, names=names)]
    found = [NamedCamera(name=rig.names[0], calibration=calibration, names=names)]
    for camera in rig.cameras[1:]:
        usual = f"{camera.name}_optical_frame"
        frame = names.prefix + valid_frame(camera.frame.lstrip("/"), usual).removeprefix(names.prefix)
        own = replace(names, optical=frame, topic=valid_topic(camera.topic, f"/{camera.name}/image_raw"))
        if any(own.optical == other.names.optical or own.link == other.names.link for other in found):
            own = replace(own, optical=names.prefix + usual)
        of_it = replace(
            calibration,
            robot=f"{calibration.robot}/{camera.name}",
            camera=camera.camera,
            image_size=camera.image_size,
            T_body_cam=camera.T_body_cam,
        )
        found.append(NamedCamera(name=camera.name, calibration=of_it, names=own))
    return found
