"""Solids as BREP, Open CASCADE's own text format, which FreeCAD, Gmsh and CadQuery read: exact, without names."""

from collections.abc import Sequence
from io import BytesIO

from markergen.solid.build import NamedSolid
from markergen.solid.kernel import import_cadquery


def write_brep(solids: Sequence[NamedSolid]) -> bytes:
    """Write solids as one compound in mm, in the order given, without triangles."""
    cadquery = import_cadquery()
    from OCP.BRepTools import BRepTools
    from OCP.Message import Message_ProgressRange
    from OCP.TopTools import TopTools_FormatVersion

    compound = cadquery.Compound.makeCompound([solid.shape for solid in solids]).wrapped
    stream = BytesIO()
    BRepTools.Write_s(
        compound, stream, False, False, TopTools_FormatVersion.TopTools_FormatVersion_VERSION_1, Message_ProgressRange()
    )
    return stream.getvalue()
