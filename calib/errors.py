"""Errors of the calib package."""

from boxcal.target.errors import BoxcalError


class CalibError(BoxcalError):
    """A drive that does not determine the calibration, or a result that cannot be read."""
