"""Triangles of mesh files and parts of CAD files of other programs, parsed in a child process.

GLB and 3MF are parsed here, within limits that are checked before memory is taken. What was tried instead:

- trimesh for GLB reads files that are refused here (nodes in a cycle, required extensions, no scene), unpacks pictures,
  draws a node once that a scene lists 20,000 times, and rounds colors to 8 bits. The checks against it are most of the
  parser.
- lib3mf for 3MF is twice as fast and takes 1.6 times the memory, but holds corners in single precision, only
  warns of an unknown unit, reads a model that is cut short or has an invalid color without an error, and gives codes
  instead of what is wrong. PrusaSlicer's parts are not its business, so that the XML parser stays.
"""

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
