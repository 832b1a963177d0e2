"""Closed meshes of solids within a tolerance of the surface, reproducible from run to run.

Open CASCADE makes the triangles, but not through cadquery's `tessellate`, which has one tolerance for balls, bores and
letters alike and keeps the order of the faces. Here the points of all parts lie on a common grid.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, log2, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import OutputError
from markergen.solid.kernel import NamedSolid

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ANGLE = 2 * pi / 96
"""Maximum angle in rad of a chord as the kernel counts it; a circle gets up to twice as many chords.

Cylinders therefore lose at most 0.02 % of their volume and balls 0.08 %, however small they are.
"""

CLOSER = 2.2
"""Factor by which the kernel's tolerance is reduced, since on balls it exceeds its tolerance up to 2.1 times."""

FINEST = -14
"""Exponent of 2, in mm, of the finest grid for points, 0.06 um; all markers of up to half a meter share it.

On this grid parts that touch have their points in common.
"""


@dataclass(frozen=True)
class Mesh:
    """A closed surface of triangles.

    Attributes
    ----------
    points : array (n, 3)
        In mm, marker frame, without duplicates, exactly representable as 32-bit floats.
    triangles : array (m, 3)
        Indices of points, counterclockwise as seen from outside.
    marked : array (m,) of bool
        True for triangles of a face with the other material's color.
    """

    points: Array
    triangles: Indices
    marked: NDArray[np.bool_]

    @property
    def volume(self) -> float:
        """Enclosed volume in mm^3."""
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def mesh_of(solid: NamedSolid, tolerance: float) -> Mesh:
    """Mesh a solid; no point of its surface is farther than `tolerance` mm from the mesh.

    Raises
    ------
    OutputError
        If Open CASCADE does not make a closed mesh of it.
    """
    corners, marked = _triangulate(solid, tolerance)
    grid = _grid(corners)
    ticks, index = np.unique(np.round(corners.reshape(-1, 3) / grid).astype(np.int64), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    # The lowest index first, then sorted, so that the kernel's order of faces does not matter.
    first = np.argmin(triangles, axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    order = np.lexsort(triangles.T[::-1])
    # On the grid a very short edge may have collapsed to a point.
    order = order[_proper(triangles[order])]
    mesh = Mesh(np.asarray(ticks * grid, float), triangles[order], marked[order])
    if not is_closed(mesh.triangles):
        raise OutputError(
            f"expected Open CASCADE to make a closed mesh of the part {solid.name!r}, found gaps; "
            "choose a finer or a coarser --tolerance"
        )
    return mesh


def is_closed(triangles: Indices) -> bool:
    """Tell whether every edge is shared by two triangles of the same orientation."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = int(triangles.max(initial=0)) + 1
    forward = edges[:, 0] * count + edges[:, 1]
    backward = edges[:, 1] * count + edges[:, 0]
    return len(np.unique(forward)) == len(forward) and np.array_equal(np.sort(forward), np.sort(backward))


def kept_apart(meshes: Sequence[Mesh]) -> list[Mesh]:
    """Separate meshes with common points: such points of a later mesh move 0.1 um into their own part.

    An inlay fills its pocket without a gap. Programs that merge equal points would find edges with four triangles
    there and report a leak.
    """
    seen: set[bytes] = set()
    apart = []
    for mesh in meshes:
        shared = np.array([point.tobytes() in seen for point in mesh.points])
        points = np.where(shared[:, None], mesh.points - _inward_step(mesh), mesh.points)
        seen.update(point.tobytes() for point in points)
        apart.append(replace(mesh, points=points))
    return apart


def _inward_step(mesh: Mesh) -> Array:
    """Step of two grid units against each point's outward normal: level if possible, since heights are measured."""
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    normals = np.zeros_like(mesh.points)
    for corner in mesh.triangles.T:
        np.add.at(normals, corner, np.cross(b - a, c - a))
    level = normals * [1, 1, 0]
    upright = np.linalg.norm(level, axis=1) < 1e-6 * np.linalg.norm(normals, axis=1)
    ways = np.where(upright[:, None], normals, level)
    length = np.linalg.norm(ways, axis=1, keepdims=True)
    return np.round(2 * np.divide(ways, length, out=np.zeros_like(ways), where=length > 0)) * _grid(mesh.points)


def _grid(points: Array) -> float:
    """Grid spacing: twice that of 32-bit floats at the largest coordinate, so that points stay distinct in mm or m."""
    return 2.0 ** max(FINEST, ceil(log2(np.abs(points).max())) - 22)


def _proper(triangles: Indices) -> NDArray[np.bool_]:
    """Tell which triangles have three different corners."""
    a, b, c = triangles.T
    return (a != b) & (b != c) & (c != a)


def _triangulate(solid: NamedSolid, tolerance: float) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (m, 3, 3) of the triangles of all faces, and whether their face is marked."""
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools

    shape = solid.shape.wrapped
    # An earlier mesh would be reused for this one and written with the shape.
    BRepTools.Clean_s(shape)
    # The kernel keeps those parts of a first mesh that are accurate enough, including points on edges.
    BRepMesh_IncrementalMesh(_parts_of_turns(solid), _parameters(tolerance, pi / 4))
    BRepMesh_IncrementalMesh(shape, _parameters(tolerance, ANGLE))
    corners, marked = [], []
    for face in solid.shape.Faces():
        found = _face_corners(face)
        corners.append(found)
        marked.append(np.full(len(found), any(face.isSame(other) for other in solid.marked)))
    BRepTools.Clean_s(shape)
    return np.concatenate(corners), np.concatenate(marked)


def _parameters(tolerance: float, angle: float) -> Any:
    from OCP.IMeshTools import IMeshTools_Parameters

    parameters = IMeshTools_Parameters()
    parameters.Deflection = parameters.DeflectionInterior = tolerance / CLOSER
    parameters.Angle = parameters.AngleInterior = angle
    parameters.InParallel = False
    return parameters


def _parts_of_turns(solid: NamedSolid) -> Any:
    """Vertical round faces of less than half a turn: letters and rounded corners, whose volume matters little.

    An engraved back has hundreds of them, which would make up most of the mesh if they were as fine as dots.
    """
    from OCP.BRep import BRep_Builder
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Cylinder
    from OCP.TopoDS import TopoDS_Compound

    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    for face in solid.shape.Faces():
        surface = BRepAdaptor_Surface(face.wrapped)
        if surface.GetType() == GeomAbs_Cylinder and surface.LastUParameter() - surface.FirstUParameter() < 0.99 * pi:
            builder.Add(compound, face.wrapped)
    return compound


def _face_corners(face: Any) -> Array:
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    location = TopLoc_Location()
    surface = BRep_Tool.Triangulation_s(face.wrapped, location)
    if surface is None:
        return np.zeros((0, 3, 3))
    move = location.Transformation()
    nodes = [surface.Node(number).Transformed(move).Coord() for number in range(1, surface.NbNodes() + 1)]
    triangles = np.array([surface.Triangle(number).Get() for number in range(1, surface.NbTriangles() + 1)]) - 1
    if face.wrapped.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        triangles = triangles[:, ::-1]
    return np.array(nodes)[triangles]
