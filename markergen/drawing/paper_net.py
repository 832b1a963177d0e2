"""Paper net of a rig: all faces in one piece, to be cut out, folded, and glued by flaps; edges at which plates meet.

The faces are unfolded one by one, each across an edge of one that is there already, from the middle of the row of side
faces; every other edge at which two faces meet gets a flap on one of them, which is glued behind the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

import markergen
from markergen.arrays import Array
from markergen.drawing.annotations import paragraph
from markergen.drawing.colors import Colors
from markergen.drawing.figure import Figure
from markergen.drawing.marker_artwork import draw_artwork
from markergen.drawing.paper import ISO, PAPERS, Frame, SheetOptions, both_ways
from markergen.drawing.print_measurements import ruler
from markergen.drawing.scene import (
    BLACK,
    FINE,
    GRAY,
    HAIRLINE,
    LIGHT,
    Box,
    Line,
    Point,
    Shape,
    Sheet,
    bounds,
    corners,
    mapped,
    moved_layers,
    overlaps,
    points_of,
    polygon,
    renamed,
    scene_of,
)
from markergen.drawing.text import text, text_width
from markergen.errors import InputError
from markergen.geometry.contour import area, backward
from markergen.geometry.region import Region
from markergen.model.body import Body
from markergen.model.marker import Marker
from markergen.model.rescale import RULERS_MM
from markergen.model.rig import Rig

SAME = 1e-6
"""Maximum distance in m of corners that are one."""

LABEL, NAME, AIR = 1.5, 2.2, 1.0
"""Cap heights of the labels of edges and of a plate's name, and their distance from its outline, mm on A4."""


@dataclass(frozen=True)
class Edge:
    """An edge of a plate, counterclockwise around it.

    Attributes
    ----------
    start, end : (x, y)
        In mm, marker frame.
    meets : (int, int) or None
        Plate and edge of it that is the same line in the rig; None if there is none.
    """

    start: Point
    end: Point
    meets: tuple[int, int] | None

    @property
    def length(self) -> float:
        """Length in mm."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def outward(self) -> Array:
        """Unit vector (2,) out of the plate."""
        along = np.subtract(self.end, self.start) / self.length
        return np.array([along[1], -along[0]])


def plate_edges(body: Body) -> list[list[Edge]]:
    """Edges of each plate whose boundary is one outline of straight edges; none for others."""
    corners = [_plate_corners(body, k) for k in range(len(body.plates))]
    places = [body.plates[k].to_body(np.column_stack([ring, np.zeros(len(ring))])) for k, ring in enumerate(corners)]
    edges_by_plate = []
    for k, outline in enumerate(corners):
        edges = []
        for i in range(len(outline)):
            ends = places[k][[i, (i + 1) % len(outline)]]
            meets = next(
                (
                    (neighbor, j)
                    for neighbor, spots in enumerate(places)
                    if neighbor != k
                    for j in range(len(spots))
                    if np.abs(spots[[(j + 1) % len(spots), j]] - ends).max() <= SAME
                ),
                None,
            )
            start, end = (tuple((outline[at % len(outline)] * 1e3).tolist()) for at in (i, i + 1))
            edges.append(Edge(start, end, meets))
        edges_by_plate.append(edges)
    return edges_by_plate


def _plate_corners(body: Body, k: int) -> Array:
    boundary = body.plates[k].marker.boundary
    contours = boundary.contours()
    if len(contours) != 1 or contours[0].has_arcs:
        return np.zeros((0, 2))
    return np.array((contours[0] if area(contours[0]) > 0 else backward(contours[0])).points)


def sheet_labels(body: Body) -> list[tuple[Shape, ...]]:
    """`plate_labels` of all plates at the size that they have on sheets."""
    return [plate_labels(body, k, edges, 0.9) for k, edges in enumerate(plate_edges(body))]


def plate_labels(body: Body, k: int, edges: list[Edge], scale: float) -> tuple[Shape, ...]:
    """Name of a plate below it, and beside each edge the plate that it meets; mm, marker frame."""
    marker = body.plates[k].marker
    left, bottom = (np.concatenate(marker.boundary.outlines()) * 1e3).min(axis=0)
    right = (np.concatenate(marker.boundary.outlines()) * 1e3)[:, 0].max()
    dots = marker.xyz[:, :2] * 1e3

    def freest(middles: Array) -> Array:
        """The one of some places (m, 2) that is farthest from all dots, the first of equal ones."""
        gaps = np.linalg.norm(middles[:, None] - dots, axis=-1).min(axis=-1)
        return np.asarray(middles[int(np.argmax(np.round(gaps, 6)))])

    size, name = NAME * scale, body.plates[k].name
    half = text_width(name, size, "bold") / 2
    quiet = np.array([point.feature.diameter * 1e3 for point in marker.control_points])

    def lowest(x: float) -> float:
        """Lower end of the plate, and of the quiet zones of dots above a name there."""
        above = np.abs(dots[:, 0] - x) < quiet + half
        return float(np.min((dots[:, 1] - quiet)[above], initial=bottom))

    ends = [(x, lowest(x) - 2 * AIR * scale - size) for x in (left + half, right - half)]
    x, low = max(ends, key=lambda end: round(end[1], 6))
    shapes: list[Shape] = [text(name, float(x), low, size, "center", "bold", name="plate-name")]
    for number, edge in enumerate(edges):
        if edge.meets is None:
            continue
        caption, height = f"to {body.plates[edge.meets[0]].name}", LABEL * scale
        reach = np.array([text_width(caption, height) / 2, height / 2])
        aside = edge.outward * (2 * AIR * scale + np.abs(edge.outward) @ reach)
        # In the middle of an edge there may be the tick of an axis, and at an end of the lower one is the name.
        shares = np.array([0.35, 0.65, 0.25, 0.75])[:, None]
        spot = freest(np.array(edge.start) + shares * np.subtract(edge.end, edge.start) + aside)
        label = text(caption, float(spot[0]), float(spot[1]) - height / 2, height, "center", color=GRAY)
        shapes.append(replace(label, name=f"edge-{number}"))
    return tuple(shapes)


FLAP, FLAP_SHARE = 12.0, 0.25
"""Width of a flap in mm, at most this share of its edge."""

HATCH, DASH = 3.0, 3.0
"""Distances in mm of hatching lines, and of dashes."""

TOUCHING = 1e-3
"""Overlap in mm^2 and mm that is rounding."""

PAPER_MARGIN = 7.0
"""Distance of the net from the paper's edge in mm, unless a margin is given: most printers reach that far."""

NOTE_WIDTH, NOTE_HEIGHT, GAP = 62.0, 40.0, 5.0
"""Room for the text, mm, and its distance from the net."""

FAINT = "#d8d8d8"

TEXT = 2.0
"""Cap height in mm."""


@dataclass(frozen=True)
class Placed:
    """A face on the net: y = R x + t, mm, from the marker frame to the net's."""

    rotation: Array
    translation: Array

    def __call__(self, points: Array) -> Array:
        """Transform points (..., 2)."""
        return points @ self.rotation.T + self.translation

    def moved(self, shape: Shape) -> Shape:
        """Shape at its place on the net."""
        ((a, b), (c, d)), (x, y) = self.rotation.tolist(), self.translation.tolist()
        return mapped(shape, lambda u, v: (a * u + b * v + x, c * u + d * v + y))


@dataclass(frozen=True)
class Flap:
    """A flap on an edge of one face, glued behind another; corners (4, 2) in mm on the net, from the edge outward."""

    face: int
    behind: int
    corners: Array


@dataclass(frozen=True)
class Net:
    """Places of the faces on the net, folds as pairs of (face, edge), flaps, and outlines (m, 2) of the faces, mm."""

    places: tuple[Placed, ...]
    folds: frozenset[tuple[int, int]]
    flaps: tuple[Flap, ...]
    outlines: tuple[Array, ...]
    edges: list[list[Edge]]

    @property
    def box(self) -> Box:
        """Bounding box, mm."""
        points = np.concatenate([*self.outlines, *(flap.corners for flap in self.flaps)])
        return (*points.min(axis=0).tolist(), *points.max(axis=0).tolist())


def unfold(rig: Marker | Rig) -> Net:
    """Unfold the faces of a rig's body.

    Raises
    ------
    InputError
        If the faces are not those of a convex body that touch along their edges, or they overlap when unfolded.
    """
    edges = plate_edges(rig)
    meeting = sum(edge.meets is not None for face_edges in edges for edge in face_edges)
    if len(rig.plates) < 3 or not rig.is_convex or not meeting:
        raise _no_net("plates that do not touch along their edges, as of a wall, or just two of them")
    upright = [abs(plate.rotation_matrix[2, 2]) < 0.5 for plate in rig.plates]
    degree = [sum(edge.meets is not None and upright[edge.meets[0]] for edge in face_edges) for face_edges in edges]
    row = [k for k in range(len(edges)) if upright[k]] or list(range(len(edges)))
    # For a cube the face -y, whose upper neighbor has its axes.
    root = max(row, key=lambda k: (degree[k], -rig.plates[k].rotation_matrix[1, 2], -k))
    places: dict[int, Placed] = {root: Placed(np.eye(2), np.zeros(2))}
    folds: set[tuple[int, int]] = set()
    waiting = [root]
    # The row of sides first, and then the others at its middle.
    for sides in (True, False):
        waiting = [root] if sides else list(places)
        while waiting:
            k = waiting.pop(0)
            for i, edge in enumerate(edges[k]):
                if edge.meets is None or edge.meets[0] in places or (sides and not upright[edge.meets[0]]):
                    continue
                neighbor, j = edge.meets
                mate = edges[neighbor][j]
                # The other face's edge runs the other way.
                places[neighbor] = _matched(mate.start, mate.end, *places[k](np.array([edge.end, edge.start])))
                folds |= {(k, i), (neighbor, j)}
                waiting.append(neighbor)
    if len(places) < len(edges):
        raise _no_net("faces in several pieces")
    ordered = tuple(places[k] for k in range(len(edges)))
    outlines = tuple(ordered[k](np.array([edge.start for edge in face_edges])) for k, face_edges in enumerate(edges))
    regions = [Region.polygon(outline) for outline in outlines]
    for k, region in enumerate(regions):
        if any((region & later).area > TOUCHING for later in regions[k + 1 :]):
            raise _no_net("faces that overlap when unfolded")
    return Net(ordered, frozenset(folds), _flaps(edges, ordered, folds, regions), outlines, edges)


def _no_net(problem: str) -> InputError:
    return InputError("the faces of a body for --net, such as a cube or a prism", problem, "leave out --net")


def _matched(start: Sequence[float], end: Sequence[float], to_start: Array, to_end: Array) -> Placed:
    """Rigid motion of the plane that takes one segment to another of the same length."""
    source, target = complex(*np.subtract(end, start)), complex(*(to_end - to_start))
    ratio = target / source
    # The quotient of two complex numbers has the angle between them.
    rotation = np.array([[ratio.real, -ratio.imag], [ratio.imag, ratio.real]]) / abs(ratio)
    # Quarter turns exactly, so that faces of a cube stay upright.
    rotation = np.where(np.abs(rotation - np.round(rotation)) < 1e-9, np.round(rotation), rotation)
    return Placed(rotation, to_start - rotation @ np.array(start))


def _flaps(
    edges: list[list[Edge]], places: Sequence[Placed], folds: set[tuple[int, int]], regions: Sequence[Region]
) -> tuple[Flap, ...]:
    """A flap for every pair of edges that meet and are not folded, on the face where there is room for it."""
    taken, flaps = list(regions), list[Flap]()
    for k, face_edges in enumerate(edges):
        for i, edge in enumerate(face_edges):
            # Each pair once: at its lower face and edge.
            if edge.meets is None or (k, i) in folds or edge.meets < (k, i):
                continue
            for face, number, behind in ((k, i, edge.meets[0]), (*edge.meets, k)):
                flap = Flap(face, behind, _trapezoid(edges[face][number], places[face]))
                region = Region.polygon(flap.corners)
                if not any((region & other).area > TOUCHING for other in taken):
                    flaps.append(flap)
                    taken.append(region)
                    break
    return tuple(flaps)


def _trapezoid(edge: Edge, place: Placed) -> Array:
    """Corners (4, 2) of a flap, chamfered by 45 degrees."""
    depth = min(FLAP, FLAP_SHARE * edge.length)
    start, end = np.array(edge.start), np.array(edge.end)
    along = (end - start) / edge.length * depth
    out = edge.outward * depth
    return place(np.array([start, end, end - along + out, start + along + out]))


def net_sheet(rig: Marker | Rig, options: SheetOptions) -> Sheet:
    """Lay out the net of a rig on one page, at true size.

    Raises
    ------
    InputError
        As `unfold` does, or if no paper, or not the named one, holds the net.
    """
    if options.compensate:
        raise InputError("a net at its true size", "--compensate", "leave it out")
    net = unfold(rig)
    left, bottom, right, top = net.box
    frames = options.candidates()
    placement = next((place for frame in frames if (place := _place(net, frame, options))), None)
    if placement is None:
        raise _too_large(net, options)
    frame, translation, corner = placement
    layers = [moved_layers(face_layers, *translation) for face_layers in _drawn(net, rig, options.colors)]
    instructions, lengths = _instructions(rig, corner)
    names = len(net.flaps)
    return Sheet(
        frame.paper,
        scene_of([*layers, instructions]),
        tuple(
            (float(place.translation[0] + translation[0]), float(place.translation[1] + translation[1]))
            for place in net.places
        ),
        (lengths, 0),
        "Paper net of a rig",
        f"Net of {len(rig.plates)} faces with {names} flaps, at true size on {frame.paper}. Print at 100 %.",
        (
            f"The net, {right - left:.0f} x {top - bottom:.0f} mm with {names} flaps, needs {frame.paper}.",
            f"Print at 100 %, then check that the ruler measures {lengths} mm; use thick paper.",
        ),
        (0.0, 0.0, frame.paper.width, frame.paper.height),
    )


_Place = tuple[Frame, tuple[float, float], Box]


def _place(net: Net, frame: Frame, options: SheetOptions) -> _Place | None:
    """Shift of the net on a page, and the box of the text: in a corner of the net if one is free, else below it."""
    left, bottom, right, top = net.box
    edge = PAPER_MARGIN if options.margin is None else options.margin * 1e3
    width, height = frame.paper.width - 2 * edge, frame.paper.height - 2 * edge
    if right - left > width or top - bottom > height:
        return None
    translation = (edge + (width - right + left) / 2 - left, edge + (height - top + bottom) / 2 - bottom)
    pieces = [*net.outlines, *(flap.corners for flap in net.flaps)]
    boxes = [np.array([*(p.min(axis=0) + translation), *(p.max(axis=0) + translation)]) for p in pieces]
    best: Box | None = None
    for y in sorted({float(box[1]) for box in boxes}):
        below = [box for box in boxes if box[1] < y - TOUCHING]
        x = max((float(box[2]) for box in below), default=edge)
        room = (x + GAP, edge, edge + width, y - GAP)
        if room[2] - room[0] >= NOTE_WIDTH and room[3] - room[1] >= NOTE_HEIGHT:
            size = (room[2] - room[0]) * (room[3] - room[1])
            best = room if best is None or size > (best[2] - best[0]) * (best[3] - best[1]) else best
    if best is None and height - (top - bottom) >= NOTE_HEIGHT + GAP and width >= NOTE_WIDTH:
        translation = (translation[0], edge + height - top)
        best = (edge, edge, edge + width, edge + height - (top - bottom) - GAP)
    return (frame, translation, best) if best else None


def _too_large(net: Net, options: SheetOptions) -> InputError:
    left, bottom, right, top = net.box
    size = f"{ceil(right - left)} x {ceil(top - bottom)} mm"
    fit = next(
        (paper for paper in [*both_ways(ISO), *PAPERS.values()] if _place(net, options.frame(paper), options)), None
    )
    remedy = f"use --paper {fit.name}" if fit else "no known paper holds it"
    return InputError(
        f"paper with room for a net of {size} and its text", options.paper or "A0", f"{remedy}, or print without --net"
    )


def _drawn(net: Net, rig: Marker | Rig, colors: Colors) -> list[dict[str, tuple[Shape, ...]]]:
    """Layers of the net, mm, net frame."""
    layers: list[dict[str, tuple[Shape, ...]]] = []
    for k, plate in enumerate(rig.plates):
        figure, place = Figure(plate.marker.as_designed, ink=colors.ink), net.places[k]
        artwork = draw_artwork(figure, replace(colors, paper="#ffffff", ink=BLACK), 0.8, figure.outline)
        face = Region.polygon([edge.start for edge in net.edges[k]])
        numbers = [shape for shape in artwork.layers["text"] if face.depth(corners(bounds(shape))).min() > 0]
        face_layers = {
            "ground": (polygon(points_of(net.outlines[k]), "ground", colors.paper),) if colors.grounded else (),
            "dots": tuple(place.moved(shape) for shape in artwork.layers["dots"]),
            "tag": tuple(place.moved(shape) for shape in artwork.layers["tag"]),
            "text": tuple(place.moved(shape) for shape in (*numbers, *_name(plate.name, figure, face, numbers))),
        }
        layers.append({name: renamed(shapes, f"marker-{k + 1}-") for name, shapes in face_layers.items()})
    cut, marks, texts = list[Shape](), list[Shape](), list[Shape]()
    flapped = {(flap.face, tuple(np.round(flap.corners[0], 6))) for flap in net.flaps}
    for k, own_edges in enumerate(net.edges):
        for i, edge in enumerate(own_edges):
            ends = net.places[k](np.array([edge.start, edge.end]))
            name = f"{k}-{i}"
            if (k, i) in net.folds:
                if edge.meets and edge.meets[0] > k:
                    marks += _dashes(ends, f"fold-{name}")
            elif (k, tuple(np.round(ends[0], 6))) in flapped:
                marks += _dashes(ends, f"fold-{name}")
            else:
                cut.append(Line(points_of(ends), FINE, f"cut-{name}", colors.cut or BLACK))
    for number, flap in enumerate(net.flaps):
        cut.append(Line(points_of(flap.corners[[1, 2, 3, 0]]), FINE, f"flap-{number}", colors.cut or BLACK))
        marks += _hatch(flap.corners, f"hatch-{number}")
        texts += _flap_words(flap, rig, number)
    return [*layers, {"cut": tuple(cut), "marks": tuple(marks), "text": tuple(texts)}]


def _name(name: str, figure: Figure, face: Region, numbers: Sequence[Shape]) -> list[Shape]:
    """Name of a face near an edge, where dots and their numbers leave room; none if there is none."""
    left, bottom, right, top = figure.outline
    width = text_width(name, TEXT)
    boxes = [np.reshape(bounds(number), (2, 2)) for number in numbers]
    spans = np.linspace(left + 2, right - 2 - width, 13)
    for y in (bottom + 2, top - 2 - TEXT, bottom + 6, top - 6 - TEXT):
        # From the middle outward.
        for x in sorted(spans, key=lambda x: abs(x + width / 2 - (left + right) / 2)):
            low, high = np.array([x, y]), np.array([x + width, y + TEXT])
            gaps = [np.hypot(*(np.clip((d.x, d.y), low, high) - (d.x, d.y))) - 2 * d.radius for d in figure.dots]
            apart = all((box[0] > high + 1).any() or (box[1] < low - 1).any() for box in boxes)
            tag = figure.tag_zone is None or not overlaps((*low, *high), figure.tag_zone)
            if apart and tag and min(gaps) > 0 and face.depth(corners((*low, *high))).min() > 0.5:
                return [text(name, float(x), float(y), TEXT, color=GRAY, name="plate-name")]
    return []


def _dashes(ends: Array, name: str) -> list[Shape]:
    """Dashes from end to end on a faint line, which is the face's outline for whoever reads the file back."""
    count = max(2, round(float(np.hypot(*(ends[1] - ends[0]))) / DASH))
    cuts = np.linspace(0, 1, 2 * count)
    spots = ends[0] + cuts[:, None] * (ends[1] - ends[0])
    dashes = [Line(points_of(spots[2 * i : 2 * i + 2]), HAIRLINE, f"{name}-{i}", GRAY) for i in range(count)]
    return [Line(points_of(ends), HAIRLINE, name, FAINT), *dashes]


def _hatch(corners: Array, name: str) -> list[Shape]:
    """Light lines across a flap, at 45 degrees to the paper."""
    region = Region.polygon(corners)
    low, high = corners.sum(axis=1).min(), corners.sum(axis=1).max()
    shapes: list[Shape] = []
    for number, level in enumerate(np.arange(low + HATCH, high, HATCH)):
        x0, x1 = corners[:, 0].min() - 1, corners[:, 0].max() + 1
        for part, run in enumerate(region.runs(np.array([[x0, level - x0], [x1, level - x1]]))):
            shapes.append(Line(points_of(np.asarray(run)), HAIRLINE, f"{name}-{number}-{part}", LIGHT))
    return shapes


def _flap_words(flap: Flap, rig: Marker | Rig, number: int) -> list[Shape]:
    """Face that a flap is glued behind, along it."""
    start, end = flap.corners[:2]
    along = (end - start) / np.hypot(*(end - start))
    depth = float(np.hypot(*(flap.corners[3] - start)) / np.sqrt(2))
    height = min(1.6, 0.3 * depth)
    label = rig.plates[flap.behind].name
    if text_width(label, height) > 0.8 * (np.hypot(*(end - start)) - 2 * depth):
        return []
    middle = flap.corners.mean(axis=0)
    # Upright or read from the right.
    if along[0] < -1e-9 or (abs(along[0]) <= 1e-9 and along[1] < 0):
        along = -along
    place = Placed(np.array([[along[0], -along[1]], [along[1], along[0]]]), middle)
    width, white = text_width(label, height) / 2 + 1, height / 2 + 0.6
    blank = np.array([[-width, -white], [width, -white], [width, white], [-width, white]])
    return [
        polygon(points_of(place(blank)), f"flap-blank-{number}", "#ffffff"),
        place.moved(text(label, 0, -height / 2, height, "center", color=GRAY, name=f"flap-name-{number}")),
    ]


def _instructions(rig: Marker | Rig, room: Box) -> tuple[dict[str, tuple[Shape, ...]], int]:
    """What to do, and a ruler along x, in a box; also the ruler's length."""
    left, bottom, right, top = room
    width = min(right - left, 110.0)
    left = right - width
    marks, texts = list[Shape](), list[Shape]()
    length = next((mm for mm in RULERS_MM if mm <= width - 8), RULERS_MM[-1])
    ruler_marks, ruler_text = ruler((left, bottom + 2), length, 0, 1.0)
    marks += ruler_marks
    texts += ruler_text
    shape = rig.provenance.get("shape")
    title = f"{shape if isinstance(shape, str) else 'rig'}: {len(rig.plates)} faces, {len(rig)} dots"
    lines = [
        f"Print at 100 %: the ruler must measure {length} mm.",
        "1  Cut along the solid lines.",
        "2  Fold back along the dashed lines, print outside.",
        "3  Glue each hatched flap behind the face it names.",
        f"markergen {markergen.__version__}",
    ]
    y = min(top, bottom + 38) - TEXT
    texts.append(text(title, left, y - TEXT, TEXT * 1.2, face="bold", name="net-title"))
    for number, line in enumerate(lines):
        texts += paragraph(line, left, y - 2.2 * TEXT - 1.9 * TEXT * number, width, TEXT * 0.9, 1, f"net-{number}")
    return {"marks": tuple(marks), "text": tuple(texts)}, length
