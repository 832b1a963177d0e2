"""The sheet: a marker at true size on paper, with what a person needs to check, mount and read it.

+--------------------------+
|       |  ticks on axes   |   everything but the dots keeps out of their quiet zones: a ring half a dot
|     o   o                |   diameter wide around each, which detectors need white
|  -  o + o  -  boundary   |
|       |                  |
|  |_|_|_|_| ruler   axes  |
|  ----------------------  |
|  marker  dots  size ...  |
+--------------------------+
"""

from dataclasses import dataclass
from math import ceil, hypot, inf

import numpy as np

from markergen.drawing import furniture
from markergen.drawing.furniture import size_words
from markergen.drawing.numbers import place_numbers, quiet_radius
from markergen.drawing.paper import ISO, PAPERS, Paper, find_paper
from markergen.drawing.scene import Disk, Layer, Line, Point, Scene, Shape, bounds, marker_dots, marker_name, moved
from markergen.drawing.text import text
from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.marker import Marker

NUMBER_HEIGHT = 2.6
"""Of the dots' numbers in mm on A4."""
MOST_LISTED = 12
"""Of the dots that a note names."""
_AWAY = "The marker's origin is not on the sheet; see the coordinates in marker.json."


@dataclass(frozen=True)
class Sheet:
    """A page ready for any printable format.

    Attributes
    ----------
    paper : Paper
    scene : Scene
        In mm from the page's lower left corner; layers ``dots``, ``marks`` and ``text``.
    origin_mm : (x, y)
        Where the marker's origin is on the page.
    ruler_mm : float
        Length of the printed ruler.
    title, description : str
        For the file's metadata.
    notes : tuple of str
        Sentences for the user.
    """

    paper: Paper
    scene: Scene
    origin_mm: Point
    ruler_mm: float
    title: str
    description: str
    notes: tuple[str, ...]


def sheet_for(marker: Marker, paper: str | None = None) -> Sheet:
    """Lay a marker out on paper, at true size.

    Parameters
    ----------
    marker : Marker
    paper : str or None
        Name of the paper (`find_paper`); None takes the smallest ISO size from A5 to A0 that holds everything.

    Raises
    ------
    InputError
        If a control point has no dot or lies off the plane, the paper is unknown, or the marker does not fit on it.
    """
    dots = marker_dots(marker)
    chosen, origin = _place(marker.boundary, dots, paper)
    return _compose(marker, chosen, origin, dots, smallest=paper is None)


def check_paper(boundary: Boundary, paper: str | None = None) -> None:
    """Refuse a boundary that the paper is too small for, whatever dots come to lie in it; see `sheet_for`."""
    _place(boundary, (), paper)


def _place(boundary: Boundary, dots: tuple[Disk, ...], paper: str | None) -> tuple[Paper, Point]:
    """The paper, and where on it the origin goes."""
    reach = _extent(boundary, dots)
    chosen = _smallest(reach) if paper is None else find_paper(paper)
    origin = _origin(chosen, reach) if chosen else None
    if chosen is None or origin is None:
        raise _too_small(reach, size_words(boundary), chosen)
    return chosen, origin


@dataclass(frozen=True)
class _Reach:
    """How far the outline and the quiet zones reach from the origin: left, down, right, up; mm."""

    outline: tuple[float, float, float, float]
    quiet: tuple[float, float, float, float]


def _extent(boundary: Boundary, dots: tuple[Disk, ...]) -> _Reach:
    left, down, right, up = map(float, furniture.box_mm(boundary))
    quiet = (
        max((quiet_radius(dot) - dot.x for dot in dots), default=-inf),
        max((quiet_radius(dot) - dot.y for dot in dots), default=-inf),
        max((quiet_radius(dot) + dot.x for dot in dots), default=-inf),
        max((quiet_radius(dot) + dot.y for dot in dots), default=-inf),
    )
    return _Reach((-left, -down, right, up), quiet)


def _needs(frame: furniture.Frame, reach: _Reach) -> tuple[float, float, float, float]:
    """Distances in mm that the origin must keep from the paper's left, lower, right and upper edge.

    Marks keep to the printable margin; quiet zones are blank and may fill it, but not leave the paper.
    """
    left, down, right, up = (side + furniture.TICK * frame.scale for side in reach.outline)
    return (
        max(frame.margin + left, reach.quiet[0]),
        frame.footer + max(down, reach.quiet[1]),
        max(frame.margin + right, reach.quiet[2]),
        max(frame.margin + up, reach.quiet[3]),
    )


def _origin(paper: Paper, reach: _Reach) -> Point | None:
    """Where the origin goes: centered across the paper if it can, in the middle of the room above the footer."""
    left, down, right, up = _needs(furniture.Frame(paper), reach)
    if left + right > paper.width or down + up > paper.height:
        return None
    aside = (reach.outline[2] - reach.outline[0]) / 2
    x = min(max(paper.width / 2 - aside, left), paper.width - right)
    return x, (down + paper.height - up) / 2


def _smallest(reach: _Reach) -> Paper | None:
    return next((paper for size in ISO for paper in (size, size.landscape) if _origin(paper, reach)), None)


def _too_small(reach: _Reach, size: str, paper: Paper | None) -> InputError:
    left, down, right, up = _needs(furniture.Frame(paper or ISO[-1]), reach)
    room = f"{ceil(left + right)} x {ceil(down + up)} mm"
    fit = _smallest(reach) or next((p for p in PAPERS.values() if _origin(p, reach)), None)
    if paper is None:
        found = f"a marker {size} that needs {room}"
        remedy = f"use --paper {fit.name}" if fit else "design a smaller one, or export it as .step"
        return InputError("a marker that A0 paper holds", found, remedy)
    return InputError(
        f"paper of at least {room} for a marker {size}",
        str(paper),
        f"use --paper {fit.name}" if fit else "no known paper holds it: design a smaller one, or export it as .step",
    )


def _compose(marker: Marker, paper: Paper, origin: Point, dots: tuple[Disk, ...], smallest: bool) -> Sheet:
    frame = furniture.Frame(paper)
    placed = tuple(moved(dot, *origin) for dot in dots)
    reach = furniture.axis_reach(marker.boundary)
    center = np.zeros(2)
    room = 1e3 * min(abs(float(shape.depth(center))) for shape in (marker.boundary, *marker.keep_outs))
    marks = [
        *furniture.boundary_lines(marker, origin, placed),
        *(furniture.center_cross(frame, origin, placed, room) if _inside(frame, origin) else ()),
    ]
    # Ticks that stand on the boundary come before the numbers; those that a quiet zone pushes out come after them.
    on_boundary = [
        tick
        for tick in furniture.axis_ticks(frame, origin, reach, placed)
        if _starts(tick, origin, reach[tick.name.removeprefix("axis")])
    ]
    names = [str(point.id) for point in marker.control_points]
    height = NUMBER_HEIGHT * frame.scale
    ink = furniture.ink_points([*marks, *on_boundary])
    places = place_numbers(placed, names, height, frame.region, origin, ink)
    numbers: list[Shape] = [
        text(name, x, y - height / 2, height, "center", color=furniture.GRAY, name=f"number-{name}")
        for name, place in zip(names, places, strict=True)
        if place is not None
        for x, y in [place]
    ]
    ticks = furniture.axis_ticks(frame, origin, reach, placed, [bounds(number) for number in numbers])
    ruler_mm = furniture.ruler_length(frame)
    ruler_marks, ruler_text = furniture.ruler(frame, ruler_mm)
    axes_marks, axes_text = furniture.axes(frame)
    block_marks, block_text = furniture.title_block(frame, marker)
    scene = Scene(
        (
            Layer("dots", placed),
            Layer("marks", (*marks, *ticks, *ruler_marks, *axes_marks, *block_marks)),
            Layer("text", (*numbers, *ruler_text, *axes_text, *block_text)),
        )
    )
    nameless = [name for name, place in zip(names, places, strict=True) if place is None]
    size = size_words(marker.boundary)
    return Sheet(
        paper,
        scene,
        origin,
        ruler_mm,
        marker_name(marker),
        f"Fiducial marker with {len(marker)} dots, {size}, at true size on {paper}. Print at 100 %.",
        _notes(f"{'needs' if smallest else 'stands on'} {paper}", size, ruler_mm, nameless)
        + (() if _inside(frame, origin) else (_AWAY,)),
    )


def _inside(frame: furniture.Frame, origin: Point) -> bool:
    left, bottom, right, top = frame.region
    return left <= origin[0] <= right and bottom <= origin[1] <= top


def _starts(tick: Line, origin: Point, reach: float) -> bool:
    foot = tick.points[0]
    return abs(hypot(foot[0] - origin[0], foot[1] - origin[1]) - reach) < 1e-6


def _notes(where: str, size: str, ruler_mm: float, nameless: list[str]) -> tuple[str, ...]:
    notes = [
        f"The marker {where}: {'its disk' if size.endswith('across') else 'its outline'} is {size}.",
        f"Print at 100 %, then check that the ruler on the sheet measures {ruler_mm:g} mm.",
    ]
    if nameless:
        more = len(nameless) - MOST_LISTED
        listed = ", ".join(nameless[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
        which = f"Dot {listed} has" if len(nameless) == 1 else f"Dots {listed} have"
        notes.append(f"{which} no room for a number outside the quiet zones; see the coordinates in marker.json.")
    return tuple(notes)
