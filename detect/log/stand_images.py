"""Images of the times at which a robot stood, fetched from a recording of which only some is read."""

import numpy as np

from boxcal.detect.log.clocks import LEAST_OFFSET_S
from boxcal.detect.log.containers.mcap_indexed import IndexedMcap
from boxcal.detect.log.frame_cache import FrameCache
from boxcal.detect.log.scan import Scan
from boxcal.detect.log.wheel_assembly import AssembledWheels
from boxcal.detect.stops import find_stops
from boxcal.target.arrays import Ids

_BEFORE_NS, _BEHIND_NS = 300_000_000, 1_000_000_000
"""Images are recorded this soon before, and this long behind, what the wheels say of the same moment,"""
_AROUND_NS = 150_000_000
"""and where both clocks agree within this of the usual."""
_EVER_NS = (1 << 63) - 1


def fetch_images(
    scan: Scan, container: IndexedMcap, camera: str, wheels: AssembledWheels, *, all_of_them: bool
) -> None:
    """Take the images that were recorded while the robot stood; of a video, or if wanted, all."""
    images = scan.images_of(camera)
    late = _lateness(wheels.stamp_ns, wheels.log_ns)
    own = _lateness(np.array(images.t_ns, dtype=np.int64), np.array(images.log_ns, dtype=np.int64))
    before, behind = late - _BEFORE_NS, late + _BEHIND_NS
    if abs(own - late) < LEAST_OFFSET_S * 1e9:
        before, behind = own - _AROUND_NS, own + _AROUND_NS
    stands = [(s.t_start_ns + before, s.t_end_ns + behind) for s in find_stops(wheels.wheels)]
    if images.is_video or all_of_them:
        stands = [(0, _EVER_NS)]
    for piece in container.batches_at(camera, np.array(stands, dtype=np.int64).reshape(-1, 2)):
        scan.take([batch for batch in piece if batch.channel.topic == camera])
    images.sort()
    scan.cache.close()  # what was kept is numbered as it came
    scan.cache = FrameCache()


def _lateness(stamp_ns: Ids, log_ns: Ids) -> int:
    """Return how long after their stamps messages were recorded, ns; 0 of none, and of those without stamps."""
    return int(np.median(log_ns - stamp_ns)) if stamp_ns.size and np.median(stamp_ns) else 0
