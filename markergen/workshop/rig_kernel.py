"""Build the parts of a rig as Open CASCADE solids: the marker's own, moved, or a block sewn from its faces."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from markergen.occt import import_kernel
from markergen.solid.bodies import COLORS
from markergen.workshop.kernel import NEAR, NamedSolid, assembled, build, checked, explored
from markergen.workshop.rig_solids import Piece, RigPart


# Cached, since several files of one rig are often written in a row.
@lru_cache(maxsize=1)
def solids_of_rig(parts: tuple[RigPart, ...]) -> tuple[NamedSolid, ...]:
    """Build all parts, in the rig frame; raises as `build` does."""
    import_kernel()
    return tuple(_block(part) if part.is_block else _moved(part) for part in parts)


def _moved(part: RigPart) -> NamedSolid:
    (piece,) = part.pieces
    solid = build(piece.part)
    shape, floors = _placed(solid.shape, solid.marked, piece)
    return NamedSolid(part.name, part.material, solid.color, shape, floors)


def _block(part: RigPart) -> NamedSolid:
    """Sew a block from its faces."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
    from OCP.BRepLib import BRepLib
    from OCP.TopoDS import TopoDS

    def sewn() -> tuple[Any, tuple[Any, ...]]:
        sewing = BRepBuilderAPI_Sewing(NEAR)
        floors: list[Any] = []
        for piece in part.pieces:
            shell, marked = assembled(piece.part, face_only=True)
            shape, own = _placed(shell, marked, piece)
            floors += own
            for face in explored(shape, "FACE"):
                sewing.Add(face)
        sewing.Perform()
        solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell_s(sewing.SewedShape())).Solid()
        BRepLib.OrientClosedSolid_s(solid)
        return solid, tuple(TopoDS.Face_s(sewing.ModifiedSubShape(face)) for face in floors)

    shape, floors = checked(part.name, part.volume, sewn)
    return NamedSolid(part.name, part.material, COLORS[part.material], shape, floors)


def _placed(shape: Any, faces: Sequence[Any], piece: Piece) -> tuple[Any, tuple[Any, ...]]:
    """Move a shape, and faces of it, from the frame of its marker to that of the rig."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.gp import gp_Trsf
    from OCP.TopoDS import TopoDS

    way = gp_Trsf()
    way.SetValues(*np.column_stack([piece.rotation, piece.translation]).ravel().tolist())
    moved = BRepBuilderAPI_Transform(shape, way, True)
    return moved.Shape(), tuple(TopoDS.Face_s(moved.ModifiedShape(face)) for face in faces)
