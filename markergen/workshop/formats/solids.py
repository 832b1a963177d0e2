"""Solids in CAD formats: STEP and BREP, and the notes and accompanying files of all formats of solids.

Open CASCADE writes both; `normalize` removes from STEP what varies from run to run.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import markergen
from markergen.errors import MissingLibraryError, OutputError
from markergen.exporters import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.model.body import Body
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import Marker, marker_name
from markergen.model.rig import Rig
from markergen.model.rig_json import rig_name
from markergen.occt import import_kernel
from markergen.solid.plate import plate_size
from markergen.solid.primitives import COLORS, OTHER
from markergen.workshop.assembly import MadeBody, check_apart, designed, made_of
from markergen.workshop.kernel import NamedSolid, solids_of
from markergen.workshop.processes import Made

MADE = (".step", ".brep", ".stl", ".3mf")
"""Suffixes of solids that are made, in which plates must not overlap; others are looked at."""


@dataclass(frozen=True)
class Designed:
    """What a solid is made of: a marker as designed, or a rig of such markers.

    Attributes
    ----------
    notes : tuple of str
        Sentences for the user.
    beside : mapping
        Files that accompany the solid, by name.
    """

    name: str
    subject: Marker | Rig
    made: MadeBody
    notes: tuple[str, ...]
    beside: Mapping[str, bytes]

    @property
    def part_names(self) -> tuple[str, ...]:
        """Names of the parts in their order."""
        return tuple(part.name for part in self.made.parts)


def designed_of(bodies: Sequence[Marker | Rig], options: ExportOptions, suffix: str) -> Designed:
    """Make the only marker of a format, or a rig.

    Raises
    ------
    InputError
        If there is not exactly one marker, or it cannot be made as requested.
    """
    body = designed(only(bodies, suffix))
    made = made_of(body, options.fabrication)
    if suffix in MADE:
        check_apart(made)
    name = marker_name(body) if isinstance(body, Marker) else rig_name(body)
    return Designed(name, body, made, solid_notes(body, made, options), _beside(body, options))


def export_step(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One assembly of solids as STEP (AP214), in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".step")
    return Output(write_step(solids_of(work.made.parts), work.name), work.notes, work.beside)


def export_brep(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One compound of solids as BREP text, in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".brep")
    names = ", ".join(work.part_names[:4]) + (", ..." if len(work.part_names) > 4 else "")
    order = f"BREP has neither names nor colors: the solids are, in this order, {names}."
    return Output(write_brep(solids_of(work.made.parts)), (*work.notes, order), work.beside)


def assembly_of(body: Marker | Rig, options: ExportOptions) -> Any:
    """Return the solids of a body as a `cadquery.Assembly`, which raises as `export_step` does."""
    work = designed_of([body], options, ".step")
    return cadquery_assembly(solids_of(work.made.parts), work.name)


def solid_notes(body: Body, made: MadeBody, options: ExportOptions) -> tuple[str, ...]:
    """Sentences on the solid, for the body as designed."""
    process = options.fabrication.process
    how = f"({process}: {PROCESSES[process].label})"
    first, count = body.plates[0].marker, len(body.plates)
    what = _of_rig(made, count) if body.frame == "rig" else _of_marker(first, made.made[0])
    overlap = [f"Note that {made.overlap}."] if made.overlap else []
    return (f"Made as {what} {how}.", *overlap, *made.notes, *without_paper(options))


def _of_rig(made: MadeBody, count: int) -> str:
    if not made.block:
        return f"an assembly of {count} plate{'s' * (count > 1)}"
    size = " x ".join(f"{side:.6g}" for side in np.ptp(np.concatenate([face.ring() for face in made.block]), axis=0))
    return f"one body of {size} mm with {count} of its {len(made.block)} faces marked"


def _of_marker(marker: Marker, made: Made) -> str:
    plates = sum(part.is_plate for part in made.parts)
    others = len(made.parts) - plates
    what = f"{'a plate' if plates == 1 else f'{plates} plates'} {plate_size(marker)}"
    rest = f", and {others} part{'s' * (others > 1)} to go with {'it' if plates == 1 else 'them'}" if others else ""
    return f"{what} and {marker.substrate.thickness * 1e3:.6g} mm thick{rest}"


def _beside(body: Body, options: ExportOptions) -> dict[str, bytes]:
    """Files that accompany a solid: for an engraved plate the DXF for the machine."""
    if body.frame == "rig" or not PROCESSES[options.fabrication.process].engraved:
        return {}
    return {f"{options.stem}.dxf": EXPORTERS[".dxf"](body, options).data}


ENTITY = re.compile(r"^#(\d+) = (.*?);$", re.MULTILINE | re.DOTALL)
REFERENCE = re.compile(r"#(\d+)")
STRING_OR_REFERENCE = re.compile(r"'(?:[^']|'')*'|#(\d+)")
STYLE_ROOT = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"


def write_step(solids: Sequence[NamedSolid], name: str) -> bytes:
    """Write solids as one assembly named `name`; units mm, every part a separate solid with its name and color.

    Open CASCADE puts the time into the header, numbers assembly links over the life of the process, and writes colors
    in the order of memory addresses; `normalize` removes all three.

    Raises
    ------
    OutputError
        If Open CASCADE fails to write it.
    """
    import_kernel()
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Interface import Interface_Static
    from OCP.Message import Message, Message_Gravity
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_StepModelType
    from OCP.XSControl import XSControl_WorkSession

    # Otherwise every file is announced on the standard output.
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    document = _document(solids, name)
    writer = STEPCAFControl_Writer(XSControl_WorkSession(), False)
    writer.SetColorMode(True)
    writer.SetNameMode(True)
    # Parametric curves on surfaces double the file size, and readers recompute them. Settings are those of the process,
    # and cadquery's exporter changes the last one.
    for setting in ("write.surfacecurve.mode", "write.precision.mode", "write.stepcaf.subshapes.name"):
        Interface_Static.SetIVal_s(setting, 0)
    for setting in ("xstep.cascade.unit", "write.step.unit"):
        Interface_Static.SetCVal_s(setting, "MM")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "marker.step"
        writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs)
        if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise OutputError(f"expected Open CASCADE to write {path}, found a failure; check that the disk has room")
        return normalize(path.read_text(encoding="ascii"), name).encode("ascii")


def _document(solids: Sequence[NamedSolid], name: str) -> Any:
    """One assembly of solids; each is a part of its own, since many programs lose the color of a compound."""
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDocStd import TDocStd_Document
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFApp import XCAFApp_Application
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_DocumentTool

    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    XCAFApp_Application.GetApplication_s().InitDocument(document)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())

    def named(label: Any, text: str) -> Any:
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(text))
        return label

    def color(label: Any, material: str) -> None:
        colors.SetColor(label, Quantity_Color(*COLORS[material], Quantity_TOC_sRGB), XCAFDoc_ColorGen)

    assembly = named(shapes.NewShape(), name)
    for solid in solids:
        part = named(shapes.AddShape(solid.shape, False), solid.name)
        color(part, solid.material)
        named(shapes.AddComponent(assembly, part, TopLoc_Location()), solid.name)
        for face in solid.marked:
            color(shapes.AddSubShape(part, face), OTHER[solid.material])
    shapes.UpdateAssemblies()
    return document


def cadquery_assembly(solids: Sequence[NamedSolid], name: str) -> Any:
    """Return solids as a `cadquery.Assembly` named `name`, with the names and colors that `write_step` writes.

    Raises
    ------
    MissingLibraryError
        If cadquery is missing, as where Open CASCADE was installed alone.
    """
    try:
        import cadquery
    except ImportError as error:
        raise MissingLibraryError(
            f"a cadquery.Assembly needs cadquery, found: {' '.join(str(error).split())}; "
            "install it with: pip install 'markergen[solids]'"
        ) from None

    def color(material: str) -> Any:
        return cadquery.Color(*COLORS[material])

    assembly = cadquery.Assembly(name=name)
    for solid in solids:
        assembly.add(cadquery.Shape.cast(solid.shape), name=solid.name, color=color(solid.material))
        for face in solid.marked:
            assembly[solid.name].addSubshape(cadquery.Shape.cast(face), color=color(OTHER[solid.material]))
    return assembly


def write_brep(solids: Sequence[NamedSolid]) -> bytes:
    """Write solids as one compound in mm, in the given order, without triangles; BREP has no names or colors."""
    import_kernel()
    from OCP.BRep import BRep_Builder
    from OCP.BRepTools import BRepTools
    from OCP.Message import Message_ProgressRange
    from OCP.TopoDS import TopoDS_Compound
    from OCP.TopTools import TopTools_FormatVersion

    builder, compound, stream = BRep_Builder(), TopoDS_Compound(), BytesIO()
    builder.MakeCompound(compound)
    for solid in solids:
        builder.Add(compound, solid.shape)
    # Version 1 of the format, which FreeCAD, Gmsh and CadQuery can all read.
    BRepTools.Write_s(
        compound, stream, False, False, TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1, Message_ProgressRange()
    )
    return stream.getvalue()


def normalize(text: str, name: str) -> str:
    """STEP text with a fixed header, assembly links numbered from 1, and colors in the order of the colored shapes.

    Colors are reordered by renumbering: entities before the first style keep their number, and the styles follow,
    each root with its references, sorted by the number of the solid.
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
    # Most entities come before all that move, and refer to none of these.
    still = {old for old, new in numbers.items() if old == new}
    if not all(int(target) in still for old in still for target in REFERENCE.findall(entities[old])):
        still = set()
    links = count(1)
    lines = []
    for old in order:
        body = entities[old]
        if old not in still:
            body = STRING_OR_REFERENCE.sub(lambda match: f"#{numbers[int(match[1])]}" if match[1] else match[0], body)
        if body.startswith("NEXT_ASSEMBLY_USAGE_OCCURRENCE"):
            # Where Open CASCADE breaks the line depends on the number.
            body = re.sub(r"\('\d+'", f"('{next(links)}'", re.sub(r"\n *", "", body), count=1)
        lines.append(f"#{numbers[old]} = {body};\n")
    return f"{header}DATA;\n{''.join(lines)}ENDSEC;\nEND-ISO-10303-21;\n"


def _references(body: str) -> list[int]:
    return [int(match[1]) for match in STRING_OR_REFERENCE.finditer(body) if match[1]]


def _colored(entities: dict[int, str], root: int) -> int:
    """Number of the shape colored by a style root: the last reference of its styled item."""
    return min(
        _references(entities[item])[-1] for item in _references(entities[root]) if "STYLED_ITEM" in entities[item]
    )
