"""Parser of STEP and BREP files; `markergen.guard` runs this script in a child process for `verification.solid_files`.

Open CASCADE reads the files; their document is traversed here, since `cadquery.Assembly.importStep` refuses files of
other programs: a single part without an assembly, or an assembly with two parts of the same name.
"""

# tests: tests/verification/test_solid_readers.py

import importlib
from typing import Any

import numpy as np

from markergen.guard import as_file

MOST_FACES = 200_000
"""Maximum number of faces of all solids; a plate with an engraved back has thousands."""

LOOSE = 0.01
"""Largest distance in mm of an edge from its faces: 1e-7 in our files, up to 1e-3 in those of others; half of what
positions may be off by."""

CHORD, LARGE_CHORD, LONG_CHORD, TURN = 3e-5, 5e-6, 0.005, 0.2
"""Maximum distance of triangles from a solid, as a share of the diagonal of all, the same where it is more than a
distance in mm, and angle in rad between neighbors.

Of that diagonal, since a part in a wrong unit would have millions of triangles within an absolute distance. With the
first share alone, fillets on a plate of 0.5 m are 0.03 mm off; with 0.003 mm, twelve half-balls on one take 11 s.
"""

Json = dict[str, Any]
Reply = tuple[Json, dict[str, Any]]
Part = tuple[str, Any, Any, list[tuple[Any, Any]]]
"""Name, color, shape and face colors of a solid: red, green, blue and opacity, which is 0 for what is hidden."""


def prepare() -> None:
    """Import the reader; raises ImportError if the kernel or one of its system libraries is missing."""
    importlib.import_module("OCP.STEPCAFControl")


def step(data: bytes) -> Reply:
    """Read the parts of a STEP file in mm, placed as its assemblies have them."""
    return _reply(as_file(data, ".step", _step))


def brep(data: bytes) -> Reply:
    """Read the parts of an Open CASCADE BREP file."""
    return _reply(as_file(data, ".brep", _brep))


def _reply(parts: list[Part]) -> Reply:
    """Parts as the parser of meshes gives them, and what is wrong with each."""
    diagonal = _diagonal([shape for _, _, shape, _ in parts])
    chord = min(CHORD * diagonal, max(LARGE_CHORD * diagonal, LONG_CHORD))
    objects: list[Json] = []
    arrays, flaws = {}, []
    for number, (name, color, shape, painted) in enumerate(parts):
        palette = [list(paint) for paint in dict.fromkeys(tuple(paint) for _, paint in painted if paint)]
        corners, faces = _triangles(shape, chord)
        paints = [next((palette.index(list(paint)) for painted_face, paint in painted
                        if paint and painted_face.IsSame(face)), -1) for face in faces]  # fmt: skip
        arrays[f"corners{number}"] = np.concatenate([np.zeros((0, 3, 3)), *corners])
        if palette:
            arrays[f"paints{number}"] = np.repeat(paints, [len(of_face) for of_face in corners]).astype(int)
        opacity = min((paint[3] for paint in (color, *(paint for _, paint in painted)) if paint), default=1.0)
        of_part = [*_flaws(shape), *(["is hidden or transparent"] if opacity < 1 else [])]
        flaws += [f"{f'the part {name}' if name else f'part {number + 1}'} {flaw}" for flaw in of_part]
        palette, color = [paint[:3] for paint in palette], color and color[:3]
        objects.append({"name": name, "color": color, "palette": palette, "tool": ""})
    return {"objects": objects, "flaws": flaws}, arrays


def _diagonal(shapes: list[Any]) -> float:
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    for shape in shapes:
        BRepBndLib.Add_s(shape, box)
    return 0.0 if box.IsVoid() else float(box.SquareExtent() ** 0.5)


def _flaws(shape: Any) -> list[str]:
    from OCP.BRep import BRep_Tool
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.ShapeAnalysis import ShapeAnalysis_ShapeTolerance
    from OCP.TopAbs import TopAbs_SHELL, TopAbs_SOLID

    shells = _within(shape, TopAbs_SHELL)
    if not shells or not all(BRep_Tool.IsClosed_s(shell) for shell in shells):
        return ["has open edges: it encloses no volume"]
    loose = ShapeAnalysis_ShapeTolerance().Tolerance(shape, 1)
    if loose > LOOSE:
        return [f"has an edge that is up to {loose:.3g} mm off its faces"]
    if shape.ShapeType() == TopAbs_SOLID and BRepCheck_Analyzer(shape).IsValid():
        return []
    return ["is not a valid solid: it is inside out or intersects itself"]


def _triangles(shape: Any, chord: float) -> tuple[list[Any], list[Any]]:
    """Triangles (m, 3, 3) of each face of a shape within a distance in mm, and the faces."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_FACE, TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    if not chord > 0:
        return [], []
    BRepMesh_IncrementalMesh(shape, chord, False, TURN, False)
    corners, faces = [], []
    for face in _within(shape, TopAbs_FACE):
        place = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(TopoDS.Face_s(face), place)
        if mesh is None:
            continue
        move = place.Transformation()
        rows = [[move.Value(row, column) for column in (1, 2, 3, 4)] for row in (1, 2, 3)]
        points = np.array([mesh.Node(k + 1).Coord() for k in range(mesh.NbNodes())])
        # Rounded, so that faces that share an edge share its points.
        points = np.round(points @ np.array(rows)[:, :3].T + np.array(rows)[:, 3], 8)
        triangles = np.array([mesh.Triangle(k + 1).Get() for k in range(mesh.NbTriangles())]) - 1
        is_flipped = (face.Orientation() == TopAbs_REVERSED) != (np.linalg.det(np.array(rows)[:, :3]) < 0)
        corners.append(points[triangles[:, ::-1] if is_flipped else triangles])
        faces.append(face)
    return corners, faces


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
    reader.SetLayerMode(True)
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
    from OCP.Quantity import Quantity_ColorRGBA, Quantity_TOC_sRGB
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_ColorTool, XCAFDoc_DocumentTool

    layers, hidden = TDF_LabelSequence(), not XCAFDoc_ColorTool.IsVisible_s(label)
    tool = XCAFDoc_DocumentTool.LayerTool_s(label)
    tool.GetLayers(label, layers)
    hidden = hidden or any(not tool.IsVisible(layer) for layer in _sequence(layers))
    paint = Quantity_ColorRGBA()
    for kind in (XCAFDoc_ColorSurf, XCAFDoc_ColorGen):
        if XCAFDoc_ColorTool.GetColor_s(label, kind, paint):
            rgb = [float(value) for value in paint.GetRGB().Values(Quantity_TOC_sRGB)]
            return [*rgb, 0.0 if hidden else float(paint.Alpha())]
    return [1.0, 1.0, 1.0, 0.0] if hidden else None


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
