"""Turn a drawing into closed outlines in m: unit, size, flattening, joining ends, nesting.

What is plainly no part of an outline is left out with a warning: shapes without area, and center lines.
"""

# tests: tests/read/outlines/test_joining.py tests/read/outlines/test_files.py

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.geometry.contour import Contour, backward, flattened, merged, mirrored
from markergen.geometry.outlines import SHALLOWEST, TOLERANCE, canonical_contours, place, polygons_of
from markergen.geometry.region import Region
from markergen.read.outlines.curves import MOST_POINTS
from markergen.read.outlines.formats import MOST_PIECES, OUTLINE_FORMATS, UNITS, Drawing, OutlineFile, load
from markergen.units import format_length

LOG = logging.getLogger("markergen")


SMALLEST, LARGEST = 1e-3, 100.0
"""Plausible sizes across in m; anything outside was most likely given in another unit."""

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


def read_contours(path: Path | str, unit: str | None = None, layer: str | None = None) -> tuple[Contour, ...]:
    """Read all closed outlines of an SVG, DXF or GeoJSON file, in m, y up, about the file's own origin.

    Lines and circular arcs are kept exactly. Other curves become polygons within 5 um, less for outlines smaller than
    50 mm. Outer outlines run counterclockwise, holes clockwise: an outline inside an odd number of others is a hole.
    Pieces whose ends lie within 1 um (3 millionths of the drawing above 0.3 m) are joined.

    Parameters
    ----------
    unit : str, optional
        One of `UNITS`: the length of one coordinate unit, overriding the file's own. For px, the pixels are those of
        the width and height of an SVG.
    layer : str, optional
        Read this layer only, visible or not; by default all visible layers.

    Raises
    ------
    InputError
        If the file cannot be read or is damaged, refers to other files, states no unit, or has an implausible size; if
        there is no outline, or one is open, has no area, or intersects itself or another. Messages give places in the
        file's own coordinates, in m or mm.
    """
    if unit is not None and unit not in UNITS:
        raise InputError("a known --boundary-unit", brief(unit), f"known: {', '.join(UNITS)}")
    file = load(Path(path))
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
    rings = closed_contours(
        _tracks(drawing, scale, min(TOLERANCE, 1e-4 * size), file), max(1e-6, 3e-6 * size), file.name
    )
    if not rings:
        raise _none(drawing, file)
    try:
        contours = canonical_contours([ring.points for ring in rings], [ring.bulges for ring in rings])
    except InputError as error:
        expected, problem, remedy = error.args
        raise InputError(f"{expected} in {file.name}", problem, remedy) from None
    # Mirroring reverses the direction of an outline.
    return tuple(backward(mirrored(contour)) if drawing.y_down else contour for contour in contours)


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
            "an outline near the file's origin", f"one {size:.3g} units across, {np.abs(points).max():.3g} units off",
            "move it to the origin: so far out its digits are lost",
        )  # fmt: skip
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


def closed_contours(tracks: Sequence[Track], tolerance: float, source: str) -> list[Contour]:
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
            LOG.warning("left out of %s: %s, %s, at %s%s", source, first.name, kind, place(first.points[0]), more)
    return [merged(contour, tolerance) for contour in contours]


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
            "close it there, or choose the outline's --layer",
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
