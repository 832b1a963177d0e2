"""What a fabrication sheet shows, as plain data in mm: the views of a solid, its sections, its parts and the words.

Nothing in here knows how solids are described; `markergen.solid.sections` tells what is seen and cut of one.
"""

from dataclasses import dataclass

from markergen.drawing.scene import Box, Point

Ring = tuple[Point, ...]
"""Closed polygon, without its first corner again at the end."""


@dataclass(frozen=True)
class Face:
    """What is seen or cut of one body; it hides what comes before it.

    Attributes
    ----------
    rings : tuple of Ring
        Its outlines, filled even-odd.
    material : {"light", "dark", ""}
        Empty: a hole that one sees through.
    edges : tuple of Ring
        Closed edges in it.
    fine : bool
        Whether its outlines are drawn fine: letters that are engraved.
    """

    rings: tuple[Ring, ...]
    material: str
    edges: tuple[Ring, ...] = ()
    fine: bool = False

    @property
    def box(self) -> Box:
        """Left, lower, right and upper end."""
        xs, ys = zip(*(point for ring in self.rings for point in ring), strict=True)
        return min(xs), min(ys), max(xs), max(ys)


@dataclass(frozen=True)
class Span:
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
class Section:
    """A cut through the solid, across and up.

    Attributes
    ----------
    title : str
    faces : tuple of Face
        In (along the cut, z), clipped to the box.
    box : (left, bottom, right, top)
    across, upright : tuple of Span
        Dimensions, the shortest first; those upright are measured along z.
    axes : tuple of float
        Where along the cut the axes of round features are.
    """

    title: str
    faces: tuple[Face, ...]
    box: Box
    across: tuple[Span, ...]
    upright: tuple[Span, ...]
    axes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Table:
    """Rows of words under headings; numbers stand with their last digits below each other."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: tuple[int, ...] = ()
    """Columns of words, which begin on the left."""


@dataclass(frozen=True)
class Label:
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
    front, side : tuple of Face
        Seen from +z with y up, and from -y with z up; x is to the right in both.
    back : tuple of Face
        Seen from -z with y up, so that x is to the left; empty if there is nothing to see.
    size : (width, height)
        Of the whole seen from the front.
    round : bool
        Whether the plate is a disk, whose size is a diameter.
    labels : tuple of Label
    callouts : tuple of Callout
    heights : tuple of Span
        Dimensions of the side view along z.
    sections : tuple of Section
    tables : tuple of Table
    notes : tuple of str
        Paragraphs.
    """

    name: str
    title: str
    process: str
    materials: str
    front: tuple[Face, ...]
    side: tuple[Face, ...]
    back: tuple[Face, ...]
    size: Point
    round: bool
    labels: tuple[Label, ...]
    callouts: tuple[Callout, ...]
    heights: tuple[Span, ...]
    sections: tuple[Section, ...]
    tables: tuple[Table, ...]
    notes: tuple[str, ...]


def around(faces: tuple[Face, ...]) -> Box:
    """Box around faces, of which there is one at least."""
    boxes = [face.box for face in faces]
    return (
        min(box[0] for box in boxes),
        min(box[1] for box in boxes),
        max(box[2] for box in boxes),
        max(box[3] for box in boxes),
    )
