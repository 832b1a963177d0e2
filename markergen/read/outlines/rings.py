"""Closed contours from pieces: open ones are joined where their ends meet."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.geometry.contour import Contour, flattened, merged
from markergen.geometry.outlines import SHALLOWEST, place
from markergen.units import format_length

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """Points (m, 2) in m along a piece of outline with a name; closed if the last is joined to the first.

    Of what is between them bulges (m - 1,) tell, as in `Contour`.
    """

    name: str
    points: Array
    closed: bool
    bulges: Array

    def backward(self) -> "Track":
        """The other way around."""
        return Track(self.name, self.points[::-1], self.closed, -self.bulges[::-1])


def close(tracks: Sequence[Track], tolerance: float, source: str) -> list[Contour]:
    """Closed contours without a repeated end, in the order of their first tracks; arcs of one circle become one.

    Ends that lie within `tolerance` (m) of each other meet; points that are much closer than that become one.
    `source` names the file in messages.

    Raises
    ------
    InputError
        If an end meets no other, or more than one, or an outline is a line without an inside; the message tells where.
    """
    rings: list[tuple[int, Track]] = []
    open_tracks: list[tuple[int, Track]] = []
    for i, track in enumerate(tracks):
        thin = _thinned(track, tolerance)
        if len(thin.points) == 1:  # A point has no outline, and editors leave some behind.
            continue
        if track.closed or _near(thin.points[0], thin.points[-1], tolerance):
            rings.append((i, thin))
        else:
            open_tracks.append((i, thin))
    rings += _joined(open_tracks, tolerance, source)
    rings.sort(key=lambda ring: ring[0])
    return [_checked(track, tolerance, source) for _, track in rings]


def _joined(tracks: list[tuple[int, Track]], tolerance: float, source: str) -> list[tuple[int, Track]]:
    """Rings of open tracks: each end 2 i (start) or 2 i + 1 (end) of track i has exactly one partner."""
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
        # Each part starts where the last one ended.
        points = np.concatenate([parts[0].points, *(part.points[1:] for part in parts[1:])])
        rings.append((index, Track(track.name, points, True, np.concatenate([part.bulges for part in parts]))))
    return rings


def _partners(ends: Array, names: list[str], tolerance: float, source: str) -> list[int]:
    """Which end meets which."""
    from scipy.spatial import cKDTree

    tree = cKDTree(ends)
    # Of a crowd, three tell as much as all.
    distances, found = tree.query(ends, k=min(3, len(ends)))
    meeting = np.count_nonzero(distances <= tolerance, axis=1)
    if (meeting == 1).any():
        alone = np.flatnonzero(meeting == 1)
        loose = ends[alone]
        gaps, other = cKDTree(loose).query(loose, k=2)
        # An end alone has no other end to go to when all else is joined.
        i = int(np.argmin(gaps[:, 1])) if len(alone) > 1 else 0
        there = loose[other[i, 1]] if len(alone) > 1 else ends[found[alone[0], 1]]
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
            "leave out what is drawn twice or joins two sides, or choose the outline's --layer",
        )
    self_first = found[:, 0] == np.arange(len(ends))
    return np.where(self_first, found[:, 1], found[:, 0]).tolist()


def _thinned(track: Track, tolerance: float) -> Track:
    """Without points that are within a tenth of the tolerance of the one before that is kept."""
    points, apart = track.points, tolerance / 10
    steps = np.hypot(*np.diff(points, axis=0).T)
    if np.all(steps > apart):
        return track
    kept = [0]
    for k in range(1, len(points)):
        if not _near(points[k], points[kept[-1]], apart):
            kept.append(k)
    # Arcs are half a turn at most, so that one with near ends is short.
    return Track(track.name, points[kept], track.closed, track.bulges[np.array(kept[1:], dtype=int) - 1])


def _checked(track: Track, tolerance: float, source: str) -> Contour:
    points, bulges = track.points, np.append(track.bulges, 0.0)
    if _near(points[0], points[-1], tolerance):
        points, bulges = points[:-1], bulges[:-1]
    bulges = np.where(np.abs(bulges) < SHALLOWEST, 0.0, bulges)
    contour = Contour(tuple((x, y) for x, y in points.tolist()), tuple(bulges.tolist()) if bulges.any() else ())
    corners = np.array(flattened(contour, 100 * tolerance))
    if len(corners) < 3 or _thin(corners, tolerance):
        raise InputError(
            f"outlines with an area in {source}",
            f"{track.name} of zero area at {place(points[0])}",
            "draw it as a closed shape with an inside, or choose the outline's --layer",
        )
    return merged(contour, tolerance)


def _thin(points: Array, tolerance: float) -> bool:
    """Tell whether an outline is nowhere wider than the tolerance."""
    import shapely

    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if np.ptp(points @ axes[1]) <= tolerance:
        return True
    polygon = shapely.Polygon(points)
    # A figure of eight may have no area either, but is told as what crosses itself.
    return bool(polygon.area <= tolerance * polygon.length / 2 and shapely.is_valid(polygon))


def _near(a: Array, b: Array, tolerance: float) -> bool:
    return bool(np.hypot(*(a - b)) <= tolerance)
