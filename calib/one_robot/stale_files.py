"""Files of a robot's folder that an earlier calibration left, of other settings or of cameras that are gone."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path

from boxcal.calib.exports.files import STALE_FILES
from boxcal.calib.results.json_format import CALIBRATION, load_calibration
from boxcal.calib.settings import CORRESPONDENCES
from boxcal.target.errors import BoxcalError

_PAIRS = ("opencv_stereo_*.yaml", "stereo_*/left.yaml", "stereo_*/right.yaml")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_OWN = (f"correspondences{CORRESPONDENCES}", CALIBRATION)


def stale_files(folder: Path, written: Collection[str], cameras: Collection[str]) -> Iterator[str]:
    """Yield the names of files in a robot's folder that are of no use any more.

    Parameters
    ----------
    folder
        The robot's.
    written
        Names of the files that are written now; in the folder of a camera that is gone, files of these names go too.
    cameras
        Names of the robot's further cameras.
    """
    yield from (name for name in STALE_FILES if name not in written)
    for pattern in _PAIRS:
        for path in sorted(folder.glob(pattern)):
            name = path.relative_to(folder).as_posix()
            if name not in written:
                yield name
    for gone in _cameras_before(folder) - set(cameras):
        if f"{gone}/{CALIBRATION}" in written or not (folder / gone).is_dir():
            continue
        ours = {name for name in (*written, *STALE_FILES, *_OWN) if "/" not in name}
        yield from (f"{gone}/{path.name}" for path in sorted((folder / gone).iterdir()) if path.name in ours)


def _cameras_before(folder: Path) -> set[str]:
    """Return the cameras that the calibration in a robot's folder gave folders of their own."""
    try:
        rig = load_calibration(folder / CALIBRATION).rig
    except BoxcalError:  # none is there yet, or none that can be read: nothing is known to be ours
        return set()
    return set() if rig is None else {name for name in rig.names[1:] if _NAME.fullmatch(name)}
