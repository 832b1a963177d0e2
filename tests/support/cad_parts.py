"""Parts of CAD files as `verify` reads them."""

from dataclasses import dataclass

import numpy as np

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
        points = self.corners.reshape(-1, 3)
        return (points.min(axis=0) + points.max(axis=0)) / 2


def cad_parts(data, kind="STEP"):
    solid = read_solid(kind, data, "the file")
    return [
        CadPart(part.name, part.color, volume, part.corners, bool(solid.flaws))
        for part, volume in zip(solid.objects, solid.volumes, strict=True)
    ]
