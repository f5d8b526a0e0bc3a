"""Errors of the target package."""


class TargetError(ValueError):
    """A box, a target file or a sheet that cannot be made or read.

    The message says which input, what was found, what was needed and what to do.
    """
