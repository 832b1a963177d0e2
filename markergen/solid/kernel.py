"""Bodies as Open CASCADE has them: swept up or around, joined and cut by its Booleans."""

from collections.abc import Callable, Sequence
from math import atan, hypot, pi
from types import ModuleType
from typing import Any

from markergen.errors import MissingLibraryError
from markergen.geometry.contour import backward
from markergen.solid.bodies import Body, Path, Prism, Side, center_of, inset

NEAR = 1e-6
"""mm: edges that are closer are one."""

LEVEL = 1 - 1e-9
"""Least upright part of the normal of a face that counts as level."""


def import_cadquery() -> ModuleType:
    """Import cadquery, or say in one line what is missing and how to install it (MissingLibraryError)."""
    try:
        import cadquery
    except ImportError as error:
        raise missing_kernel("solids need", " ".join(str(error).split())) from None
    return cadquery


def missing_kernel(need: str, found: str) -> MissingLibraryError:
    """Error that says what is needed for, what was found, and what to install."""
    return MissingLibraryError(
        f"{need} the library cadquery with the system's libGL and libX11, found: {found}; "
        "install them with: pip install 'markergen[solids]' && apt-get install libgl1 libx11-6"
    )


def solid_of(body: Body) -> Any:
    """TopoDS_Solid of a body."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism, BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pln, gp_Pnt, gp_Vec

    if isinstance(body, Prism) and body.chamfer:
        return _chamfered(body)
    if isinstance(body, Prism):
        level = gp_Pln(gp_Pnt(0, 0, body.bottom), gp_Dir(0, 0, 1))
        base = _face(level, [_wire(path, body.bottom) for path in (body.outer, *body.holes)])
        return BRepPrimAPI_MakePrism(base, gp_Vec(0, 0, body.top - body.bottom)).Shape()
    place = gp_Pnt(body.x, body.y, 0)
    profile = _face(gp_Pln(place, gp_Dir(0, -1, 0)), [_wire(body.profile, None, (body.x, body.y))])
    return BRepPrimAPI_MakeRevol(profile, gp_Ax1(place, gp_Dir(0, 0, 1))).Shape()


def faces_of(shape: Any) -> list[Any]:
    """TopoDS_Faces of a shape, oriented as it has them."""
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopoDS import TopoDS

    return _explored(shape, TopAbs_FACE, TopoDS.Face_s)


def side_of(face: Any) -> int:
    """1 if a face is level and its outside is above it, -1 if below; 0 if it is not level."""
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


def joined(added: Sequence[Any], cut: Sequence[Any], marked: Sequence[Any]) -> tuple[Any, list[Any]]:
    """TopoDS_Solid of all that is added together less all the others, and its level faces at floors of what is marked.

    One operation with many arguments each: Open CASCADE then takes hundreds of pockets in a second.
    """
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse

    shape, floors = added[0], []
    if len(added) > 1:
        shape = _operated(BRepAlgoAPI_Fuse(), added[:1], added[1:]).Shape()
    if cut or marked:
        operation = _operated(BRepAlgoAPI_Cut(), [shape], [*cut, *marked])
        shape = operation.Shape()
        for body in marked:
            for face in faces_of(body):
                if side_of(face) < 0:
                    floors += list(operation.Modified(face)) or [face]
    (solid, *more) = _solids(shape) or [None]
    if solid is None or more:
        raise ValueError(f"{len(more) + 1} pieces" if more else "nothing")
    # As the solid has them, which is the other way around.
    return solid, [face for face in faces_of(solid) if any(face.IsSame(floor) for floor in floors)]


def _operated(operation: Any, arguments: Sequence[Any], tools: Sequence[Any]) -> Any:
    from OCP.TopTools import TopTools_ListOfShape

    for shapes, give in ((arguments, operation.SetArguments), (tools, operation.SetTools)):
        every = TopTools_ListOfShape()
        for shape in shapes:
            every.Append(shape)
        give(every)
    operation.Build()
    return operation


def _solids(shape: Any) -> list[Any]:
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    return _explored(shape, TopAbs_SOLID, TopoDS.Solid_s)


def _explored(shape: Any, kind: Any, cast: Callable[[Any], Any]) -> list[Any]:
    from OCP.TopExp import TopExp_Explorer

    found, explorer = [], TopExp_Explorer(shape, kind)
    while explorer.More():
        found.append(cast(explorer.Current()))
        explorer.Next()
    return found


def _chamfered(body: Prism) -> Any:
    """Prism with a chamfer, sewn from its faces: the kernel's own chamfers go wrong where sides turn by little."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    rim, edge = body.top - body.chamfer, inset(body.outer, body.chamfer)
    lower, upper = (solid_of(Prism(path, (), body.bottom, z)) for path, z in ((body.outer, rim), (edge, body.top)))
    sewing = BRepBuilderAPI_Sewing(NEAR)
    for face in faces_of(lower):
        if side_of(face) <= 0:
            sewing.Add(face)
    for face in faces_of(upper):
        if side_of(face) > 0:
            sewing.Add(face)
    pairs = list(zip(body.outer.sides, edge.sides, strict=True))
    whole = body.outer.is_circle
    for one, other in pairs[:1] if whole else pairs:
        sewing.Add(_slant(one, other, rim, body.top, 2 * pi if whole else 4 * atan(abs(one[2]))))
    sewing.Perform()
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell_s(sewing.SewedShape())).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    holes = [solid_of(Prism(backward(hole), (), body.bottom, body.top)) for hole in body.holes]
    return _solids(_operated(BRepAlgoAPI_Cut(), [solid], holes).Shape())[0] if holes else solid


def _slant(one: Side, other: Side, low: float, high: float, angle: float) -> Any:
    """Face from a side of a path up to the same side moved inward: of a plane, or of a cone for an arc of an angle."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakePolygon
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp_Ax1, gp_Ax3, gp_Dir, gp_Pln, gp_Pnt

    (x, y), (u, v), bulge = one
    (p, q), (r, s), _ = other
    if not bulge:
        corners = [gp_Pnt(x, y, low), gp_Pnt(u, v, low), gp_Pnt(r, s, high), gp_Pnt(p, q, high)]
        along, wide = gp_Dir(u - x, v - y, 0), high - low
        # The inward normal of the side, and as much upward.
        normal = gp_Dir(along.Y() * wide, -along.X() * wide, wide)
        ring = BRepBuilderAPI_MakePolygon(*corners, True).Wire()
        return _face(gp_Pln(gp_Ax3(corners[0], normal, along)), [ring])
    axis = gp_Ax1(gp_Pnt(*center_of(one), 0), gp_Dir(0, 0, 1 if bulge > 0 else -1))
    edge = BRepBuilderAPI_MakeEdge(gp_Pnt(x, y, low), gp_Pnt(p, q, high)).Edge()
    return faces_of(BRepPrimAPI_MakeRevol(edge, axis, angle).Shape())[0]


def _face(plane: Any, wires: Sequence[Any]) -> Any:
    """Face in a plane that is given, because one that Open CASCADE finds from the wire is off by rounding."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    maker = BRepBuilderAPI_MakeFace(plane, wires[0], True)
    for hole in wires[1:]:
        maker.Add(hole)
    return maker.Face()


def _wire(path: Path, height: float | None, axis: tuple[float, float] = (0.0, 0.0)) -> Any:
    """Wire at a height, or with a height of None upright in the half plane of positive x from the axis."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex, BRepBuilderAPI_MakeWire
    from OCP.gp import gp_Ax2, gp_Circ, gp_Dir, gp_Pnt

    def point(x: float, y: float) -> Any:
        return gp_Pnt(axis[0] + x, axis[1], y) if height is None else gp_Pnt(x, y, height)

    # About these a turn to the left in the path is a turn to the left in space.
    left = gp_Dir(0, -1, 0) if height is None else gp_Dir(0, 0, 1)
    right, along = left.Reversed(), gp_Dir(1, 0, 0)
    wire = BRepBuilderAPI_MakeWire()
    vertices = [BRepBuilderAPI_MakeVertex(point(*corner)).Vertex() for corner in path.points]
    bulges = path.bulges or (0.0,) * len(vertices)
    if (whole := path.as_circle) is not None:
        # Two half turns are a circle with one edge: half the faces, and what readers look for as a circle.
        x, y, radius = whole
        circle = gp_Circ(gp_Ax2(point(x, y), left if bulges[0] > 0 else right, along), radius)
        return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(circle).Edge()).Wire()
    for i, ((x, y), bulge) in enumerate(zip(path.points, bulges, strict=True)):
        j = (i + 1) % len(vertices)
        u, v = path.points[j]
        if not bulge:
            wire.Add(BRepBuilderAPI_MakeEdge(vertices[i], vertices[j]).Edge())
            continue
        center = center_of(((x, y), (u, v), bulge))
        radius = hypot(x - center[0], y - center[1])
        circle = gp_Circ(gp_Ax2(point(*center), left if bulge > 0 else right, along), radius)
        wire.Add(BRepBuilderAPI_MakeEdge(circle, vertices[i], vertices[j]).Edge())
    return wire.Wire()
