"""How the plates of a body lie in a solid.

A solid of one plate may be right but for one thing about it as a whole: turned, sheared, in another unit, only a part.
In a solid of several each is looked at from its own side, and its place compared with the body.
"""

# tests: tests/verification/test_placement.py tests/verification/test_made.py

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import box
from markergen.maths.rotation import rigid_motion
from markergen.model.body import Body, Plate
from markergen.model.marker import Marker
from markergen.verification.claims import several_findings
from markergen.verification.findings import AGAIN, MIRRORED, UNTAGGED, Verdict, extras, judge_copies
from markergen.verification.made import faces_of, is_light_alone
from markergen.verification.matching import DotSet, expected_dots
from markergen.verification.reading import Page, Reading
from markergen.verification.result import Check
from markergen.verification.solids import (
    DARK,
    FLUSH,
    LIGHT,
    classified,
    differ,
    dots_of_surface,
    plate_index,
    reading_of,
    round_edges,
)
from markergen.verification.surface import Surface
from markergen.verification.tags import tag_findings
from markergen.verification.words import KNOWN, MOST_LISTED, NO_PLATE, Finding, scale_finding, short_length

STRAIGHT = np.radians(0.01)
"""Angle in rad below which an axis is an axis."""

ROUGHLY = 4.0
"""Maximum ratio of the size of a plate to that of its marker, for a guess at its unit."""

NEAR = 2.0
"""Maximum distance in mm of a part or pocket of a dot from its place, beyond which it belongs to something else."""

LAYER = 0.05
"""Minimum distance in mm between two planes with dots."""

TURNED = np.radians(0.005)
"""Angle in rad below which a marker counts as not turned."""

NEARLY = 20.0
"""Ratio of the tolerance within which a marker in another one's place is recognized."""


# --- One plate -------------------------------------------------------------------------------------------------------


UNITS = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "inch": 25.4, "foot": 304.8}
"""Units, in mm, that a file may have been written in although it is read in another."""


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


def _with_surface(marker: Marker, reading: Reading, surface: Surface) -> Reading:
    """Return the reading of a solid with another surface."""
    return replace(reading, pages=reading_of(reading.kind, [surface], marker).pages)


def _in_unit(marker: Marker, reading: Reading, factor: float) -> Reading:
    """Scale everything in a reading by a factor."""
    surface = reading.pages[0].surface
    # The kernel's checks of a solid depend on its size.
    return reading if surface is None else replace(_with_surface(marker, reading, surface.scaled(factor)), flaws=())


def turned_solids(marker: Marker, reading: Reading, surface: Surface) -> Iterator[Placement]:
    """The solid with its largest level area up, and with it down; not the view that the file has."""
    for view in surface.views():
        # The direction in the file of what is up in the view.
        finding = _direction(view.rotation[2], reading.kind)
        yield Placement(finding, replace(reading, pages=_with_surface(marker, reading, view).pages))


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
    for usual in ("m", "mm") if reading.kind == "GLB" else ("mm",):
        for unit, factor in UNITS.items():
            for times, mistake, remedy in (
                (factor / UNITS[usual], f"{unit} taken for {usual}", f"export it in {usual}"),
                (UNITS[usual] / factor, f"{usual} taken for {unit}", f"open it in {usual} where it was saved last"),
            ):
                if round(times, 9) in seen or (size != 1.0 and not 1 / ROUGHLY < size * times < ROUGHLY):
                    continue
                seen.add(round(times, 9))
                try:
                    rescaled = _in_unit(marker, reading, times)
                except InputError:
                    continue  # Larger than any marker.
                sentence = f"scaled by {1 / times:.6g} along x, y and z: {mistake}"
                yield Placement(Finding("scaled", sentence, remedy), rescaled, times)


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
        yield Placement(finding, _with_surface(marker, reading, undone))
    lean_offset = _middle(box(face.edges[0])) - _middle(box(back.edges[0]))
    lean = lean_offset / thick
    if np.linalg.norm(lean_offset) > 1e-3:
        matrix = np.eye(3)
        matrix[:2, 2] = -lean
        x, y = lean_offset
        off = short_length(float(np.hypot(x, y)))
        finding = Finding(
            "sheared", f"sheared: its face lies {off} beside its back (x {x:+.4g} mm, y {y:+.4g} mm)",
            "export it again from its marker.json",
        )  # fmt: skip
        yield Placement(finding, _with_surface(marker, reading, surface.mapped(matrix)))


def _middle(limits: tuple[float, float, float, float]) -> Array:
    left, bottom, right, top = limits
    return np.array([left + right, bottom + top]) / 2


def in_part(marker: Marker, surface: Surface, tolerance: float) -> tuple[list[Finding], str, int] | None:
    """Errors of a file of the dark or of the light parts alone, a note, and the number of dots; None for other files.

    The file is in the marker frame: nothing else shows where the other parts go. Tolerance in mm.
    """
    expected = expected_dots(marker)
    ids = [point.id for point in marker.control_points]
    if surface.loose:
        dots = dots_of_surface(surface, expected)
        note, places = DARK, dots.centers
        nearest = [int(np.argmin(np.linalg.norm(expected.centers - place, axis=1))) for place in places]
        rise = np.ones(1)
        if len(dots) and dots.heights is not None and expected.heights is not None:
            rise = dots.heights - expected.heights[nearest]
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


# --- Several plates --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PlateInFile:
    """A marker's layout found in a file.

    Attributes
    ----------
    rotation, translation : array (3, 3) and (3,)
        Its pose in the file, mm.
    points : array (m, 3)
        Its dots in the file, mm.
    wanted : array (m, 3)
        The same dots in the marker frame, mm.
    view : Surface
        The side that shows it.
    dots : DotSet
        All dots of that side and height.
    """

    verdict: Verdict
    rotation: Array
    translation: Array
    points: Array
    wanted: Array
    view: Surface
    dots: DotSet


@dataclass(frozen=True, eq=False)
class FileMotion:
    """A rigid motion from the rig frame to that of a file, mm."""

    rotation: Array
    translation: Array

    @classmethod
    def by(cls, plate: Plate, placed: PlateInFile) -> "FileMotion":
        """Motion that one plate shows."""
        rotation = placed.rotation @ plate.rotation_matrix.T
        return cls(rotation, placed.translation - rotation @ (1e3 * plate.translation_vector))

    def of(self, plate: Plate) -> tuple[Array, Array]:
        """Pose that a marker has in the file if its place in the rig is right."""
        place = self.rotation @ (1e3 * plate.translation_vector) + self.translation
        return self.rotation @ plate.rotation_matrix, place


def check_sides(body: Body, reading: Reading, tolerance: float) -> Check:
    """Compare the sides of a solid with a body as designed."""
    plates = [replace(plate, marker=plate.marker.as_designed) for plate in body.plates]
    views = [page.surface for page in reading.pages if page.surface is not None]
    factor, findings = _unit(plates, views)
    views = [surface.scaled(factor) if factor != 1 else surface for surface in views]
    compared = _compared(plates, reading, views, tolerance)
    if (stretch := _stretch(compared)) is not None:
        undone = [surface.scaled(1 / stretch) for surface in views]
        half = 500 * np.ptp(_points_of(plates), axis=0)[[0, 1]]
        findings = [scale_finding(stretch / factor, stretch / factor, np.maximum(half, 1.0), 1e3 * tolerance)]
        compared = _compared(plates, reading, undone, tolerance)
    # The kernel's checks of a solid depend on its size.
    flaws = () if findings else reading.flaws
    errors = (*(Finding("solid", flaw) for flaw in flaws), *findings, *compared.check.findings)
    result = replace(compared.check, findings=errors, tolerance=tolerance)
    if findings:
        scale = (stretch or 1.0) / factor
        return replace(result, largest=np.nan, worst=None, scale=(scale, scale))
    return result


def _unit(plates: Sequence[Plate], views: Sequence[Surface]) -> tuple[float, list[Finding]]:
    """Factor that undoes a wrong unit, 1 if there is none, and the finding about it."""
    if not views:
        return 1.0, []
    corners = [np.array([part.low, part.high]) for part in views[0].parts]
    size = float(np.linalg.norm(np.ptp(np.concatenate(corners), axis=0)))
    outlines = [plate.to_body(_in_plane(np.concatenate(plate.marker.boundary.outlines()))) for plate in plates]
    wanted = 1e3 * float(np.linalg.norm(np.ptp(np.concatenate(outlines), axis=0)))
    ratio = size / wanted
    if not 0 < ratio < np.inf or abs(np.log(ratio)) < np.log(ROUGHLY) / 2:
        return 1.0, []
    nearest = min(KNOWN, key=lambda factor: abs(np.log(ratio / factor)))
    if abs(np.log(ratio / nearest)) > np.log(ROUGHLY) / 2:
        return 1.0, []
    return 1 / nearest, [scale_finding(nearest, nearest, np.array([wanted, wanted]), 1e-3)]


def _points_of(plates: Sequence[Plate]) -> Array:
    """Control points (n, 3) of all plates in m, body frame."""
    return np.concatenate([plate.to_body(plate.marker.xyz) for plate in plates])


def _in_plane(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])


@dataclass(frozen=True)
class _Compared:
    check: Check
    verdicts: tuple[Verdict, ...]


def _stretch(compared: _Compared) -> float | None:
    """Factor by which a whole file is scaled, where all its markers are."""
    scales = np.array([verdict.scale for verdict in compared.verdicts])
    is_scaled = [any(finding.kind == "scaled" for finding in verdict.findings) for verdict in compared.verdicts]
    if not is_scaled or not all(is_scaled) or not np.isfinite(scales).all() or np.ptp(scales) > 1e-3:
        return None
    return float(np.median(scales))


def _compared(plates: Sequence[Plate], reading: Reading, views: Sequence[Surface], tolerance: float) -> _Compared:
    kind = reading.kind
    placements = [_placements(plate, views, tolerance) for plate in plates]
    motion = _motion(plates, placements, tolerance)
    if motion is None:
        return _Compared(Check("", kind, findings=(NO_PLATE,)), ())
    chosen = [
        min(candidates, key=lambda placed: _apart(placed, *motion.of(plate)), default=None)
        for plate, candidates in zip(plates, placements, strict=True)
    ]
    findings, notes, largest, worst = list[Finding](), list[str](), 0.0, None
    mirrored = all(
        any(finding.kind == "mirrored" for finding in placed.verdict.findings) for placed in chosen if placed
    )
    if mirrored:
        findings.append(Finding("mirrored", "mirrored", MIRRORED))
    elif (at := _frame(motion, plates, tolerance)) and (kind != "3MF" or "turned" in at):
        notes.append(f"the rig is {at} in the file")
    for k, (plate, placed) in enumerate(zip(plates, chosen, strict=True)):
        if placed is None:
            findings.append(
                Finding("missing", f"{plate.name} is missing: its {len(plate.marker)} dots are not there", AGAIN)
            )
            continue
        errors = [finding for finding in placed.verdict.findings if not (mirrored and finding.kind == "mirrored")]
        local, remark = _beside(plate, placed, tolerance)
        findings += [replace(finding, sentence=f"{plate.name}: {finding.sentence}") for finding in (*errors, *local)]
        notes += remark
        if not mirrored and not any(finding.kind in UNTAGGED for finding in errors):
            findings += _moved(plates, k, chosen, motion, tolerance)
        rotation, translation = motion.of(plate)
        off = np.linalg.norm(placed.points - placed.wanted @ rotation.T - translation, axis=-1)
        if off.max() > largest:
            largest, worst = float(off.max()), f"{plate.name}/{placed.verdict.names[int(np.argmax(off))]}"
    if not findings and views[0].triangles is not None:
        placed_plates = [(plate.marker, *motion.of(plate)) for plate in plates]
        findings += several_findings(
            placed_plates, views[0].triangles @ views[0].rotation, views[0].round_dots, 1e3 * tolerance
        )
    verdicts = tuple(placed.verdict for placed in chosen if placed)
    scales = np.array([verdict.scale for verdict in verdicts])
    check = Check(
        "", kind, sum(len(verdict.used) for verdict in verdicts), 1, largest / 1e3, worst,
        (float(scales[:, 0].mean()), float(scales[:, 1].mean())), (None,), tolerance,
        tuple(list(dict.fromkeys(findings))[: 3 * MOST_LISTED]), tuple(dict.fromkeys(notes)),
    )  # fmt: skip
    return _Compared(check, verdicts)


def _placements(plate: Plate, views: Sequence[Surface], tolerance: float) -> list[PlateInFile]:
    """Find all places of a marker's layout in the sides of a file."""
    wanted = expected_dots(plate.marker)
    ids = [point.id for point in plate.marker.control_points]
    flat = bool(np.ptp(wanted.heights) < LAYER) if wanted.heights is not None else True
    placements = []
    for view in views:
        seen = _visible(view, dots_of_surface(view, wanted))
        for dots in _layers(seen) if flat else [seen]:
            level = replace(wanted, heights=None), ids, replace(dots, heights=None)
            verdicts = judge_copies(*level, tolerance, ordered=False)
            placements += [_in_file(wanted, ids, view, dots, verdict) for verdict in verdicts if len(verdict.used)]
    return placements


def _visible(surface: Surface, dots: DotSet) -> DotSet:
    """Dots that nothing hides from above: not the ends of inlays inside of a body."""
    if not len(dots) or dots.heights is None:
        return dots
    _, z, _ = surface.look(dots.centers)
    balls = np.array([[b.x, b.y, b.radius] for part in surface.parts for b in part.balls]).reshape(-1, 3)
    is_on_axis = np.linalg.norm(dots.centers[:, None] - balls[None, :, :2], axis=-1) < 1.0
    rise = np.where(is_on_axis, balls[None, :, 2], 0.0).max(axis=1, initial=0.0)
    return dots.take(z <= dots.heights + rise + FLUSH)


def _layers(dots: DotSet) -> list[DotSet]:
    """Dots of each height."""
    if not len(dots) or dots.heights is None:
        return []
    order = np.argsort(dots.heights, kind="stable")
    cuts = np.flatnonzero(np.diff(dots.heights[order]) > LAYER) + 1
    return [dots.take(np.sort(rows)) for rows in np.split(order, cuts)]


def _in_file(wanted: DotSet, ids: list[int], view: Surface, dots: DotSet, verdict: Verdict) -> PlateInFile:
    """Place a layout that was found in a view in the frame of the file."""
    assert verdict.motion is not None
    assert dots.heights is not None
    assert wanted.heights is not None
    indices = [ids.index(name) for name in verdict.names]
    have, want = dots.heights[verdict.used], wanted.heights[indices]
    level = float(np.median(have - want))
    rotation, translation = verdict.motion
    rotation_in_view = np.eye(3)
    rotation_in_view[:2, :2] = rotation
    rotation_in_view[2, 2] = np.linalg.det(rotation)
    back = view.rotation.T
    points = np.column_stack([dots.centers[verdict.used], have]) @ view.rotation
    return PlateInFile(
        verdict, back @ rotation_in_view, back @ np.array([*translation, level]), points,
        np.column_stack([wanted.centers[indices], want]), view, dots,
    )  # fmt: skip


def _motion(
    plates: Sequence[Plate], placements: Sequence[Sequence[PlateInFile]], tolerance: float
) -> FileMotion | None:
    """Motion from the rig to the file that most markers agree with, by least squares of their dots; None for none."""
    best: tuple[float, list[tuple[int, PlateInFile]]] | None = None
    for k, candidates in enumerate(placements):
        for placed in candidates:
            guess = FileMotion.by(plates[k], placed)
            agreed, off = [], 0.0
            for j, others in enumerate(placements):
                away = [(_apart(candidate, *guess.of(plates[j])), candidate) for candidate in others]
                distance, nearest = min(away, key=lambda pair: pair[0], default=(np.inf, None))
                # A marker's own turn is known less well than its place.
                if nearest is not None and distance < NEARLY * 1e3 * tolerance:
                    agreed.append((j, nearest))
                    off += distance
            score = off - 1e6 * len(agreed)
            if best is None or score < best[0]:
                best = score, agreed
    if best is None:
        return None
    agreed = best[1]
    first, placed = agreed[0]
    if np.linalg.det(placed.rotation) < 0:
        return FileMotion.by(plates[first], placed)
    source = np.concatenate([1e3 * plates[j].to_body(placed.wanted / 1e3) for j, placed in agreed])
    return FileMotion(*rigid_motion(source, np.concatenate([placed.points for _, placed in agreed])))


def _apart(placed: PlateInFile, rotation: Array, translation: Array) -> float:
    """Largest distance in mm of a found marker's dots from where a pose puts them."""
    return float(
        np.linalg.norm(placed.wanted @ (placed.rotation - rotation).T + placed.translation - translation, axis=-1).max()
    )


def _frame(motion: FileMotion, plates: Sequence[Plate], tolerance: float) -> str:
    """Say how the rig lies in the file; empty if it is where its file says."""
    off = 1e3 * _points_of(plates) @ (motion.rotation - np.eye(3)).T + motion.translation
    if np.linalg.norm(off, axis=-1).max() <= 1e3 * tolerance:
        return ""
    return _motion_words(motion.rotation, motion.translation, 1e3 * tolerance)


def _motion_words(rotation: Array, translation: Array, tolerance: float) -> str:
    """A rotation and a shift in mm in words: ``turned by 3 degrees about z, and 1.2 mm off (x +1.2 mm)``."""
    from scipy.spatial.transform import Rotation

    about = Rotation.from_matrix(rotation).as_rotvec()
    angle, phrases = float(np.linalg.norm(about)), []
    if angle > TURNED:
        axis = about / angle
        k = int(np.argmax(np.abs(axis)))
        way = (
            f"{'-' if axis[k] < 0 else ''}{'xyz'[k]}"
            if abs(axis[k]) > 0.9999
            else "({:.3g}, {:.3g}, {:.3g})".format(*axis)
        )
        phrases.append(f"turned by {np.degrees(angle):.4g} degrees about {way}")
    if np.linalg.norm(translation) > tolerance:
        along = " and ".join(
            f"{axis} {v:+.4g} mm" for axis, v in zip("xyz", translation, strict=True) if abs(v) > tolerance / 10
        )
        phrases.append(f"{short_length(float(np.linalg.norm(translation)))} off ({along})")
    return ", and ".join(phrases) or "not quite in its place"


def _moved(
    plates: Sequence[Plate], k: int, chosen: Sequence[PlateInFile | None], motion: FileMotion, tolerance: float
) -> list[Finding]:
    """Say that a marker is in another place, or in that of another one."""
    plate, placed = plates[k], chosen[k]
    assert placed is not None
    if _apart(placed, *motion.of(plate)) <= 1e3 * tolerance:
        return []
    for j, neighbor in enumerate(plates):
        if j != k and _apart(placed, *motion.of(neighbor)) < NEARLY * 1e3 * tolerance:
            back = chosen[j]
            if back is not None and _apart(back, *motion.of(plate)) < NEARLY * 1e3 * tolerance:
                first, second = sorted((k, j))
                names = f"{plates[first].name} and {plates[second].name}"
                return [Finding("relation", f"{names} are swapped", "put each in its own place")]
            return [Finding("relation", f"{plate.name} is in the place of {neighbor.name}", "put it in its own place")]
    rotation, translation = motion.of(plate)
    displacement = _motion_words(
        rotation.T @ placed.rotation, rotation.T @ (placed.translation - translation), 1e3 * tolerance
    )
    return [Finding("relation", f"{plate.name} is {displacement}, in its own frame", "put it in its place")]


def _beside(plate: Plate, placed: PlateInFile, tolerance: float) -> tuple[list[Finding], list[str]]:
    """Findings about heights, colors and the tag of a marker that was found, and about dots that it does not have."""
    assert placed.verdict.motion is not None
    findings, notes = list[Finding](), list[str]()
    tol, marker = 1e3 * tolerance, plate.marker
    rise = (placed.points - placed.translation) @ placed.rotation[:, 2] - placed.wanted[:, 2]
    findings += [
        Finding(
            "height",
            f"dot {placed.verdict.names[n]} is {short_length(abs(rise[n]))} too {'high' if rise[n] > 0 else 'low'}",
        )
        for n in np.flatnonzero(np.abs(rise) > tol)[:MOST_LISTED]
    ]
    rotation, translation = placed.verdict.motion
    reach = 1e3 * np.concatenate(marker.boundary.outlines()) @ rotation.T + translation
    surface = classified(_part_of(placed.view, reach), marker)
    dots = placed.dots.take(placed.verdict.used)
    if surface.loose:
        notes.append(DARK)
    elif is_light_alone(surface, dots):
        notes.append(LIGHT)
    middle = dots.centers + np.column_stack([(dots.radii + dots.inner) / 2 * dots.rings, np.zeros(len(dots))])
    pale = [placed.verdict.names[n] for n in np.flatnonzero(_pale(surface, dots, middle))]
    if pale:
        findings.append(Finding("color", f"dots {', '.join(map(str, pale[:MOST_LISTED]))} look like the plate", AGAIN))
    inside = _within(placed.dots.centers, reach)
    nearby = placed.dots.take(inside)
    used = np.searchsorted(np.flatnonzero(inside), np.intersect1d(placed.verdict.used, np.flatnonzero(inside)))
    holes = np.array([[1e3 * hole.x, 1e3 * hole.y] for hole in marker.substrate.holes]).reshape(-1, 2)
    findings += extras(nearby, used, placed.verdict.motion, holes)
    if marker.tag is not None and not any(finding.kind in UNTAGGED for finding in placed.verdict.findings):
        page = Page(np.zeros((0, 3)), surface=surface)
        findings += tag_findings(marker.tag, page, lambda points: 1e3 * points @ rotation.T + translation, tol)
    return findings, notes


def _pale(surface: Surface, dots: DotSet, middle: Array) -> NDArray[np.bool_]:
    """Tell which dots have the color of the plate or, without colors, are one with it; by points (m, 2) on them."""
    if surface.loose or dots.heights is None:
        return np.zeros(len(dots), dtype=bool)
    plate = plate_index(surface)
    part, z, colors = surface.look(middle)
    contrasts = [differ(color, surface.parts[plate].color) for color in colors]
    flush = (part == plate) & (z > dots.heights - FLUSH)
    return np.array([bool(flush[k]) if contrasts[k] is None else not contrasts[k] for k in range(len(dots))])


def _part_of(surface: Surface, reach: Array) -> Surface:
    """Parts that lie under a marker, of points (k, 2) around it."""
    left, bottom = reach.min(axis=0)
    right, top = reach.max(axis=0)
    parts = [
        part
        for part in surface.parts
        if part.low[0] < right and part.low[1] < top and part.high[0] > left and part.high[1] > bottom
    ]
    return replace(surface, parts=tuple(parts))


def _within(points: Array, reach: Array) -> NDArray[np.bool_]:
    low, high = reach.min(axis=0), reach.max(axis=0)
    return np.asarray(((points > low) & (points < high)).all(axis=1))
