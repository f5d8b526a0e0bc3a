"""The compiled code made before it is needed: once on a computer, whatever number of processes ask for it.

    python -m boxcal.detect.alignment.compilation

compiles what is missing. The first process takes a lock, says what it does, and compiles with the help of a second one;
the others wait for it, and then read compiled code from the cache. The two share the detector's code so that nothing
large is compiled in both: what sums over pixels in one, the rest in the other. Code of other modules, which a robot
needs only once its pictures have been looked at, the second process compiles while the first goes on.
"""

import atexit
import gc
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import numpy as np

from boxcal.detect.alignment.backend import Backend, backend
from boxcal.detect.alignment.box_refinement import CAMERA
from boxcal.detect.alignment.radial_camera import no_distortion
from boxcal.detect.alignment.registration.image_model import no_sums
from boxcal.detect.alignment.registration.sandwich_sums import no_part_sums
from boxcal.detect.alignment.registration.tag_batch import Batch, Frame
from boxcal.detect.alignment.tag_patterns import family_patterns

PATIENCE_S = 180.0
"""After so long a helper or another process that compiles is taken to have died."""
_SIZE = 32
"""Side of the picture that functions are compiled with, px; what it shows does not matter."""
_HALVES = ("first", "second")
PASSING = ("lock", "second")
"""Names of files that matter only while code is compiled."""
_MODULE = "boxcal.detect.alignment.compilation"
Tell = Callable[[str], None]


def prepare(tell: Tell | None = None, further: Sequence[str] = ()) -> None:
    """Have the detector's compiled code made, unless it is already or cannot be kept.

    Parameters
    ----------
    tell
        Told what takes long.
    further
        Modules with code of their own, each with ``compile_all()`` and ``cache_folder()``. Where the detector's code is
        made, the same process as makes half of that goes on with theirs; :func:`finish` waits for it.
    """
    if backend().name == "numpy":
        return
    tell, folder = tell or _silent, detector_folder()
    if folder is None:
        tell("compiling in memory, as no folder for compiled code can be written (some 10 s each time)")
        return
    if _complete(folder).exists():
        return
    with _locked(folder / PASSING[0], tell):
        if _complete(folder).exists():
            return
        tell("compiling, once on this computer (some 10 s) ...")
        start = time.monotonic()
        _second(folder).unlink(missing_ok=True)
        helper = _helper(further)
        try:
            with _no_collector():
                compile_half(_HALVES[0])
                _wait_for(_second(folder), helper)
                compile_half(_HALVES[1])
        except BaseException:
            _end(helper)
            raise
        _complete(folder).touch()
        tell(f"compiled in {time.monotonic() - start:.0f} s")


def finish(module: str) -> None:
    """Have a module's own code compiled: wait for who does so, or do it, unless it is already or cannot be kept."""
    folder: Path | None = import_module(module).cache_folder()
    if folder is None or _complete(folder).exists():
        return
    with _locked(folder / PASSING[0], _silent):
        if not _complete(folder).exists():
            with _no_collector():
                import_module(module).compile_all()
            _complete(folder).touch()


def _help(further: Sequence[str]) -> None:
    """Compile the detector's second half, say so by a file, and go on with other modules' code."""
    folder = detector_folder()
    with _no_collector():
        compile_half(_HALVES[1])
    if folder is not None:
        _second(folder).touch()
    for module in further:
        finish(module)


def _helper(further: Sequence[str]) -> subprocess.Popen[bytes]:
    """Return a process that helps, which Ctrl-C does not reach: it is ended with this one."""
    words = [sys.executable, "-P", "-m", _MODULE, _HALVES[1], *further]
    none = subprocess.DEVNULL
    helper = subprocess.Popen(words, stdin=none, stdout=none, stderr=none, process_group=0)  # noqa: S603 - this module
    atexit.register(_end, helper)
    return helper


def _end(helper: subprocess.Popen[bytes]) -> None:
    helper.kill()
    helper.wait()


def _wait_for(path: Path, helper: subprocess.Popen[bytes]) -> None:
    """Wait until a file is there, or it is clear that it will not be."""
    limit = time.monotonic() + PATIENCE_S
    while not path.exists() and helper.poll() is None and time.monotonic() < limit:
        time.sleep(0.02)


@contextmanager
def _no_collector() -> Iterator[None]:
    """Leave cyclic garbage alone meanwhile: looking for it takes an eighth of the time of compiling."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def detector_folder() -> Path | None:
    """Return the folder for the detector's compiled code; None if no place can be written."""
    from boxcal.detect.alignment.numba.kernel import cache_folder  # noqa: PLC0415 - slow to import

    return cache_folder()


def _second(folder: Path) -> Path:
    return folder / PASSING[1]


def _complete(folder: Path) -> Path:
    from boxcal.detect.alignment.numba.kernel import COMPLETE  # noqa: PLC0415 - slow to import

    return folder / COMPLETE


def compile_half(which: str) -> None:
    """Compile one half of the functions by calling them, or both if it is ``all``; the halves take equally long."""
    compute = backend()
    if which != _HALVES[1]:
        _pixels(compute)
    if which != _HALVES[0]:
        _outlines(compute)
        _box(compute)
        _begin(compute)
        _corners(compute)
        _shapes(compute)
        _sandwich(compute)


def _outlines(compute: Backend) -> None:
    compute.four_sided(np.zeros((_SIZE, _SIZE), np.uint8), 1, _SIZE)


def _box(compute: Backend) -> None:
    points, uv = np.random.default_rng(1).uniform(1, 2, (4, 3)), np.zeros((4, 2))
    lens = no_distortion((_SIZE, _SIZE))
    start = (30.0, lens, np.eye(4))
    compute.levenberg_marquardt(points, uv, start, np.ones(CAMERA), np.zeros(CAMERA), 1.0, 1.0)
    compute.predict(points, 30.0, lens, np.eye(4), np.eye(CAMERA + 6))


def _shapes(compute: Backend) -> None:
    corners = np.zeros((1, 4, 2))
    compute.widths(corners)
    compute.least_squares_homography(corners[0], corners[0])
    compute.undistort_locally(no_distortion((_SIZE, _SIZE)), np.ones((1, 3)), corners)


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
        near=np.ones(1),
    )


def _pixels(compute: Backend) -> None:
    compute.accumulate(_batch())


def _begin(compute: Backend) -> None:
    patterns = family_patterns("DICT_APRILTAG_36h11", np.arange(1))
    compute.begin(_batch().frame, patterns, np.zeros((1, 4, 2)), None, 1.0)


def _corners(compute: Backend) -> None:
    batch = _batch()
    compute.finish(
        batch.frame,
        family_patterns("DICT_APRILTAG_36h11", np.arange(1)),
        theta=batch.theta,
        normalisation=batch.normalisation,
        sums=no_sums(1, batch.cells),
        covariance=True,
    )


def _sandwich(compute: Backend) -> None:
    batch = _batch()
    parts = no_part_sums(np.ones(1, dtype=np.bool_), batch.bounding_boxes)
    compute.sandwich_sums(batch, parts, np.zeros((1, 4, 2)), np.ones(1))


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
            tell("waiting for another process that compiles ...")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _silent(_: str) -> None:
    return


if __name__ == "__main__":
    if len(sys.argv) > 1:
        _help(sys.argv[2:])
    else:
        prepare(print)
