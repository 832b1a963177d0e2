"""How the plates of a body lie in a solid.

A solid of one plate may be right but for one thing about it as a whole: turned, sheared, in another unit. In a solid of
several each is found by the rims of its dots, and its place compared with the body.
"""

# tests: tests/verification/test_placement.py tests/verification/test_made.py

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from markergen.arrays import Array
from markergen.maths.rotation import inverse_pose, pose_product, rigid_motion, skew
from markergen.model.body import Body, Plate
from markergen.verification.findings import AGAIN, MIRRORED, UNTAGGED, Verdict, judge_copies
from markergen.verification.matching import DotSet
from markergen.verification.rays import CHORDS, difference, normals_of
from markergen.verification.reading import ALIKE
from markergen.verification.result import (
    LENGTHS,
    MOST_LISTED,
    NO_PLATE,
    REMOVE,
    SHEET,
    THROUGH_PLANE,
    Check,
    Finding,
    nearest_mistake,
    scale_finding,
    short_length,
    somewhere,
    unit_mistakes,
)
from markergen.verification.rims import Rims, dots_of
from markergen.verification.solid_files import Solid
from markergen.verification.wanted_solids import WantedSolid, size_of, wanted_dots

STRAIGHT = np.radians(0.01)
"""Angle in rad below which an axis is an axis."""

ROUGHLY = 4.0
"""Maximum ratio of the size of a solid to that of its body, for a guess at its unit."""

LAYER = 0.05
"""Minimum distance in mm between two planes with dots."""

TURNED = np.radians(0.005)
"""Angle in rad below which a marker counts as not turned."""

NEARLY = 20.0
"""Ratio of the tolerance within which a marker in another one's place is recognized."""

COARSE, SNAP = 1e-3, 2e-4
"""Width in rad of the groups of parallel rims, and angle below which a direction is one that is expected."""

MOST_SIDES = 60
"""Maximum number of directions of rims to look from."""


# --- One plate -------------------------------------------------------------------------------------------------------


class Placement(NamedTuple):
    """A way in which a solid as a whole may be wrong, the solid without it, and the factor of lengths that undid it."""

    finding: Finding
    solid: Solid
    times: float = 1.0


def placements(solid: Solid, wanted: WantedSolid, kind: str) -> Iterator[Placement]:
    """The solid if it is turned, or in another unit."""
    for normal in _widest(solid.shell.corners):
        rotation = rotation_up(normal)
        if rotation[2, 2] < 1 - 1e-4:
            # The direction in the file of what is up in the view.
            yield Placement(_direction(rotation[2], kind), solid.mapped(rotation))
    size = size_of(solid.shell.corners) / size_of(wanted.shell.corners)
    homes = ("m", "mm") if kind == "GLB" else ("mm",)
    for ratio, (mistake, remedy) in unit_mistakes(*homes, units=LENGTHS).items():
        if 1 / ROUGHLY < size / ratio < ROUGHLY:
            sentence = f"scaled by {ratio:.6g} along x, y and z: {mistake}"
            rescaled = solid.mapped(np.eye(3) / ratio)
            yield Placement(Finding("scaled", sentence, remedy), rescaled, 1 / ratio)


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


def _widest(corners: Array) -> list[Array]:
    """Unit normals of the largest area of parallel triangles, and the opposite one: the two faces of a plate."""
    areas = normals_of(corners)
    size = np.linalg.norm(areas, axis=1)
    areas, size = areas[size > 0], size[size > 0]
    if not len(size):
        return []
    # Opposite normals together, since a plate's back is larger than its face.
    ways = areas / size[:, None]
    ways *= np.where(ways[np.arange(len(ways)), np.argmax(np.abs(ways), axis=1)] < 0, -1.0, 1.0)[:, None]
    _, group = np.unique(np.round(ways, 2), axis=0, return_inverse=True)
    chosen = group.ravel() == np.argmax(np.bincount(group.ravel(), weights=size))
    way = np.sum(ways[chosen] * size[chosen, None], axis=0)
    way /= np.linalg.norm(way)
    return [way, -way]


def rotation_up(direction: Array) -> Array:
    """Rotation (3, 3) by the smallest angle that turns a unit vector (3,) up; over the x-axis if it points down."""
    if direction[2] < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    cross = skew(np.cross(direction, [0.0, 0.0, 1.0]))
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + direction[2]))


def stretched(solid: Solid, wanted: WantedSolid, tol: float) -> Iterator[Placement]:
    """The solid if its heights are mirrored or scaled, or its layers shifted against each other: it is then sheared."""
    yield Placement(Finding("mirrored", THROUGH_PLANE, MIRRORED), solid.mapped(np.diag([1.0, 1.0, -1.0])))
    (low, high), (wanted_low, wanted_high) = solid.shell.heights, wanted.shell.heights
    by = (high - low) / (wanted_high - wanted_low)
    if by > 0 and abs(by - 1) * (wanted_high - wanted_low) > tol:
        finding = Finding("scaled", f"scaled by {by:.5g} along z", "export it again at its size")
        yield Placement(finding, solid.mapped(np.diag([1.0, 1.0, 1 / by])))
    below, above = (_middle(solid, wanted, low, wanted_low), _middle(solid, wanted, high, wanted_high))
    lean = (above - below) / max(high - low, 1e-9)
    if np.linalg.norm(above - below) > tol:
        matrix = np.eye(3)
        matrix[:2, 2] = -lean
        x, y = above - below
        off = short_length(float(np.hypot(x, y)))
        sentence = f"sheared: its face lies {off} beside its back (x {x:+.4g} mm, y {y:+.4g} mm)"
        finding = Finding("sheared", sentence, "export it again from its marker.json")
        yield Placement(finding, solid.mapped(matrix))


def _middle(solid: Solid, wanted: WantedSolid, height: float, wanted_height: float) -> Array:
    """Middle of what is at a height of a solid, relative to that of the wanted one."""
    middles = []
    for shell, z in ((solid.shell, height), (wanted.shell, wanted_height)):
        level = shell.corners.reshape(-1, 3)
        level = level[np.abs(level[:, 2] - z) < 0.01]
        middles.append((level.min(axis=0) + level.max(axis=0))[:2] / 2)
    return np.asarray(middles[0] - middles[1])


# --- Several plates --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PlateInFile:
    """A marker's layout found in a file.

    Attributes
    ----------
    rotation, translation : array (3, 3) and (3,)
        Its pose in the file, mm.
    points : array (m, 3)
        The rims of its dots in the file, mm.
    wanted : array (m, 3)
        The same rims in the marker frame, mm.
    """

    verdict: Verdict
    rotation: Array
    translation: Array
    points: Array
    wanted: Array

    @property
    def is_mirrored(self) -> bool:
        """True if the layout is that of the marker seen from behind."""
        return "mirrored" in self.verdict.kinds


FilePose = tuple[Array, Array]
"""Rotation (3, 3) and translation (3,) in mm, from the frame of the rig or of a plate to that of a file."""


def check_sides(body: Body, solid: Solid, wanted: WantedSolid, kind: str, tolerance: float) -> Check:
    """Compare a solid with a body of several plates as designed."""
    designed = body.as_designed
    # In mm, as the file is.
    plates = [replace(plate, translation=tuple(1e3 * plate.translation_vector)) for plate in designed.plates]
    factor, findings = _unit(solid, wanted)
    solid = solid.mapped(factor * np.eye(3)) if factor != 1 else solid
    check, verdicts = _compared(plates, solid, wanted, kind, tolerance)
    stretch = _stretch(verdicts)
    if stretch is not None:
        half = 500 * np.ptp(designed.xyz, axis=0)[[0, 1]]
        findings = [scale_finding(stretch / factor, stretch / factor, np.maximum(half, 1.0), 1e3 * tolerance)]
        check, _ = _compared(plates, solid.mapped(np.eye(3) / stretch), wanted, kind, tolerance)
    if not findings:
        return check
    scale = (stretch or 1.0) / factor
    return replace(check, findings=(*findings, *check.findings), largest=np.nan, worst=None, scale=(scale, scale))


def _unit(solid: Solid, wanted: WantedSolid) -> tuple[float, list[Finding]]:
    """Factor that undoes a wrong unit, 1 if there is none, and the finding about it."""
    size = size_of(wanted.shell.corners)
    ratio = size_of(solid.shell.corners) / size
    if not 0 < ratio < np.inf or abs(np.log(ratio)) < np.log(ROUGHLY) / 2:
        return 1.0, []
    nearest = nearest_mistake(ratio, unit_mistakes("mm", units=LENGTHS))
    if abs(np.log(ratio / nearest)) > np.log(ROUGHLY) / 2:
        return 1.0, []
    return 1 / nearest, [scale_finding(nearest, nearest, np.array([size, size]), 1e-3)]


def _stretch(verdicts: Sequence[Verdict]) -> float | None:
    """Factor by which a whole file is scaled, where all its markers are."""
    scales = np.array([verdict.scale for verdict in verdicts])
    is_scaled = ["scaled" in verdict.kinds for verdict in verdicts]
    if not is_scaled or not all(is_scaled) or not np.isfinite(scales).all() or np.ptp(scales) > 1e-3:
        return None
    return float(np.median(scales))


def _compared(
    plates: Sequence[Plate], solid: Solid, wanted: WantedSolid, kind: str, tolerance: float
) -> tuple[Check, list[Verdict]]:
    candidates_of_plates = [_placements(plate, solid.shell.rims, wanted, plates, tolerance) for plate in plates]
    motion = _motion(plates, candidates_of_plates, tolerance)
    if motion is None and not any(_wanted_on(plate, wanted)[0].names for plate in plates):
        return Check("", kind, findings=tuple(_of_whole(solid, wanted, tolerance)), notes=(SHEET,)), []
    if motion is None:
        return Check("", kind, findings=(NO_PLATE,)), []
    poses = [plate.camera_pose(*motion) for plate in plates]
    chosen = [
        min(candidates, key=lambda placed: _misfit(placed, pose, tolerance), default=None)
        for pose, candidates in zip(poses, candidates_of_plates, strict=True)
    ]
    findings, largest, worst = list[Finding](), 0.0, None
    notes = [wanted.note] if wanted.note else []
    mirrored = all(placed.is_mirrored for placed in chosen if placed)
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
        # Dots above or below the plane of the others.
        rise = (placed.points - placed.translation) @ placed.rotation[:, 2] - placed.wanted[:, 2]
        for n in np.flatnonzero(np.abs(rise) > 1e3 * tolerance)[:MOST_LISTED]:
            way = "high" if rise[n] > 0 else "low"
            sentence = f"dot {placed.verdict.expected.names[n]} is {short_length(abs(rise[n]))} too {way}"
            errors.append(Finding("height", sentence))
        findings += [finding.about(plate.name) for finding in errors]
        if not mirrored and not any(finding.kind in UNTAGGED for finding in errors):
            findings += _moved(plates, k, chosen, poses, tolerance)
        rotation, translation = poses[k]
        off = np.linalg.norm(placed.points - placed.wanted @ rotation.T - translation, axis=-1)
        if off.max() > largest:
            largest, worst = float(off.max()), f"{plate.name}/{placed.verdict.expected.names[int(np.argmax(off))]}"
    if not findings:
        findings = _of_whole(solid.mapped(*inverse_pose(motion)), wanted, tolerance)
    verdicts = [placed.verdict for placed in chosen if placed]
    x, y = np.mean([verdict.scale for verdict in verdicts], axis=0).tolist()
    check = Check(
        "", kind, sum(len(verdict.used) for verdict in verdicts), 1, largest / 1e3, worst, (x, y), (None,), tolerance,
        tuple(list(dict.fromkeys(findings))[: 3 * MOST_LISTED]), tuple(dict.fromkeys(notes)),
    )  # fmt: skip
    return check, verdicts


def _of_whole(solid: Solid, wanted: WantedSolid, tolerance: float) -> list[Finding]:
    """What a solid in the frame of the body has too much, too little, or in the other color."""
    compared = difference(solid.shell, wanted.shell, 1e3 * tolerance + CHORDS)
    findings = somewhere("extra", "something that belongs to no plate", compared.extra, REMOVE)
    findings = findings or somewhere("missing", "something missing", compared.missing, AGAIN)
    findings = findings or somewhere("twice", "something that is there twice", compared.twice, REMOVE)
    return [*findings, *somewhere("color", "the other color than it should be", compared.repainted, AGAIN)]


def _wanted_on(plate: Plate, wanted: WantedSolid) -> tuple[DotSet, Array]:
    """Rims of a plate's dots as `wanted_dots` has them, in the marker's frame."""
    to_plate = inverse_pose((plate.rotation_matrix, plate.translation_vector))
    return wanted_dots(plate.marker, wanted.shell.rims.mapped(*to_plate))


def _placements(
    plate: Plate, rims: Rims, wanted: WantedSolid, plates: Sequence[Plate], tolerance: float
) -> list[PlateInFile]:
    """Find all places of a marker's layout among the rims of a file."""
    expected, sizes = _wanted_on(plate, wanted)
    if not len(expected):
        return []
    ways = np.array([neighbor.rotation_matrix[:, 2] for neighbor in plates])
    placements = []
    for way in _directions(rims, sizes, ways):
        rotation = rotation_up(way)
        seen = _open(dots_of(view := rims.mapped(rotation), sizes), view)
        for dots in _layers(seen) if np.ptp(expected.heights) < LAYER else [seen]:
            # Heights are compared in the file.
            verdicts = judge_copies(expected, replace(dots, heights=np.full(len(dots), np.nan)), tolerance)
            placements += [_in_file(rotation, dots, verdict) for verdict in verdicts if len(verdict.used)]
    return placements


def _directions(rims: Rims, sizes: Array, ways: Array) -> Iterator[Array]:
    """Unit normals of rims of about some radii, those with most rims first; expected ones (k, 3) as they are."""
    alike = np.abs(np.log(np.maximum(rims.radii[:, None], 1e-12) / sizes)).min(axis=1) < 0.1
    # A half-ball has a rim below alone.
    normals = np.concatenate([rims.normals[alike], -rims.normals[alike]])
    _, first, count = np.unique(np.round(normals / COARSE), axis=0, return_index=True, return_counts=True)
    before: list[Array] = []
    for index in first[np.argsort(-count, kind="stable")][:MOST_SIDES]:
        snapped = ways[np.linalg.norm(ways - normals[index], axis=1) < SNAP]
        way = snapped[0] if len(snapped) else normals[index]
        if all(np.linalg.norm(way - earlier) > COARSE for earlier in before):
            before.append(way)
            yield way


def _open(dots: DotSet, rims: Rims) -> DotSet:
    """Dots of a view without those that lie on a face, such as the floor of a pocket below an inlay seen from behind.

    Where that leaves none, they are all there is: half-balls that stand on a plate.
    """
    away = np.linalg.norm(np.column_stack([dots.centers, dots.heights])[:, None] - rims.centers, axis=2)
    here = (away < LAYER) & (np.abs(np.log(rims.radii / dots.radii[:, None])) < np.log(ALIKE))
    is_closed = (here & (rims.normals[:, 2] < -0.99)).any(axis=1) & (here & (rims.normals[:, 2] > 0.99)).any(axis=1)
    return dots if is_closed.all() else dots.take(~is_closed)


def _layers(dots: DotSet) -> list[DotSet]:
    """Dots of each height."""
    order = np.argsort(dots.heights, kind="stable")
    cuts = np.flatnonzero(np.diff(dots.heights[order]) > LAYER) + 1
    return [dots.take(np.sort(rows)) for rows in np.split(order, cuts)]


def _in_file(view: Array, dots: DotSet, verdict: Verdict) -> PlateInFile:
    """Place a layout that was found in a view (3, 3) in the frame of the file."""
    assert verdict.motion is not None
    have, want = dots.heights[verdict.used], verdict.expected.heights
    level = float(np.median(have - want))
    rotation, translation, _ = verdict.motion
    rotation_in_view = np.eye(3)
    rotation_in_view[:2, :2] = rotation
    rotation_in_view[2, 2] = np.linalg.det(rotation)
    points = np.column_stack([dots.centers[verdict.used], have]) @ view
    return PlateInFile(
        verdict, view.T @ rotation_in_view, view.T @ np.array([*translation, level]), points,
        np.column_stack([verdict.expected.centers, want]),
    )  # fmt: skip


def _motion(plates: Sequence[Plate], placements: Sequence[Sequence[PlateInFile]], tolerance: float) -> FilePose | None:
    """Pose of the rig in the file that most markers agree with, by least squares of their dots; None for none."""
    best: tuple[float, list[tuple[int, PlateInFile]]] | None = None
    for k, candidates in enumerate(placements):
        for placed in candidates:
            rotation = placed.rotation @ plates[k].rotation_matrix.T
            guess = rotation, placed.translation - rotation @ plates[k].translation_vector
            agreed, off = [], 0.0
            for j, (plate, others) in enumerate(zip(plates, placements, strict=True)):
                pose = plate.camera_pose(*guess)
                nearest = min(others, key=lambda candidate: _misfit(candidate, pose, tolerance), default=None)
                distance = np.inf if nearest is None else _apart(nearest, pose)
                # A marker's own rotation is known less well than its place.
                if nearest is not None and distance < NEARLY * 1e3 * tolerance:
                    agreed.append((j, nearest))
                    off += distance
            score = off - 1e6 * len(agreed) + 1e3 * placed.is_mirrored
            if best is None or score < best[0]:
                best = score, agreed
    if best is None:
        return None
    agreed = best[1]
    source = np.concatenate([plates[j].to_body(placed.wanted) for j, placed in agreed])
    return rigid_motion(source, np.concatenate([placed.points for _, placed in agreed]))


def _apart(placed: PlateInFile, pose: FilePose) -> float:
    """Largest distance in mm of a layout's dots from where a pose puts them."""
    off = placed.wanted @ (placed.rotation - pose[0]).T + placed.translation - pose[1]
    return float(np.linalg.norm(off, axis=-1).max())


def _misfit(placed: PlateInFile, pose: FilePose, tolerance: float) -> tuple[bool, bool, float]:
    """Order of places by how well they fit a pose; what is seen from behind, if it fits no better, comes last."""
    distance = _apart(placed, pose)
    return distance >= NEARLY * 1e3 * tolerance, placed.is_mirrored, distance


def _frame(motion: FilePose, plates: Sequence[Plate], tolerance: float) -> str:
    """Say how the rig lies in the file; empty if it is where its file says."""
    points = np.concatenate([plate.to_body(1e3 * plate.marker.xyz) for plate in plates])
    off = points @ (motion[0] - np.eye(3)).T + motion[1]
    return "" if np.linalg.norm(off, axis=-1).max() <= 1e3 * tolerance else _motion_words(*motion, 1e3 * tolerance)


def _motion_words(rotation: Array, translation: Array, tolerance: float) -> str:
    """A rotation and a translation in mm in words: ``turned by 3 degrees about z, and 1.2 mm off (x +1.2 mm)``."""
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
    plates: Sequence[Plate],
    k: int,
    chosen: Sequence[PlateInFile | None],
    poses: Sequence[FilePose],
    tolerance: float,
) -> list[Finding]:
    """Say that a marker is in another place, or in that of another one."""
    plate, placed = plates[k], chosen[k]
    assert placed is not None
    if _apart(placed, poses[k]) <= 1e3 * tolerance:
        return []
    for j, neighbor in enumerate(plates):
        if j != k and _apart(placed, poses[j]) < NEARLY * 1e3 * tolerance:
            back = chosen[j]
            if back is not None and _apart(back, poses[k]) < NEARLY * 1e3 * tolerance:
                first, second = sorted((k, j))
                names = f"{plates[first].name} and {plates[second].name}"
                return [Finding("relation", f"{names} are swapped", "put each in its own place")]
            return [Finding("relation", f"{plate.name} is in the place of {neighbor.name}", "put it in its own place")]
    moved = pose_product(inverse_pose(poses[k]), (placed.rotation, placed.translation))
    displacement = _motion_words(*moved, 1e3 * tolerance)
    return [Finding("relation", f"{plate.name} is {displacement}, in its own frame", "put it in its place")]
