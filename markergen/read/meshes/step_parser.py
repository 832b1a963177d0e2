"""Parser of STEP and BREP files; `markergen.guard` runs this script in a child process for `verification.step`.

Open CASCADE reads the files; their document is traversed here, since `cadquery.Assembly.importStep` refuses files of
other programs: a single part without an assembly, or an assembly with two parts of the same name. numpy is not
imported, as it would take 80 MB of the memory that the child may use.
"""

# tests: tests/verification/test_solid_readers.py

import importlib
from math import ceil, pi, sqrt
from typing import Any

from markergen.guard import as_file

LEVEL = 1e-9
"""Maximum of 1 - |nz| for a level face: 0.003 degrees."""

SAME = 1e-6
"""Maximum difference in mm between arcs of one circle."""

STEPS = 16
"""Minimum number of points on a curved edge; a closed one has four times as many."""

MOST_STEPS = 1024
"""Maximum number of points on an arc."""

SAGITTA = 1e-3
"""Maximum distance in mm of an arc from the lines between its points, as far as that number allows."""

MOST_FACES = 200_000
"""Maximum number of faces of all solids; a plate with an engraved back has thousands."""

CHORD, TURN = 5e-4, 0.8
"""Distance as a share of a part's size, and angle in rad between neighbors, of the triangles that show where there is
something."""

SMALLEST_SIDE, MOST_SIDES = 0.02, 60
"""Minimum share of the largest level area, for a side to look at, and maximum number of pairs of opposite sides."""

Json = dict[str, Any]
Part = tuple[str, Any, Any, list[tuple[Any, Any]]]
"""Name, color, shape and face colors of a solid."""


def prepare() -> None:
    """Import the reader; raises ImportError if the kernel or one of its system libraries is missing."""
    importlib.import_module("OCP.STEPCAFControl")


def step(data: bytes) -> Json:
    """Read the parts of a STEP file in mm, placed as its assemblies have them."""
    return _whole(as_file(data, ".step", _step))


def brep(data: bytes) -> Json:
    """Read the parts of an Open CASCADE BREP file."""
    return _whole(as_file(data, ".brep", _brep))


def _whole(parts: list[Part]) -> Json:
    """Parts, and the corners of rough triangles of all of them."""
    described = [_described(*part) for part in parts]
    return {"parts": described, "triangles": [value for _, _, shape, _ in parts for value in _triangles(shape)]}


def _triangles(shape: Any) -> list[float]:
    """Coordinates of the corners of triangles within `CHORD` of a shape."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRep import BRep_Tool
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box)
    if box.IsVoid():
        return []
    # An absolute chord makes millions of triangles of a part in a wrong unit.
    BRepMesh_IncrementalMesh(shape, max(CHORD * box.SquareExtent() ** 0.5, SAGITTA), False, TURN, False)
    values: list[float] = []
    for face in _within(shape, TopAbs_FACE):
        place = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(TopoDS.Face_s(face), place)
        if mesh is None:
            continue
        move = place.Transformation()
        points = [mesh.Node(k + 1).Transformed(move) for k in range(mesh.NbNodes())]
        places = [(point.X(), point.Y(), point.Z()) for point in points]
        for k in range(mesh.NbTriangles()):
            for corner in mesh.Triangle(k + 1).Get():
                values += places[corner - 1]
    return values


def step_turned(data: bytes) -> Json:
    """Read a STEP file with its largest level area turned up, and with it turned down."""
    return _turned(as_file(data, ".step", _step))


def brep_turned(data: bytes) -> Json:
    """Read a BREP file as `step_turned` does a STEP file."""
    return _turned(as_file(data, ".brep", _brep))


def step_sides(data: bytes) -> Json:
    """Read a STEP file with each of its larger level areas turned up, and with each turned down."""
    return _turned(as_file(data, ".step", _step), SMALLEST_SIDE)


def brep_sides(data: bytes) -> Json:
    """Read a BREP file as `step_sides` does a STEP file."""
    return _turned(as_file(data, ".brep", _brep), SMALLEST_SIDE)


def _turned(parts: list[Part], smallest: float = 0.0) -> Json:
    """Views with the largest level area up and down, or with all whose share of it is at least `smallest`."""
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt, gp_Quaternion, gp_Trsf, gp_Vec
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopLoc import TopLoc_Location

    areas: dict[tuple[float, float, float], float] = {}
    ways: dict[tuple[float, float, float], tuple[float, float, float]] = {}
    for _, _, shape, _ in parts:
        for face in _within(shape, TopAbs_FACE):
            if (plane := _plane(face)) is not None:
                # Opposite normals together, since a plate's back is larger than its face.
                way, area = plane
                way = way if max(way, key=abs) > 0 else (-way[0], -way[1], -way[2])
                key = (round(way[0], 6), round(way[1], 6), round(way[2], 6))
                areas[key], ways[key] = areas.get(key, 0.0) + area, way
    order = sorted(areas, key=lambda normal: -areas[normal])
    sides = [normal for normal in order if areas[normal] >= smallest * areas[order[0]]][: MOST_SIDES if smallest else 1]
    views = []
    for x, y, z in (tuple(sign * value for value in ways[side]) for side in sides for sign in (1.0, -1.0)):
        if z > 1 - LEVEL and not smallest:
            continue
        move = gp_Trsf()
        if z < LEVEL - 1:
            move.SetRotation(gp_Ax1(gp_Pnt(), gp_Dir(1, 0, 0)), pi)
        else:
            move.SetRotation(gp_Quaternion(gp_Vec(x, y, z), gp_Vec(0, 0, 1)))
        place = TopLoc_Location(move)
        matrix = [[move.Value(row, column) for column in (1, 2, 3)] for row in (1, 2, 3)]
        turned = [
            (name, color, shape.Moved(place), [(face.Moved(place), paint) for face, paint in painted])
            for name, color, shape, painted in parts
        ]
        views.append({"turn": matrix, "parts": [_described(*part) for part in turned]})
    return {"views": views}


def _plane(face: Any) -> tuple[tuple[float, float, float], float] | None:
    """Normal and area of a plane face; None for others."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepGProp import BRepGProp
    from OCP.GeomAbs import GeomAbs_Plane
    from OCP.GProp import GProp_GProps
    from OCP.TopoDS import TopoDS

    surface = BRepAdaptor_Surface(TopoDS.Face_s(face), False)
    if surface.GetType() != GeomAbs_Plane:
        return None
    mass = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, mass)
    way = surface.Plane().Axis().Direction()
    return (way.X(), way.Y(), way.Z()), mass.Mass()


def _step(path: str) -> list[Part]:
    """Solids of a STEP file."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Interface import Interface_Static
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDF import TDF_LabelSequence
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    reader = STEPCAFControl_Reader()
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    if reader.ReadFile(path) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise ValueError("text that is no STEP")
    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    if not reader.Transfer(document):
        raise ValueError("entities that make no shape")
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    roots = TDF_LabelSequence()
    tool.GetFreeShapes(roots)
    return [part for label in _sequence(roots) for part in _labeled(label, None, "", None, 0)]


def _labeled(label: Any, place: Any, name: str, color: Any, depth: int) -> list[Part]:
    """Solids under a label of the document, at the location that an assembly gives them."""
    from OCP.TDF import TDF_Label, TDF_LabelSequence
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_ShapeTool

    place, name, color = place or TopLoc_Location(), _name(label) or name, _color(label) or color
    if depth > 50:
        raise ValueError("assemblies without an end")
    if XCAFDoc_ShapeTool.IsReference_s(label):
        meant = TDF_Label()
        XCAFDoc_ShapeTool.GetReferredShape_s(label, meant)
        moved = place.Multiplied(XCAFDoc_ShapeTool.GetLocation_s(label))
        return _labeled(meant, moved, name, color, depth + 1)
    if XCAFDoc_ShapeTool.IsAssembly_s(label):
        children = TDF_LabelSequence()
        XCAFDoc_ShapeTool.GetComponents_s(label, children, False)
        return [part for child in _sequence(children) for part in _labeled(child, place, name, color, depth + 1)]
    shape = XCAFDoc_ShapeTool.GetShape_s(label)
    painted = TDF_LabelSequence()
    XCAFDoc_ShapeTool.GetSubShapes_s(label, painted)
    # Keyed by shape without location: a face is the same in every place.
    faces = [(XCAFDoc_ShapeTool.GetShape_s(face), _color(face)) for face in _sequence(painted)]
    solids = []
    for solid in _solids(shape):
        solid_paint = next((paint for face, paint in faces if paint and face.IsSame(solid)), None)
        solids.append(
            (name, solid_paint or color, solid.Moved(place), [(face.Moved(place), paint) for face, paint in faces])
        )
    return solids


def _brep(path: str) -> list[Part]:
    from OCP.BRep import BRep_Builder
    from OCP.BRepTools import BRepTools
    from OCP.TopoDS import TopoDS_Shape

    shape = TopoDS_Shape()
    if not BRepTools.Read_s(shape, path, BRep_Builder()) or shape.IsNull():
        raise ValueError("text that is no BREP")
    return [("", None, solid, []) for solid in _solids(shape)]


def _sequence(labels: Any) -> list[Any]:
    return [labels.Value(k) for k in range(1, labels.Length() + 1)]


def _name(label: Any) -> str:
    from OCP.TDataStd import TDataStd_Name

    attribute = TDataStd_Name()
    if not label.FindAttribute(TDataStd_Name.GetID_s(), attribute):
        return ""
    return str(attribute.Get().ToExtString())


def _color(label: Any) -> list[float] | None:
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_ColorTool

    rgb = Quantity_Color()
    for kind in (XCAFDoc_ColorSurf, XCAFDoc_ColorGen):
        if XCAFDoc_ColorTool.GetColor_s(label, kind, rgb):
            return [float(value) for value in rgb.Values(Quantity_TOC_sRGB)]
    return None


def _solids(shape: Any) -> list[Any]:
    """Solids of a shape; if it has none, the shape itself, which is then open."""
    from OCP.TopAbs import TopAbs_SOLID

    return _within(shape, TopAbs_SOLID) or [shape]


def _within(shape: Any, kind: Any) -> list[Any]:
    from OCP.TopExp import TopExp_Explorer

    shapes: list[Any] = []
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More() and len(shapes) < MOST_FACES:
        shapes.append(explorer.Current())
        explorer.Next()
    return shapes


def _described(name: str, color: Any, shape: Any, painted: list[tuple[Any, Any]]) -> Json:
    from OCP.Bnd import Bnd_Box
    from OCP.BRep import BRep_Tool
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL, TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    mass, box = GProp_GProps(), Bnd_Box()
    BRepGProp.VolumeProperties_s(shape, mass)
    BRepBndLib.Add_s(shape, box)
    shells = _within(shape, TopAbs_SHELL)
    corners = [0.0] * 6 if box.IsVoid() else list(box.Get())
    faces: list[Json] = []
    backs: list[Json] = []
    balls: list[Json] = []
    for face in (TopoDS.Face_s(shape_face) for shape_face in _within(shape, TopAbs_FACE)):
        paint = next((paint for painted_face, paint in painted if paint and painted_face.IsSame(face)), None)
        level = _level(face)
        if level:
            (faces if level.pop("up") else backs).append({**level, "color": paint})
        ball = _ball(face)
        if ball:
            balls.append({**ball, "color": paint})
    return {
        "name": name,
        "color": color,
        "volume": mass.Mass(),
        "valid": shape.ShapeType() == TopAbs_SOLID and BRepCheck_Analyzer(shape).IsValid(),
        "closed": bool(shells) and all(BRep_Tool.IsClosed_s(shell) for shell in shells),
        "low": corners[:3],
        "high": corners[3:],
        "faces": faces,
        "backs": backs,
        "balls": balls,
    }


def _level(face: Any) -> Json | None:
    """Height and loops of a level face, and whether it faces up; None for other faces."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Plane
    from OCP.TopAbs import TopAbs_REVERSED, TopAbs_WIRE

    surface = BRepAdaptor_Surface(face, False)
    if surface.GetType() != GeomAbs_Plane:
        return None
    plane = surface.Plane()
    up = plane.Axis().Direction().Z() * (1.0 if plane.Direct() else -1.0)
    if abs(up) < 1 - LEVEL:
        return None
    loops = [loop for wire in _within(face, TopAbs_WIRE) if (loop := _loop(wire, face))["points"]]
    faces_up = (up > 0) != (face.Orientation() == TopAbs_REVERSED)
    return {"z": plane.Location().Z(), "loops": loops, "up": faces_up} if loops else None


def _loop(wire: Any, face: Any) -> Json:
    """Points along a wire, the circle if the entire wire lies on one, and whether it has straight sides."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.BRepTools import BRepTools_WireExplorer
    from OCP.GeomAbs import GeomAbs_Circle, GeomAbs_Line
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopoDS import TopoDS

    points: list[tuple[float, float]] = []
    circles: list[tuple[float, float, float]] = []
    turned, bent, straight = 0.0, True, False
    explorer = BRepTools_WireExplorer(TopoDS.Wire_s(wire), face)
    while explorer.More():
        curve = BRepAdaptor_Curve(explorer.Current())
        first, last = curve.FirstParameter(), curve.LastParameter()
        if explorer.Orientation() == TopAbs_REVERSED:
            first, last = last, first
        if curve.GetType() == GeomAbs_Circle:
            center = curve.Circle().Location()
            circles.append((center.X(), center.Y(), curve.Circle().Radius()))
            turned += abs(last - first)
        else:
            bent = False
        straight = straight or curve.GetType() == GeomAbs_Line
        steps = 1 if curve.GetType() == GeomAbs_Line else 4 * STEPS if curve.IsClosed() else STEPS
        if curve.GetType() == GeomAbs_Circle and not curve.IsClosed():
            # The lines of a drawn hole are compared with the drawing's.
            step = sqrt(8 * SAGITTA / curve.Circle().Radius())
            steps = min(max(steps, ceil(abs(last - first) / step)), MOST_STEPS)
        for k in range(steps):
            point = curve.Value(first + (last - first) * k / steps)
            points.append((point.X(), point.Y()))
        explorer.Next()
    same = all(max(abs(a - b) for a, b in zip(arc, circles[0], strict=True)) < SAME for arc in circles)
    whole = bent and same and abs(turned - 2 * pi) < 1e-6
    return {"points": points, "circle": circles[0] if whole else None, "straight": straight}


def _ball(face: Any) -> Json | None:
    """Center, radius, and plan-view radii of hole and rim, of a spherical face that bulges up."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
    from OCP.BRepTools import BRepTools
    from OCP.GeomAbs import GeomAbs_Circle, GeomAbs_Sphere
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_REVERSED
    from OCP.TopoDS import TopoDS

    surface = BRepAdaptor_Surface(face, False)
    if surface.GetType() != GeomAbs_Sphere:
        return None
    sphere = surface.Sphere()
    # Material outside of the sphere makes it a dent.
    if (face.Orientation() == TopAbs_REVERSED) == sphere.Direct():
        return None
    center, radius = sphere.Location(), sphere.Radius()
    heights = []
    u0, u1, v0, v1 = BRepTools.UVBounds_s(face)
    for i in range(5):
        for j in range(9):
            point = surface.Value(u0 + (u1 - u0) * i / 4, v0 + (v1 - v0) * j / 8)
            heights.append(point.Z() - center.Z())
    top, bottom = max(heights), min(heights)
    for edge in _within(face, TopAbs_EDGE):
        curve = BRepAdaptor_Curve(TopoDS.Edge_s(edge))
        if curve.GetType() == GeomAbs_Circle and abs(curve.Circle().Axis().Direction().Z()) > 1 - LEVEL:
            height = curve.Circle().Location().Z() - center.Z()
            # Bounds have only a few digits; edges are exact.
            top = height if abs(height - top) < 1e-6 * radius else top
            bottom = height if abs(height - bottom) < 1e-6 * radius else bottom
    # A ball may consist of two faces that meet at its equator.
    if top <= 1e-6 * radius:
        return None

    def around(height: float) -> float:
        return max(radius**2 - height**2, 0.0) ** 0.5

    hole = around(top) if top < radius * (1 - 1e-9) else 0.0
    place = {"x": center.X(), "y": center.Y(), "z": center.Z(), "radius": radius}
    return {**place, "hole": hole, "rim": around(max(bottom, 0.0))}
