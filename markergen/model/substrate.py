"""The substrate: the plate that carries the dots when a marker is made as a solid."""

from dataclasses import dataclass
from typing import Literal

from markergen.model.boundary import Boundary


@dataclass(frozen=True)
class Hole:
    """A round hole through the plate.

    Attributes
    ----------
    x, y : float
        Of its axis in the marker frame, m.
    diameter : float
        m.
    sink : float
        Diameter in m of a countersink of 90 degrees at the printed face; 0 is none.
    use : {"mount", "dowel"}
        A screw goes through the one, a pin that tells where the frame is fits the other.
    name : str
        What goes through, such as ``M3``.
    """

    x: float
    y: float
    diameter: float
    sink: float = 0.0
    use: Literal["mount", "dowel"] = "mount"
    name: str = ""


@dataclass(frozen=True)
class Substrate:
    """A plate whose upper face is z = 0.

    Attributes
    ----------
    thickness : float
        m.
    edge : float
        Least width in m of the plate outside of the boundary; without effect where an outline is given.
    corner_radius : float
        Of the outline's corners seen from above, m.
    chamfer : float
        Of the edge around the upper face, 45 degrees, m.
    outline : Boundary or None
        The plate's own outline; None is the boundary with its edge around it.
    holes : tuple of Hole
    """

    thickness: float = 0.003
    edge: float = 0.002
    corner_radius: float = 0.0
    chamfer: float = 0.0
    outline: Boundary | None = None
    holes: tuple[Hole, ...] = ()
