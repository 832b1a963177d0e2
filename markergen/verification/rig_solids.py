"""Check solids of rigs: each marker is looked at from its own side, and its place in the file compared with the rig."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from markergen.model.body import Plate
from markergen.model.rig import Rig
from markergen.verification.check import UNTAGGED, Check
from markergen.verification.findings import AGAIN, MIRRORED, Verdict, extras, judge
from markergen.verification.made import is_light_alone
from markergen.verification.matching import DotSet, expected_dots
from markergen.verification.mesh import sides_of, triangles_of
from markergen.verification.models import model_of, site_flaws
from markergen.verification.placement import DARK, LIGHT, ROUGHLY
from markergen.verification.reading import PRINTABLE, Page
from markergen.verification.solids import FLUSH, differ, dots_of_surface, flaws_of, plate_of, reading_of
from markergen.verification.step import sides_of as sides_of_kernel
from markergen.verification.surface import Surface, View
from markergen.verification.tags import tag_findings
from markergen.verification.words import KNOWN, MOST_LISTED, Finding, scale_finding, short_length

Array = NDArray[np.float64]

MODELS = {".urdf": "URDF", ".sdf": "SDF", ".mjcf.xml": "MJCF"}
MESHES = {".stl": "STL", ".3mf": "3MF", ".glb": "GLB"}
KERNEL = {".step": "STEP", ".stp": "STEP", ".brep": "BREP"}
SUFFIXES = (*MODELS, *MESHES, *KERNEL)
"""Suffixes of the solids that can be verified against a rig."""

MOST_COPIES = 100
"""Maximum number of times that a marker's layout is looked for in one view."""

LAYER = 0.05
"""Minimum distance in mm between two planes with dots."""

TURNED = np.radians(0.005)
"""Angle in rad below which a marker counts as not turned."""

NEARLY = 20.0
"""Ratio of the tolerance within which a marker in another one's place is recognized."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A marker's layout found in a file.

    Attributes
    ----------
    turn, shift : array (3, 3) and (3,)
        Its pose in the file, mm.
    points : array (m, 3)
        Its dots in the file, mm.
    wanted : array (m, 3)
        The same dots in the marker frame, mm.
    view : View
        The side that shows it.
    dots : DotSet
        All dots of that side and height.
    """

    verdict: Verdict
    rotation: Array
    translation: Array
    points: Array
    wanted: Array
    view: View
    dots: DotSet


@dataclass(frozen=True, eq=False)
class Motion:
    """A rigid motion from the rig frame to that of a file, mm."""

    rotation: Array
    translation: Array

    def of(self, each: Plate) -> tuple[Array, Array]:
        """Pose that a marker has in the file if its place in the rig is right."""
        place = self.rotation @ (1e3 * each.translation_vector) + self.translation
        return self.rotation @ each.rotation_matrix, place


def check_solid(rig: Rig, suffix: str, data: bytes, name: str, tolerance: float | None) -> Check:
    """Compare a solid with a rig as designed; raises as the readers of solids do."""
    allowed = PRINTABLE if tolerance is None else tolerance
    kind, views, flaws = _read(rig, suffix, data, name)
    factor, findings = _unit(rig, views)
    views = [(turn, surface.scaled(factor) if factor != 1 else surface) for turn, surface in views]
    check = _compared(rig, kind, views, allowed, suffix in MODELS)
    if (stretch := _stretch(check)) is not None:
        undone = [(turn, surface.scaled(1 / stretch)) for turn, surface in views]
        half = 500 * np.ptp(rig.xyz, axis=0)[[0, 1]]
        findings = [scale_finding(stretch / factor, stretch / factor, np.maximum(half, 1.0), 1e3 * allowed)]
        check = _compared(rig, kind, undone, allowed, suffix in MODELS)
    said = [*(Finding("solid", flaw) for flaw in flaws), *findings]
    if not findings and views:
        said += [Finding("solid", flaw) for flaw in flaws_of(views[0][1])]
    scale = stretch or 1.0
    result = replace(check.check, findings=(*said, *check.check.findings), tolerance=allowed)
    if findings:
        return replace(result, largest=np.nan, worst=None, scale=(scale / factor, scale / factor))
    return result


def _read(rig: Rig, suffix: str, data: bytes, name: str) -> tuple[str, list[View], list[str]]:
    """Kind of a file, views of all its sides, and what is wrong with it otherwise."""
    ways = np.array([each.rotation_matrix[:, 2] for each in rig.markers])
    if suffix in KERNEL:
        return KERNEL[suffix], sides_of_kernel(KERNEL[suffix], data, name), []
    if suffix in MESHES:
        return MESHES[suffix], sides_of(triangles_of(MESHES[suffix], data, name), ways, name), []
    model = model_of(MODELS[suffix], data, name)
    wanted = {
        f"{each.name}/dot-{point.id}": each.to_body(np.array([point.x, point.y, point.z]))
        for each in rig.markers
        for point in each.marker.control_points
    }
    wanted |= {f"{each.name}/marker": each.translation_vector for each in rig.markers}
    flaws = [*model.flaws, *site_flaws(model, wanted)[:MOST_LISTED]]
    return MODELS[suffix], sides_of(model.pieces, ways, name), flaws


def _unit(rig: Rig, views: Sequence[View]) -> tuple[float, list[Finding]]:
    """Factor that undoes a wrong unit, 1 if there is none, and the finding about it."""
    if not views:
        return 1.0, []
    corners = [np.array([part.low, part.high]) for part in views[0][1].parts]
    size = float(np.linalg.norm(np.ptp(np.concatenate(corners), axis=0)))
    wanted = 1e3 * float(
        np.linalg.norm(np.ptp(np.concatenate([rig.outline(k) for k in range(len(rig.markers))]), axis=0))
    )
    ratio = size / wanted
    if not 0 < ratio < np.inf or abs(np.log(ratio)) < np.log(ROUGHLY) / 2:
        return 1.0, []
    near = min(KNOWN, key=lambda known: abs(np.log(ratio / known)))
    if abs(np.log(ratio / near)) > np.log(ROUGHLY) / 2:
        return 1.0, []
    return 1 / near, [scale_finding(near, near, np.array([wanted, wanted]), 1e-3)]


@dataclass(frozen=True)
class _Compared:
    check: Check
    verdicts: tuple[Verdict, ...]


def _stretch(compared: _Compared) -> float | None:
    """Factor by which a whole file is scaled, where all its markers are."""
    scales = np.array([each.scale for each in compared.verdicts])
    told = [any(one.kind == "scaled" for one in each.findings) for each in compared.verdicts]
    if not told or not all(told) or not np.isfinite(scales).all() or np.ptp(scales) > 1e-3:
        return None
    return float(np.median(scales))


def _compared(rig: Rig, kind: str, views: Sequence[View], tolerance: float, framed: bool) -> _Compared:
    found = [_placements(each, views, tolerance) for each in rig.markers]
    motion = _motion(rig, found, tolerance)
    if motion is None:
        none = Finding("no dots", "no marker of the rig is in it", "export it again, or verify it against its own rig")
        return _Compared(Check("", kind, findings=(none,)), ())
    chosen = [
        min(some, key=lambda one: _apart(one, *motion.of(each)), default=None)
        for each, some in zip(rig.markers, found, strict=True)
    ]
    findings, notes, largest, worst = list[Finding](), list[str](), 0.0, None
    mirrored = all(any(said.kind == "mirrored" for said in one.verdict.findings) for one in chosen if one)
    if mirrored:
        findings.append(Finding("mirrored", "mirrored", MIRRORED))
    elif (at := _frame(motion, rig, tolerance)) and (framed or kind != "3MF" or "turned" in at):
        if framed:
            findings.append(Finding("frame", f"its frame is not the rig's: the rig is {at} in it", AGAIN))
        else:
            notes.append(f"the rig is {at} in the file")
    for k, (each, one) in enumerate(zip(rig.markers, chosen, strict=True)):
        if one is None:
            findings.append(
                Finding("missing", f"{each.name} is missing: its {len(each.marker)} dots are not there", AGAIN)
            )
            continue
        said = [said for said in one.verdict.findings if not (mirrored and said.kind == "mirrored")]
        local, remark = _beside(each, one, tolerance)
        findings += [replace(own, sentence=f"{each.name}: {own.sentence}") for own in (*said, *local)]
        notes += remark
        if not mirrored and not any(own.kind in UNTAGGED for own in said):
            findings += _moved(rig, k, chosen, motion, tolerance)
        turn, shift = motion.of(each)
        off = np.linalg.norm(one.points - one.wanted @ turn.T - shift, axis=-1)
        if off.max() > largest:
            largest, worst = float(off.max()), f"{each.name}/{one.verdict.names[int(np.argmax(off))]}"
    verdicts = tuple(one.verdict for one in chosen if one)
    scales = np.array([each.scale for each in verdicts])
    check = Check(
        "", kind, sum(len(each.used) for each in verdicts), 1, largest / 1e3, worst,
        (float(scales[:, 0].mean()), float(scales[:, 1].mean())), (None,), tolerance,
        tuple(list(dict.fromkeys(findings))[: 3 * MOST_LISTED]), tuple(dict.fromkeys(notes)),
    )  # fmt: skip
    return _Compared(check, verdicts)


def _placements(each: Plate, views: Sequence[View], tolerance: float) -> list[Placed]:
    """Find all places of a marker's layout in the sides of a file."""
    wanted = expected_dots(each.marker)
    ids = [point.id for point in each.marker.control_points]
    flat = bool(np.ptp(wanted.heights) < LAYER) if wanted.heights is not None else True
    found = []
    for view in views:
        seen = _visible(view[1], dots_of_surface(view[1], wanted))
        for dots in _layers(seen) if flat else [seen]:
            left = np.arange(len(dots))
            for _ in range(MOST_COPIES):
                verdict = judge(
                    replace(wanted, heights=None), ids, replace(dots.take(left), heights=None), tolerance, ordered=False
                )
                if verdict.motion is None or not len(verdict.used):
                    break
                found.append(_in_file(wanted, ids, view, dots, replace(verdict, used=left[verdict.used])))
                left = np.setdiff1d(left, found[-1].verdict.used)
                if len(left) < 3:
                    break
    return found


def _visible(surface: Surface, dots: DotSet) -> DotSet:
    """Dots that nothing hides from above: not the ends of inlays inside of a body."""
    if not len(dots) or dots.heights is None:
        return dots
    _, z, _ = surface.look(dots.centers)
    balls = np.array([[b.x, b.y, b.radius] for part in surface.parts for b in part.balls]).reshape(-1, 3)
    near = np.linalg.norm(dots.centers[:, None] - balls[None, :, :2], axis=-1) < 1.0
    rise = np.where(near, balls[None, :, 2], 0.0).max(axis=1, initial=0.0)
    return dots.take(z <= dots.heights + rise + FLUSH)


def _layers(dots: DotSet) -> list[DotSet]:
    """Dots of each height."""
    if not len(dots) or dots.heights is None:
        return []
    order = np.argsort(dots.heights, kind="stable")
    cuts = np.flatnonzero(np.diff(dots.heights[order]) > LAYER) + 1
    return [dots.take(np.sort(some)) for some in np.split(order, cuts)]


def _in_file(wanted: DotSet, ids: list[int], view: View, dots: DotSet, verdict: Verdict) -> Placed:
    """Place a layout that was found in a view in the frame of the file."""
    assert verdict.motion is not None
    assert dots.heights is not None
    assert wanted.heights is not None
    own = [ids.index(name) for name in verdict.names]
    have, want = dots.heights[verdict.used], wanted.heights[own]
    level = float(np.median(have - want))
    rotation, shift = verdict.motion
    turn = np.eye(3)
    turn[:2, :2] = rotation
    turn[2, 2] = np.linalg.det(rotation)
    back = view[0].T
    points = np.column_stack([dots.centers[verdict.used], have]) @ view[0]
    return Placed(
        verdict, back @ turn, back @ np.array([*shift, level]), points,
        np.column_stack([wanted.centers[own], want]), view, dots,
    )  # fmt: skip


def _motion(rig: Rig, found: Sequence[Sequence[Placed]], tolerance: float) -> Motion | None:
    """Motion from the rig to the file that most markers agree with, by least squares of their dots; None for none."""
    from scipy.spatial.transform import Rotation

    best: tuple[float, list[tuple[int, Placed]]] | None = None
    for k, some in enumerate(found):
        for one in some:
            turn = one.rotation @ rig.markers[k].rotation_matrix.T
            guess = Motion(turn, one.translation - turn @ (1e3 * rig.markers[k].translation_vector))
            agreed, off = [], 0.0
            for j, others in enumerate(found):
                away = [(_apart(other, *guess.of(rig.markers[j])), other) for other in others]
                near, other = min(away, key=lambda pair: pair[0], default=(np.inf, None))
                # A marker's own turn is known less well than its place.
                if other is not None and near < NEARLY * 1e3 * tolerance:
                    agreed.append((j, other))
                    off += near
            score = off - 1e6 * len(agreed)
            if best is None or score < best[0]:
                best = score, agreed
    if best is None:
        return None
    agreed = best[1]
    if np.linalg.det(agreed[0][1].rotation) < 0:
        one = agreed[0][1]
        turn = one.rotation @ rig.markers[agreed[0][0]].rotation_matrix.T
        return Motion(turn, one.translation - turn @ (1e3 * rig.markers[agreed[0][0]].translation_vector))
    source = np.concatenate([1e3 * rig.markers[j].to_body(one.wanted / 1e3) for j, one in agreed])
    target = np.concatenate([one.points for _, one in agreed])
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    turn = Rotation.align_vectors(target - goal, source - middle)[0].as_matrix()
    return Motion(turn, goal - turn @ middle)


def _apart(one: Placed, turn: Array, shift: Array) -> float:
    """Largest distance in mm of a found marker's dots from where a pose puts them."""
    return float(np.linalg.norm(one.wanted @ (one.rotation - turn).T + one.translation - shift, axis=-1).max())


def _frame(motion: Motion, rig: Rig, tolerance: float) -> str:
    """Say how the rig lies in the file; empty if it is where its file says."""
    off = 1e3 * rig.xyz @ (motion.rotation - np.eye(3)).T + motion.translation
    if np.linalg.norm(off, axis=-1).max() <= 1e3 * tolerance:
        return ""
    return _motion_words(motion.rotation, motion.translation, 1e3 * tolerance)


def _motion_words(turn: Array, shift: Array, tolerance: float) -> str:
    """A rotation and a shift in mm in words: ``turned by 3 degrees about z, and 1.2 mm off (x +1.2 mm)``."""
    from scipy.spatial.transform import Rotation

    about = Rotation.from_matrix(turn).as_rotvec()
    angle, said = float(np.linalg.norm(about)), []
    if angle > TURNED:
        axis = about / angle
        k = int(np.argmax(np.abs(axis)))
        way = (
            f"{'-' if axis[k] < 0 else ''}{'xyz'[k]}"
            if abs(axis[k]) > 0.9999
            else "({:.3g}, {:.3g}, {:.3g})".format(*axis)
        )
        said.append(f"turned by {np.degrees(angle):.4g} degrees about {way}")
    if np.linalg.norm(shift) > tolerance:
        along = " and ".join(
            f"{axis} {v:+.4g} mm" for axis, v in zip("xyz", shift, strict=True) if abs(v) > tolerance / 10
        )
        said.append(f"{short_length(float(np.linalg.norm(shift)))} off ({along})")
    return ", and ".join(said) or "not quite in its place"


def _moved(rig: Rig, k: int, chosen: Sequence[Placed | None], motion: Motion, tolerance: float) -> list[Finding]:
    """Say that a marker is in another place, or in that of another one."""
    each, one = rig.markers[k], chosen[k]
    assert one is not None
    if _apart(one, *motion.of(each)) <= 1e3 * tolerance:
        return []
    for j, other in enumerate(rig.markers):
        if j != k and _apart(one, *motion.of(other)) < NEARLY * 1e3 * tolerance:
            back = chosen[j]
            if back is not None and _apart(back, *motion.of(each)) < NEARLY * 1e3 * tolerance:
                first, second = sorted((k, j))
                names = f"{rig.markers[first].name} and {rig.markers[second].name}"
                return [Finding("relation", f"{names} are swapped", "put each in its own place")]
            return [Finding("relation", f"{each.name} is in the place of {other.name}", "put it in its own place")]
    turn, shift = motion.of(each)
    words = _motion_words(turn.T @ one.rotation, turn.T @ (one.translation - shift), 1e3 * tolerance)
    return [Finding("relation", f"{each.name} is {words}, in its own frame", "put it in its place")]


def _beside(each: Plate, one: Placed, tolerance: float) -> tuple[list[Finding], list[str]]:
    """Findings about heights, colors and the tag of a marker that was found, and about dots that it does not have."""
    assert one.verdict.motion is not None
    findings, notes = list[Finding](), list[str]()
    tol, marker = 1e3 * tolerance, each.marker
    rise = (one.points - one.translation) @ one.rotation[:, 2] - one.wanted[:, 2]
    findings += [
        Finding(
            "height",
            f"dot {one.verdict.names[n]} is {short_length(abs(rise[n]))} too {'high' if rise[n] > 0 else 'low'}",
        )
        for n in np.flatnonzero(np.abs(rise) > tol)[:MOST_LISTED]
    ]
    rotation, shift = one.verdict.motion
    reach = 1e3 * np.concatenate(marker.boundary.outlines()) @ rotation.T + shift
    surface = _part_of(one.view[1], reach)
    dots = one.dots.take(one.verdict.used)
    loose = reading_of("", surface, marker).pages[0].surface
    if loose is not None and loose.loose:
        notes.append(DARK)
        surface = loose
    elif is_light_alone(surface, dots):
        notes.append(LIGHT)
    middle = dots.centers + np.column_stack([(dots.radii + dots.inner) / 2 * dots.rings, np.zeros(len(dots))])
    pale = [one.verdict.names[n] for n in np.flatnonzero(_pale(surface, dots, middle))]
    if pale:
        findings.append(Finding("color", f"dots {', '.join(map(str, pale[:MOST_LISTED]))} look like the plate", AGAIN))
    inside = _within(one.dots.centers, reach)
    near = one.dots.take(inside)
    used = np.searchsorted(np.flatnonzero(inside), np.intersect1d(one.verdict.used, np.flatnonzero(inside)))
    holes = np.array([[1e3 * hole.x, 1e3 * hole.y] for hole in marker.substrate.holes]).reshape(-1, 2)
    findings += extras(near, used, one.verdict.motion, holes)
    if marker.tag is not None and not any(said.kind in UNTAGGED for said in one.verdict.findings):
        page = Page(np.zeros((0, 3)), surface=surface)
        findings += tag_findings(marker.tag, page, lambda points: 1e3 * points @ rotation.T + shift, tol)
    return findings, notes


def _pale(surface: Surface, dots: DotSet, middle: Array) -> NDArray[np.bool_]:
    """Tell which dots have the color of the plate or, without colors, are one with it; by points (m, 2) on them."""
    if surface.loose or dots.heights is None:
        return np.zeros(len(dots), dtype=bool)
    plate = plate_of(surface)
    part, z, colors = surface.look(middle)
    told = [differ(color, surface.parts[plate].color) for color in colors]
    flush = (part == plate) & (z > dots.heights - FLUSH)
    return np.array([bool(flush[k]) if told[k] is None else not told[k] for k in range(len(dots))])


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
