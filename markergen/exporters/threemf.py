"""3MF, core specification: one object per part with its material, put together as one."""

import zipfile
from collections.abc import Sequence
from io import BytesIO
from xml.sax.saxutils import quoteattr

import markergen
from markergen.exporters import ExportOptions, Output
from markergen.exporters.meshes import MATERIALS, MeshedPart, meshed
from markergen.model.marker import Marker
from markergen.solid.bodies import COLORS, OTHER

MODEL = "3D/3dmodel.model"
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    "</Types>\n"
)
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Id="model" Target="/{MODEL}" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest time that a zip file can hold: the same in every file."""


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """All parts as 3MF in mm, with their materials; slicers load them as the parts of one object."""
    made = meshed(markers, options, ".3mf")
    return Output(write_3mf(made.parts, made.name), made.notes)


def write_3mf(parts: Sequence[MeshedPart], name: str) -> bytes:
    """Write parts as a 3MF package whose one build item is an object called `name` made of them; mm, marker frame."""
    package = BytesIO()
    with zipfile.ZipFile(package, "w") as archive:
        archive.comment = name.encode("ascii")
        for path, text in (
            ("[Content_Types].xml", TYPES),
            ("_rels/.rels", RELATIONS),
            (MODEL, _model(parts, name)),
        ):
            entry = zipfile.ZipInfo(path, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)
    return package.getvalue()


def _model(parts: Sequence[MeshedPart], name: str) -> str:
    materials = "".join(f'<base name="{material}" displaycolor="{_hex(COLORS[material])}"/>' for material in MATERIALS)
    # The object made of all comes last: a 3MF refers only to what stands before.
    whole = len(parts) + 2
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n'
        f'<metadata name="Title">{name}</metadata>\n'
        f'<metadata name="Application">markergen {markergen.__version__}</metadata>\n'
        f'<resources>\n<basematerials id="1">{materials}</basematerials>\n'
        + "".join(_object(number, part) for number, part in enumerate(parts, start=2))
        + f'<object id="{whole}" type="model" name="{name}"><components>'
        + "".join(f'<component objectid="{number}"/>' for number in range(2, whole))
        + f'</components></object>\n</resources>\n<build><item objectid="{whole}"/></build>\n</model>\n'
    )


def _object(number: int, part: MeshedPart) -> str:
    mesh, material = part.mesh, MATERIALS.index(part.material)
    mark = f' pid="1" p1="{MATERIALS.index(OTHER[part.material])}"'
    # Nine digits are what a 32-bit float holds.
    vertices = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>\n' for x, y, z in mesh.points.tolist())
    triangles = "".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}"{mark if marked else ""}/>\n'
        for (a, b, c), marked in zip(mesh.triangles.tolist(), mesh.marked.tolist(), strict=True)
    )
    return (
        f'<object id="{number}" type="model" name={quoteattr(part.name)} pid="1" pindex="{material}"><mesh>\n'
        f"<vertices>\n{vertices}</vertices>\n<triangles>\n{triangles}</triangles>\n</mesh></object>\n"
    )


def _hex(color: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(channel * 255):02X}" for channel in color) + "FF"
