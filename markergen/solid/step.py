"""Solids as STEP (AP214): named, colored, and the same bytes from run to run."""

import re
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import markergen
from markergen.errors import OutputError
from markergen.solid.bodies import OTHER
from markergen.solid.build import COLORS, NamedSolid
from markergen.solid.kernel import import_cadquery

ENTITY = re.compile(r"^#(\d+) = (.*?);$", re.MULTILINE | re.DOTALL)
STRING_OR_REFERENCE = re.compile(r"'(?:[^']|'')*'|#(\d+)")
STYLE_ROOT = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"


def write_step(solids: Sequence[NamedSolid], name: str) -> bytes:
    """Write solids as one assembly called `name`; units mm, every part a solid of its own with its name and color.

    Open CASCADE puts the time into the header, counts assembly links over the life of the process, and writes colors
    in the order of memory addresses; `normalize` takes all three out.
    """
    import_cadquery()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "marker.step"
        _transfer(solids, name, path)
        return normalize(path.read_text(encoding="ascii"), name).encode("ascii")


def normalize(text: str, name: str) -> str:
    """STEP text with a fixed header, assembly links numbered from 1, and colors in the order of what they color.

    The order of colors is restored by renumbering: entities before the first style keep their number, and the styles
    follow, each root with what it refers to, sorted by the number of the solid.
    """
    head, data = text.split("DATA;\n", 1)
    header = re.sub(
        r"FILE_NAME\(.*?\);",
        f"FILE_NAME('{name}.step','',('markergen'),(''),'markergen {markergen.__version__}','Open CASCADE','');",
        head,
        flags=re.DOTALL,
    )
    entities = {int(number): body for number, body in ENTITY.findall(data)}
    roots = [number for number, body in entities.items() if body.startswith(STYLE_ROOT)]
    order = [number for number in entities if number < min(roots, default=len(entities) + 1)]
    placed = set(order)

    def place(number: int) -> None:
        if number in placed:
            return
        placed.add(number)
        order.append(number)
        for reference in _references(entities[number]):
            place(reference)

    for root in sorted(roots, key=lambda root: _colored(entities, root)):
        place(root)
    numbers = {old: new for new, old in enumerate(order, start=1)}
    links = count(1)
    lines = []
    for old in order:
        body = STRING_OR_REFERENCE.sub(
            lambda match: f"#{numbers[int(match[1])]}" if match[1] else match[0], entities[old]
        )
        if body.startswith("NEXT_ASSEMBLY_USAGE_OCCURRENCE"):
            body = re.sub(r"\('\d+'", f"('{next(links)}'", body, count=1)
        lines.append(f"#{numbers[old]} = {body};\n")
    return f"{header}DATA;\n{''.join(lines)}ENDSEC;\nEND-ISO-10303-21;\n"


def _references(body: str) -> list[int]:
    return [int(match[1]) for match in STRING_OR_REFERENCE.finditer(body) if match[1]]


def _colored(entities: dict[int, str], root: int) -> int:
    """Number of the shape that a style root colors: the last reference of its styled item."""
    return min(
        _references(entities[item])[-1] for item in _references(entities[root]) if "STYLED_ITEM" in entities[item]
    )


def _transfer(solids: Sequence[NamedSolid], name: str, path: Path) -> None:
    """Write an Open CASCADE document with one labeled solid per part.

    Not cadquery.Assembly: it wraps every part in a compound, on which many programs lose the color.
    """
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Interface import Interface_Static
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_StepModelType
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_DocumentTool

    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    shapes.SetAutoNaming_s(False)
    colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())

    def call(label: Any, label_name: str) -> None:
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(label_name))

    assembly = shapes.NewShape()
    call(assembly, name)
    for solid in solids:
        part = shapes.NewShape()
        shapes.SetShape(part, solid.shape.wrapped)
        call(part, solid.name)
        colors.SetColor(part, Quantity_Color(*solid.color, Quantity_TOC_sRGB), XCAFDoc_ColorGen)
        for face in solid.marked:
            other = Quantity_Color(*COLORS[OTHER[solid.material]], Quantity_TOC_sRGB)
            colors.SetColor(shapes.AddSubShape(part, face.wrapped), other, XCAFDoc_ColorSurf)
        call(shapes.AddComponent(assembly, part, TopLoc_Location()), solid.name)
    shapes.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    # These are global to Open CASCADE, so they are set for every file; before there is a writer they do not exist.
    # Without curves in the parameters of surfaces, which readers find for themselves, a file is half as large.
    settings = (
        Interface_Static.SetCVal_s("xstep.cascade.unit", "MM"),
        Interface_Static.SetCVal_s("write.step.unit", "MM"),
        Interface_Static.SetIVal_s("write.surfacecurve.mode", 0),
    )
    if not all(settings):
        raise OutputError("expected Open CASCADE to take the units of STEP files, found that it does not; update it")
    writer.SetColorMode(True)
    writer.SetNameMode(True)
    done = writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs)
    if not done or writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise OutputError(f"expected Open CASCADE to write {path}, found a failure; check that the disk has room")
