"""Cameras of a robot as its report lists them."""

from dataclasses import dataclass

import numpy as np

from boxcal.calib.results.calibration import Calibration


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraRow:
    """One camera of a robot.

    Attributes
    ----------
    name, topic, model, image, stops, rms
        As text.
    link
        Relative address of its own report; empty for the one that the page is about.
    """

    name: str
    topic: str
    model: str
    image: str
    stops: str
    rms: str
    link: str


def camera_rows(calibration: Calibration) -> list[CameraRow]:
    """Return a row a camera; none for a robot with one."""
    rig = calibration.rig
    if rig is None or len(rig.cameras) == 1:
        return []
    here = next((c.name for c in rig.cameras if np.array_equal(c.T_body_cam, calibration.T_body_cam)), "")
    first = rig.names[0]
    links = {name: f"{name}/report.html" if here == first else f"../{name}/report.html" for name in rig.names}
    links |= {first: "../report.html"} | {here: ""}
    return [
        CameraRow(
            name=c.name,
            topic=c.topic,
            model=str(c.camera.kind),
            image=f"{c.image_size[0]} x {c.image_size[1]} px",
            stops=str(c.stops),
            rms=f"{c.reprojection_rms_px:.3f} px",
            link=links[c.name],
        )
        for c in rig.cameras
    ]
