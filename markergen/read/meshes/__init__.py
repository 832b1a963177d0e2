"""Triangles of mesh files and parts of CAD files of other programs, parsed in a child process."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Color = tuple[float, float, float]

MOST_OBJECTS = 20_000
"""Maximum number of objects, components, materials and so on."""

LONGEST = 200
"""Maximum length of a name."""


class MeshObject(NamedTuple):
    """Triangles of one object, in mm, with z pointing out of the printed face.

    Attributes
    ----------
    corners : array (m, 3, 3)
        Counterclockwise seen from outside.
    color : (red, green, blue) or None
    paints : array (m,) of int
        Index of each triangle's own color in `palette`, or -1 for the object's color.
    tool : str
        Number of the extruder that prints it, if the file has it.
    """

    corners: NDArray[Any]
    name: str = ""
    color: Color | None = None
    paints: NDArray[np.int64] | None = None
    palette: Sequence[Color] = ()
    tool: str = ""

    def mapped(self, matrix: NDArray[np.floating]) -> "MeshObject":
        """Map linearly by a matrix (3, 3) of positive determinant."""
        return self._replace(corners=self.corners @ matrix.T)
