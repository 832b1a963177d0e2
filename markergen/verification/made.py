"""What a made plate has besides the places and sizes of its dots: outline, holes, layers, seats, colors and names."""

# tests: tests/verification/test_made.py tests/verification/test_solids.py

import re
from collections import Counter
from dataclasses import dataclass

import numpy as np

from markergen.arrays import Array
from markergen.geometry.contour import area
from markergen.geometry.region import Region
from markergen.model.marker import Marker
from markergen.verification.claims import body_findings, core_findings, surface_findings
from markergen.verification.lines import CutLine, line_findings, plate_lines, seek_among
from markergen.verification.matching import DotSet
from markergen.verification.solids import CONTRAST, FLUSH, LUMA, hole_findings, is_dot, plate_index
from markergen.verification.surface import Color, LevelFace, Surface
from markergen.verification.words import MOST_LISTED, Finding, short_length

Motion = tuple[Array, Array]

WHOLE = "export it again with all of its parts"
AGAIN = "export it again from its marker.json"
REMARK = "remark"
"""Kind of a finding that is no error: `export --thickness` makes a plate of another thickness."""
FINER = "export it with a finer tolerance, or with circles that are circles"

ROUGHEST = 0.1
"""Maximum distance in mm of the sides of a polygon from the round outline or hole that it stands for."""

GRID = 1e-4
"""Grid in mm on which level faces that share edges are joined."""

SLIVER = 0.01
"""Area in mm^2 below which a gap between level faces is rounding."""

DOT = re.compile(r"dot[-_ ]?(\d+)([-_ ]core)?\b", re.IGNORECASE)
"""Names of parts of dots, as other programs leave them: spaces and hyphens may be underscores."""


@dataclass(frozen=True)
class Seat:
    """How a dot is made.

    Attributes
    ----------
    name : int
        Id.
    part : int
        Index of the part that is seen on it, -1 for none.
    kind : {"part", "ball", "floor", "flush", "open"}
        A part of its own, flat or a ball; the floor of a pocket or mark; level with the plate and a part of it; a hole.
    low : float
        Height of the lowest point of its part, or of its floor.
    height : float
        Height of its face or center.
    covered : bool
        True if something is above its face.
    color : (red, green, blue) or None
    """

    name: int
    part: int
    kind: str
    low: float
    height: float
    covered: bool
    color: Color | None


def solid_findings(
    marker: Marker, surface: Surface, motion: Motion, dots: DotSet | None, names: tuple[int, ...], tolerance: float
) -> list[Finding]:
    """Errors of a made plate apart from the places and sizes of its dots.

    Parameters
    ----------
    motion : (rotation (2, 2), shift (2,))
        From the marker frame to the file, mm.
    dots : DotSet or None
        The marker's dots as found in the file; None if the plate has recesses for printed dots.
    names : tuple of int
        Ids of these dots.
    tolerance : float
        mm.
    """
    findings: list[Finding] = []
    seats = seats_of(surface, dots, names, tolerance) if dots is not None else []
    if dots is not None:
        findings += _round(surface, dots, names, tolerance)
        findings += [] if is_light_alone(surface, dots) else _seated(surface, seats, dots, tolerance)
        findings += color_findings(surface, dots, seats)
        findings += _tag_inlays(marker, surface, motion, seats)
        findings += _named(surface, dots, seats)
    if surface.loose:
        # Without names and colors it is a file of the dark parts alone, as is written beside an STL.
        missing = any(part.name or part.color for part in surface.parts)
        return [*findings, *([Finding("part", "the plate is missing", WHOLE)] if missing else [])]
    findings += _layers(marker, surface, seats, tolerance)
    return [*findings, *plate_findings(marker, surface, motion, tolerance)]


def unclaimed_findings(
    marker: Marker, surface: Surface, motion: Motion, dots: DotSet | None, names: tuple[int, ...], tolerance: float
) -> list[Finding]:
    """Bodies, cores of rings and surface that belong to nothing of the marker; arguments as of `solid_findings`."""
    whole = plate_index(surface) if surface.parts and not surface.loose else -1
    findings = body_findings(marker, surface, motion, whole)
    if dots is not None and not is_light_alone(surface, dots):
        findings += core_findings(surface, dots, names, tolerance)
    if surface.loose or findings:
        return findings
    face, back = faces_of(surface)
    if face is None or back is None:
        return []
    return surface_findings(marker, surface, motion, plate_lines(marker), (face.z, back.z), tolerance)


def seats_of(surface: Surface, dots: DotSet, names: tuple[int, ...], tolerance: float) -> list[Seat]:
    """How each dot is made, as seen from above."""
    angle = np.pi * (np.arange(8) + 0.25) / 4
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    places = dots.centers[:, None] + ((dots.radii + dots.inner) / 2)[:, None, None] * directions
    part, z, colors = surface.look(places.reshape(-1, 2))
    seats = []
    heights = dots.heights if dots.heights is not None else np.zeros(len(dots))
    for k, name in enumerate(names):
        seen_parts, over = part[8 * k : 8 * k + 8], z[8 * k : 8 * k + 8]
        main = int(Counter(seen_parts.tolist()).most_common(1)[0][0])
        seen = surface.parts[main] if main >= 0 else None
        x, y = dots.centers[k].tolist()
        height, color = float(heights[k]), colors[8 * k + int(np.flatnonzero(seen_parts == main)[0])]
        if seen is None:
            seats.append(Seat(name, main, "open", -np.inf, height, False, None))
            continue
        level = float(np.median(over[seen_parts == main]))
        if seen.balls:
            seats.append(Seat(name, main, "ball", seen.low[2], height, False, color))
            continue
        kind = "floor" if level < height - FLUSH else "flush"
        kind = "part" if is_dot(seen, x, y, float(dots.radii[k])) else kind
        low = level if kind == "floor" else seen.low[2]
        covered = bool((over > height + max(tolerance, FLUSH)).any())
        seats.append(Seat(name, main, kind, low, height, covered, color))
    return seats


def is_light_alone(surface: Surface, dots: DotSet) -> bool:
    """Tell whether rings have cores of their own but no dot has an inlay, in a file without names and colors."""
    if surface.loose or not dots.rings.any() or any(part.name or part.color for part in surface.parts):
        return False
    plate = plate_index(surface)
    middles = surface.look(dots.centers)[0]
    rims = surface.look(dots.centers + ((dots.radii + dots.inner) / 2)[:, None] * [1.0, 0.0])[0]
    return bool(np.isin(rims, (plate, -1)).all() and (~np.isin(middles[dots.rings], (plate, -1))).all())


def _round(surface: Surface, dots: DotSet, names: tuple[int, ...], tolerance: float) -> list[Finding]:
    """Dots whose rims are polygons that show."""
    edges = [
        (*about, face.z, rough)
        for part in surface.parts
        for face in part.faces
        for edge, rough in zip(face.edges, face.rough, strict=False)
        if rough > tolerance and (about := edge.as_circle)
    ]
    table = np.array(edges, dtype=float).reshape(-1, 5)
    findings = []
    for k, name in enumerate(names):
        away = np.linalg.norm(table[:, :2] - dots.centers[k], axis=-1)
        size = np.abs(table[:, 2:3] - [dots.radii[k], dots.inner[k]]).min(axis=-1)
        level = np.abs(table[:, 3] - (dots.heights[k] if dots.heights is not None else 0.0)) < max(tolerance, FLUSH)
        is_rim = (away < tolerance) & (size < tolerance) & level
        if is_rim.any():
            off = short_length(float(table[is_rim, 4].max()))
            findings.append(
                Finding("diameter", f"dot {name} is not round: its sides are up to {off} off its circle", FINER)
            )
    return _few(
        findings,
        f"all dots are polygons, up to {short_length(float(table[:, 4].max(initial=0.0)))} off a circle",
        len(names),
    )


def _few(findings: list[Finding], together: str, count: int) -> list[Finding]:
    """The findings, or one in their place if they are about all dots."""
    if len(findings) == count > 1:
        return [Finding(findings[0].kind, together, findings[0].remedy)]
    return findings[:MOST_LISTED]


def _seated(surface: Surface, seats: list[Seat], dots: DotSet, tolerance: float) -> list[Finding]:
    """Dots that are made differently from the others: without their inlay, thinner, covered, squashed."""
    findings = []
    kinds = Counter(seat.kind for seat, ring in zip(seats, dots.rings, strict=True) if not ring)
    kinds = kinds or Counter(seat.kind for seat in seats)
    usual = kinds.most_common(1)[0][0] if kinds else ""
    for k, (seat, ring) in enumerate(zip(seats, dots.rings, strict=True)):
        # A ring's light middle would fall out of a hole.
        wanted = "part" if ring and usual == "open" else usual
        if seat.covered:
            findings.append(Finding("covered", f"something lies over dot {seat.name}", AGAIN))
        elif seat.kind != wanted and wanted in ("part", "ball", "flush") and seat.kind in ("floor", "open"):
            findings.append(Finding("missing", f"dot {seat.name} has no inlay: its pocket is empty", WHOLE))
        elif abs(1 - (flat := _flatness(surface, seat))) * dots.radii[k] > tolerance:
            findings.append(Finding("height", f"dot {seat.name} is a ball flattened to {100 * flat:.4g} %", AGAIN))
        elif seat.kind != wanted and "ball" in (seat.kind, wanted):
            findings.append(
                Finding("kind", f"dot {seat.name} is {_shape(seat)}, the others are {_others(wanted)}", AGAIN)
            )
    for kind in ("part", "floor"):
        for ring in (False, True):
            alike = [
                seat for seat, is_ring in zip(seats, dots.rings, strict=True) if seat.kind == kind and is_ring == ring
            ]
            findings += _thinner(alike, tolerance)
    return findings[:MOST_LISTED]


def _tag_inlays(marker: Marker, surface: Surface, motion: Motion, seats: list[Seat]) -> list[Finding]:
    """Pockets of a tag without the inlays that dots have; colors or the lack of them do not show this."""
    tag = marker.tag
    face, _ = faces_of(surface)
    if tag is None or surface.loose or face is None or not any(seat.kind in ("part", "ball") for seat in seats):
        return []
    row, column = np.nonzero(tag.ink)
    cells = np.stack([(column + 0.5) / tag.cells - 0.5, 0.5 - (row + 0.5) / tag.cells], axis=-1)
    rotation, translation = motion
    seen, heights, _ = surface.look(1e3 * (tag.side * cells + tag.center) @ rotation.T + translation)
    if (seen != plate_index(surface)).any() or (heights > face.z - FLUSH).any():
        return []
    return [Finding("tag", "the tag has no inlays: its pockets are empty", WHOLE)]


def _flatness(surface: Surface, seat: Seat) -> float:
    """Height over width of the ball of a dot; 1 for other dots."""
    return surface.parts[seat.part].balls[0].flatness if seat.kind == "ball" else 1.0


def _shape(seat: Seat) -> str:
    return "a ball" if seat.kind == "ball" else "flat"


def _others(wanted: str) -> str:
    return "balls" if wanted == "ball" else "flat"


def _thinner(seats: list[Seat], tolerance: float) -> list[Finding]:
    """Dots of another depth than the others of their kind."""
    if len(seats) < 3:
        return []
    depths = np.array([seat.height - seat.low for seat in seats])
    usual = float(np.median(depths))
    wrong = np.abs(depths - usual) > tolerance
    if 2 * wrong.sum() >= len(seats):
        return []
    what = "deep" if seats[0].kind == "floor" else "thick"
    return [
        Finding("thickness", f"dot {seats[k].name} is {depths[k]:.4g} mm {what}, the others {usual:.4g} mm", AGAIN)
        for k in np.flatnonzero(wrong)
    ]


def color_findings(surface: Surface, dots: DotSet, seats: list[Seat]) -> list[Finding]:
    """Dots that are not darker than the plate, and rings whose middle is; nothing if the file has no colors."""
    plate = surface.parts[plate_index(surface)].color
    if plate is None or surface.loose or not seats:
        return []
    contrasts = [(seat, _darker(seat.color, plate)) for seat in seats if seat.color is not None]
    lighter = [seat.name for seat, by in contrasts if by < -CONTRAST]
    if lighter and len(lighter) == len(contrasts):
        sentence = "light and dark are swapped: the dots are lighter than the plate"
        return [Finding("inverted", sentence, "swap the two materials, or export it again")]
    findings = [Finding("inverted", f"dot {name} is lighter than the plate", AGAIN) for name in lighter]
    same = [seat.name for seat, by in contrasts if abs(by) <= CONTRAST]
    findings += _few(
        [Finding("color", f"dot {name} has the color of the plate", AGAIN) for name in same],
        "dots and plate have the same color", len(seats),
    )  # fmt: skip
    _, _, colors = surface.look(dots.centers)
    for seat, ring, color in zip(seats, dots.rings, colors, strict=True):
        if ring and color is not None and _darker(color, plate) > CONTRAST:
            sentence = f"the middle of dot {seat.name} does not have the color of the plate"
            findings.append(Finding("color", sentence, AGAIN))
    tools: dict[bool, set[str]] = {True: set(), False: set()}
    for part in surface.parts:
        if part.color is not None and part.tool:
            tools[_darker(part.color, plate) > CONTRAST].add(part.tool)
    if tools[True] & tools[False]:
        findings.append(Finding("inverted", "light and dark parts are printed by the same extruder", AGAIN))
    elif tools[True] and max(tools[False], default="") > max(tools[True]):
        findings.append(Finding("inverted", "the extruder of the light parts comes after that of the dark ones", AGAIN))
    return findings[:MOST_LISTED]


def _darker(color: Color | None, plate: Color) -> float:
    return float(LUMA @ (np.array(plate) - np.array(color)))


def _named(surface: Surface, dots: DotSet, seats: list[Seat]) -> list[Finding]:
    """Parts with the name of another dot."""
    middle = surface.look(dots.centers)[0]
    findings = []
    for seat, ring, core in zip(seats, dots.rings, middle, strict=True):
        named_parts = [(seat.part, False)] if seat.kind in ("part", "ball") else []
        named_parts += [(int(core), True)] if ring and core not in (seat.part, plate_index(surface), -1) else []
        for part, is_core in named_parts:
            called = surface.parts[part].name
            match = DOT.search(called)
            right = match is not None and int(match[1]) == seat.name and bool(match[2]) == is_core
            # Other programs number parts, or give all the name of the file.
            if not right and (match or called.startswith(("plate", "tag-"))):
                place = f"the middle of dot {seat.name}" if is_core else f"dot {seat.name}"
                findings.append(
                    Finding("part", f"the part called {called!r} is {place}", "give the parts their own names")
                )
    return findings[:MOST_LISTED]


def faces_of(surface: Surface) -> tuple[LevelFace | None, LevelFace | None]:
    """Upper and lower level face of the plate: those that reach farthest."""

    def reach(face: LevelFace) -> float:
        return round(abs(area(face.edges[0])), 3)

    fronts = [face for part in surface.parts for face in part.faces]
    backs = [face for part in surface.parts for face in part.backs]
    return (
        max(fronts, key=lambda face: (reach(face), face.z), default=None),
        max(backs, key=lambda face: (reach(face), -face.z), default=None),
    )


def _layers(marker: Marker, surface: Surface, seats: list[Seat], tolerance: float) -> list[Finding]:
    """A plate of another thickness, or whose face is not in the plane of the dots."""
    face, back = faces_of(surface)
    if face is None or back is None:
        return []
    thickness, wanted = face.z - back.z, 1e3 * marker.substrate.thickness
    findings = []
    if abs(thickness - wanted) > tolerance:
        sentence = f"the plate is {thickness:.5g} mm thick, where marker.json says {wanted:.6g} mm"
        findings.append(Finding(REMARK, sentence))
    rise = {point.id: 1e3 * point.z for point in marker.control_points}
    flat = [seat.height - rise[seat.name] for seat in seats if seat.kind in ("part", "floor", "flush")]
    if len(flat) >= 3 and np.ptp(flat) < tolerance and abs(off := face.z - float(np.median(flat))) > tolerance:
        way = "above" if off > 0 else "below"
        findings.append(
            Finding("height", f"the plate's face is {short_length(abs(off))} {way} the plane of the dots", AGAIN)
        )
    return findings


def sheet_plate_findings(marker: Marker, surface: Surface, tolerance: float) -> list[Finding]:
    """Errors of a plate that a printed sheet is glued into, at its place in the marker frame; mm."""
    face, _ = faces_of(surface)
    findings = _layers(marker, surface, [], tolerance)
    if face is not None and abs(face.z) > tolerance:
        sentence = f"the plate is {short_length(abs(face.z))} too {'high' if face.z > 0 else 'low'}"
        findings.append(Finding("height", sentence, "move its face to z = 0"))
    return [*findings, *plate_findings(marker, surface, (np.eye(2), np.zeros(2)), tolerance)]


def plate_findings(marker: Marker, surface: Surface, motion: Motion, tolerance: float) -> list[Finding]:
    """Errors of the outline and the holes, in the face and through to the back; mm."""
    rotation, translation = motion
    holes = hole_findings(surface, marker.substrate.holes, motion, tolerance)
    # A hole that is wrong in the face is wrong in the back, too.
    wrong_holes = tuple(hole.sentence.partition(" mm ")[0] for hole in holes)
    back = back_of(surface)
    wanted = plate_lines(marker)
    rings = [(ring - translation) @ rotation for ring in back.rings]
    pieces = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings if len(ring)]
    lines = line_findings(wanted, seek_among(np.concatenate(pieces) if pieces else np.zeros((0, 2, 2))), tolerance)
    lines = [line for line in lines if not (wrong_holes and line.sentence.startswith(wrong_holes))]
    return [*lines, *holes, *_rough(wanted, surface, motion), *_strange(marker, wanted, back, motion)]


def back_of(surface: Surface) -> Region:
    """What is seen from behind: all level faces that face down, letters engraved in the back filled."""
    return Region.union([face.region for part in surface.parts for face in part.backs], GRID)


def _rough(wanted: list[CutLine], surface: Surface, motion: Motion) -> list[Finding]:
    """Round lines of the plate that are polygons with few sides."""
    rotation, translation = motion
    findings = []
    backs = [face for part in surface.parts for face in (*part.backs, *part.faces)]
    edges = [
        (*about, rough)
        for face in backs
        for edge, rough in zip(face.edges, face.rough, strict=False)
        if rough > ROUGHEST and (about := edge.as_circle)
    ]
    for line in wanted:
        if (whole := line.contour.as_circle) is None:
            continue
        x, y = rotation @ whole[:2] + translation
        off = [rough for u, v, r, rough in edges if max(abs(u - x), abs(v - y), abs(r - whole[2])) < ROUGHEST]
        if off:
            sentence = f"{line.name} is not round: its sides are up to {short_length(max(off))} off its circle"
            findings.append(Finding("hole" if line.hole else "outline", sentence, FINER))
    return findings


def _strange(marker: Marker, wanted: list[CutLine], back: Region, motion: Motion) -> list[Finding]:
    """Holes through the plate that the marker does not have."""
    rotation, translation = motion
    expected = [Region.of_contour(line.contour, (), FLUSH) for line in wanted if line.hole]
    expected += [Region.disk(1e3 * p.x, 1e3 * p.y, 650 * p.feature.diameter, 16) for p in marker.control_points]
    findings = []
    for piece in back.pieces:
        for ring in piece.rings[1:]:
            hole = Region.polygon((ring - translation) @ rotation, mend=True)
            if hole.area < SLIVER or any(region.meets(hole) for region in expected):
                continue
            left, bottom, right, top = hole.box
            place = f"x {(left + right) / 2:.5g}, y {(bottom + top) / 2:.5g} mm"
            findings.append(Finding("hole", f"a hole at {place} that the marker does not have", AGAIN))
    return findings[:MOST_LISTED]
