"""Solids that are right but for one thing about them as a whole: turned, sheared, in another unit, only a part."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.geometry.contour import box
from markergen.model.marker import Marker
from markergen.verification.made import faces_of
from markergen.verification.matching import expected_dots
from markergen.verification.reading import Reading
from markergen.verification.solids import UNITS, dots_of_surface, in_unit, mapped, round_edges
from markergen.verification.surface import Surface
from markergen.verification.words import Finding, short_length

Array = NDArray[np.float64]

STRAIGHT = np.radians(0.01)
"""Angle in rad below which an axis is an axis."""

ROUGHLY = 4.0
"""Maximum ratio of the size of a plate to that of its marker, for a guess at its unit."""

NEAR = 2.0
"""Maximum distance in mm of a part or pocket of a dot from its place, beyond which it belongs to something else."""

DARK = "the dark parts alone: verify the light ones, or the file of all parts, too"
LIGHT = "the light parts alone, with pockets for the dark ones: verify these, or the file of all parts, too"


@dataclass(frozen=True)
class Placement:
    """A way in which a solid as a whole may be wrong.

    Attributes
    ----------
    reading : Reading
        The solid without it.
    times : float
        Factor by which lengths were multiplied to undo it.
    """

    finding: Finding
    reading: Reading
    times: float = 1.0


def turned(marker: Marker, reading: Reading, surface: Surface) -> Iterator[Placement]:
    """The solid with its largest level area up, and with it down; not the view that the file has."""
    for turn, view in surface.views():
        # The direction in the file of what is up in the view.
        said = _direction(turn[2], reading.kind)
        yield Placement(said, replace(reading, pages=mapped(marker, reading, view).pages))


def _direction(way: Array, kind: str) -> Finding:
    """Say where the face of a solid points that should point along z."""
    axis = int(np.argmax(np.abs(way)))
    name = ("-" if way[axis] < 0 else "") + "xyz"[axis]
    if np.arccos(min(abs(way[axis]), 1.0)) > STRAIGHT:
        lean = np.degrees(np.arccos(np.clip(way[2], -1, 1)))
        return Finding("turned", f"tilted: its face leans {lean:.4g} degrees from z", "lay it flat and export it")
    if name == "-z":
        return Finding("turned", "turned over: its face points down", "turn it by 180 degrees about x")
    if kind == "GLB":
        # There y is up in the file, and the reader turned it.
        remedy = "export it with y up, as programs expect of a GLB"
    else:
        remedy = f"turn it by 90 degrees about {'x' if axis == 1 else 'y'}, or export it with z up"
    return Finding("turned", f"turned: its face points along {name} instead of z", remedy)


def in_other_units(marker: Marker, reading: Reading) -> Iterator[Placement]:
    """The solid if it was written in one unit and read in another."""
    seen = {1.0}
    size = _size(reading, marker)
    for own in ("m", "mm") if reading.kind == "GLB" else ("mm",):
        for unit, factor in UNITS.items():
            for times, said, remedy in (
                (factor / UNITS[own], f"{unit} taken for {own}", f"export it in {own}"),
                (UNITS[own] / factor, f"{own} taken for {unit}", f"open it in {own} where it was saved last"),
            ):
                if round(times, 9) in seen or (size != 1.0 and not 1 / ROUGHLY < size * times < ROUGHLY):
                    continue
                seen.add(round(times, 9))
                try:
                    other = in_unit(marker, reading, times)
                except InputError:
                    continue  # Larger than any marker.
                sentence = f"scaled by {1 / times:.6g} along x, y and z: {said}"
                yield Placement(Finding("scaled", sentence, remedy), other, times)


def _size(reading: Reading, marker: Marker) -> float:
    """Size of a solid as a multiple of the marker's."""
    surface = reading.pages[0].surface
    boxes = np.array([part.box for part in surface.parts] if surface else [])
    if surface is None or surface.mapped is None or not len(boxes):
        # The kernel's boxes of a CAD file that is too small for it mean nothing.
        return 1.0
    return float(np.ptp(boxes.reshape(-1, 2), axis=0).max() / (2e3 * marker.boundary.radius))


def stretched(marker: Marker, reading: Reading, surface: Surface) -> Iterator[Placement]:
    """The solid if its heights are scaled, or its layers shifted against each other: it is then sheared."""
    face, back = faces_of(surface)
    if surface.mapped is None or face is None or back is None or not face.z - back.z > 0:
        return
    thick = face.z - back.z
    flat = [ball.flatness for part in surface.parts for ball in part.balls]
    wanted = 1e3 * marker.substrate.thickness
    for by in {round(thick / wanted, 6), round(float(np.median(flat)), 6) if flat else 1.0} - {1.0}:
        finding = Finding("scaled", f"scaled by {by:.5g} along z", "export it again at its size")
        undone = surface.mapped(np.diag([1.0, 1.0, 1 / by]))
        yield Placement(finding, mapped(marker, reading, undone))
    shift = _middle(box(face.edges[0])) - _middle(box(back.edges[0]))
    lean = shift / thick
    if np.linalg.norm(shift) > 1e-3:
        matrix = np.eye(3)
        matrix[:2, 2] = -lean
        off = short_length(float(np.linalg.norm(shift)))
        finding = Finding(
            "sheared", f"sheared: its face lies {off} beside its back (x {shift[0]:+.4g} mm, y {shift[1]:+.4g} mm)",
            "export it again from its marker.json",
        )  # fmt: skip
        yield Placement(finding, mapped(marker, reading, surface.mapped(matrix)))


def _middle(limits: tuple[float, float, float, float]) -> Array:
    left, bottom, right, top = limits
    return np.array([left + right, bottom + top]) / 2


def in_part(marker: Marker, surface: Surface, tolerance: float) -> tuple[list[Finding], str, int] | None:
    """Errors of a file of the dark or of the light parts alone, a note, and the number of dots; None for other files.

    The file is in the marker frame: nothing else tells where the other parts go. Tolerance in mm.
    """
    expected = expected_dots(marker)
    ids = [point.id for point in marker.control_points]
    if surface.loose:
        found = dots_of_surface(surface, expected)
        note, places = DARK, found.centers
        nearest = [int(np.argmin(np.linalg.norm(expected.centers - each, axis=1))) for each in places]
        rise = np.ones(1)
        if len(found) and found.heights is not None and expected.heights is not None:
            rise = found.heights - expected.heights[nearest]
    else:
        edges = round_edges(surface)
        nearest, note, rows = list(range(len(expected))), LIGHT, []
        for center, radius in zip(expected.centers, expected.radii, strict=True):
            away = np.linalg.norm(edges[:, :2] - center, axis=1)
            there = np.flatnonzero((away < NEAR) & (edges[:, 2] < radius))
            if not len(there):
                return None
            rows.append(edges[there[np.argmax(edges[there, 2])], :2])
        places, rise = np.array(rows), np.zeros(1)
    off = places - expected.centers[nearest]
    apart = np.linalg.norm(off, axis=1)
    if len(set(nearest)) < len(nearest) or not np.abs(rise).max() <= tolerance or not apart.max() <= NEAR:
        return None
    findings = [
        Finding("shifted", f"dot {ids[index]} is {short_length(by)} off (x {1e3 * x:+.4g} um, y {1e3 * y:+.4g} um)")
        for index, by, (x, y) in zip(nearest, apart.tolist(), off.tolist(), strict=True)
        if by > tolerance
    ]
    return findings, note, len(places)
