"""Solids in CAD formats: parts as Open CASCADE solids, written as STEP and BREP, with notes and files beside them.

Solids are built from walls and level faces that share their edges, without Boolean operations. Walls are those of the
bodies, extruded or revolved; the level faces between them are known in closed form (`markergen.workshop.level_faces`).
Open CASCADE is called through OCP, its bindings for Python, which takes a second to import; cadquery on top of it would
take two more. `normalize` removes from STEP what varies from run to run.
"""
# tests: tests/workshop/formats/test_solids.py tests/workshop/test_kernel.py

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from itertools import count
from math import atan, hypot, pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import markergen
from markergen.errors import MissingLibraryError, OutputError, install
from markergen.exporters import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.geometry.contour import Contour, Side, backward, center_of, offset
from markergen.model.body import Body
from markergen.model.body_json import rig_name
from markergen.model.fabrication import PROCESSES
from markergen.model.marker import Marker, marker_name
from markergen.model.rig import Rig
from markergen.model.substrate import PLATE_LENGTHS, Substrate
from markergen.occt import import_kernel
from markergen.solid.plate import plate_size
from markergen.solid.primitives import COLORS, OTHER, BodyPart, Part, PosedPart, Primitive, Prism
from markergen.workshop.assembly import MadeBody, check_no_overlap, made_of
from markergen.workshop.level_faces import PlanarFace, level_faces, signed_bodies
from markergen.workshop.processes import Made

NEAR = 1e-6
"""Distance in mm below which edges are sewn together."""

LEVEL = 1 - 1e-9
"""Minimum vertical component of the normal of a level face."""

TOLERANCE = 1e-5
"""Maximum relative difference between the kernel's volume of a part and the closed form."""


@dataclass(frozen=True)
class NamedSolid:
    """One part as a solid of the CAD kernel.

    Attributes
    ----------
    name : str
        As in `Part`.
    material : {"light", "dark"}
    shape : OCP.TopoDS.TopoDS_Solid
        In mm, marker frame: the face of the plate is z = 0, the plate is below.
    marked : tuple of OCP.TopoDS.TopoDS_Face
        Faces of `shape` with the other material's color.
    """

    name: str
    material: str
    shape: Any
    marked: tuple[Any, ...] = ()


# Cached, since several files of one marker are often written in a row, and building solids takes most of the time.
@lru_cache(maxsize=1)
def solids_of(parts: tuple[Part | BodyPart, ...]) -> tuple[NamedSolid, ...]:
    """Build all parts, in the body frame.

    Raises
    ------
    OutputError
        If the kernel makes an invalid solid, or one whose volume is not the part's.
    MissingLibraryError
        If Open CASCADE or one of its system libraries is missing.
    """
    import_kernel()
    return tuple(
        NamedSolid(part.name, part.material, *(_block(part) if part.is_block else _placed(part))) for part in parts
    )


def _placed(part: Part | BodyPart) -> tuple[Any, tuple[Any, ...]]:
    (piece,) = part.pieces
    solid = checked(piece.part.name, piece.part.volume, lambda: assembled(piece.part))
    return _moved(*solid, piece) if piece.is_moved else solid


def _block(part: Part | BodyPart) -> tuple[Any, tuple[Any, ...]]:
    """Sew a block from its faces."""
    from OCP.TopoDS import TopoDS

    def make() -> tuple[Any, tuple[Any, ...]]:
        pieces = [_moved(*assembled(piece.part, face_only=True), piece) for piece in part.pieces]
        solid, sewing = _sewn(face for shape, _ in pieces for face in explored(shape, "FACE"))
        floors = (face for _, marked in pieces for face in marked)
        return solid, tuple(TopoDS.Face_s(sewing.ModifiedSubShape(face)) for face in floors)

    return checked(part.name, part.volume, make)


def _sewn(faces: Iterable[Any]) -> tuple[Any, Any]:
    """Solid of faces that enclose it, and what sewed them together."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    sewing = BRepBuilderAPI_Sewing(NEAR)
    for face in faces:
        sewing.Add(face)
    sewing.Perform()
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell_s(sewing.SewedShape())).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid, sewing


def _moved(shape: Any, faces: Sequence[Any], piece: PosedPart) -> tuple[Any, tuple[Any, ...]]:
    """Move a shape, and faces of it, from the frame of its plate to that of the body."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Trsf
    from OCP.TopoDS import TopoDS

    pose = gp_Trsf()
    # SetValues takes the rows of [R | t]; its constructor has no such form.
    pose.SetValues(*np.column_stack([piece.rotation, piece.translation]).ravel().tolist())
    # True copies the geometry; else the shape would refer to that of the plate with a location.
    moved = BRepBuilderAPI_Transform(shape, pose, True)
    return moved.Shape(), tuple(TopoDS.Face_s(moved.ModifiedShape(face)) for face in faces)


def checked(name: str, volume: float, make: Callable[[], tuple[Any, tuple[Any, ...]]]) -> tuple[Any, tuple[Any, ...]]:
    """Make a TopoDS_Solid and faces of it, and check that it is valid and has a volume in mm^3; see `solids_of`."""
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    try:
        shape, floors = make()
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(shape, properties)
        enclosed = properties.Mass()
        # A shell that is inside out encloses a negative volume.
        if enclosed <= 0 or not BRepCheck_Analyzer(shape).IsValid():
            raise ValueError("several pieces" if enclosed > 0 else "nothing")
    except Exception as error:
        # Open CASCADE raises errors of many classes, none of them Python's.
        raise _failed(name, " ".join(str(error).split()) or type(error).__name__) from None
    if abs(enclosed - volume) > TOLERANCE * enclosed:
        raise _failed(name, f"{enclosed:.9g} mm^3 instead of {volume:.9g} mm^3")
    return shape, floors


def _failed(name: str, problem: str) -> OutputError:
    return OutputError(
        f"expected Open CASCADE to make a valid solid of the part {name!r}, found {problem}; change the depth, "
        "the thickness or the outline a little"
    )


def _solid(body: Primitive) -> Any:
    """TopoDS_Solid of a body, without its chamfer."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism, BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pln, gp_Pnt, gp_Vec

    if isinstance(body, Prism):
        level = gp_Pln(gp_Pnt(0, 0, body.bottom), gp_Dir(0, 0, 1))
        base = _face(level, [_wire(contour, body.bottom) for contour in (body.outer, *body.holes)])
        return BRepPrimAPI_MakePrism(base, gp_Vec(0, 0, body.top - body.bottom)).Shape()
    place = gp_Pnt(body.x, body.y, 0)
    # x, z and -y are right-handed, so that the profile turns in this plane as its contour does.
    profile = _face(gp_Pln(place, gp_Dir(0, -1, 0)), [_wire(body.profile, None, (body.x, body.y))])
    return BRepPrimAPI_MakeRevol(profile, gp_Ax1(place, gp_Dir(0, 0, 1))).Shape()


def assembled(part: Part, face_only: bool = False) -> tuple[Any, tuple[Any, ...]]:
    """TopoDS_Solid of a part, and its level faces that are floors of marked bodies.

    With `face_only` it is open: walls and bottom of the part's first body are left out, for one face of a block.
    """
    from OCP.BRep import BRep_Builder, BRep_Tool
    from OCP.TopoDS import TopoDS_Shell, TopoDS_Solid

    builder, shell, solid, rims, floors = BRep_Builder(), TopoDS_Shell(), TopoDS_Solid(), _Rims(), []
    builder.MakeShell(shell)
    for number, (body, sign, _) in enumerate(signed_bodies(part)):
        for piece, piece_sign in _pieces(body):
            for face in explored(piece, "FACE"):
                if _side(face):
                    rims.add(face)
                elif number or not face_only:
                    builder.Add(shell, face if sign * piece_sign > 0 else face.Reversed())
    for level in level_faces(part, face_only):
        face = _level(level, rims)
        builder.Add(shell, face)
        if level.marked:
            floors.append(face)
    # BRep_Builder sets no flags of what it makes.
    shell.Closed(BRep_Tool.IsClosed_s(shell))
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return solid, tuple(floors)


class _Rims:
    """Wires around the caps of bodies, found by one of their corners."""

    def __init__(self) -> None:
        self._wires: list[Any] = []
        self._corners: list[tuple[float, float, float]] = []
        self._owners: list[int] = []

    def add(self, cap: Any) -> None:
        """Add the wires of a cap."""
        from OCP.BRep import BRep_Tool

        for wire in explored(cap, "WIRE"):
            for vertex in explored(wire, "VERTEX"):
                self._corners.append(BRep_Tool.Pnt_s(vertex).Coord())
                self._owners.append(len(self._wires))
            self._wires.append(wire)

    def at(self, contours: Sequence[Contour], z: float) -> list[Any]:
        """Wires of contours at a height."""
        starts = np.array([(*contour.points[0], z) for contour in contours])
        corners = np.array(self._corners)
        nearest = [int(np.argmin(np.abs(corners - start).max(axis=1))) for start in starts]
        if np.abs(corners[nearest] - starts).max() > NEAR:
            raise ValueError(f"a face without an edge at z = {z:.6g} mm")
        return [self._wires[self._owners[k]] for k in nearest]


def _level(level: PlanarFace, rims: _Rims) -> Any:
    """TopoDS_Face of a level face, with its outside where it should be."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt
    from OCP.TopoDS import TopoDS

    plane = gp_Pln(gp_Pnt(0, 0, level.z), gp_Dir(0, 0, 1))
    # Faces of one wire each turn their wires counterclockwise.
    outer, *holes = (
        BRepBuilderAPI_MakeFace(plane, wire, True).Face()
        for wire in rims.at([rim.contour for rim in level.rims], level.z)
    )
    maker = BRepBuilderAPI_MakeFace(outer)
    for hole in holes:
        maker.Add(TopoDS.Wire_s(explored(hole, "WIRE")[0].Reversed()))
    face = maker.Face()
    return face if level.up else TopoDS.Face_s(face.Reversed())


def _pieces(body: Primitive) -> list[tuple[Any, int]]:
    """Solids that make a body, each with 1 or, if it is a hole, -1."""
    if not (isinstance(body, Prism) and body.chamfer):
        return [(_solid(body), 1)]
    holes = [_solid(Prism(backward(hole), (), body.bottom, body.top)) for hole in body.holes]
    return [(_chamfered(body), 1), *((hole, -1) for hole in holes)]


def explored(shape: Any, kind: str) -> list[Any]:
    """Distinct faces, wires or vertices of a TopoDS_Shape, with their orientation in it."""
    from OCP import TopAbs
    from OCP.TopExp import TopExp
    from OCP.TopoDS import TopoDS
    from OCP.TopTools import TopTools_IndexedMapOfShape

    shapes = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, getattr(TopAbs.TopAbs_ShapeEnum, f"TopAbs_{kind}"), shapes)
    cast = getattr(TopoDS, f"{kind.capitalize()}_s")
    return [cast(shapes.FindKey(number)) for number in range(1, shapes.Extent() + 1)]


def _side(face: Any) -> int:
    """1 if a face is level with its outside above, -1 if below; 0 if it is not level."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Plane
    from OCP.TopAbs import TopAbs_REVERSED

    surface = BRepAdaptor_Surface(face)
    if surface.GetType() != GeomAbs_Plane:
        return 0
    position = surface.Plane().Position()
    # A left-handed placement reverses the normal that the direction stands for.
    up = position.Direction().Z() * (1 if position.Direct() else -1)
    if abs(up) < LEVEL:
        return 0
    return 1 if (up > 0) != (face.Orientation() == TopAbs_REVERSED) else -1


def _chamfered(body: Prism) -> Any:
    """Prism with a chamfer, without holes, sewn from its faces.

    The kernel's own chamfers fail where sides turn only slightly.
    """
    rim, edge = body.top - body.chamfer, offset(body.outer, body.chamfer)
    lower, upper = (_solid(Prism(outline, (), body.bottom, z)) for outline, z in ((body.outer, rim), (edge, body.top)))
    faces = [face for face in explored(lower, "FACE") if _side(face) <= 0]
    faces += [face for face in explored(upper, "FACE") if _side(face) > 0]
    pairs = list(zip(body.outer.sides, edge.sides, strict=True))
    whole = body.outer.is_circle
    for side, inner in pairs[:1] if whole else pairs:
        faces.append(_slant(side, inner, rim, body.top, 2 * pi if whole else 4 * atan(abs(side[2]))))
    return _sewn(faces)[0]


def _slant(side: Side, inner: Side, low: float, high: float, angle: float) -> Any:
    """Face of a chamfer between a side and its inward offset: a plane, or a cone for an arc."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakePolygon
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Ax3, gp_Dir, gp_Pln, gp_Pnt

    (x, y), (u, v), bulge = side
    (p, q), (r, s), _ = inner
    if not bulge:
        corners = [gp_Pnt(x, y, low), gp_Pnt(u, v, low), gp_Pnt(r, s, high), gp_Pnt(p, q, high)]
        along, wide = gp_Dir(u - x, v - y, 0), high - low
        # The inward normal of the side plus an equal upward component.
        normal = gp_Dir(along.Y() * wide, -along.X() * wide, wide)
        ring = BRepBuilderAPI_MakePolygon(*corners, True).Wire()
        return _face(gp_Pln(gp_Ax3(corners[0], normal, along)), [ring])
    # Revolution is counterclockwise about its axis: the axis of an arc that turns right points down.
    axis = gp_Ax1(gp_Pnt(*center_of(side), 0), gp_Dir(0, 0, 1 if bulge > 0 else -1))
    edge = BRepBuilderAPI_MakeEdge(gp_Pnt(x, y, low), gp_Pnt(p, q, high)).Edge()
    return explored(BRepPrimAPI_MakeRevol(edge, axis, angle).Shape(), "FACE")[0]


def _face(plane: Any, wires: Sequence[Any]) -> Any:
    """Face in a given plane, since the plane that Open CASCADE fits to the wire is off by rounding."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    maker = BRepBuilderAPI_MakeFace(plane, wires[0], True)
    for hole in wires[1:]:
        maker.Add(hole)
    return maker.Face()


def _wire(contour: Contour, height: float | None, axis: tuple[float, float] = (0.0, 0.0)) -> Any:
    """Wire at a height or, if it is None, vertical in the half plane of positive x from the axis."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex, BRepBuilderAPI_MakeWire
    from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt

    def point(x: float, y: float) -> Any:
        return gp_Pnt(axis[0] + x, axis[1], y) if height is None else gp_Pnt(x, y, height)

    # About this direction, arcs that turn left in the contour turn left in space.
    left = gp_Dir(0, -1, 0) if height is None else gp_Dir(0, 0, 1)
    right, along = left.Reversed(), gp_Dir(1, 0, 0)
    wire = BRepBuilderAPI_MakeWire()
    vertices = [BRepBuilderAPI_MakeVertex(point(*corner)).Vertex() for corner in contour.points]
    if (whole := contour.as_circle) is not None:
        # A single circular edge instead of two half turns halves the faces and is recognized as a circle by readers.
        x, y, radius = whole
        circle = gp_Circ(gp_Ax2(point(x, y), left if contour.bulges[0] > 0 else right, along), radius)
        return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(circle).Edge()).Wire()
    for side, start, end in zip(contour.sides, vertices, (*vertices[1:], vertices[0]), strict=True):
        (x, y), _, bulge = side
        if not bulge:
            wire.Add(BRepBuilderAPI_MakeEdge(start, end).Edge())
            continue
        center = center_of(side)
        circle = gp_Circ(
            gp_Ax2(point(*center), left if bulge > 0 else right, along), hypot(x - center[0], y - center[1])
        )
        wire.Add(BRepBuilderAPI_MakeEdge(circle, start, end).Edge())
    return wire.Wire()


EXPORTED = "markergen export"
"""Before the options of an export that a file records."""

MOST_RECORD = 30_000
"""Maximum number of characters of a record: a string of STEP has 32 769, the comment of a 3MF's archive 65 535."""

MADE = (".step", ".brep", ".stl", ".3mf")
"""Suffixes of solids that are made, in which plates must not overlap; others are looked at."""


@dataclass(frozen=True)
class Designed:
    """What a solid is made of: a marker as designed, or a rig of such markers.

    Attributes
    ----------
    notes : tuple of str
        Sentences for the user.
    record, short_record : str
        Options that are not the defaults, as JSON; empty for none. The short one has no outline and no holes.
    """

    name: str
    subject: Marker | Rig
    made: MadeBody
    notes: tuple[str, ...]
    record: str = ""
    short_record: str = ""


def designed_of(bodies: Sequence[Marker | Rig], options: ExportOptions, suffix: str) -> Designed:
    """Make the only marker of a format, or a rig.

    Raises
    ------
    InputError
        If there is not exactly one marker, or it cannot be made as requested.
    """
    body = only(bodies, suffix).as_designed
    made = made_of(body, options.fabrication)
    if suffix in MADE:
        check_no_overlap(made, body)
    name = marker_name(body) if isinstance(body, Marker) else rig_name(body)
    asked, plate, lengths = options.fabrication.shape_options, body.plates[0].marker.substrate, {}
    for measure in PLATE_LENGTHS:
        values = {getattr(other.marker.substrate, measure) for other in body.plates}
        if len(values) == 1 and values != {getattr(Substrate, measure)}:
            lengths[measure] = values.pop()
    is_whole = (plate.outline or plate.holes) and all(other.marker.substrate == plate for other in body.plates)
    short_record = _record_of(asked | lengths)
    record = _record_of(asked | {"substrate": plate.as_dict()}) if is_whole else short_record
    record = record if len(record) <= MOST_RECORD else short_record
    return Designed(name, body, made, solid_notes(body, made, options), record, short_record)


def _record_of(asked: Mapping[str, Any]) -> str:
    return json.dumps(asked, separators=(",", ":")) if asked else ""


def export_step(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One assembly of solids as STEP (AP214), in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".step")
    data = write_step(solids_of(work.made.parts), work.name, work.record)
    return Output(data, work.notes, _beside(work.subject, options))


def export_brep(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """One compound of solids as BREP text, in mm; paper options have no effect."""
    work = designed_of(bodies, options, ".brep")
    parts = work.made.parts
    names = ", ".join(part.name for part in parts[:4]) + (", ..." if len(parts) > 4 else "")
    order = f"BREP has neither names nor colors: the solids are, in this order, {names}."
    return Output(write_brep(solids_of(parts), work.record), (*work.notes, order), _beside(work.subject, options))


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
    plates = len(made.plates)
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


def write_step(solids: Sequence[NamedSolid], name: str, record: str = "") -> bytes:
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
        return normalize(path.read_text(encoding="ascii"), name, record).encode("ascii")


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
            f"install it with: {install('solids')}"
        ) from None

    def color(material: str) -> Any:
        return cadquery.Color(*COLORS[material])

    assembly = cadquery.Assembly(name=name)
    for solid in solids:
        assembly.add(cadquery.Shape.cast(solid.shape), name=solid.name, color=color(solid.material))
        for face in solid.marked:
            assembly[solid.name].addSubshape(cadquery.Shape.cast(face), color=color(OTHER[solid.material]))
    return assembly


def write_brep(solids: Sequence[NamedSolid], record: str = "") -> bytes:
    """Write solids as one compound in mm, in the given order, without triangles; BREP has no names or colors.

    Options of the export stand before the header, where Open CASCADE skips lines of up to 99 characters.
    """
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
    lines = f"{EXPORTED} {record}\n".replace(",", ",\n") if record else ""
    return lines.encode() + stream.getvalue()


def normalize(text: str, name: str, record: str = "") -> str:
    """STEP text with a fixed header, assembly links numbered from 1, and colors in the order of the colored shapes.

    Colors are reordered by renumbering: entities before the first style keep their number, and the styles follow,
    each root with its references, sorted by the number of the solid.
    """
    head, data = text.split("DATA;\n", 1)
    exported = f"{EXPORTED} {record}".replace("\\", 2 * "\\").replace("'", "''") if record else ""
    by = f"'markergen {markergen.__version__}','Open CASCADE','{exported}'"
    header = re.sub(
        r"FILE_NAME\(.*?\);",
        lambda _: f"FILE_NAME('{name}.step','',('markergen'),(''),{by});",
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
