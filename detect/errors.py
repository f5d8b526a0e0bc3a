"""Errors of the detect package."""


class DetectError(ValueError):
    """A log, an image or a correspondence file that cannot be used.

    The message says which input, what was found, what was needed and what to do.
    """
