"""Parse boundaries and keep-outs as users write them: a radius, a shape with dimensions, or a drawing.

A drawing becomes closed outlines in m: unit, size, flattening, joining ends, nesting. What is plainly no part of an
outline is left out with a warning: shapes without area, center lines, and loops that no tool can cut.
"""
# tests: tests/read/outlines/test_boundaries.py tests/read/outlines/test_joining.py tests/read/outlines/test_files.py

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.files import exists
from markergen.geometry.contour import Contour, area, backward, flattened, merged, mirrored, placed, without_loops
from markergen.geometry.outlines import SHALLOWEST, TOLERANCE, canonical_contours, place, polygons_of
from markergen.geometry.region import Region
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.read.outlines.curves import MOST_POINTS
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    PIXELS_PER_INCH,
    UNITS,
    Drawing,
    OutlineFile,
    load,
)
from markergen.read.remarks import MOST_LISTED, remark, remark_unused
from markergen.units import format_length, parse_length

SMALLEST, LARGEST = 1e-3, 100.0
"""Plausible sizes across in m; anything outside was most likely given in another unit."""

SMALLEST_LOOP, SHORTEST_LOOP = 1e-8, 2e-3
"""Area in m^2 below which a loop is left out, and the length in m of those that are sought in outlines that cross
themselves: box generators leave loops of 0.0006 mm^2 at inner corners, half a kerf wide."""

APART = 0.1
"""Minimum distance of a center line's ends from other loose ends, as a share of its length: the sides of a shape whose
corners do not quite meet have ends that are closer."""


@dataclass(frozen=True)
class Track:
    """Points (m, 2) in m along a named piece of outline; if closed, the last is joined to the first.

    Bulges (m - 1,) describe the segments between them, as in `Contour`.
    """

    name: str
    points: Array
    closed: bool
    bulges: Array

    def backward(self) -> "Track":
        """Return the reversed track."""
        return Track(self.name, self.points[::-1], self.closed, -self.bulges[::-1])


def read_outline(path: Path | str, unit: str | None = None, layer: str | None = None) -> tuple[Array, ...]:
    """Read all closed outlines as polygons (m, 2), with arcs approximated to 5 um; otherwise as `read_contours`."""
    return polygons_of(read_contours(path, unit, layer))


def read_contours(
    path: Path | str, unit: str | None = None, layer: str | None = None, ignore_open: bool = False
) -> tuple[Contour, ...]:
    """Read all closed outlines of an SVG, DXF, GeoJSON or KiCad file, in m, y up, about the file's own origin.

    Lines and circular arcs are kept exactly. Other curves become polygons within 5 um, less for outlines smaller than
    50 mm. Outer outlines run counterclockwise, holes clockwise: an outline inside an odd number of others is a hole.
    Pieces whose ends lie within 1 um (3 millionths of the drawing above 0.3 m) are joined.

    Parameters
    ----------
    unit : str, optional
        One of `UNITS`: the length of one coordinate unit, overriding the file's own. For px, the pixels are those of
        the width and height of an SVG.
    layer : str, optional
        Read this layer only, visible or not; by default all visible layers, and Edge.Cuts of KiCad.
    ignore_open : bool
        Leave out lines that bound nothing, and list them in a warning.

    Raises
    ------
    InputError
        If the file cannot be read or is damaged, refers to other files, states no unit, or has an implausible size; if
        there is no outline, or one is open, has no area, or intersects itself or another. Messages give places in the
        file's own coordinates, in m or mm.
    """
    file = load(Path(path))
    drawing, _, rings = _rings(file, unit, layer, ignore_open)
    contours = _canonical(rings, file.name)
    # Mirroring reverses the direction of an outline.
    return tuple(backward(mirrored(contour)) if drawing.y_down else contour for contour in contours)


def _rings(
    file: OutlineFile, unit: str | None, layer: str | None, ignore_open: bool
) -> tuple[Drawing, float, list[Contour]]:
    """Return the drawing, m per unit, and closed contours in m, y as in the file."""
    if unit is not None and unit not in UNITS:
        raise InputError("a known --boundary-unit", brief(unit), f"known: {', '.join(UNITS)}")
    format_ = next((OUTLINE_FORMATS[name] for name in OUTLINE_FORMATS if OUTLINE_FORMATS[name].fits(file)), None)
    if format_ is None:
        signs = "; ".join(f"{name}: {OUTLINE_FORMATS[name].signs}" for name in OUTLINE_FORMATS)
        raise InputError(f"an outline in {file.name}", "an unknown format", f"known formats: {signs}")
    # Overflows become infinite, and are reported with the piece's name.
    with np.errstate(over="ignore", invalid="ignore"):
        drawing = format_.read(file, layer)
        if len(drawing.pieces) > MOST_PIECES:
            raise file.too_much(f"at most {MOST_PIECES} pieces of outline")
        size = _size(drawing, file)
    scale = _scale(drawing, size, file, unit)
    size *= scale
    tracks = _tracks(drawing, scale, min(TOLERANCE, 1e-4 * size), file)
    rings = closed_contours(tracks, max(1e-6, 3e-6 * size), file.name, ignore_open)
    if not rings:
        raise _none(drawing, file)
    counts = Counter(drawing.others)
    remark_unused(file.name, (f"{count} {name}" if count > 1 else name for name, count in counts.items()))
    if unit == "px" and drawing.pixels_per_inch != PIXELS_PER_INCH and drawing.scale is None:
        remark(f"{file.name}: px of {drawing.pixels_per_inch:g} to the inch, as its program writes, would be pt")
    return drawing, scale, rings


def _canonical(rings: list[Contour], source: str) -> tuple[Contour, ...]:
    """Return contours that are nested and do not cross, without loops that no tool can cut."""
    large = [ring for ring in rings if abs(area(ring)) >= SMALLEST_LOOP] or rings
    _remark_left_out(source, "a loop below 0.01 mm^2", [ring.points[0] for ring in rings if ring not in large])

    def canonical(contours: list[Contour]) -> tuple[Contour, ...]:
        return canonical_contours([ring.points for ring in contours], [ring.bulges for ring in contours])

    try:
        return canonical(large)
    except InputError as error:
        # Sought only now, since it takes longer.
        mended, places = zip(*(without_loops(ring, SMALLEST_LOOP, SHORTEST_LOOP) for ring in large), strict=True)
        try:
            if not any(places):
                raise error from None
            contours = canonical(list(mended))
        except InputError as last:
            expected, problem, remedy = last.args
            raise InputError(f"{expected} in {source}", problem, remedy) from None
    _remark_left_out(source, "a loop below 0.01 mm^2", [point for points in places for point in points])
    return contours


def _remark_left_out(source: str, kind: str, points: Sequence[Iterable[float]]) -> None:
    if points:
        more = f", and {len(points) - 1} more" if len(points) > 1 else ""
        remark(f"left out of {source}: {kind}, at {place(np.array(list(points[0])))}{more}")


def _size(drawing: Drawing, file: OutlineFile) -> float:
    """Diagonal of the bounding box of all curves, in the file's unit."""
    sketches = [(piece.name, curve.sketch()) for piece in drawing.pieces for curve in piece.curves]
    if not sketches:
        raise _none(drawing, file)
    for name, points in sketches:
        if not np.isfinite(points).all():
            raise file.unreadable("finite coordinates", f"nan, infinity or endless numbers in {name}", "correct it")
    points = np.concatenate([points for _, points in sketches])
    size = float(np.hypot(*np.ptp(points, axis=0)))
    if size == 0:
        raise file.unreadable("outlines with an area", "single points", "draw a closed shape with an inside")
    if not float(np.abs(points).max()) < 1e9 * size < np.inf:
        raise file.unreadable(
            "an outline near the file's origin",
            f"one {size:.3g} units across, {np.abs(points).max():.3g} units off",
            "move it to the origin: so far out its digits are lost",
        )
    return size


def _scale(drawing: Drawing, size: float, file: OutlineFile, unit: str | None) -> float:
    """Return m per unit, as given by the user or else the file, if the resulting size is plausible."""
    scale = UNITS[unit] * (drawing.pixels if unit == "px" else 1.0) if unit else drawing.scale
    if scale is None:
        raise file.unreadable(
            "a unit of length",
            f"none: the drawing is {size:.6g} units across",
            f"give --boundary-unit, one of {', '.join(UNITS)}{drawing.hint}",
        )
    if not SMALLEST <= size * scale <= LARGEST:
        remedy = f"give {'another' if unit else 'the'} --boundary-unit, one of {', '.join(UNITS)}"
        if size * min(UNITS.values()) > LARGEST:
            farthest = max(
                drawing.pieces, key=lambda piece: max(np.abs(curve.sketch()).max() for curve in piece.curves)
            )
            remedy = f"remove or correct what is so far out, such as {farthest.name}"
        raise file.unreadable(
            f"a marker of {format_length(SMALLEST)} to {format_length(LARGEST)}",
            f"one that is {format_length(size * scale)} across{f' with {unit} for the unit' if unit else ''}",
            remedy,
        )
    return scale


def _tracks(drawing: Drawing, scale: float, tolerance: float, file: OutlineFile) -> list[Track]:
    tracks, total = [], 0
    for piece in drawing.pieces:
        try:
            points, bulges = _traced([curve.trace(tolerance / scale) for curve in piece.curves])
        except InputError as error:
            expected, problem, remedy = error.args
            raise file.unreadable(expected, f"{problem}, {piece.name}", remedy) from None
        total += len(points)
        if total > MOST_POINTS:
            raise file.too_much(f"outlines that {MOST_POINTS} points can approximate to {tolerance * 1e6:.2g} um")
        tracks.append(Track(piece.name, points * scale, piece.closed, bulges))
    return tracks


def _traced(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Points and bulges of consecutive curves, with a line from each to the next."""
    bulges = [np.append(bulges, 0.0) for _, bulges in parts]
    return np.concatenate([points for points, _ in parts]), np.concatenate(bulges)[:-1]


def _none(drawing: Drawing, file: OutlineFile) -> InputError:
    others = sorted(set(drawing.others))
    content = f"only {', '.join(others[:8])}" if others else "none"
    remedy = "draw a closed shape, turn text into paths, or choose another --layer"
    return file.unreadable("a closed outline", content, remedy)


def closed_contours(tracks: Sequence[Track], tolerance: float, source: str, ignore_open: bool = False) -> list[Contour]:
    """Join tracks into closed contours, in the order of their first tracks, and merge arcs of one circle.

    Ends within `tolerance` (m) of each other are joined; points much closer than that are merged. `source` names the
    file in messages. Beside closed contours, shapes of zero area and lone straight lines that cross a contour are left
    out with a warning.

    Raises
    ------
    InputError
        If an end meets no other or more than one, or no outline has an area; the message says where.
    """
    rings: list[tuple[int, Track]] = []
    open_tracks: list[tuple[int, Track]] = []
    for i, track in enumerate(tracks):
        thin = _thinned(track, tolerance)
        if len(thin.points) == 1:  # Editors leave single points behind, which have no outline.
            continue
        if track.closed or _near(thin.points[0], thin.points[-1], tolerance):
            rings.append((i, thin))
        else:
            open_tracks.append((i, thin))
    if ignore_open and (loose := _loose([track for _, track in open_tracks], tolerance)):
        left_out = [track for k, (_, track) in enumerate(open_tracks) if k in loose]
        open_tracks = [item for k, item in enumerate(open_tracks) if k not in loose]
        if not rings and not open_tracks:
            raise InputError(f"closed outlines in {source}", f"{len(left_out)} open ones", "close one")
        names = [f"{track.name} at {place(track.points[0])}" for track in left_out[:MOST_LISTED]]
        more = f", and {len(left_out) - MOST_LISTED} more" if len(left_out) > MOST_LISTED else ""
        remark(f"left out of {source}, open: {', '.join(names)}{more}")
    lone = _lone_lines([track for _, track in open_tracks], tolerance)
    joined = _joined([open_tracks[k] for k in range(len(open_tracks)) if k not in lone], tolerance, source)
    closed = [(track, _contour(track, tolerance)) for _, track in sorted(rings + joined, key=lambda ring: ring[0])]
    contours = [contour for _, contour in closed if contour is not None]
    flat = [track for track, contour in closed if contour is None]
    lines = [open_tracks[k][1] for k in sorted(lone)]
    if lines and not _cross(lines, contours):
        _joined(open_tracks, tolerance, source)  # Raises the error about their ends.
    if flat and not contours:
        raise InputError(
            f"outlines with an area in {source}",
            f"{flat[0].name} of zero area at {place(flat[0].points[0])}",
            "draw it as a closed shape with an inside, or choose the outline's --layer",
        )
    for kind, left_out in (("of zero area", flat), ("a line that bounds nothing", lines)):
        if left_out:
            more = f", and {len(left_out) - 1} more" if len(left_out) > 1 else ""
            first = left_out[0]
            remark(f"left out of {source}: {first.name}, {kind}, at {place(first.points[0])}{more}")
    return [merged(contour, tolerance) for contour in contours]


def _loose(tracks: list[Track], tolerance: float) -> set[int]:
    """Indices of tracks that end where no other does, also once the others of these are gone."""
    from scipy.spatial import cKDTree

    loose: set[int] = set()
    if not tracks:
        return loose
    ends = np.array([end for track in tracks for end in (track.points[0], track.points[-1])])
    meeting = [set(ends_near) - {end} for end, ends_near in enumerate(cKDTree(ends).query_ball_point(ends, tolerance))]
    todo = [end // 2 for end, others in enumerate(meeting) if not others]
    while todo:
        if (k := todo.pop()) not in loose:
            loose.add(k)
            for end in (2 * k, 2 * k + 1):
                for other in meeting[end]:
                    meeting[other].discard(end)
                    todo += [other // 2] if not meeting[other] else []
    return loose


def _lone_lines(tracks: list[Track], tolerance: float) -> set[int]:
    """Indices of straight tracks whose ends meet no other and are not even near the loose ends of others."""
    if not tracks:
        return set()
    from scipy.spatial import cKDTree

    ends = np.array([end for track in tracks for end in (track.points[0], track.points[-1])])
    tree = cKDTree(ends)
    lone = set()
    for k, track in enumerate(tracks):
        chord = track.points[-1] - track.points[0]
        length = float(np.hypot(*chord))
        across = (track.points - track.points[0]) @ np.array([-chord[1], chord[0]]) / length
        straight = not track.bulges.any() and float(np.abs(across).max()) <= tolerance
        neighbors = tree.query_ball_point(ends[2 * k : 2 * k + 2], max(APART * length, tolerance))
        if straight and not {int(end) // 2 for ends_near in neighbors for end in ends_near} - {k}:
            lone.add(k)
    return lone


def _cross(lines: list[Track], contours: list[Contour]) -> bool:
    """Tell whether each line has its middle inside a contour and an end outside, as center lines have."""
    ends = np.array([line.points[[0, -1]] for line in lines])
    regions = [Region.of_contour(contour, (), TOLERANCE) for contour in contours]
    crossed = [
        region.contains(ends.mean(axis=1)) & ~(region.contains(ends[:, 0]) & region.contains(ends[:, 1]))
        for region in regions
    ]
    return bool(np.any(crossed, axis=0).all())


def _joined(tracks: list[tuple[int, Track]], tolerance: float, source: str) -> list[tuple[int, Track]]:
    """Join open tracks into rings: each end 2 i (start) or 2 i + 1 (end) of track i has exactly one partner."""
    if not tracks:
        return []
    ends = np.array([end for _, track in tracks for end in (track.points[0], track.points[-1])])
    partners = _partners(ends, [track.name for _, track in tracks], tolerance, source)
    rings = []
    left = dict.fromkeys(range(len(tracks)))
    while left:
        first = next(iter(left))
        end, parts = 2 * first, []
        while end // 2 in left:
            del left[end // 2]
            part = tracks[end // 2][1]
            parts.append(part if end % 2 == 0 else part.backward())
            end = partners[end ^ 1]
        index, track = tracks[first]
        # Each part starts at the end of the last one.
        points = np.concatenate([parts[0].points, *(part.points[1:] for part in parts[1:])])
        rings.append((index, Track(track.name, points, True, np.concatenate([part.bulges for part in parts]))))
    return rings


def _partners(ends: Array, names: list[str], tolerance: float, source: str) -> list[int]:
    """Index of the partner of each end (2 t,)."""
    from scipy.spatial import cKDTree

    tree = cKDTree(ends)
    # Three neighbors suffice to detect a branch.
    distances, partners = tree.query(ends, k=min(3, len(ends)))
    meeting = np.count_nonzero(distances <= tolerance, axis=1)
    if (meeting == 1).any():
        alone = np.flatnonzero(meeting == 1)
        loose = ends[alone]
        gaps, partner = cKDTree(loose).query(loose, k=2)
        # A single loose end has no partner; report the gap to its nearest neighbor.
        i = int(np.argmin(gaps[:, 1])) if len(alone) > 1 else 0
        there = loose[partner[i, 1]] if len(alone) > 1 else ends[partners[alone[0], 1]]
        gap = float(np.hypot(*(there - loose[i])))
        more = len(alone) // 2 - 1
        raise InputError(
            f"closed outlines in {source}",
            f"{names[alone[i] // 2]} open: a gap of {format_length(gap)} between {place(loose[i])} and {place(there)}"
            + (f", and {more} more gaps" if more > 0 else ""),
            "close it there, choose the outline's --layer, or leave open lines out with --ignore-open",
        )
    if (meeting > 2).any():
        i = int(np.flatnonzero(meeting > 2)[0])
        raise InputError(
            f"outlines that do not branch in {source}",
            f"three or more ends at {place(ends[i])}, one of {names[i // 2]}",
            "remove what is drawn twice or joins two sides, or choose the outline's --layer",
        )
    self_first = partners[:, 0] == np.arange(len(ends))
    return np.where(self_first, partners[:, 1], partners[:, 0]).tolist()


def _thinned(track: Track, tolerance: float) -> Track:
    """Drop points within a tenth of the tolerance of the last point kept."""
    points, apart = track.points, tolerance / 10
    steps = np.hypot(*np.diff(points, axis=0).T)
    if np.all(steps > apart):
        return track
    kept = [0]
    for k in range(1, len(points)):
        if not _near(points[k], points[kept[-1]], apart):
            kept.append(k)
    # Arcs are half a turn at most, so that one with close ends is short.
    return Track(track.name, points[kept], track.closed, track.bulges[np.array(kept[1:], dtype=int) - 1])


def _contour(track: Track, tolerance: float) -> Contour | None:
    """Contour of a closed track; None if it has no area."""
    points, bulges = track.points, np.append(track.bulges, 0.0)
    if _near(points[0], points[-1], tolerance):
        points, bulges = points[:-1], bulges[:-1]
    bulges = np.where(np.abs(bulges) < SHALLOWEST, 0.0, bulges)
    contour = Contour(tuple((x, y) for x, y in points.tolist()), tuple(bulges.tolist()) if bulges.any() else ())
    corners = np.array(flattened(contour, 100 * tolerance))
    return None if len(corners) < 3 or _thin(corners, tolerance) else contour


def _thin(points: Array, tolerance: float) -> bool:
    """Tell whether an outline is nowhere wider than the tolerance."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if np.ptp(points @ axes[1]) <= tolerance:
        return True
    inside = Region.polygon(points)
    # A figure eight may have no area either, but is reported as self-intersecting.
    return inside.area <= tolerance * inside.perimeter / 2 and not inside.crosses_itself


def _near(a: Array, b: Array, tolerance: float) -> bool:
    return bool(np.hypot(*(a - b)) <= tolerance)


_NUMBER = re.compile(r"\s*[-+]?\.?\d[^/\\]*")
_SUFFIXES = (".svg", ".dxf", ".json", ".geojson", ".kicad_pcb")
_SHAPE = re.compile(r"(circle|rect):([^@]*)(?:@([^@]*))?")
_FORMS = (
    "write a radius such as 0.15, circle:150mm, rect:0.2x0.1 or rect:200mmx100mm, or an SVG, DXF, GeoJSON or KiCad file"
)


def parse_boundary(
    text: str | Path,
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
    ignore_open: bool = False,
) -> Boundary:
    """Make a boundary from text: a radius ``0.15``, ``circle:R``, ``rect:WxH``, or the path of an outline file.

    Parameters
    ----------
    text : str or path
        Lengths have a unit or are in m. For ``origin="file"`` a shape may have a position, ``circle:3mm@40mm,-20mm``,
        which places a keep-out.
    unit, layer, ignore_open : optional
        For files, as in `read_contours`.
    origin : {"center", "file"}
        Move the origin to the center of the smallest enclosing circle, or keep that of the file.

    Raises
    ------
    InputError
        If it is none of these, a dimension is not above 0, or the file has no usable outline.
    """
    if origin not in ("center", "file"):
        raise InputError("an origin of center or file", brief(origin), "use --origin center or --origin file")
    shape = _SHAPE.fullmatch(str(text).strip())
    is_file = is_drawing(text)
    if not is_file and (unit is not None or layer is not None or ignore_open):
        raise InputError(
            "--boundary-unit, --layer and --ignore-open with an outline file only",
            brief(text),
            "write the unit with the number",
        )
    if is_file:
        return polygon_from(read_contours(text, unit, layer, ignore_open), origin)
    kind, measures, place = shape.groups() if shape is not None else ("circle", str(text), None)
    center = _place(place, origin)
    if kind == "circle":
        radius = parse_length(measures, "radius")
        _check_size(2 * radius, text, origin)
        return Circle(radius, center)
    half = _half_sides(measures)
    _check_size(2 * hypot(*half), text, origin)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    return polygon_from([corners + center], "file")


def is_drawing(text: str | Path) -> bool:
    """Tell whether a boundary is given as a file rather than a radius or a shape; raises InputError if it is empty."""
    text_lines = str(text)
    if not text_lines.strip():
        raise InputError("a boundary", "none", _FORMS)
    is_number = _NUMBER.fullmatch(text_lines) and not text_lines.lower().endswith(_SUFFIXES)
    return isinstance(text, Path) or not (is_number or _SHAPE.fullmatch(text_lines.strip()))


def read_room(
    boundary: str | None,
    keep_outs: Sequence[str] = (),
    unit: str | None = None,
    layer: str | None = None,
    origin: str = "center",
    ignore_open: bool = False,
) -> tuple[Boundary | None, tuple[Boundary, ...]]:
    """Read a boundary and its keep-outs, both in m in the marker frame.

    Keep-outs from a drawing share the frame of a boundary from a drawing and move with it. A shape such as
    ``circle:3mm@40mm,-20mm`` is already in the marker frame.

    Parameters
    ----------
    boundary : str or None
        See `parse_boundary`; None for no boundary.
    keep_outs : sequence of str
        Shapes or drawings; ``plate.dxf#HOLES`` selects a layer.
    unit, layer, origin, ignore_open : optional
        See `parse_boundary`; the unit and `ignore_open` also apply to keep-outs.

    Raises
    ------
    InputError
        See `parse_boundary`.
    """
    drawings = [text for text in (boundary, *keep_outs) if text is not None and is_drawing(_split(text)[0])]
    if unit is not None and not drawings:
        raise InputError("a drawing for --boundary-unit", "none", "write the unit with the number: 150mm")
    if boundary is None:
        return None, tuple(_keep_out(text, unit, (0.0, 0.0), ignore_open) for text in keep_outs)
    drawn = is_drawing(boundary)
    room = parse_boundary(boundary, unit if drawn else None, layer, "file" if drawn else origin, ignore_open and drawn)
    offset = room.center if drawn and origin == "center" else (0.0, 0.0)
    if drawn:
        room = polygon_from(room.contours(), origin)
    return room, tuple(_keep_out(text, unit, offset, ignore_open) for text in keep_outs)


def drawn_plate(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the substrate table for a boundary from a drawing: the drawing is the plate's outline, without an edge.

    It is stored explicitly, since a drawn rectangle equals one that was given by its dimensions.

    Raises
    ------
    InputError
        If there is an edge but no outline for the plate.
    """
    if values.get("outline") is not None:
        return dict(values)
    if values.get("edge"):
        raise InputError(
            "an edge around a disk or a rectangle only",
            "--edge with a drawing, whose outline is the plate's",
            "leave out --edge, or draw the plate and give it as --outline",
        )
    return {**values, "edge": 0.0}


def _check_size(size: float, text: str | Path, origin: str) -> None:
    """Refuse a size that most likely lacks its unit; keep-outs may be arbitrarily small."""
    if size > LARGEST or (0 < size < SMALLEST and origin == "center"):
        raise InputError(
            f"a boundary of {format_length(SMALLEST)} to {format_length(LARGEST)}",
            f"{format_length(size)} across for {brief(str(text))}",
            "write the unit with each number, such as 150mm or rect:200mmx100mm",
        )


def _half_sides(measures: str) -> Array:
    sides = measures.split("x")
    if len(sides) != 2:
        raise InputError("a width and a height", brief(f"rect:{measures}"), "write rect:0.2x0.1 or rect:200mmx100mm")
    half = np.array([parse_length(side, name) / 2 for side, name in zip(sides, ("width", "height"), strict=True)])
    if not (half > 0).all():
        raise InputError("sides above 0", brief(f"rect:{measures}"), "write rect:0.2x0.1 or rect:200mmx100mm")
    return half


def _place(text: str | None, origin: str) -> tuple[float, float]:
    if text is None:
        return 0.0, 0.0
    if origin == "center":
        raise InputError("no position of a boundary in its own frame", brief(f"@{text}"), "leave it out")
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError("a position x,y", brief(f"@{text}"), "write for example circle:3mm@40mm,-20mm")
    return parse_length(parts[0], "x"), parse_length(parts[1], "y")


def _keep_out(text: str, unit: str | None, offset: tuple[float, float], ignore_open: bool) -> Boundary:
    path, layer = _split(text)
    if not is_drawing(path):
        return parse_boundary(text, origin="file")
    return moved_outline(parse_boundary(path, unit, layer, "file", ignore_open), offset)


def moved_outline(region: Boundary, origin: Sequence[float]) -> Boundary:
    """Return a region as it is seen from another origin, in whole picometers."""
    if isinstance(region, Circle):
        x, y = (round(value - start, 12) + 0.0 for value, start in zip(region.center, origin, strict=True))
        return Circle(region.size, (x, y))
    return polygon_from([placed(contour, 1.0, origin, 12) for contour in region.contours()], "file")


def _split(text: str) -> tuple[str, str | None]:
    path, mark, layer = text.rpartition("#")
    if not mark or not path or exists(Path(text)):
        return text, None
    return path, layer
