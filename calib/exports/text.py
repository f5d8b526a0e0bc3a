"""Numbers and names in files of other formats: exact, and harmless whatever a robot is called."""

import re
from collections.abc import Iterable
from zlib import crc32

from boxcal.calib.console.judgement import header_lines
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level
from boxcal.detect.log.safe_text import printable

MAX_ROS_NAME = 60
_YAML_WORDS = {"y", "n", "yes", "no", "true", "false", "on", "off", "null"}
_UNITS = {
    **dict.fromkeys(("fu", "fv", "cu", "cv"), "px"),
    **dict.fromkeys(("rR", "rL", "b", "tx", "ty", "tz"), "m"),
    **dict.fromkeys(("rx", "ry", "rz"), "rad"),
}


def number(value: float) -> str:
    """Return a float so that it reads back exactly, as a float, in YAML 1.1 (``1e-05`` would be a string there)."""
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return text if "." in mantissa or "n" in mantissa else f"{mantissa}.0{e}{exponent}"


def numbers(values: Iterable[float]) -> str:
    """Return ``[a, b, c]``, each as :func:`number` writes it."""
    return f"[{', '.join(number(v) for v in values)}]"


def ros_name(robot: str) -> str:
    """Return a robot's name as ROS accepts it: letters, digits and single underscores, a letter first.

    Of letters that ROS does not know a number is kept, so that two robots keep two names.
    """
    name = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9]", "_", robot))[:MAX_ROS_NAME].strip("_")
    if any(c.isalnum() and not c.isascii() for c in robot):  # what is lost tells robots apart
        name = f"{name[: MAX_ROS_NAME - 9] or 'robot'}_{crc32(robot.encode('utf-8', 'replace')):08x}"
    return name if name[:1].isalpha() else f"robot_{name}".rstrip("_")


def yaml_name(name: str) -> str:
    """Return a name of letters, digits and underscores as YAML 1.1 reads it: ``"False"`` or ``"no"`` in quotes."""
    return f'"{name}"' if name.lower() in _YAML_WORDS else name


def in_comment(text: str) -> str:
    """Return text that keeps to its line of a comment."""
    return printable(text)


def in_xml_comment(text: str) -> str:
    """Return text that neither ends an XML comment nor means anything to xacro."""
    plain = re.sub(r"[^A-Za-z0-9 _.:;,()/+='-]", "?", text)
    return re.sub(r"-(?=-)", "- ", plain).removesuffix("-")


def xml_comment(lines: Iterable[str]) -> str:
    """Return lines as an XML comment."""
    return "<!-- " + "\n     ".join(in_xml_comment(line) for line in lines) + " -->\n"


def heading(calibration: Calibration, what: str) -> list[str]:
    """Return the first lines of a file's comment: what it is, whose, where it came from, and whether it may be used."""
    p = calibration.provenance
    first = in_comment(calibration.robot) + f": {what}, by boxcal {in_comment(p.version)}, {in_comment(p.created)}"
    return [first, *(in_comment(line) for line in header_lines(calibration.verdict))]


def usage(calibration: Calibration, *lines: str) -> tuple[str, ...]:
    """Return lines on how a file is used; none for a result whose verdict forbids use."""
    forbidden = calibration.verdict is not None and calibration.verdict.level is Level.REDO
    return () if forbidden else lines


def sigma_line(calibration: Calibration, names: Iterable[str]) -> str:
    """Return a line with the standard deviations of some parameters, or that there are none."""
    if calibration.detail is None:
        return "standard deviations: not estimated"
    sigma = calibration.detail.covariance.sigma
    return "standard deviations: " + ", ".join(f"{n} {sigma[n]:.2g} {_UNITS.get(n, '')}".rstrip() for n in names)


def comment(lines: Iterable[str]) -> str:
    """Return lines as a ``#`` comment."""
    return "".join(f"# {line}\n" for line in lines)
