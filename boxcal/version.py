"""The version that is installed."""

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """Return the version of the installed boxcal, or ``not installed`` where it runs from its sources alone."""
    try:
        return version("boxcal")
    except PackageNotFoundError:
        return "not installed"
