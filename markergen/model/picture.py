"""A small picture of a marker's layout, for notebooks: no sheet, and nothing to measure on."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from markergen.model.boundary import Boundary
from markergen.model.marker import ControlPoint, Marker

Array = NDArray[np.float64]

WIDTH = 360
"""Width of the picture in CSS px."""


def svg(marker: Marker) -> str:
    """SVG of boundary, keep-outs, holes, tag, and dots with their ids, seen along -z of the marker frame."""
    outlines = [*marker.boundary.outlines(), *(_in_marker(plate, ring) for plate, ring in _plates(marker))]
    corners = np.concatenate(outlines) * 1e3
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    margin = 0.03 * float(size.max())
    # SVG's y goes down.
    box = (low[0] - margin, -(low[1] + size[1]) - margin, size[0] + 2 * margin, size[1] + 2 * margin)
    blocked = [*marker.keep_outs, *marker.substrate.rims]
    parts = [
        _path(outlines, f'fill="none" stroke="#888" stroke-width="{margin / 8:.4g}"'),
        _path(_rings(blocked), 'fill="#ddd"') if blocked else "",
        _path(marker.tag.outlines, 'fill="#000"') if marker.tag else "",
        *(_dot(point, margin) for point in marker.control_points),
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{WIDTH * box[3] / box[2]:.4g}" '
        f'viewBox="{" ".join(f"{value:.6g}" for value in box)}">{"".join(parts)}</svg>'
    )


def _plates(marker: Marker) -> Iterable[tuple[Array, Array]]:
    """Pose (3, 4) and one outline (m, 2) of each plate in turn, m."""
    for plate in marker.plates:
        pose = np.column_stack([np.array(plate.rotation), np.array(plate.translation)])
        yield from ((pose, ring) for ring in plate.boundary.outlines())


def _in_marker(pose: Array, ring: Array) -> Array:
    return ring @ pose[:2, :2].T + pose[:2, 3]


def _rings(regions: Iterable[Boundary]) -> list[Array]:
    return [ring for region in regions for ring in region.outlines()]


def _path(rings: Sequence[Array], style: str) -> str:
    steps = "".join("M" + "L".join(f"{1e3 * x:.6g} {-1e3 * y:.6g}" for x, y in ring.tolist()) + "Z" for ring in rings)
    return f'<path fill-rule="evenodd" {style} d="{steps}"/>'


def _dot(point: ControlPoint, margin: float) -> str:
    x, y = 1e3 * float(point.x), -1e3 * float(point.y)
    outer, inner = 500 * float(point.feature.diameter), 500 * float(point.feature.inner_diameter)
    ink, other = ("#fff", "#000") if point.feature.polarity == "light" else ("#000", "#fff")
    size = max(0.6 * outer, margin / 2)
    radius = outer or margin / 4
    hole = f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{inner:.6g}" fill="{other}"/>' if inner else ""
    return (
        f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{radius:.6g}" fill="{ink}" stroke="#000" '
        f'stroke-width="{margin / 20:.4g}"/>{hole}<text x="{x:.6g}" y="{y:.6g}" font-size="{size:.4g}" fill="#d60" '
        f'text-anchor="middle" dominant-baseline="central" font-family="sans-serif">{int(point.id)}</text>'
    )
