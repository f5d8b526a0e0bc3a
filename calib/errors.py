"""Errors of the calib package."""


class CalibError(ValueError):
    """A drive that does not determine the calibration, or a result that cannot be read.

    The message says what was found, what was needed and what to do.
    """
