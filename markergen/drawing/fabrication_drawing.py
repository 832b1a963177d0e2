"""Content of a fabrication drawing as plain data in mm: views of a solid, its sections, its parts and the words.

Independent of how solids are described: `markergen.solid` fills it in, `fabrication_views` draws it.
"""

from dataclasses import dataclass

from markergen.drawing.scene import Box, Point, union
from markergen.geometry import contour
from markergen.geometry.contour import Contour


@dataclass(frozen=True)
class ViewFace:
    """Visible or cut face of one body; it hides the faces before it.

    Attributes
    ----------
    contours : tuple of Contour
        Its outer contour, then the holes in it.
    material : {"light", "dark", ""}
        Empty: a hole that one sees through.
    edges : tuple of Contour
        Closed edges in it.
    fine : bool
        Whether its outlines are drawn fine: letters that are engraved.
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
    """A dimension between two places along one direction, with what is written on it."""

    start: float
    end: float
    words: str


@dataclass(frozen=True)
class Callout:
    """Features that are alike, named once and pointed at.

    Attributes
    ----------
    lines : tuple of str
    places : tuple of (x, y, radius)
        Of each of them.
    pitch : float
        Radius of the circle around the origin that all of them are on; 0 if there is none.
    """

    lines: tuple[str, ...]
    places: tuple[tuple[float, float, float], ...]
    pitch: float = 0.0


@dataclass(frozen=True)
class SectionView:
    """A cut through the solid, across and up.

    Attributes
    ----------
    title : str
    faces : tuple of ViewFace
        In (along the cut, z), clipped to the box.
    box : (left, bottom, right, top)
    across, upright : tuple of Dimension
        Dimensions, the shortest first; those upright are measured along z.
    axes : tuple of float
        Where along the cut the axes of round features are.
    """

    title: str
    faces: tuple[ViewFace, ...]
    box: Box
    across: tuple[Dimension, ...]
    upright: tuple[Dimension, ...]
    axes: tuple[float, ...] = ()


@dataclass(frozen=True)
class DrawingTable:
    """Rows of words under headings; numbers stand with their last digits below each other."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: tuple[int, ...] = ()
    """Columns of words, which begin on the left."""


@dataclass(frozen=True)
class DotLabel:
    """The number of a control point, at its dot; mm."""

    words: str
    x: float
    y: float
    radius: float
    inner_radius: float = 0.0


@dataclass(frozen=True)
class Workpiece:
    """All that a fabrication sheet says.

    Attributes
    ----------
    name, title : str
        The marker's name, and what it is in a few words.
    process, materials : str
        For the title block.
    front, side : tuple of ViewFace
        Seen from +z with y up, and from -y with z up; x is to the right in both.
    back : tuple of ViewFace
        Seen from -z with y up, so that x is to the left; empty if there is nothing to see.
    size : (width, height)
        Of the whole seen from the front.
    round : bool
        Whether the plate is a disk, whose size is a diameter.
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
    """Box around faces, of which there is one at least."""
    return union(*(face.box for face in faces))


def millimeters(value: float) -> str:
    """Length in mm as it is written on a drawing: whole microns, no zeros behind."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")
