"""Calibrate every robot's camera, wheels and camera extrinsics from one AprilTag box and the robot's log."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str

__all__ = ["__version__"]


def __getattr__(name: str) -> object:
    """Return what is looked up on first use, so that ``import boxcal`` is instant (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("boxcal")
        except PackageNotFoundError:
            return "0 (not installed)"
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
