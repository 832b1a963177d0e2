"""Compare a solid of one marker with the one that is made of it again, and say what differs."""

# tests: tests/verification/test_solids.py tests/verification/test_made.py tests/verification/test_claims.py

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from markergen.arrays import Array, Mask
from markergen.errors import InputError, OutputError
from markergen.geometry.contour import fitted_sphere
from markergen.model.body import Body
from markergen.model.fabrication import Fabrication
from markergen.model.marker import ControlPoint, Marker
from markergen.model.substrate import EDGE, PLATE_LENGTHS, Substrate
from markergen.verification.findings import (
    AGAIN,
    MIRRORED,
    NEAR_CELL,
    NOTHING,
    UNTAGGED,
    PlaneMotion,
    Verdict,
    corners_off,
    extras,
    judge,
    not_there,
    round_holes,
)
from markergen.verification.lines import hole_name, line_findings, pieces_of, plate_lines, seek_among
from markergen.verification.placement import Placement, check_sides, placements, stretched
from markergen.verification.rays import CHORDS, Difference, difference, normals_of
from markergen.verification.reading import ALIKE, PRINTABLE, READERS, Settings
from markergen.verification.result import (
    FIT_TO_PAGE,
    MOST_LISTED,
    REMOVE,
    SHEET,
    SMALLER_PAPER,
    Check,
    Finding,
    along_axes,
    is_strange,
    other_plate,
    short_length,
    somewhere,
)
from markergen.verification.rims import FLUSH, dots_of
from markergen.verification.solid_files import CAD, Solid, open_edges, read_solid
from markergen.verification.wanted_solids import (
    ALONE,
    WantedSolid,
    area_of,
    best_wanted,
    on_plate,
    size_of,
    volume_of,
    wanted_dots,
)

AROUND = 0.6
"""Distance in mm from a dot or a tag within which what differs is about it: its gap, and what is around its inlay."""

MOSTLY = 0.5
"""Minimum share of a part's surface that is missing of a part that is reported as missing."""

HOLE = 2.0
"""Maximum distance of a hole from its nominal position, in mm, beyond which it is another hole."""

NEAR = 6.0
"""Distance in mm from a wrong line or hole within which what differs is explained by it."""

WHOLLY, STRETCHED = {"scaled", "mirrored", "turned"}, {"extra", "missing", "thickness"}
"""Kinds of findings about a solid as a whole, and of those that stretching it may leave alone."""

ALWAYS = {*WHOLLY, "outline", "hole", "shifted", "inverted"}
"""Kinds of findings that no other options of the export explain."""

TYPICAL = 100.0
"""Size in mm to which a solid of any unit is brought to find triangles that are the same to 10 nm."""

WHOLE = "export it again with all of its parts"

PLATE_OPTIONS = (
    "options of the plate that export was given, such as --outline, --mount or --chamfer, are to be given here, too"
)

OF_SOLIDS = {
    FIT_TO_PAGE: "export it again, and save it without scaling it",
    MIRRORED: "export it again, and save it without mirroring it",
}
"""Remedies of solids by those of sheets."""

Inside = Callable[[Array], Mask]
"""Tells which points (k, 3) are inside of something."""

RECORD = re.compile(rb'(?:markergen export"?:? ?|mm )(\{.*\})', re.DOTALL)
"""Options of an export: in the header of an STL or STEP, the asset of a GLB, the comment of a 3MF's archive."""

RECORDED_WITHIN = 40_000
"""Number of bytes at the beginning or the end of a file in which they are: of up to 30 000 some are written twice."""

DOT = re.compile(r"dot-(\d+)(-core)?$")


def _verified(kind: str, data: bytes, name: str, body: Body, settings: Settings) -> Check:
    """Read a solid and compare it; another plate that it records is one finding, unless holes are all."""
    solid, record = _once(read_solid(kind, data, name)), _recorded(kind, data)
    check = _checked(kind, solid, record, body, settings)
    if record.plate is None or check.kinds <= {"hole"}:
        return check
    try:
        made = on_plate(body, record.plate, name)
    except InputError:
        return check
    plate, usual_plate = (design.plates[0].marker.substrate for design in (made, body))
    differing = [key for key in ("outline", "holes") if getattr(plate, key) != getattr(usual_plate, key)]
    remade = _checked(kind, solid, record, made, settings) if differing else check
    if len(remade.findings) >= len(check.findings):
        return check
    notes = (*remade.notes, *_other_lengths(plate, usual_plate))
    return replace(remade, findings=(other_plate(differing), *remade.findings), notes=notes)


def _checked(kind: str, solid: Solid, record: "_Record", body: Body, settings: Settings) -> Check:
    """Compare a solid with a body, made with the recorded options and lengths of the plate."""
    flaws = [*solid.flaws]
    if volume_of(solid.shell.corners) < 0:
        flaws.append("it is inside out")
    tolerance = PRINTABLE if settings.tolerance is None else settings.tolerance
    recorded = record.fabrication
    asked = settings.fabrication if recorded is None else recorded
    usual, body = body, _on_plate(body, record.lengths)
    best = partial(best_wanted, asked=asked, recorded=recorded is not None, corners=solid.shell.corners,
                   bare=not any(mesh.name or mesh.color for mesh in solid.objects))  # fmt: skip
    try:
        choices = best(body)
    except (InputError, OutputError) as error:
        problem = Finding("no dots", f"another marker: this one cannot be made: {error}")
        return Check("", kind, findings=(problem,), tolerance=tolerance)
    # With a thicker plate, the nearest in volume may be of another process.
    thicker = filter(None, (_thickness(body, solid, wanted, 1e3 * tolerance) for wanted in choices))
    if (other := next(thicker, None)) is not None:
        with suppress(InputError, OutputError):
            choices = [best(_on_plate(body, {"thickness": other}))[0], *choices]
    if kind not in CAD and any(open_edges(mesh.corners) for mesh in solid.objects):
        flaws.append("the mesh has open edges: it encloses no volume")
    checks, several = list[tuple[Check, WantedSolid]](), body.frame != "marker"
    for wanted in choices:
        check = check_sides(body, solid, wanted, kind, tolerance) if several else _compared(solid, wanted, tolerance)
        if not several and _is_elsewhere(check):
            check = _placed(check, placements(solid, wanted, kind), wanted, tolerance)
        checks.append((check, wanted))
        if check.kinds <= ALWAYS:
            break

    def rank(pair: tuple[Check, WantedSolid]) -> tuple[bool, bool, int, bool]:
        strange = is_strange(pair[0])
        preferred = asked if strange or asked != Fabrication() else pair[1].fabrication
        # A plate of another thickness is reported, too.
        count = len(pair[0].findings) + (pair[1].body != body)
        return bool(pair[0].findings), strange, count, pair[1].fabrication != preferred

    check, wanted = min(checks, key=rank)
    if not (several or check.kinds & WHOLLY or is_strange(check)) and (
        len(check.findings) > 1 or check.kinds & STRETCHED
    ):
        check = _placed(check, stretched(solid, wanted, 1e3 * tolerance), wanted, tolerance)
    recorded_plate, usual_plate = (design.plates[0].marker.substrate for design in (body, usual))
    notes = [*check.notes, *_other_lengths(recorded_plate, usual_plate)]
    if wanted.body != body and "scaled" not in check.kinds:
        [sentence] = _other_lengths(wanted.body.plates[0].marker.substrate, recorded_plate)
        remedy = "export it again, or give the --thickness that export was given"
        check = replace(check, findings=(Finding("thickness", sentence, remedy), *check.findings))
    if check.kinds & {"hole", "outline", "extra"}:
        notes.append(PLATE_OPTIONS)
    # The kernel's checks depend on the unit.
    broken = () if check.kinds & {"scaled", "mirrored"} else (Finding("solid", flaw) for flaw in flaws[:MOST_LISTED])
    findings = [
        replace(
            finding,
            sentence=finding.sentence.removesuffix(SMALLER_PAPER),
            remedy=OF_SOLIDS.get(finding.remedy, finding.remedy),
        )
        for finding in check.findings
    ]
    return replace(
        check, kind=kind, findings=(*broken, *findings), notes=tuple(notes), tolerance=tolerance, pages=(None,)
    )


for _suffix, _kind in ((".step", "STEP"), (".stp", "STEP"), (".brep", "BREP"), (".stl", "STL"), (".3mf", "3MF"),
                       (".glb", "GLB")):  # fmt: skip
    READERS.register(_suffix)(partial(_verified, _kind))


def _once(solid: Solid) -> Solid:
    """The solid without triangles that are there before with the same side outside, which are a flaw."""
    objects, count = [], 0
    size = size_of(solid.shell.corners)
    for mesh in solid.objects:
        corners = mesh.corners * (TYPICAL / size)
        rows = np.round(np.column_stack([corners.sum(axis=1), normals_of(corners)]), 5)
        # One number instead of six: sorting takes a fifth of the time.
        _, first = np.unique(rows @ np.sqrt([2.0, 3, 5, 7, 11, 13]), return_index=True)
        kept = np.sort(first)
        count += len(rows) - len(kept)
        paints = mesh.paints if mesh.paints is None else mesh.paints[kept]
        objects.append(mesh._replace(corners=mesh.corners[kept], paints=paints))
    if not count:
        return solid
    return Solid(tuple(objects), (*solid.flaws, f"{count} triangles are there twice"))


class _Record(NamedTuple):
    """Options that a file records, lengths of its plate in m, and its plate; None for what is not there."""

    fabrication: Fabrication | None = None
    lengths: Mapping[str, Any] = MappingProxyType({})
    plate: Mapping[str, Any] | None = None


def _recorded(kind: str, data: bytes) -> _Record:
    match = RECORD.search(data[:RECORDED_WITHIN]) or RECORD.search(data[-RECORDED_WITHIN:])
    if match is None:
        return _Record()
    text = match[1].decode("ascii", "replace")
    if kind == "STEP":
        text = text.replace("''", "'").replace(2 * "\\", "\\")
    try:
        asked, _ = json.JSONDecoder().raw_decode(text.replace(",\n", ",") if kind == "BREP" else text)
        plate = asked.pop("substrate", None)
        lengths = {name: (plate or asked).get(name) for name in PLATE_LENGTHS if name in (plate or asked)}
        Substrate(**lengths)
        options = {name: value for name, value in asked.items() if name not in PLATE_LENGTHS}
        return _Record(Fabrication(**options), lengths, plate)
    except (ValueError, TypeError, AttributeError, InputError, RecursionError):
        return _Record()


def _is_elsewhere(check: Check) -> bool:
    """Tell whether a solid may be in another unit, or turned or mirrored."""
    return is_strange(check) or "mirrored" in check.kinds


def _placed(plain: Check, ways: Iterable[Placement], wanted: WantedSolid, tolerance: float) -> Check:
    """The check of a solid or, if that leaves less to report, of it without one thing that is wrong as a whole."""
    best = plain
    for placement in ways:
        check = _compared(placement.solid, wanted, tolerance)
        # Without dots, any solid of about that size would do.
        if check.findings and (not check.dots or not is_strange(plain) or _is_elsewhere(check) or best is not plain):
            continue
        right = placement.times == 1.0
        best = replace(
            check, largest=check.largest if right else np.nan, worst=check.worst if right else None,
            scale=(check.scale[0] / placement.times, check.scale[1] / placement.times),
            findings=(placement.finding, *check.findings),
        )  # fmt: skip
        if not check.findings:
            break
    return best


def _compared(solid: Solid, wanted: WantedSolid, tolerance: float) -> Check:
    marker = wanted.body.plates[0].marker.as_designed
    expected, sizes = wanted_dots(marker, wanted.shell.rims)
    ids, tol = expected.names, 1e3 * tolerance
    dots = dots_of(solid.shell.rims, sizes) if len(sizes) else expected
    if len(ids) > 2:
        verdict = judge(expected, dots, tolerance)
    else:
        in_place, none = PlaneMotion(np.eye(2), np.zeros(2)), expected.take(NOTHING)
        verdict = Verdict(np.nan, None, (np.nan, np.nan), (), in_place, NOTHING, none)
    base = Check("", "", len(verdict.used), int(bool(ids)), verdict.largest, verdict.worst, verdict.scale,
                 findings=verdict.findings)  # fmt: skip
    if verdict.motion is None or base.kinds & UNTAGGED:
        return base
    aligned = _aligned(solid, verdict, dots.heights)
    compared = difference(aligned.shell, wanted.shell, tol + CHORDS)
    notes = [wanted.note] if wanted.note else []
    if not ids:
        notes.append(SHEET)
    elif wanted.fabrication.process == "print":
        sizes_by_id = {point.id: 500 * point.feature.diameter for point in marker.control_points}
        room = float(np.median(expected.radii - [sizes_by_id[name] for name in ids]))
        notes.append(f"recesses for printed dots with {1e3 * room:.4g} um of room around them, and no dots")
    findings = [*verdict.findings]
    if compared.extra.size and len(ids) > 2:
        findings += extras(dots, verdict.used, verdict.motion, round_holes(marker))
    findings += _Explained(marker, aligned, wanted, compared, findings, tol).findings()
    return replace(base, findings=tuple(findings), notes=tuple(dict.fromkeys(notes)))


def _aligned(solid: Solid, verdict: Verdict, heights: Array) -> Solid:
    """The solid in the frame of the marker, at the height of its dots if all are off by the same."""
    assert verdict.motion is not None
    rise = 0.0
    if len(verdict.used):
        off = heights[verdict.used] - verdict.expected.heights
        rise = float(np.median(off)) if np.ptp(off) < 0.01 else 0.0
    rotation, translation = np.eye(3), np.zeros(3)
    rotation[:2, :2] = verdict.motion.rotation.T
    translation[:] = *verdict.motion.to_marker(np.zeros(2)), -rise
    return solid.mapped(rotation, translation)


def _thickness(body: Body, solid: Solid, wanted: WantedSolid, tol: float) -> float | None:
    """Thickness in m of the plate in a file, if it is another one and all else is as high."""
    (low, high), (usual_low, usual_high) = solid.shell.heights, wanted.shell.heights
    thickness = 1e3 * body.plates[0].marker.substrate.thickness + usual_low - low
    is_plate = body.frame == "marker" and 0.1 < thickness < 1e3
    is_other = abs(usual_low - low) > tol and not abs(usual_high - high) > tol
    return round(thickness, 6) / 1e3 if is_plate and is_other else None


def _on_plate(body: Body, lengths: Mapping[str, Any]) -> Body:
    """The body on plates with some of `PLATE_LENGTHS` in m, as export makes it with their options."""
    if not lengths:
        return body
    return body.with_markers(lambda marker: replace(marker, substrate=replace(marker.substrate, **lengths)))


def _other_lengths(plate: Substrate, usual: Substrate) -> list[str]:
    """Sentences about lengths of a plate that are not those of marker.json."""
    sentences = []
    for name in PLATE_LENGTHS:
        have, want = getattr(plate, name), getattr(usual, name)
        if have != want:
            what = "plate is {} thick" if name == "thickness" else f"plate's {name.replace('_', ' ')} is {{}}"
            sizes = (EDGE if length is None else length for length in (have, want))
            have, want = (f"{1e3 * length:.6g} mm" for length in sizes)
            sentences.append(f"the {what.format(have)}, where marker.json says {want}")
    return sentences


@dataclass(frozen=True)
class _Explained:
    """What differs, by what of the marker it is about; mm, marker frame."""

    marker: Marker
    solid: Solid
    wanted: WantedSolid
    compared: Difference
    before: Sequence[Finding]
    tol: float

    @cached_property
    def around(self) -> dict[int, Inside]:
        """What tells whether points are on a dot or around it, by its id."""
        places, radii = 1e3 * self.marker.xyz[:, :2], 1e3 * self.marker.radii + AROUND
        ids = self.marker.ids.tolist()
        return {name: partial(_in_disk, *disk) for name, *disk in zip(ids, places, radii, strict=True)}

    def findings(self) -> list[Finding]:
        if findings := self._of_plate():
            return findings
        left = self.compared.extra, self.compared.missing
        for finding, inside in (*self._dots(), *self._tag()):
            findings += [finding] if finding is not None else []
            left = left[0][~inside(left[0])], left[1][~inside(left[1])]
        if (len(left[0]) or len(left[1])) and self.wanted.note != ALONE["dark"]:
            lines, inside = self._lines(left[0])
            findings += lines
            left = left[0][~inside(left[0])], left[1][~inside(left[1])]
        if not any(finding.kind == "extra" for finding in self.before):
            findings += somewhere("extra", "something that is not the marker's", left[0], REMOVE)
            findings += somewhere("missing", "something missing of it", left[1], WHOLE) * (not findings)
        if not (findings or self.before):
            findings += somewhere("twice", "something that is there twice", self.compared.twice, REMOVE)
        return [*findings, *self._colors([*self.before, *findings]), *self._names()]

    def _share(self, name: str) -> float:
        """Share of the surface of a part that is missing."""
        if name not in self.wanted.names:
            return 0.0
        index = self.wanted.names.index(name)
        return float(np.sum(self.compared.missing_owner == index) / max(int(self.compared.seen[index]), 1))

    def _of_plate(self) -> list[Finding]:
        """The plate as a whole."""
        if self._share("plate") < MOSTLY:
            return []
        tops = [_level(shell.corners) for shell in (self.solid.shell, self.wanted.shell)]
        large = area_of(self.solid.shell.corners) > MOSTLY * area_of(self.wanted.shell.corners)
        if large and abs(tops[0] - tops[1]) > self.tol:
            way = "above" if tops[0] > tops[1] else "below"
            off = short_length(abs(tops[0] - tops[1]))
            return [Finding("height", f"the plate's face is {off} {way} the plane of the dots", AGAIN)]
        return [] if large else [Finding("part", "the plate is missing", WHOLE)]

    def _dots(self) -> list[tuple[Finding | None, Inside]]:
        explained = list[tuple[Finding | None, Inside]]()
        for point, inside in zip(self.marker.control_points, self.around.values(), strict=True):
            extra, missing = (points[inside(points)] for points in (self.compared.extra, self.compared.missing))
            if not len(extra) + len(missing):
                continue
            finding = None
            if not _is_named(point.id, self.before):
                finding = self._ball(point) or self._dot(point.id, 1e3 * point.z, extra, missing)
            explained.append((finding, inside))
        return explained

    def _ball(self, point: ControlPoint) -> Finding | None:
        """A ball that is elsewhere, by the corners of its surface."""
        if self.wanted.fabrication.dome != "ball":
            return None
        radius, offset = 500 * point.feature.diameter, self.solid.shell.corners.reshape(-1, 3)
        offset = offset - 1e3 * np.array([point.x, point.y, point.z])
        offset = offset[np.abs(np.linalg.norm(offset, axis=1) - radius) < 0.1 * radius]
        x, y, z = fitted_sphere(offset)[0] if len(offset) else np.zeros(3)
        if not (off := float(np.linalg.norm((x, y, z)))) > self.tol:
            return None
        sentence = f"dot {point.id} is {short_length(off)} off {along_axes(x, y)}"
        return Finding("shifted", sentence, AGAIN)

    def _dot(self, name: int, height: float, extra: Array, missing: Array) -> Finding:
        part, core = self._share(f"dot-{name}"), self._share(f"dot-{name}-core")
        above = extra[extra[:, 2] > height + self.tol] if len(extra) else extra
        if len(above) and not part > MOSTLY:
            return somewhere("extra", f"something over dot {name}", above, REMOVE)[0]
        if part > MOSTLY and len(extra) < len(missing) / 4:
            return Finding("missing", f"dot {name} has no inlay: its pocket is empty", WHOLE)
        if core > 0.1:
            what = "is missing" if core > MOSTLY and not len(extra) else "is of another size, or elsewhere"
            kind = "kind" if what == "is missing" else "diameter"
            return Finding(kind, f"the core of ring {name} {what}", WHOLE)
        if len(extra) and len(missing):
            have, want = height - extra[:, 2].min(), height - missing[:, 2].min()
            if abs(have - want) > self.tol:
                return Finding("thickness", f"dot {name} is {have:.4g} mm thick, not {want:.4g} mm", AGAIN)
        return Finding("thickness", f"dot {name} is not made as it should be", AGAIN)

    def _tag(self) -> list[tuple[Finding | None, Inside]]:
        """The tag, with its outer corners by those of triangles: a strip of 0.1 mm lies between rays."""
        tag, compared = self.marker.tag, self.compared
        if tag is None:
            return []
        corners = 1e3 * tag.corners
        inside = partial(_in_box, corners.min(axis=0) - AROUND, corners.max(axis=0) + AROUND)
        wanted, square = (_square(shell.corners, inside) for shell in (self.wanted.shell, self.solid.shell))
        if wanted is None:
            return []
        findings = [] if square is None else corners_off(wanted, square, self.tol)
        is_other = any(inside(points).any() for points in (compared.missing, compared.repainted, compared.extra))
        far = square is None or np.abs(square - wanted).max() > NEAR_CELL * 1e3 * tag.side / tag.cells
        if is_other and (far or not findings):
            findings = [not_there(tag)]
        return [(finding, inside) for finding in findings]

    def _lines(self, extra: Array) -> tuple[list[Finding], Inside]:
        """Outline and holes, in a section of the plate and of countersinks in its face; and what these explain."""
        wanted = plate_lines(self.marker)
        low, high = self.wanted.shell.heights
        back = low + 0.45 * min(1e3 * self.marker.substrate.thickness, high - low)
        seek = seek_among(_section(self.solid.shell.corners, back))
        rounds = [self._round(line.name, whole) for line in wanted if (whole := line.contour.as_circle)]
        others = [line for line in wanted if line.contour.as_circle is None]
        findings = [
            *(finding for of_line in rounds for finding in of_line),
            *line_findings(others, seek, self.tol + CHORDS),
            *self._sinks(),
            *self._strange_holes(extra),
        ]
        sentences = "; ".join(finding.sentence for finding in findings)
        wrong = seek_among(pieces_of([line.contour for line in wanted if line.name in sentences]))
        strange = np.array(re.findall(r"a hole at x (\S+), y (\S+) mm", sentences), float).reshape(-1, 2)

        def inside(points: Array) -> Mask:
            flat = points[:, :2]
            places = np.stack([wrong(flat, flat), *np.broadcast_to(strange[:, None], (len(strange), *flat.shape))])
            return np.asarray((np.linalg.norm(places - flat, axis=2) < NEAR).any(axis=0))

        return findings, inside

    def _round(self, name: str, whole: tuple[float, float, float], absent: str = "is missing") -> list[Finding]:
        """A round outline or hole, by its rim in the back or else in the face."""
        rims, kind = self.solid.shell.rims, "hole" if "hole" in name else "outline"
        off, ratio = rims.centers[:, :2] - whole[:2], np.abs(np.log(rims.radii / whole[2]))
        away = np.linalg.norm(off, axis=1)
        candidates = np.flatnonzero((away < HOLE) & (ratio < np.log(ALIKE)) & (np.abs(rims.normals[:, 2]) > 0.99))
        if not len(candidates):
            return [Finding(kind, f"{name} {absent}")]
        best = candidates[np.argmin((away + np.abs(rims.radii - whole[2]) + (rims.normals[:, 2] > 0))[candidates])]
        findings = list[Finding]()
        if away[best] > self.tol:
            findings.append(Finding(kind, f"{name} is {short_length(away[best])} off"))
        if abs(rims.radii[best] - whole[2]) > self.tol:
            sizes = f"{2 * rims.radii[best]:.6g} mm, not {2 * whole[2]:.6g} mm"
            findings.append(Finding(kind, f"{name} has a diameter of {sizes}"))
        return findings

    def _sinks(self) -> list[Finding]:
        """Countersinks of the holes that are there."""
        findings, rims = list[Finding](), self.solid.shell.rims
        for hole in self.marker.substrate.holes:
            x, y, radius = 1e3 * hole.x, 1e3 * hole.y, 500 * hole.sink
            if radius and (np.hypot(rims.centers[:, 0] - x, rims.centers[:, 1] - y) < 0.1).any():
                absent = f"has no countersink of {2 * radius:.6g} mm"
                findings += self._round(hole_name(hole), (x, y, radius), absent)
        return findings

    def _strange_holes(self, extra: Array) -> list[Finding]:
        """Rims in the back around which there is something extra."""
        rims, findings = self.solid.shell.rims, list[Finding]()
        wanted = np.array([[1e3 * hole.x, 1e3 * hole.y] for hole in self.marker.substrate.holes]).reshape(-1, 2)
        low, _ = self.solid.shell.heights
        for center, radius, normal in zip(rims.centers, rims.radii, rims.normals, strict=True):
            away = np.abs(np.linalg.norm(extra[:, :2] - center[:2], axis=1) - radius)
            is_strange = np.linalg.norm(wanted - center[:2], axis=1).min(initial=np.inf) > HOLE
            if normal[2] < -0.99 and abs(center[2] - low) < 0.1 and np.sum(away < 0.1) > 8 and is_strange:
                x, y = center[:2].round(4) + 0.0
                sentence = f"a hole at x {x:.5g}, y {y:.5g} mm that the marker does not have"
                findings.append(Finding("hole", sentence, "remove it, or give the options that export was given"))
        return findings[:MOST_LISTED]

    def _colors(self, before: Sequence[Finding]) -> list[Finding]:
        """Dots that are not darker than the plate, and rings whose middle is."""
        compared = self.compared
        tools: dict[bool, set[str]] = {True: set(), False: set()}
        dark = self.solid.shell.dark
        for index, mesh in enumerate(self.solid.objects):
            if mesh.tool and dark is not None:
                tools[bool(np.median(dark[self.solid.shell.owner == index]))].add(mesh.tool)
        if tools[True] & tools[False]:
            return [Finding("inverted", "light and dark parts are printed by the same extruder", AGAIN)]
        if tools[True] and max(tools[False], default="") > max(tools[True]):
            return [Finding("inverted", "the extruder of the light parts comes after that of the dark ones", AGAIN)]
        if not len(compared.repainted):
            return []
        pale = compared.repainted[compared.was_dark]
        inked = compared.repainted[~compared.was_dark]
        wrong = [name for name, inside in self.around.items() if inside(pale).sum() > 8]
        on_dots = np.any([inside(inked) for inside in self.around.values()], axis=0)
        if np.sum(~on_dots) > 8 and wrong:
            sentence = "light and dark are swapped: the dots are lighter than the plate"
            return [Finding("inverted", sentence, "swap the two materials, or export it again")]
        if len(wrong) == len(self.around) > 1:
            return [Finding("color", "dots and plate have the same color", AGAIN)]
        findings = list[Finding]()
        for name, inside in self.around.items():
            if _is_named(name, before):
                continue
            if name in wrong:
                findings.append(Finding("color", f"dot {name} has the color of the plate", AGAIN))
            elif inside(inked).sum() > 8:
                sentence = f"the middle of dot {name} does not have the color of the plate"
                findings.append(Finding("color", sentence, AGAIN))
        if not findings and not before:
            findings = somewhere("color", "the other color than it should be", compared.repainted, AGAIN)
        return findings[:MOST_LISTED]

    def _names(self) -> list[Finding]:
        """Parts with the name of another one. Other programs number parts, or give all the name of the file."""
        findings, names = [], [mesh.name for mesh in self.solid.objects]
        for index, wanted in enumerate(self.wanted.names):
            votes = self.compared.votes[index]
            called = names[int(np.argmax(votes))] if votes.sum() else ""
            if called != wanted and called in self.wanted.names and wanted in names:
                place = DOT.sub(lambda match: f"{'the middle of ' * bool(match[2])}dot {match[1]}", wanted)
                findings.append(
                    Finding("part", f"the part called {called!r} is {place}", "give the parts their own names")
                )
        return findings[:MOST_LISTED]


def _is_named(name: int, findings: Sequence[Finding]) -> bool:
    """Tell whether findings are about a dot, or all of them."""
    about = re.compile(rf"\bdots? (?:\d+, )*{name}\b|\bring {name}\b|^all dots")
    return any(about.search(finding.sentence) for finding in findings)


def _in_disk(center: Array, radius: float, points: Array) -> Mask:
    return np.asarray(np.linalg.norm(points[:, :2] - center, axis=1) <= radius)


def _in_box(low: Array, high: Array, points: Array) -> Mask:
    return np.asarray(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))


def _square(corners: Array, inside: Inside) -> Array | None:
    """Corners (4, 2), from the top left clockwise, of the box around corners of triangles in the plane of the dots."""
    points = corners.reshape(-1, 3)
    points = points[(np.abs(points[:, 2]) < FLUSH) & inside(points)]
    if not len(points):
        return None
    (left, bottom), (right, top) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _level(corners: Array) -> float:
    """Height of the largest level area that faces up."""
    area = normals_of(corners)[:, 2]
    flat = (np.ptp(corners[:, :, 2], axis=1) < 1e-3) & (area > 0)
    heights, index = np.unique(np.round(corners[flat, 0, 2], 3), return_inverse=True)
    return float(heights[np.argmax(np.bincount(index, area[flat]))]) if flat.any() else 0.0


def _section(corners: Array, height: float) -> Array:
    """Lines (k, 2, 2) in which a plane of equal height cuts triangles (m, 3, 3)."""
    above = corners[:, :, 2] > height
    cut = corners[above.any(axis=1) & ~above.all(axis=1)]
    start, end = cut, np.roll(cut, -1, axis=1)
    crossed = (start[:, :, 2] > height) != (end[:, :, 2] > height)
    share = (height - start[:, :, 2]) / np.where(crossed, end[:, :, 2] - start[:, :, 2], 1.0)
    points = (start + share[:, :, None] * (end - start))[:, :, :2]
    return points[crossed].reshape(-1, 2, 2)
