"""Writing 3MF: one object of several colours that a slicer keeps together (3MF Core Specification 1.3).

Slicers do not agree on how to say which part is printed with which filament, so it is said in all of them: a base
material for each triangle (as specified; what viewers show), and ``Metadata/Slic3r_PE_model.config``, which has the
triangles and the extruder of each volume. PrusaSlicer and its kin read that; Bambu Studio and OrcaSlicer read it where
the file's application names PrusaSlicer. Components would be loaded as separate objects, and moved apart.
"""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_SLIC3R = "http://schemas.slic3r.org/3mf/2017/06"
"""Without the version in this namespace PrusaSlicer leaves every volume but the first where it was before the item's
transform."""
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_TYPES = (
    f'<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="{_PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    '<Default Extension="config" ContentType="text/xml"/></Types>\n'
)
_RELATIONS = (
    f'<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="{_PACKAGE}/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
)
_APPLICATION = "boxcal, volumes and extruders as in PrusaSlicer's files"
_DATE = (1980, 1, 1, 0, 0, 0)
_MATERIALS, _OBJECT = 1, 2
"""Ids of the resources."""


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
    """Return a 3MF file with one object, put at (middle_mm, middle_mm) on the bed.

    Each body is one of its volumes, printed by the extruder of its number (the first by extruder 1, tool 0).
    """
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w") as archive:
        for path, text in (
            ("[Content_Types].xml", _TYPES),
            ("_rels/.rels", _RELATIONS),
            ("3D/3dmodel.model", _model(name, bodies, title=title, middle_mm=middle_mm)),
            ("Metadata/Slic3r_PE_model.config", _volumes(name, bodies)),
        ):
            entry = zipfile.ZipInfo(path, date_time=_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)
    return package.getvalue()


def _model(name: str, bodies: Sequence[Coloured], *, title: str, middle_mm: float) -> str:
    materials = "".join(f'<base name={quoteattr(b.name)} displaycolor="{b.colour}FF"/>' for b in bodies)
    vertices, triangles, first = [], [], 0
    for number, body in enumerate(bodies):
        vertices += [f'<vertex x="{x:.6f}" y="{y:.6f}" z="{z:.6f}"/>' for x, y, z in body.vertices + 0.0]
        triangles += [
            f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="{_MATERIALS}" p1="{number}"/>'
            for a, b, c in np.asarray(body.triangles, dtype=np.int64) + first
        ]
        first += len(body.vertices)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}" xmlns:slic3rpe="{_SLIC3R}">\n'
        '<metadata name="slic3rpe:Version3mf">1</metadata>\n'
        f'<metadata name="Title">{escape(title)}</metadata>\n'
        f'<metadata name="Application">{escape(_APPLICATION)}</metadata>\n'
        f'<resources><basematerials id="{_MATERIALS}">{materials}</basematerials>\n'
        f'<object id="{_OBJECT}" type="model" name={quoteattr(name)} pid="{_MATERIALS}" pindex="0"><mesh>'
        f"<vertices>{''.join(vertices)}</vertices><triangles>{''.join(triangles)}</triangles></mesh></object></resources>\n"
        f'<build><item objectid="{_OBJECT}" transform="1 0 0 0 1 0 0 0 1 {middle_mm:g} {middle_mm:g} 0"/></build>\n'
        "</model>\n"
    )


def _volumes(name: str, bodies: Sequence[Coloured]) -> str:
    lines, first = [], 0
    for number, body in enumerate(bodies, 1):
        last = first + len(body.triangles) - 1
        lines += [
            f'  <volume firstid="{first}" lastid="{last}">',
            f'   <metadata type="volume" key="name" value={quoteattr(body.name)}/>',
            '   <metadata type="volume" key="volume_type" value="ModelPart"/>',
            '   <metadata type="volume" key="matrix" value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/>',
            f'   <metadata type="volume" key="extruder" value="{number}"/>',
            "  </volume>",
        ]
        first = last + 1
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            "<config>",
            f' <object id="{_OBJECT}" instances_count="1">',
            f'  <metadata type="object" key="name" value={quoteattr(name)}/>',
            '  <metadata type="object" key="extruder" value="1"/>',
            *lines,
            " </object>",
            "</config>\n",
        ]
    )
