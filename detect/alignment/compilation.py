"""The detector's code compiled before it is needed: once on a computer, whatever number of processes ask for it.

    python -m boxcal.detect.alignment.compilation

compiles what is missing. The first process takes a lock, says what it does, and compiles with the help of a second one;
the others wait for it, and then read compiled code from the cache.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from boxcal.detect.alignment.backend import Backend, backend
from boxcal.detect.alignment.box_refinement import CAMERA
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.tag_batch import Batch, Frame
from boxcal.detect.alignment.tag_patterns import family_patterns

PATIENCE_S = 180.0
"""After so long a helper or another process that compiles is taken to have died."""
_SIZE = 32
"""Side of the picture that functions are compiled with, px; what it shows does not matter."""
_HALVES = ("first", "second")
_MODULE = "boxcal.detect.alignment.compilation"
Tell = Callable[[str], None]


def prepare(tell: Tell | None = None) -> None:
    """Have the detector's code compiled, unless it is already or cannot be kept; ``tell`` is told what takes long."""
    if backend().name == "numpy":
        return
    from boxcal.detect.alignment.numba.kernel import cache_folder  # noqa: PLC0415 - slow to import

    tell = tell or _silent
    folder = cache_folder()
    if folder is None:
        tell("compiling the detector in memory, as no folder for compiled code can be written (some 20 s each time)")
        return
    complete = folder / "complete"
    if complete.exists():
        return
    with _locked(folder / "lock", tell):
        if complete.exists():
            return
        tell("compiling the detector, once on this computer (some 10 s) ...")
        start = time.monotonic()
        helper = subprocess.Popen([sys.executable, "-P", "-m", _MODULE, _HALVES[1]])  # noqa: S603 - this module
        compile_half(_HALVES[0])
        try:
            helper.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            helper.kill()
        for half in _HALVES:
            compile_half(half)
        complete.touch()
        tell(f"compiled in {time.monotonic() - start:.0f} s")


def compile_half(which: str) -> None:
    """Compile one half of the functions by calling them, or both if it is ``all``; the halves take equally long."""
    compute = backend()
    if which != _HALVES[1]:
        _box(compute)
    if which != _HALVES[0]:
        _pixels()
    if which != _HALVES[1]:
        _alignment()
    if which != _HALVES[0]:
        _variance(compute)


def _box(compute: Backend) -> None:
    points, uv = np.random.default_rng(1).uniform(1, 2, (4, 3)), np.zeros((4, 2))
    lens = no_distortion((_SIZE, _SIZE))
    start = (30.0, lens, np.eye(4))
    compute.levenberg_marquardt(points, uv, start, np.ones(CAMERA), np.zeros(CAMERA), 1.0, 1.0)
    compute.predict(points, 30.0, lens, np.eye(4), np.eye(CAMERA + 6))


def _batch() -> Batch:
    frame = Frame(
        grey=np.zeros((_SIZE, _SIZE), np.float32), response=np.array([0.0, 1.0]), lens=no_distortion((_SIZE, _SIZE))
    )
    return Batch(
        frame=frame,
        cells=family_patterns("DICT_APRILTAG_36h11", np.arange(1)).cells,
        rows=np.zeros(1, dtype=np.int64),
        theta=np.eye(1, 14),
        normalisation=np.ones((1, 3)),
        bounding_boxes=np.array([[0, 2, 0, 2]]),
        margin=np.ones(1),
        stride=np.ones((1, 3), dtype=np.int64),
    )


def _pixels() -> None:
    from boxcal.detect.alignment.numba import image_model, pixels  # noqa: PLC0415 - slow to import

    arrays = _batch().arrays()
    room = pixels.room(arrays.bounding_boxes[0])
    image_model.differentiate(arrays, 0, room, 0, np.zeros(6))
    pixels.collect(arrays, 0, room)


def _alignment() -> None:
    patterns = family_patterns("DICT_APRILTAG_36h11", np.arange(1))
    corners = np.array([[[4.0, 4], [20, 4], [20, 20], [4, 20]]])
    align(_batch().frame, patterns, np.zeros(1, dtype=np.int64), corners)


def _variance(compute: Backend) -> None:
    patterns = family_patterns("DICT_APRILTAG_36h11", np.arange(1))
    corners = np.array([[[4.0, 4], [20, 4], [20, 20], [4, 20]]])
    batch = _batch()
    tags = align(batch.frame, patterns, batch.rows, corners, iterations=0)
    compute.cluster_sums(batch, tags, np.full(1, 8))
    compute.block_motion(batch, np.ones(1))
    compute.accumulate(batch)


@contextmanager
def _locked(path: Path, tell: Tell) -> Iterator[None]:
    """Hold a file locked; where another process holds it, wait. Systems without such locks go ahead without."""
    try:
        import fcntl  # noqa: PLC0415 - there is none on Windows
    except ImportError:
        yield
        return
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            tell("waiting for another process that compiles the detector ...")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _silent(_: str) -> None:
    return


if __name__ == "__main__":
    if len(sys.argv) > 1:
        compile_half(sys.argv[1])
    else:
        prepare(print)
