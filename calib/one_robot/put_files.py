"""Files of a robot put into its folder, together."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from boxcal.calib.one_robot.stale_files import stale_files
from boxcal.calib.results.json_format import CALIBRATION
from boxcal.target.files.atomic_write import write_together


def put_files(folder: Path, files: Mapping[str, bytes], cameras: Sequence[str] = ()) -> None:
    """Write a robot's files to its folder, ``calibration.json`` last; remove those that other settings gave.

    ``cameras`` are those of the robot that have folders of their own.
    """
    ordered = {name: files[name] for name in sorted(files, key=lambda name: name == CALIBRATION)}
    write_together(folder, ordered, stale=list(stale_files(folder, files, cameras)))
    (folder / "static_transform.sh").chmod(0o755)
