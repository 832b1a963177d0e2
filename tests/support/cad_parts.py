"""Parts of CAD files as `verify` reads them."""

from dataclasses import dataclass

import numpy as np

from markergen.guard import as_file
from markergen.read.meshes import step_parser
from markergen.verification.solid_files import read_solid


@dataclass(frozen=True, eq=False)
class CadPart:
    name: str
    color: tuple | None
    volume: float
    corners: np.ndarray
    flawed: bool

    @property
    def middle(self):
        """Mean of the corners: those of a rim are at equal distances, but not where it is widest."""
        return np.unique(self.corners.reshape(-1, 3).round(6), axis=0).mean(axis=0)


def cad_parts(data, kind="STEP"):
    solid = read_solid(kind, data, "the file")
    shapes = as_file(data, f".{kind.lower()}", step_parser._step if kind == "STEP" else step_parser._brep)
    return [
        CadPart(part.name, part.color, volume_of(shape), part.corners, bool(solid.flaws))
        for part, (_, _, shape, _) in zip(solid.objects, shapes, strict=True)
    ]


def volume_of(shape):
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    mass = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, mass)
    return mass.Mass()
