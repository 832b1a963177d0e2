"""Content of a fabrication drawing as plain data in mm: views of a solid, its sections, its parts and the text.

Independent of the representation of solids: `content` fills it in, `views` and `details` draw it.
"""
# tests: tests/workshop/drafting/test_content.py tests/workshop/drafting/test_rig_drawing.py

from dataclasses import dataclass
from typing import Literal

from markergen.drawing.scene import Box, Disk, Point, union
from markergen.geometry import contour
from markergen.geometry.contour import Contour


@dataclass(frozen=True)
class ViewFace:
    """Visible or cut face of a body; it hides the faces listed before it.

    Attributes
    ----------
    contours : tuple of Contour
        Outer contour, then the holes.
    material : {"light", "dark", "engraved", ""}
        Material, or letters engraved in it; empty for a through hole, which shows what is behind it.
    edges : tuple of Contour
        Closed edges within the face.
    fine : bool
        True if its outlines are drawn with thin lines.
    """

    contours: tuple[Contour, ...]
    material: str
    edges: tuple[Contour, ...] = ()
    fine: bool = False

    @property
    def box(self) -> Box:
        """Left, lower, right and upper end."""
        return union(*(contour.box(ring) for ring in self.contours))


@dataclass(frozen=True)
class Dimension:
    """Dimension between two positions along one direction, with its text."""

    start: float
    end: float
    text: str


@dataclass(frozen=True)
class Control:
    """Geometrical tolerance (ISO 1101), drawn as a frame of boxes.

    Attributes
    ----------
    symbol : {"position", "flatness", "perpendicularity", "parallelism", "angularity", "profile"}
    zone : str
        Width or diameter of the zone: ``\xd80.04``.
    datums : tuple of str
        Letters of the datums in their order.
    of : str
        What it applies to, written before the frame; empty if that is clear.
    """

    symbol: Literal["position", "flatness", "perpendicularity", "parallelism", "angularity", "profile"]
    zone: str
    datums: tuple[str, ...] = ()
    of: str = ""


@dataclass(frozen=True)
class Datum:
    """Datum feature (ISO 5459), and what it fixes of the marker frame.

    Attributes
    ----------
    kind : {"face", "rim", "edge", "hole"}
    text : str
        The feature: ``face that shows the dots``.
    place : str
        Where it is in the marker frame: ``y = [-52]``.
    at : (x, y)
        Point on an edge, or the center of a hole or rim.
    out : (x, y)
        Outward direction of an edge.
    """

    letter: str
    kind: Literal["face", "rim", "edge", "hole"]
    text: str
    place: str
    at: Point = (0.0, 0.0)
    out: Point = (0.0, 0.0)


@dataclass(frozen=True)
class Callout:
    """Callout of identical features, which names them once and points at them.

    Attributes
    ----------
    lines : tuple of str
        Words in brackets are theoretically exact: they are drawn in a box.
    places : tuple of (x, y, radius)
        Position and radius of each feature.
    pitch : float
        Radius of their pitch circle about the origin; 0 for none.
    controls : tuple of Control
        Tolerances drawn below the lines.
    datum : str
        Letter of the datum that the feature is, attached to the last control.
    area : tuple of (x, y, radius)
        What else no leader should run over.
    """

    lines: tuple[str, ...]
    places: tuple[tuple[float, float, float], ...]
    pitch: float = 0.0
    controls: tuple[Control, ...] = ()
    datum: str = ""
    area: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class SectionView:
    """Section through the solid, with coordinates along the cut and up.

    Attributes
    ----------
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
class EngravedText:
    """Lines of text, the height of their capitals, and the box that they occupy; mm."""

    lines: tuple[str, ...]
    height: float
    box: Box


@dataclass(frozen=True)
class TitleBlock:
    """Entries of the title block (ISO 7200); an empty one is a field to fill in by hand.

    Attributes
    ----------
    name, title : str
        Identification number, and a short description.
    process, material, general, finish, edges : str
        How it is made, of what, general tolerances, surface finish, and the state of edges.
    """

    name: str
    title: str
    process: str
    material: str = ""
    general: str = ""
    finish: str = ""
    edges: str = ""


@dataclass(frozen=True)
class Workpiece:
    """Complete content of a fabrication sheet.

    Attributes
    ----------
    front, side : tuple of ViewFace
        Views from +z with y up, and from -y with z up; x is to the right in both.
    back : tuple of ViewFace
        View from -z with y up, so that x is to the left; empty if there is nothing to show.
    engraved : tuple of EngravedText
        Text on the back, in its view; the letters are no faces of `back`.
    size : (width, height)
        Overall size in the front view.
    round : bool
        True if the plate is a disk, whose size is a diameter.
    listed : bool
        True if tables or another sheet describe the outline: then overall sizes are auxiliary, in parentheses.
    face : float
        Height of the plate's upper face.
    flatness : Control
        Tolerance of that face.
    parallelism : Control or None
        Of the back; None for a face of a body, whose other faces have their own.
    datums : tuple of Datum
        The first is that face.
    heights : tuple of Dimension
        Dimensions of the side view along z.
    key : tuple of (material, words)
        What fills and hatches mean: ``light`` or ``dark`` material, ``engraved``.
    labels, holes : tuple of Disk
        Dots and holes, with their numbers as names.
    notes : tuple of str
        Paragraphs.
    """

    block: TitleBlock
    front: tuple[ViewFace, ...]
    side: tuple[ViewFace, ...]
    back: tuple[ViewFace, ...]
    engraved: tuple[EngravedText, ...]
    size: Point
    round: bool
    listed: bool
    face: float
    flatness: Control
    parallelism: Control | None
    datums: tuple[Datum, ...]
    labels: tuple[Disk, ...]
    holes: tuple[Disk, ...]
    callouts: tuple[Callout, ...]
    heights: tuple[Dimension, ...]
    sections: tuple[SectionView, ...]
    tables: tuple[DrawingTable, ...]
    key: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def around(faces: tuple[ViewFace, ...]) -> Box:
    """Bounding box of at least one face."""
    return union(*(face.box for face in faces))


def fixed(value: float, digits: int = 4) -> str:
    """Format a number for a table, such as a theoretically exact coordinate in mm; never -0."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def exact(value: float, digits: int = 4) -> str:
    """Format a theoretically exact number as in tables, but without trailing zeros."""
    return fixed(value, digits).rstrip("0").rstrip(".")


def millimeters(value: float) -> str:
    """Format a length in mm for a drawing: whole microns, no trailing zeros."""
    return exact(value, 3)
