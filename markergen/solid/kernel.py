"""Build parts as Open CASCADE solids: bodies extruded or revolved, then combined by Booleans.

cadquery is used where it suffices. Made with OCP directly are faces in given rather than fitted planes, arcs about
exact centers, chamfers that tolerate nearly tangent sides, and Booleans that track the floors of engraving.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import atan, hypot, pi
from types import ModuleType
from typing import Any

from markergen.errors import MissingLibraryError, OutputError
from markergen.geometry.contour import Contour, Side, backward, center_of, offset
from markergen.solid.bodies import COLORS, Body, Part, Prism

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
    color : (red, green, blue)
        0 to 1, sRGB.
    shape : cadquery.Solid
        In mm, marker frame: the face of the plate is z = 0, the plate is below.
    marked : tuple of cadquery.Face
        Faces of `shape` with the other material's color.
    """

    name: str
    material: str
    color: tuple[float, float, float]
    shape: Any
    marked: tuple[Any, ...] = ()


def import_cadquery() -> ModuleType:
    """Import cadquery; raises MissingLibraryError with what is missing and how to install it."""
    try:
        import cadquery
    except ImportError as error:
        raise missing_kernel("solids need", " ".join(str(error).split())) from None
    return cadquery


def missing_kernel(need: str, found: str) -> MissingLibraryError:
    """Return the error with what needs cadquery, what was found, and what to install."""
    return MissingLibraryError(
        f"{need} the library cadquery with the system's libGL and libX11, found: {found}; "
        "install them with: pip install 'markergen[solids]' && apt-get install libgl1 libx11-6"
    )


# Cached, since several files of one marker are often written in a row, and building solids takes most of the time.
@lru_cache(maxsize=1)
def solids_of(parts: tuple[Part, ...]) -> tuple[NamedSolid, ...]:
    """Build all parts; raises like `build`."""
    return tuple(map(build, parts))


def build(part: Part) -> NamedSolid:
    """Build one part.

    Raises
    ------
    OutputError
        If the kernel makes an invalid solid, or one whose volume is not the part's.
    MissingLibraryError
        If cadquery or one of its system libraries is missing.
    """
    import_cadquery()
    try:
        shape, floors = _joined(*([_solid(body) for body in bodies] for bodies in (part.add, part.cut, part.marked)))
        volume = shape.Volume()
        sound = shape.isValid() and abs(volume - part.volume) <= TOLERANCE * abs(volume)
    except Exception as error:
        # Open CASCADE raises errors of many classes, none of them Python's.
        raise _failed(part, " ".join(str(error).split()) or type(error).__name__) from None
    if not sound:
        raise _failed(part, f"{volume:.9g} mm^3 instead of {part.volume:.9g} mm^3")
    return NamedSolid(part.name, part.material, COLORS[part.material], shape, floors)


def _failed(part: Part, found: str) -> OutputError:
    return OutputError(
        f"expected Open CASCADE to make a valid solid of the part {part.name!r}, found {found}; change the depth, "
        "the thickness or the outline a little"
    )


def _solid(body: Body) -> Any:
    """TopoDS_Solid of a body."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism, BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pln, gp_Pnt, gp_Vec

    if isinstance(body, Prism) and body.chamfer:
        return _chamfered(body)
    if isinstance(body, Prism):
        level = gp_Pln(gp_Pnt(0, 0, body.bottom), gp_Dir(0, 0, 1))
        base = _face(level, [_wire(contour, body.bottom) for contour in (body.outer, *body.holes)])
        return BRepPrimAPI_MakePrism(base, gp_Vec(0, 0, body.top - body.bottom)).Shape()
    place = gp_Pnt(body.x, body.y, 0)
    profile = _face(gp_Pln(place, gp_Dir(0, -1, 0)), [_wire(body.profile, None, (body.x, body.y))])
    return BRepPrimAPI_MakeRevol(profile, gp_Ax1(place, gp_Dir(0, 0, 1))).Shape()


def _joined(added: Sequence[Any], cut: Sequence[Any], marked: Sequence[Any]) -> tuple[Any, tuple[Any, ...]]:
    """One cadquery.Solid of all added bodies less the others, and its level faces that are floors of marked bodies.

    Each operation takes all its arguments at once: Open CASCADE then cuts hundreds of pockets in a second.
    """
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse

    shape, floors = added[0], []
    if len(added) > 1:
        shape = _operated(BRepAlgoAPI_Fuse(), added[:1], added[1:]).Shape()
    if cut or marked:
        operation = _operated(BRepAlgoAPI_Cut(), [shape], [*cut, *marked])
        shape = operation.Shape()
        for body in marked:
            for face in _faces(body):
                if _side(face) < 0:
                    floors += list(operation.Modified(face)) or [face]
    solids = import_cadquery().Shape.cast(shape).Solids()
    if len(solids) != 1:
        raise ValueError(f"{len(solids)} pieces" if solids else "nothing")
    # The solid's own orientation of the faces is the reverse.
    (solid,) = solids
    faces = solid.Faces() if floors else []
    return solid, tuple(face for face in faces if any(face.wrapped.IsSame(floor) for floor in floors))


def _faces(shape: Any) -> list[Any]:
    """TopoDS_Faces of a TopoDS_Shape, with their orientation in it."""
    return [face.wrapped for face in import_cadquery().Shape.cast(shape).Faces()]


def _side(face: Any) -> int:
    """1 if a face is level with its outside above, -1 if below; 0 if it is not level."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Plane
    from OCP.TopAbs import TopAbs_REVERSED

    surface = BRepAdaptor_Surface(face)
    if surface.GetType() != GeomAbs_Plane:
        return 0
    position = surface.Plane().Position()
    up = position.Direction().Z() * (1 if position.Direct() else -1)
    if abs(up) < LEVEL:
        return 0
    return 1 if (up > 0) != (face.Orientation() == TopAbs_REVERSED) else -1


def _operated(operation: Any, arguments: Sequence[Any], tools: Sequence[Any]) -> Any:
    from OCP.TopTools import TopTools_ListOfShape

    for shapes, give in ((arguments, operation.SetArguments), (tools, operation.SetTools)):
        every = TopTools_ListOfShape()
        for shape in shapes:
            every.Append(shape)
        give(every)
    operation.Build()
    return operation


def _chamfered(body: Prism) -> Any:
    """Prism with a chamfer, sewn from its faces: the kernel's own chamfers fail where sides turn only slightly."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    rim, edge = body.top - body.chamfer, offset(body.outer, body.chamfer)
    lower, upper = (_solid(Prism(each, (), body.bottom, z)) for each, z in ((body.outer, rim), (edge, body.top)))
    sewing = BRepBuilderAPI_Sewing(NEAR)
    for face in _faces(lower):
        if _side(face) <= 0:
            sewing.Add(face)
    for face in _faces(upper):
        if _side(face) > 0:
            sewing.Add(face)
    pairs = list(zip(body.outer.sides, edge.sides, strict=True))
    whole = body.outer.is_circle
    for one, other in pairs[:1] if whole else pairs:
        sewing.Add(_slant(one, other, rim, body.top, 2 * pi if whole else 4 * atan(abs(one[2]))))
    sewing.Perform()
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell_s(sewing.SewedShape())).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    if not body.holes:
        return solid
    holes = [_solid(Prism(backward(hole), (), body.bottom, body.top)) for hole in body.holes]
    cut = _operated(BRepAlgoAPI_Cut(), [solid], holes).Shape()
    return import_cadquery().Shape.cast(cut).Solids()[0].wrapped


def _slant(one: Side, other: Side, low: float, high: float, angle: float) -> Any:
    """Face of a chamfer between a side and its inward offset: a plane, or a cone for an arc."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakePolygon
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Ax3, gp_Dir, gp_Pln, gp_Pnt

    (x, y), (u, v), bulge = one
    (p, q), (r, s), _ = other
    if not bulge:
        corners = [gp_Pnt(x, y, low), gp_Pnt(u, v, low), gp_Pnt(r, s, high), gp_Pnt(p, q, high)]
        along, wide = gp_Dir(u - x, v - y, 0), high - low
        # The inward normal of the side plus an equal upward component.
        normal = gp_Dir(along.Y() * wide, -along.X() * wide, wide)
        ring = BRepBuilderAPI_MakePolygon(*corners, True).Wire()
        return _face(gp_Pln(gp_Ax3(corners[0], normal, along)), [ring])
    axis = gp_Ax1(gp_Pnt(*center_of(one), 0), gp_Dir(0, 0, 1 if bulge > 0 else -1))
    edge = BRepBuilderAPI_MakeEdge(gp_Pnt(x, y, low), gp_Pnt(p, q, high)).Edge()
    return _faces(BRepPrimAPI_MakeRevol(edge, axis, angle).Shape())[0]


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
