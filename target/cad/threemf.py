"""Writing 3MF: bodies of several colours that a slicer keeps together (3MF Core Specification 1.3)."""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_TYPES = (
    f'<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="{_PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
_RELATIONS = (
    f'<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="{_PACKAGE}/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
)
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coloured:
    """A closed triangle mesh of one colour.

    Attributes
    ----------
    name
        What a slicer lists it as.
    colour
        ``#RRGGBB``.
    vertices : (V, 3), mm
        Where it is printed: z = 0 is the bed.
    triangles : (F, 3)
        Counter-clockwise as seen from outside.
    """

    name: str
    colour: str
    vertices: Array
    triangles: NDArray[np.integer]


def threemf(name: str, bodies: Sequence[Coloured], *, title: str, middle_mm: float) -> bytes:
    """Return a 3MF file with one object made of the bodies, put at (middle_mm, middle_mm) on the bed."""
    materials = "".join(f'<base name={quoteattr(b.name)} displaycolor="{b.colour}FF"/>' for b in bodies)
    objects, components = [], []
    for number, body in enumerate(bodies):
        objects.append(
            f'<object id="{number + 2}" type="model" name={quoteattr(body.name)} pid="1" pindex="{number}"><mesh>'
            "<vertices>"
            + "".join(f'<vertex x="{x:.6f}" y="{y:.6f}" z="{z:.6f}"/>' for x, y, z in body.vertices + 0.0)
            + "</vertices><triangles>"
            + "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in body.triangles)
            + "</triangles></mesh></object>\n"
        )
        components.append(f'<component objectid="{number + 2}"/>')
    last = len(bodies) + 2
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}">\n'
        f'<metadata name="Title">{title}</metadata>\n'
        f'<resources><basematerials id="1">{materials}</basematerials>\n'
        + "".join(objects)
        + f'<object id="{last}" type="model" name={quoteattr(name)}><components>{"".join(components)}</components>'
        f'</object></resources>\n<build><item objectid="{last}" transform="1 0 0 0 1 0 0 0 1 {middle_mm:g} '
        f'{middle_mm:g} 0"/></build>\n</model>\n'
    )
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w") as archive:
        for path, text in (
            ("[Content_Types].xml", _TYPES),
            ("_rels/.rels", _RELATIONS),
            ("3D/3dmodel.model", model),
        ):
            entry = zipfile.ZipInfo(path, date_time=_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)
    return package.getvalue()
