"""Errors of the detect package."""

from boxcal.target.errors import BoxcalError


class DetectError(BoxcalError):
    """A log, or images in it, that cannot be used."""
