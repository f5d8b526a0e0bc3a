"""Times of a recording's frames on the wheels' clock."""

import numpy as np

from boxcal.detect.log.clocks import offset_by_recording, usable_stamps, without_jumps
from boxcal.detect.log.images import ImageSeries
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.wheel_assembly import AssembledWheels
from boxcal.target.arrays import Ids


def frame_times(images: ImageSeries, wheels: AssembledWheels, camera: str) -> tuple[Ids, Ids, int, tuple[str, ...]]:
    """Return the frames' times on the wheels' clock, their numbers, the offset taken away, and what was done."""
    stamps, log_ns = np.array(images.t_ns, dtype=np.int64), np.array(images.log_ns, dtype=np.int64)
    times = usable_stamps(stamps, log_ns, f"the images in {printable(camera)}")
    kept = np.flatnonzero(times.t_ns != 0) if np.any(times.t_ns != 0) else np.arange(stamps.size)
    notes = [times.note] if times.note else []
    if len(kept) < stamps.size:
        notes.append(f"{stamps.size - len(kept)} images without stamps were left out")
    t_kept = times.t_ns[kept]
    if not times.note:
        t_kept, jumps = without_jumps(t_kept, log_ns[kept], (wheels.stamp_ns, wheels.log_ns))
        notes += [
            f"the camera's clock jumps by {jump.later_s:+.1f} s against the times of recording, "
            f"{(jump.at_ns - log_ns[0]) / 1e9:.0f} s after the first image; its stamps were put right by that"
            for jump in jumps
        ]
    t_ns, first = np.unique(t_kept, return_index=True)
    numbers = kept[first]
    offset = 0
    if not times.note:
        offset = offset_by_recording(t_ns, log_ns[numbers], wheels.stamp_ns, wheels.log_ns)
    if offset:
        notes.append(
            f"the camera's clock is {abs(offset) / 1e9:.1f} s {'ahead of' if offset > 0 else 'behind'} the wheels' (by "
            "the times of recording); its stamps were put right by that"
        )
    return t_ns - offset, numbers, offset, tuple(notes)
