"""Names of a robot's cameras, made of their topics: of folders, frames and links."""

import re
from collections.abc import Sequence

from boxcal.detect.log.topics import without_transport

_PICTURES = re.compile(r"(image|img|picture|video|frame)[a-z0-9_]*", re.IGNORECASE)
_LONGEST = 40


def camera_names(topics: Sequence[str]) -> tuple[str, ...]:
    """Return a name for each topic: letters, digits and underscores, a letter first, each once.

    Examples
    --------
    >>> camera_names(["/front/image_raw/compressed", "/camera/infra1/image_rect_raw"])
    ('front', 'camera_infra1')
    """
    names: list[str] = []
    for topic in topics:
        parts = [part for part in without_transport(topic).split("/") if part]
        if len(parts) > 1 and _PICTURES.fullmatch(parts[-1]):
            parts = parts[:-1]
        stem = re.sub(r"[^A-Za-z0-9]+", "_", "_".join(parts))[:_LONGEST].strip("_")
        stem = stem if stem[:1].isalpha() else f"camera_{stem}".rstrip("_")
        name, number = stem, 2
        while name.lower() in {n.lower() for n in names}:
            name, number = f"{stem}_{number}", number + 1
        names.append(name)
    return tuple(names)
