"""From what a user types to the contestants of a comparison, all in the same enclosing circle."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot, pi, sin, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.board import Board
from markergen.model.boundary import Circle
from markergen.model.marker import Marker, check_supported, dressed
from markergen.model.marker_json import read_marker
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.model.tag import Tag, parse_tag
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.dot_size import CLEARANCE, ROOM, choose_dots
from markergen.optimize.problem import Region
from markergen.read.poses import poses_from
from markergen.units import format_length
from markergen.validation.contestants import Contestant, DotMarker, Peer
from markergen.validation.proof import setting_of

Array = NDArray[np.float64]

LAYOUTS = ("ngon", "square", "random")
TAGS = ("aruco", "apriltag", "charuco")
FORMS = "MARKER.json, ngon:N, square, random:N, aruco:DICT[:ID], apriltag:FAMILY[:ID], charuco:CxR[:DICT]"
PEERS = ("aruco:DICT_4X4_50", "apriltag:36h11", "charuco:5x5")
DEFAULTS = (*LAYOUTS, *PEERS)
"""What a single contestant is compared with."""


def line_up(
    texts: Sequence[str],
    poses: str | PoseDistribution | None = None,
    seed: int = 0,
    given: Mapping[str, Marker] | None = None,
) -> tuple[list[Contestant], Setting]:
    """Contestants by their texts, and the camera and poses that the first marker file was designed for.

    Layouts get dots of the first marker's size, or, where those do not fit or there is no marker file, what `design`
    would choose, or, where a ring of those does not fit, the like share of the largest that do. Tags and boards are as
    large as the same circle allows, a tag with one white cell around it; a board needs no more white than its squares
    have.

    Parameters
    ----------
    texts : sequence of str
        Of the forms in `FORMS`; a single one is joined by `DEFAULTS`.
    poses : str, PoseDistribution or None
        Poses to use instead, as `poses_from` takes them.
    seed : int
        Seed for the random layouts.
    given : mapping or None
        Markers that are in no file, by the texts that stand for them.

    Raises
    ------
    InputError
        If a text has none of the forms, a file is no marker, the markers differ in size, or a tag does not exist.
    """
    if seed < 0:
        raise InputError("a seed of 0 or more", f"seed={seed}", "give a non-negative whole number")
    if not texts:
        raise InputError("contestants to compare", "none", f"name some: {FORMS}")
    wanted = list(dict.fromkeys([*texts, *DEFAULTS] if len(texts) == 1 else texts))
    known = given or {}
    markers = {
        text: _visible(text, known[text]) if text in known else _read(text)
        for text in wanted
        if text in known or text.split(":")[0] not in (*LAYOUTS, *TAGS)
    }
    first = next(iter(markers.values()), None)
    judged = setting_of(first, poses) if first else _default_setting(poses)
    radius = judged.boundary.radius
    for text, marker in markers.items():
        if abs(marker.boundary.radius - radius) > 1e-9 * radius:
            raise InputError(
                f"markers in circles of one size, here of radius {format_length(radius)}",
                f"{text} with {format_length(marker.boundary.radius)}",
                "design it again with the same --radius",
            )
    # Whatever its outline, each is judged where its whole circle is seen, so that all are seen from the same poses.
    disk = Circle(radius)
    height = max((marker.height for marker in markers.values()), default=0.0)
    setting = Setting(judged.boundary, judged.camera, judged.poses.seen_whole(disk, judged.camera, height))
    found: dict[str, Contestant] = {}
    for text in wanted:
        if text in markers:
            entry: Contestant = DotMarker(text, markers[text])
        elif text.split(":")[0] in LAYOUTS:
            entry = _layout(text, first, setting, seed)
        else:
            entry = Peer(text, _fiducial(text, radius), radius)
        found.setdefault(entry.name, entry)
    return list(found.values()), setting


def _read(text: str) -> Marker:
    path = Path(text)
    if path.suffix.lower() != ".json" and not path.exists():
        raise InputError("a known contestant", repr(text), f"known: {FORMS}")
    return _visible(text, read_marker(path))


def _visible(text: str, marker: Marker) -> Marker:
    check_supported(marker, "to compare")
    if min(point.feature.diameter for point in marker.control_points) == 0:
        raise InputError("dots that can be seen", f"a dot of diameter 0 in {text}", "design it with --dot above 0")
    return marker


def _default_setting(poses: str | PoseDistribution | None) -> Setting:
    spec = Spec()
    seen = poses_from(spec.poses if poses is None else poses).seen_whole(spec.boundary, spec.camera)
    return Setting(spec.boundary, spec.camera, seen)


def _layout(text: str, first: Marker | None, setting: Setting, seed: int) -> DotMarker:
    kind, colon, number = text.partition(":")
    if colon and not (number.isdecimal() and kind != "square"):
        form = "square" if kind == "square" else f"{kind}:N, N a whole number"
        raise InputError(form, repr(text), f"known: {FORMS}")
    n = 4 if kind == "square" else int(number) if colon else len(first) if first else Spec().n
    spec = Spec(n=n, boundary=setting.boundary, camera=setting.camera)
    name = kind if kind == "square" else f"{kind}:{n}"
    sizes = [(first.dot_diameter, first.clearance)] if first else []
    dots = choose_dots(spec, setting.poses)
    for diameter, clearance in [*sizes, (dots.diameter, dots.clearance), _on_a_ring(n, setting.boundary.radius)]:
        region = Region(setting.boundary, diameter, clearance)
        layouts = comparison_layouts(region, n, seed).get(kind)
        if layouts is not None:
            objective = OBJECTIVES["pose"](setting)
            # Of several layouts the median one; their number is odd.
            middle = layouts[np.argsort(objective(layouts))[len(layouts) // 2]]
            return DotMarker(name, dressed(middle, setting.boundary, diameter, clearance))
    raise InputError(f"room for {name}", f"a {setting.boundary}", "use fewer dots")


def _on_a_ring(n: int, radius: float) -> tuple[float, float]:
    """Diameter and clearance in m of n dots on the inset rim, `ROOM` of the largest at which they keep apart.

    Neighbors at 2 (r - d/2 - c) sin(pi/n) are d + c apart, with c the default share of d.
    """
    sine = sin(pi / n)
    largest = 2 * radius * sine / (1 + CLEARANCE + (1 + 2 * CLEARANCE) * sine)
    diameter = float(np.floor(ROOM * largest * 1e4) / 1e4)
    return diameter, CLEARANCE * diameter


def _fiducial(text: str, radius: float) -> Tag | Board:
    if not text.startswith("charuco"):
        unit = parse_tag(text, 1.0)
        return replace(unit, side=sqrt(2) * radius / unit.outer_side)
    _, _, rest = text.partition(":")
    size, _, dictionary = rest.partition(":")
    columns, cross, rows = size.partition("x")
    if not (cross and columns.isdecimal() and rows.isdecimal()):
        raise InputError("charuco:COLUMNSxROWS[:DICT]", repr(text), "write for example charuco:5x5:DICT_4X4_50")
    family = f"aruco:{dictionary or 'DICT_4X4_50'}"
    return Board(family, int(columns), int(rows), 2 * radius / hypot(int(columns), int(rows)))
