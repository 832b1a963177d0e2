"""Artwork of a marker in its own frame, for a page or tiles: dots, cut lines, dashes, ticks, center cross, numbers.

What is cut and what is only kept free follows the rule of docs/conventions.md.
"""

# tests: tests/drawing/test_sheet_layout.py tests/cli/test_drawn_plates.py tests/workshop/drafting/test_views.py

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, hypot, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.drawing.colors import BLACK_ON_WHITE, Colors
from markergen.drawing.figure import Figure, quiet_radius
from markergen.drawing.scene import (
    BLACK,
    FINE,
    HAIRLINE,
    Box,
    Disk,
    Line,
    Shape,
    around_origin,
    bounds,
    frame_lines,
    ink_points,
    overlap,
    overlaps,
    rectangle,
    union,
)
from markergen.drawing.text import text, text_width
from markergen.geometry.contour import Contour, area, flattened
from markergen.geometry.outlines import walked
from markergen.geometry.region import Region
from markergen.model.boundary import Circle
from markergen.model.json_text import in_one_line
from markergen.model.openings import SHOWN, holes_beyond, openings

NUMBER_HEIGHT = 2.6
"""Digit height of dot numbers, mm on A4."""

GRAY_SHARE, PALE_SHARE, GROUND = 0.647, 0.4, 5.5
"""Shares of ink in the colors of numbers and dashes; width in mm on A4 of a printed ground around everything."""

TICK = 4.0
"""Length of an axis tick in mm on A4."""

CENTROID_PULL = 2e-3
"""Maximum shift in mm of a dot's centroid by an eccentric center cross."""

SHORTEST_ARM = 0.5
"""Minimum arm length of the center cross, mm; a shorter one would look like a speck."""

SPECK = 2.0
"""Length in mm up to which a line along the boundary, between two quiet zones, looks like dust, and is left out."""

AIR = 1.0
"""Gap between an outline and a tick or the center cross, mm."""

TRUE = 5e-4
"""Maximum distance in mm of a closed line from its circle."""

DASH, INKED, FEWEST_DASHES, FINEST = 3.0, 0.6, 6, 0.25
"""Length in mm on A4 of a dash with its gap, its inked share, least number on a closed line, and steps in mm."""

HEADINGS = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
"""Unit vectors of the four axis directions."""


@dataclass(frozen=True)
class MarkerArtwork:
    """Shapes by layer, mm, marker frame, the dots without room for their number, and sentences about the lines."""

    layers: dict[str, tuple[Shape, ...]]
    nameless: tuple[str, ...]
    notes: tuple[str, ...] = ()


def ground_box(figure: Figure, scale: float) -> Box:
    """Box filled by a printed ground: outline and quiet zones, with room for numbers around them."""
    left, bottom, right, top = union(figure.outline, figure.quiet)
    pad = GROUND * scale
    return left - pad, bottom - pad, right + pad, top + pad


def draw_artwork(
    figure: Figure,
    colors: Colors,
    scale: float,
    room: Box,
    ink: Array | None = None,
    rooms: Sequence[Box] | None = None,
) -> MarkerArtwork:
    """Draw a marker within a room.

    Parameters
    ----------
    scale : float
        Scale of numbers and ticks.
    room : box
        Bounds of numbers and ticks, mm, marker frame.
    ink : array (m, 2) or None
        Additional points that numbers must avoid.
    rooms : sequence of box or None
        Additional bounds of the number of each dot.
    """
    marker, dots = figure.marker, figure.dots
    boxes = [figure.tag_zone] if figure.tag_zone else []
    ground = ground_box(figure, scale) if colors.grounded else None
    room = ground or room
    center = np.zeros(2)
    clear = 1e3 * min(abs(float(shape.depth(center))) for shape in (marker.boundary, *marker.blocked))
    cut, free = cut_lines(figure, colors), free_lines(figure, colors, scale)
    on_tag = any(around_origin(box) for box in boxes)
    cross = [] if on_tag or not around_origin(room) else center_cross(scale, dots, clear, colors)
    reach = axis_reach(figure)
    # Ticks on the boundary are placed before the numbers, those displaced by a quiet zone after them.
    on_boundary = [
        tick
        for tick in axis_ticks(scale, room, reach, dots, figure.hole_boxes)
        if abs(hypot(*tick.points[0]) - reach[tick.name.removeprefix("axis")]) < 1e-6
    ]
    height = NUMBER_HEIGHT * scale
    names = [str(point.id) for point in marker.control_points]
    labels = [frame_lines(bounds(shape), FINE) for shape in figure.beside]
    taken = ink_points([*cut, *free, *cross, *on_boundary, *labels])
    if ink is not None:
        taken = np.concatenate([taken, ink])
    number_rooms = [overlap(room, dot_room) for dot_room in rooms] if rooms else [room] * len(dots)
    places = place_numbers(dots, names, height, number_rooms, (0.0, 0.0), taken, boxes)
    numbers = tuple(
        text(name, x, y - height / 2, height, "center", color=colors.mix(GRAY_SHARE), name=f"number-{name}")
        for name, place in zip(names, places, strict=True)
        if place is not None
        for x, y in [place]
    )
    beside = [*figure.hole_boxes, *(bounds(number) for number in numbers)]
    ticks = axis_ticks(scale, room, reach, dots, beside, colors.ink)
    return MarkerArtwork(
        {
            "ground": (rectangle(ground, "ground", colors.paper),) if ground else (),
            "dots": dots,
            "tag": figure.tag,
            "cut": tuple(cut),
            "marks": (*free, *cross, *ticks),
            "text": (*numbers, *figure.beside),
        },
        tuple(name for name, place in zip(names, places, strict=True) if place is None),
        _notes(figure, cut, free),
    )


def axis_ticks(
    scale: float,
    room: Box,
    reach: Mapping[str, float],
    dots: tuple[Disk, ...],
    boxes: Sequence[Box] = (),
    color: str = BLACK,
) -> list[Line]:
    """Short lines where the axes leave the boundary, or farther out if a quiet zone or a box is in the way.

    A tick is omitted if it would leave the `room` (mm, marker frame) or if its axis has the entire boundary behind it.
    `reach` is the result of `axis_reach`.
    """
    length = TICK * scale
    centers = np.array([[dot.x, dot.y] for dot in dots])
    blocked = np.array([quiet_radius(dot) + FINE for dot in dots])
    ticks = []
    for name, heading in HEADINGS.items():
        along, across = centers @ heading, centers @ heading[::-1]
        half = np.sqrt(np.maximum(blocked**2 - across**2, 0))
        zones = list(zip(along - half, along + half, strict=True))
        zones += [_shadow(box, heading, 2 * scale) for box in boxes]
        start = reach[name]
        # Sorted by their start, so one pass moves the tick beyond all zones that it would touch.
        for low, high in sorted(zones):
            if low < high and low < start + length and high > start:
                start = float(high)
        foot, tip = ((at * heading[0], at * heading[1]) for at in (start, start + length))
        left, bottom, right, top = room
        if start > 0 and left <= tip[0] <= right and bottom <= tip[1] <= top:
            ticks.append(Line((foot, tip), FINE, f"axis{name}", color))
    return ticks


def _shadow(box: Box, heading: tuple[int, int], air: float) -> tuple[float, float]:
    """Distances at which a ray from the origin enters and leaves a box with a margin around it; (0, 0) if it misses."""
    low, high = np.array(box[:2]) - air, np.array(box[2:]) + air
    side = 1 - int(np.argmax(np.abs(heading)))
    if not low[side] < 0 < high[side]:
        return 0.0, 0.0
    ends = sorted((float(low @ heading), float(high @ heading)))
    return ends[0], ends[1]


def center_cross(scale: float, dots: tuple[Disk, ...], room: float, colors: Colors) -> list[Line]:
    """Fine cross at the origin: ink on paper, paper on a dot, omitted where it would disturb a dot.

    A cross on a dot, e mm off the dot's center, shifts the dot's centroid by area(cross) e / area(dot); its arms are
    shortened until the shift is below `CENTROID_PULL`. The cross is omitted if its arms become too short to see, or if
    it lies in a dot's quiet zone but off the dot; the axis ticks still mark the center. The distance `room` in mm to
    the nearest outline also limits the arms.
    """
    arm, width, color = min(3.0 * scale, room - AIR), HAIRLINE, colors.ink
    for dot in dots:
        offset = hypot(dot.x, dot.y)
        if offset >= quiet_radius(dot) + arm:
            continue
        width, in_hole = 0.1, offset < dot.inner_radius
        color = colors.ink if in_hole else colors.paper
        if in_hole:
            inside = dot.inner_radius - offset
        else:
            inside = min(dot.radius - offset, offset - dot.inner_radius if dot.inner_radius else dot.radius)
        arm = min(arm, inside / 2)
        if offset:
            ink = pi * (dot.radius**2 - dot.inner_radius**2)
            arm = min(arm, CENTROID_PULL * ink / (4 * width * offset))
    if arm < SHORTEST_ARM:
        return []
    return [
        Line(((-arm, 0.0), (arm, 0.0)), width, "center-x", color),
        Line(((0.0, -arm), (0.0, arm)), width, "center-y", color),
    ]


def cut_lines(figure: Figure, colors: Colors) -> list[Line]:
    """Lines to cut along, mm, marker frame: ``boundary-0``... along the boundary, and ``hole-0``... of `openings`.

    A hole's line is closed, as is every line in a cutter's color, which leaves no ink; hairlines along the boundary are
    interrupted at quiet zones, and those too short to be more than a speck are left out.
    """
    whole = colors.cut != BLACK_ON_WHITE.cut
    paths = [_path(figure, contour) for contour in figure.marker.boundary.contours() if area(contour) > 0]
    lines = [
        run
        for rim, corner in paths
        for run in _runs(rim, np.ones(len(rim), dtype=bool) if whole else _clear(rim, figure), corner)
        if (run[0] == run[-1]).all() or np.hypot(*np.diff(run, axis=0).T).sum() > SPECK
    ]
    cut = [_line(run, f"boundary-{index}", colors.cut) for index, run in enumerate(lines)]
    for index, opening in enumerate(openings(figure.marker)):
        rim, corner = _path(figure, opening.contour)
        cut.append(_line(_closed(rim[corner]), f"hole-{index}", colors.cut))
    return cut


def free_lines(figure: Figure, colors: Colors, scale: float) -> list[Line]:
    """Dashes around what is told and not cut, interrupted at quiet zones; mm, marker frame.

    These are ``keep-out-0``... within the boundary, and the countersinks ``sink-0``... of the plate's holes.
    """
    marker, holes = figure.marker, enumerate(figure.marker.substrate.holes)
    sinks = [(f"sink-{index}", hole.rim) for index, hole in holes if hole.sink]
    dashes = []
    for name, shape in (*((f"keep-out-{index}", keep_out) for index, keep_out in enumerate(marker.keep_outs)), *sinks):
        runs: list[Array] = []
        for contour in shape.contours():
            rim, corner = _path(figure, contour, FINEST)
            free = _clear(rim, figure) & _dashes(rim, scale)
            if shape in marker.keep_outs:
                free &= marker.boundary.depth(rim / figure.factor / 1e3) > 0
            runs += _runs(rim, free, corner)
        dashes += [_line(run, f"{name}-{index}", colors.mix(PALE_SHARE)) for index, run in enumerate(runs)]
    return dashes


def _notes(figure: Figure, cut: Sequence[Line], free: Sequence[Line]) -> tuple[str, ...]:
    """Sentences about lines that are not where, or not as, a reader expects."""
    marker, notes = figure.marker, []
    if not cut or not all(line.closed for line in cut):
        notes.append(
            "The line along the boundary pauses in the quiet zones of dots; for a cutter, --colors black,cut:NAME "
            "draws it whole."
        )
    notes += holes_beyond(marker)
    drawn = {line.name.rpartition("-")[0] for line in free}
    hidden = [f"keep-out {k + 1}" for k in range(len(marker.keep_outs)) if f"keep-out-{k}" not in drawn]
    holes = enumerate(marker.substrate.holes)
    hidden += [f"the countersink of {hole}" for k, hole in holes if hole.sink and f"sink-{k}" not in drawn]
    if hidden:
        notes.append(f"Not shown, in quiet zones or outside the boundary: {in_one_line(hidden, SHOWN)}.")
    return tuple(notes)


def _path(figure: Figure, contour: Contour, step: float = 1.0) -> tuple[Array, NDArray[np.bool_]]:
    """Points (m, 2) in mm along a contour in m, at most a step apart, and which of them are its corners."""
    if (whole := contour.as_circle) is not None:
        x, y, radius = whole
        around = 2 * pi * radius * 1e3
        count = max(ceil(around / step), ceil(pi * sqrt(radius * 1e3 / (2 * TRUE))), 360)
        return Circle(radius, (x, y)).rim(count) * 1e3 * figure.factor, np.ones(count, dtype=bool)
    ring = np.array(flattened(contour, TRUE / 1e3) if contour.has_arcs else contour.points)
    points, corner = walked(ring * 1e3, step)
    return points * figure.factor, corner


def _clear(rim: Array, figure: Figure) -> NDArray[np.bool_]:
    """Points of a closed line whose segments cannot cross a quiet zone: outside by half a step or more."""
    spare = _steps(rim).max() / 2 + HAIRLINE
    free = np.ones(len(rim), dtype=bool)
    for dot in figure.dots:
        free &= np.hypot(*(rim - (dot.x, dot.y)).T) > quiet_radius(dot) + spare
    return free


def _dashes(rim: Array, scale: float) -> NDArray[np.bool_]:
    """Points of a closed line that are on its dashes, all of them equal."""
    steps = _steps(rim)
    way = np.cumsum(steps) - steps
    count = max(round(float(steps.sum()) / (DASH * scale)), FEWEST_DASHES)
    return np.asarray(way / steps.sum() * count % 1 < INKED)


def _steps(rim: Array) -> Array:
    return np.hypot(*(np.roll(rim, -1, axis=0) - rim).T)


def _line(run: Array, name: str, color: str) -> Line:
    return Line(tuple((float(x), float(y)) for x, y in run), HAIRLINE, name, color)


def _closed(corners: Array) -> Array:
    return np.concatenate([corners, corners[:1]])


def _runs(rim: Array, free: NDArray[np.bool_], corner: NDArray[np.bool_]) -> list[Array]:
    """Runs of consecutive free points of a closed line, reduced to their ends and the corners between them."""
    if free.all():
        return [_closed(rim[corner])]
    start = int(np.argmin(free))
    rim, free, corner = np.roll(rim, -start, axis=0), np.roll(free, -start), np.roll(corner, -start)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    runs = []
    for begin, end in edges.reshape(-1, 2):
        kept = corner[begin:end].copy()
        kept[[0, -1]] = True
        if end - begin > 1:
            runs.append(rim[begin:end][kept])
    return runs


def axis_reach(figure: Figure) -> dict[str, float]:
    """Distance of the outline from the origin along each axis, mm, beyond which ticks may begin.

    Only the outline within `AIR` of the axis counts, or all of it if there is none on that side.
    """
    region = Region.enclosed(ring * 1e3 * figure.factor for ring in figure.marker.boundary.outlines())
    whole = region.box
    beyond = max(map(abs, whole)) + AIR
    strips = Region.rectangle(-beyond, -AIR, beyond, AIR), Region.rectangle(-AIR, -beyond, AIR, beyond)
    boxes = [part.box if (part := region & strip) else None for strip in strips]
    reach = {}
    for name, heading in HEADINGS.items():
        axis, side = (0, heading[0]) if heading[0] else (1, heading[1])
        end = axis + (2 if side > 0 else 0)
        box = boxes[axis]
        reach[name] = side * (box[end] if box and side * box[end] > 0 else whole[end])
    return reach


# --- Places of numbers ------------------------------------------------------------------------------------------------

ANGLES = np.deg2rad([0, *(sign * step for step in range(10, 180, 10) for sign in (1, -1)), 180])
"""Candidate directions from a dot to its number, the outward one first."""


def place_numbers(
    dots: Sequence[Disk],
    labels: Sequence[str],
    height: float,
    rooms: Sequence[Box],
    center: tuple[float, float],
    ink: Array,
    boxes: Sequence[Box] = (),
) -> list[tuple[float, float] | None]:
    """Find centers (x, y) in mm for the numbers of the first dots; None for a dot without a free position.

    A number stands as close to its dot as the quiet zone permits, outward if possible, and closer to its dot than to
    any other, so that it is not mistaken for the neighbor's.

    Parameters
    ----------
    labels : sequence of str
        One for each dot that needs one.
    height : float
        Digit height, mm.
    rooms : sequence of box
        Bounds of each number.
    center : (x, y)
        Point from which "outward" is measured.
    ink : array (m, 2)
        Points of everything else that is drawn, dense enough that no number fits between two.
    boxes : sequence of box
        Areas without numbers.
    """
    centers = np.array([[dot.x, dot.y] for dot in dots])
    quiet = np.array([quiet_radius(dot) for dot in dots])
    taken: list[Box] = list(boxes)
    places: list[tuple[float, float] | None] = []
    for index, label in enumerate(labels):
        half = np.array([text_width(label, height) / 2, height / 2]) + 0.5 * height
        outward = centers[index] - center
        # A central dot has no outward direction; its number goes where a footnote mark would be.
        heading = np.arctan2(outward[1], outward[0]) if np.hypot(*outward) > dots[index].radius else np.pi / 4
        direction = np.stack([np.cos(heading + ANGLES), np.sin(heading + ANGLES)], axis=-1)
        # The support of the box in that direction: at that distance the box cannot overlap the circle.
        reach = quiet[index] + np.abs(direction) @ half
        candidates = np.concatenate(
            [centers[index] + (reach + extra * height)[:, None] * direction for extra in (0.2, 1, 2)]
        )
        place = next(
            (
                (float(middle[0]), float(middle[1]))
                for lead in (2 * height, 0.0)  # clearly the closest if possible, otherwise just the closest
                for middle in candidates
                if _free(middle, half, index, lead, centers, quiet, rooms[index], ink, taken)
            ),
            None,
        )
        places.append(place)
        if place is not None:
            taken.append(_box(np.array(place), half))
    return places


def _free(
    middle: Array,
    half: Array,
    dot: int,
    lead: float,
    centers: Array,
    quiet: Array,
    page: Box,
    ink: Array,
    taken: Sequence[Box],
) -> bool:
    left, bottom, right, top = box = _box(middle, half)
    if left < page[0] or bottom < page[1] or right > page[2] or top > page[3]:
        return False
    gap = np.hypot(*np.maximum(np.abs(centers - middle) - half, 0).T) - quiet
    if np.any(gap < 0) or np.any(np.delete(gap, dot) <= gap[dot] + lead):
        return False
    if len(ink) and np.any(np.all(np.abs(ink - middle) < half, axis=-1)):
        return False
    return not any(overlaps(box, other) for other in taken)


def _box(middle: Array, half: Array) -> Box:
    (left, bottom), (right, top) = (middle - half).tolist(), (middle + half).tolist()
    return left, bottom, right, top
