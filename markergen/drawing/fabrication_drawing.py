"""Content of a fabrication drawing as plain data in mm: views of a solid, its sections, its parts and the text.

Independent of the representation of solids: `markergen.solid` fills it in, `fabrication_views` draws it.
"""

from dataclasses import dataclass

from markergen.drawing.scene import Box, Point, union
from markergen.geometry import contour
from markergen.geometry.contour import Contour


@dataclass(frozen=True)
class ViewFace:
    """Visible or cut face of a body; it hides the faces listed before it.

    Attributes
    ----------
    contours : tuple of Contour
        Outer contour, then the holes.
    material : {"light", "dark", ""}
        Material; empty for a through hole, which shows what is behind it.
    edges : tuple of Contour
        Closed edges within the face.
    fine : bool
        True if its outlines are drawn with thin lines, as for engraved letters.
    """

    contours: tuple[Contour, ...]
    material: str
    edges: tuple[Contour, ...] = ()
    fine: bool = False

    @property
    def box(self) -> Box:
        """Left, lower, right and upper end."""
        return union(*(contour.box(each) for each in self.contours))


@dataclass(frozen=True)
class Dimension:
    """Dimension between two positions along one direction, with its text."""

    start: float
    end: float
    words: str


@dataclass(frozen=True)
class Callout:
    """Callout of identical features, which names them once and points at them.

    Attributes
    ----------
    lines : tuple of str
    places : tuple of (x, y, radius)
        Position and radius of each feature.
    pitch : float
        Radius of their pitch circle about the origin; 0 for none.
    """

    lines: tuple[str, ...]
    places: tuple[tuple[float, float, float], ...]
    pitch: float = 0.0


@dataclass(frozen=True)
class SectionView:
    """Section through the solid, with coordinates along the cut and up.

    Attributes
    ----------
    title : str
    faces : tuple of ViewFace
        Faces in (along the cut, z), clipped to the box.
    box : (left, bottom, right, top)
    across, upright : tuple of Dimension
        Dimensions along the cut and along z, shortest first.
    axes : tuple of float
        Positions along the cut of the axes of round features.
    """

    title: str
    faces: tuple[ViewFace, ...]
    box: Box
    across: tuple[Dimension, ...]
    upright: tuple[Dimension, ...]
    axes: tuple[float, ...] = ()


@dataclass(frozen=True)
class DrawingTable:
    """Rows of words under headings; numbers are right-aligned."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: tuple[int, ...] = ()
    """Left-aligned columns of words."""


@dataclass(frozen=True)
class DotLabel:
    """Number of a control point, at its dot; mm."""

    words: str
    x: float
    y: float
    radius: float
    inner_radius: float = 0.0


@dataclass(frozen=True)
class Workpiece:
    """Complete content of a fabrication sheet.

    Attributes
    ----------
    name, title : str
        Name of the marker, and a short description.
    process, materials : str
        Entries of the title block.
    front, side : tuple of ViewFace
        Views from +z with y up, and from -y with z up; x is to the right in both.
    back : tuple of ViewFace
        View from -z with y up, so that x is to the left; empty if there is nothing to show.
    size : (width, height)
        Overall size in the front view.
    round : bool
        True if the plate is a disk, whose size is a diameter.
    labels : tuple of DotLabel
    callouts : tuple of Callout
    heights : tuple of Dimension
        Dimensions of the side view along z.
    sections : tuple of SectionView
    tables : tuple of DrawingTable
    notes : tuple of str
        Paragraphs.
    """

    name: str
    title: str
    process: str
    materials: str
    front: tuple[ViewFace, ...]
    side: tuple[ViewFace, ...]
    back: tuple[ViewFace, ...]
    size: Point
    round: bool
    labels: tuple[DotLabel, ...]
    callouts: tuple[Callout, ...]
    heights: tuple[Dimension, ...]
    sections: tuple[SectionView, ...]
    tables: tuple[DrawingTable, ...]
    notes: tuple[str, ...]


def around(faces: tuple[ViewFace, ...]) -> Box:
    """Bounding box of at least one face."""
    return union(*(face.box for face in faces))


def millimeters(value: float) -> str:
    """Format a length in mm for a drawing: whole microns, no trailing zeros."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")
