"""Read circles of a DXF from its pairs of group code and value, without a DXF library."""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

from collections.abc import Iterator
from itertools import pairwise
from math import cos, hypot, pi, sin

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.body import Body
from markergen.verification.reading import FARTHEST, READERS, Page, Reading, Settings, circles_of, round_shape
from markergen.verification.words import MOST_LISTED

Group = tuple[int, str]

MM = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 9: 0.0254, 13: 1e-3, 14: 100.0}
"""Units that $INSUNITS can name, in mm."""

MOST_GROUPS = 3_000_000
"""Maximum number of groups, pairs of lines, in a file; those that we write for a marker have some 2,000."""


CUT, ENGRAVE = "CUT", "ENGRAVE"
"""Layers of what is made."""

MADE = (CUT, ENGRAVE)
LAYERS = (*MADE, "INFO")
SOLID = ("BYLAYER", "BYBLOCK", "CONTINUOUS", "")
"""Types of lines without gaps."""

DEEPEST = 20
"""Maximum number of blocks in blocks."""

READ = ("CIRCLE", "ELLIPSE", "ARC", "LINE", "LWPOLYLINE", "POLYLINE", "VERTEX", "SEQEND", "POINT")
"""Kinds of entities that are read; a machine would make others too."""

ARC_STEP = 0.006
"""Maximum angle in rad of a straight piece of an arc to be cut: within 0.7 um of it for a radius of 150 mm."""

MOST_ENTITIES, MOST_PIECES = 100_000, 500_000
"""Maximum numbers of entities, which take 1.5 s to read, and of straight pieces of lines to cut; ours have some 350."""


@READERS.register(".dxf")
def read_dxf(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read circles in the model space: CIRCLE, full ELLIPSE and round LWPOLYLINE entities, with layers, and lines."""
    groups = _groups(data, name)
    unit = _unit(groups, name, settings.unit)
    off, dashed = _switched_off(groups), _dashed(groups)
    circles: list[tuple[float, float, float]] = []
    layers: list[str] = []
    corners: list[Array] = []
    lines, cut, hidden = [np.zeros((0, 2, 2))], list[bool](), set[str]()
    unread: list[tuple[str, Array]] = []
    arcs: dict[tuple[str, float, float, float], float] = {}
    shapes: dict[tuple[object, ...], str] = {}
    twice, engraved = list[str](), [np.zeros((0, 2, 2))]
    for number, (kind, entity) in enumerate(_in_place(groups, name)):
        if number == MOST_ENTITIES:
            raise InputError(f"at most {MOST_ENTITIES} entities in {name}", "more", "verify a smaller file")
        layer = next((value for code, value in entity if code == 8), "0")
        if (60, "1") in entity:
            hidden.add("an entity is invisible")
            continue
        if (layer in MADE and kind not in READ) or layer not in LAYERS:
            label = layer if layer in LAYERS else brief(layer)
            unread.append((f"the {brief(kind)} on the layer {label}", np.full((4, 2), np.nan)))
        if layer in off:
            hidden.add(f"the layer {brief(layer)} is switched off")
            continue
        # An extrusion that points down mirrors the entity's plane.
        flip = -1.0 if _values(entity, 230)[:1] == [-1.0] else 1.0
        whole = _circles(kind, entity, corners, flip * unit, unit)
        for x, y, r in whole:
            circles.append((flip * unit * x, unit * y, unit * r))
            layers.append(layer)
        ring = _line(kind, entity) if layer in MADE else np.zeros((0, 2))
        if len(ring) < 2:
            continue
        points = ring * [flip * unit, unit]
        pieces = np.stack([points[:-1], points[1:]], axis=1)
        if kind == "ARC" and np.isfinite(points).all():
            circle = _whole_of(arcs, layer, entity, flip * unit, unit)
            if circle is not None:
                circles.append(circle)
                layers.append(layer)
        elif kind == "LINE":
            corners.append(points)
        if _line_type(entity) not in SOLID or layer in dashed:
            unread.append((f"the {brief(kind)} in a broken line on the layer {layer}", np.full((4, 2), np.nan)))
        key = _signature(layer, points)
        if key in shapes:
            twice.append(f"the {brief(kind)} around x {points[:, 0].mean():.4g}, y {points[:, 1].mean():.4g} mm")
        shapes[key] = kind
        if layer == CUT:
            lines.append(pieces)
            cut += [True] * len(pieces)
        elif not whole:
            engraved.append(pieces)
        if len(cut) > MOST_PIECES:
            raise InputError(f"at most {MOST_PIECES} pieces of lines to cut in {name}", "more", "simplify it")
    points = np.concatenate(corners) if corners else np.zeros((0, 2))
    table = np.array(circles, dtype=float).reshape(-1, 3)
    good = (np.abs(table[:, :2]) < FARTHEST).all(axis=-1)
    page = Page(
        circles_of(circles, name),
        None,
        points[np.isfinite(points).all(axis=-1)],
        lines=np.concatenate(lines),
        cut=np.array(cut, dtype=np.bool_) if CUT in _names(groups) else None,
        layers=tuple(layer for layer, kept in zip(layers, good, strict=True) if kept),
        hidden=tuple(sorted(hidden)),
        unread=tuple(dict(unread).items()),
        engraved=np.concatenate(engraved),
    )
    both = tuple(f"{shape} is there twice, and would be made twice" for shape in twice[:MOST_LISTED])
    return Reading("DXF", (page,), tagged=True, twice=both)


def _whole_of(
    arcs: dict[tuple[str, float, float, float], float], layer: str, entity: list[Group], unit_x: float, unit_y: float
) -> tuple[float, float, float] | None:
    """The circle that an arc completes with earlier ones, mm; None while some of it is missing."""
    x, y, r, start, end = ((*_values(entity, code), np.nan)[0] for code in (10, 20, 40, 50, 51))
    key = (layer, round(x * unit_x, 4), round(y * unit_y, 4), round(r * unit_y, 4))
    before = arcs.get(key, 0.0)
    arcs[key] = before + ((end - start) % 360 or 360.0)
    return (unit_x * x, unit_y * y, unit_y * r) if before < 359.99 <= arcs[key] else None


def _signature(layer: str, points: Array) -> tuple[object, ...]:
    """What two entities have in common that draw the same."""
    low, high = points.min(axis=0), points.max(axis=0)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    around = sorted(np.round(points[[0, -1]], 2).tolist()) if np.linalg.norm(points[0] - points[-1]) > 0.01 else []
    return (layer, *np.round(low, 2).tolist(), *np.round(high, 2).tolist(), round(length, 1), str(around))


def _line_type(entity: list[Group]) -> str:
    return next((value.upper() for code, value in entity if code == 6), "BYLAYER")


def _dashed(groups: list[Group]) -> set[str]:
    """Names of layers whose lines are broken."""
    return {
        name
        for name, entry in _table_of(groups, "LAYER")
        if next((value.upper() for code, value in entry if code == 6), "CONTINUOUS") not in SOLID
    }


def _table_of(groups: list[Group], kind: str) -> Iterator[tuple[str, list[Group]]]:
    """Name and groups of each entry of a table."""
    starts = [index for index, (code, _) in enumerate(groups) if code == 0]
    for start, end in zip(starts, [*starts[1:], len(groups)], strict=True):
        if groups[start][1] == kind:
            entry = groups[start + 1 : end]
            yield next((value for code, value in entry if code == 2), ""), entry


def _in_place(groups: list[Group], name: str) -> Iterator[tuple[str, list[Group]]]:
    """Entities of the model space, with those of inserted blocks where these are."""
    blocks: dict[str, tuple[list[float], list[tuple[str, list[Group]]]]] = {}
    block: list[tuple[str, list[Group]]] = []
    for kind, entity in _entities(groups, "BLOCKS"):
        if kind == "BLOCK":
            block = []
            called = next((value for code, value in entity if code == 2), "")
            blocks[called] = ([(*_values(entity, code), 0.0)[0] for code in (10, 20)], block)
        elif kind != "ENDBLK":
            block.append((kind, entity))
    left = MOST_ENTITIES

    def placed(kind: str, entity: list[Group], deep: int) -> Iterator[tuple[str, list[Group]]]:
        nonlocal left
        left -= 1
        if left < 0 or deep > DEEPEST:
            raise InputError(f"at most {MOST_ENTITIES} entities in {name}", "more", "verify a smaller file")
        if kind != "INSERT":
            yield kind, entity
            return
        called = next((value for code, value in entity if code == 2), "")
        layer = next((value for code, value in entity if code == 8), "0")
        scales = [(*_values(entity, code), 1.0)[0] for code in (41, 42)]
        counts = [(*_values(entity, code), 1.0)[0] for code in (70, 71)]
        if called not in blocks or abs(scales[0]) != abs(scales[1]) or scales[0] <= 0 or counts != [1.0, 1.0]:
            remedy = "explode the blocks"
            raise InputError(f"blocks that are neither stretched, mirrored nor repeated in {name}", "others", remedy)
        base, inner = blocks[called]
        angle = np.radians((*_values(entity, 50), 0.0)[0])
        factor = scales[0] * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        offset = np.array([(*_values(entity, code), 0.0)[0] for code in (10, 20)])
        for inner_kind, part in inner:
            moved = _moved(part, factor, offset, np.array(base), layer, scales[1] < 0)
            yield from placed(inner_kind, moved, deep + 1)

    for kind, entity in _entities(groups):
        yield from placed(kind, entity, 0)


def _moved(entity: list[Group], factor: Array, offset: Array, base: Array, layer: str, mirrored: bool) -> list[Group]:
    """Groups of an entity that is turned, scaled and moved with its block; in layer 0 it takes that of the block."""
    matrix = factor @ np.diag([1.0, -1.0]) if mirrored else factor
    scale, turn = float(np.hypot(*factor[:, 0])), float(np.degrees(np.arctan2(factor[1, 0], factor[0, 0])))
    kind_is_ellipse = any(code == 41 for code, _ in entity) and any(code == 11 for code, _ in entity)
    groups, x = list[Group](), dict[int, float]()
    angles = {code: values[0] for code in (50, 51) if (values := _values(entity, code))}
    for code, text in entity:
        try:
            value = float(text) if code in (10, 11, 20, 21, 40, 50, 51, 42) else 0.0
        except ValueError:
            value = np.nan
        if code in (10, 11):
            x[code] = value
            groups.append((code, text))
        elif code in (20, 21) and code - 10 in x:
            point = np.array([x[code - 10], value])
            place = matrix @ point if kind_is_ellipse and code == 21 else matrix @ (point - base) + offset
            index = max(k for k, (known, _) in enumerate(groups) if known == code - 10)
            groups[index] = (code - 10, repr(float(place[0])))
            groups.append((code, repr(float(place[1]))))
        elif code == 40 and not kind_is_ellipse:
            groups.append((code, repr(scale * value)))
        elif code in (50, 51):
            other = angles.get(101 - code, value)
            groups.append((code, repr(turn - other if mirrored else value + turn)))
        elif code == 42 and mirrored and not kind_is_ellipse:
            groups.append((code, repr(-value)))
        elif code == 8 and text == "0":
            groups.append((code, layer))
        else:
            groups.append((code, text))
    return groups


def _names(groups: list[Group]) -> set[str]:
    """Names of all layers that are used or defined."""
    return {value for code, value in groups if code in (2, 8)}


def _switched_off(groups: list[Group]) -> set[str]:
    """Names of layers that are off, frozen or not plotted."""
    off = set()
    for name, entry in _table_of(groups, "LAYER"):
        # A negative color is off, the first bit of the flags is frozen.
        flags = [int(value) for value in _values(entry, 70) if abs(value) < 1e6]
        if any(value < 0 for value in _values(entry, 62)) or any(flag & 1 for flag in flags) or (290, "0") in entry:
            off.add(name)
    return off


def _groups(data: bytes, name: str) -> list[Group]:
    if data.startswith(b"AutoCAD Binary DXF"):
        raise InputError(f"an ASCII DXF in {name}", "a binary one", "save it as ASCII DXF")
    lines = data.decode("utf-8", "replace").splitlines()
    if len(lines) > 2 * MOST_GROUPS:
        raise InputError(f"at most {MOST_GROUPS} groups in {name}", "more", "verify a smaller file")
    groups = []
    for index in range(0, len(lines) - 1, 2):
        code = lines[index].strip()
        if not (code.lstrip("-").isdecimal() and len(code) < 6):
            raise InputError(f"a group code in line {index + 1} of {name}", brief(code), "export the DXF again")
        groups.append((int(code), lines[index + 1].strip()))
    if not groups or groups[-1] != (0, "EOF"):
        raise InputError(f"a complete DXF in {name}", "no EOF at its end", "export it again")
    return groups


def _unit(groups: list[Group], name: str, asked: float | None) -> float:
    for (code, key), (_, value) in pairwise(groups):
        if (code, key) == (9, "$INSUNITS"):
            unit = int(value) if value.isdecimal() and len(value) < 4 else -1
            if unit not in MM and asked is not None:
                return asked
            if unit not in MM:
                raise InputError(f"a unit of length in {name}", f"$INSUNITS {brief(value)}", "save it in mm")
            return MM[unit]
    if asked is not None:
        return asked
    raise InputError(f"a unit of length in {name}", "no $INSUNITS", "save it in mm, or give --unit")


def _entities(groups: list[Group], section: str = "ENTITIES") -> Iterator[tuple[str, list[Group]]]:
    """Kind and groups of each entity in a section."""
    inside, entity = False, list[Group]()
    starts = [index for index, (code, _) in enumerate(groups) if code == 0]
    for start, end in zip(starts, [*starts[1:], len(groups)], strict=True):
        kind, entity = groups[start][1], groups[start + 1 : end]
        if kind == "SECTION":
            inside = (2, section) in entity
        elif kind == "ENDSEC":
            inside = False
        elif inside and not any(code == 67 and value == "1" for code, value in entity):  # paper space
            yield kind, entity


def _values(entity: list[Group], code: int) -> list[float]:
    values = []
    for key, text in entity:
        if key == code:
            try:
                values.append(float(text))
            except ValueError:
                values.append(np.nan)
    return values


def _circles(
    kind: str, entity: list[Group], corners: list[Array], unit_x: float, unit_y: float
) -> list[tuple[float, float, float]]:
    """Circles of one entity in its own unit and plane; the corners of other shapes are collected in mm."""

    def first(*codes: int) -> list[float]:
        return [values[0] if (values := _values(entity, code)) else np.nan for code in codes]

    if kind == "CIRCLE":
        x, y, r = first(10, 20, 40)
        return [(x, y, r)] if r > 0 else []
    if kind == "ELLIPSE":
        x, y, dx, dy, ratio, start, end = first(10, 20, 11, 21, 40, 41, 42)
        whole = abs(abs(end - start) - 2 * pi) < 1e-6 and ratio > 0.8
        return [(x, y, hypot(dx, dy) * ratio**0.5)] if whole else []
    if kind in ("LWPOLYLINE", "POLYLINE"):
        points = _polyline(entity)
        circle = round_shape(points) if len(points) else None
        if circle is None and len(points) >= 3:
            corners.append(points * [unit_x, unit_y])
        return [circle] if circle else []
    return []


def _line(kind: str, entity: list[Group]) -> Array:
    """Points (m, 2) along an entity that a cutter follows, in its own unit; a closed one ends at its start."""

    def first(*codes: int) -> list[float]:
        return [values[0] if (values := _values(entity, code)) else np.nan for code in codes]

    def arc(start: float, sweep: float, u: Array, v: Array, center: Array) -> Array:
        if not np.isfinite([start, sweep]).all():
            return np.zeros((0, 2))
        t = start + np.linspace(0, sweep, max(int(abs(sweep) / ARC_STEP), 1) + 1)[:, None]
        return np.asarray(center + u * np.cos(t) + v * np.sin(t))

    if kind == "LINE":
        return np.array(first(10, 20, 11, 21)).reshape(2, 2)
    if kind in ("CIRCLE", "ARC"):
        x, y, r = first(10, 20, 40)
        start, end = (np.radians(value) for value in first(50, 51)) if kind == "ARC" else (0.0, 2 * pi)
        return arc(start, (end - start) % (2 * pi) or 2 * pi, np.array([r, 0.0]), np.array([0.0, r]), np.array([x, y]))
    if kind == "ELLIPSE":
        x, y, dx, dy, ratio, start, end = first(10, 20, 11, 21, 40, 41, 42)
        sweep = min(max(end - start, -2 * pi), 2 * pi)
        return arc(start, sweep, np.array([dx, dy]), ratio * np.array([-dy, dx]), np.array([x, y]))
    if kind in ("LWPOLYLINE", "POLYLINE"):
        points = _polyline(entity, ARC_STEP)
        closed = any(int(value) & 1 for value in _values(entity, 70) if abs(value) < 1e6)
        return np.concatenate([points, points[:1]]) if closed else points
    return np.zeros((0, 2))


def _polyline(entity: list[Group], step: float = 0.4) -> Array:
    """Points of a polyline, with arcs sampled in steps of this angle in rad or less, 16 at least."""
    vertices: list[list[float]] = []
    for code, text in entity:
        try:
            value = float(text) if code in (10, 20, 42) else 0.0
        except ValueError:
            value = np.nan
        if code == 10:
            vertices.append([value, np.nan, 0.0])
        elif code in (20, 42) and vertices:
            vertices[-1][1 if code == 20 else 2] = value
    points: list[tuple[float, float]] = []
    for (x, y, bulge), (u, v, _) in zip(vertices, [*vertices[1:], *vertices[:1]], strict=True):
        points.append((x, y))
        if bulge and np.isfinite([x, y, u, v, bulge]).all():
            # The arc's angle is 4 atan(bulge); its center lies on the perpendicular bisector of the chord.
            k = (1 - bulge**2) / (4 * bulge)
            cx, cy = (x + u) / 2 - k * (v - y), (y + v) / 2 + k * (u - x)
            sweep = 4 * float(np.arctan(bulge))
            count = max(16, int(abs(sweep) / step))
            for number in range(1, count):
                c, s = cos(sweep * number / count), sin(sweep * number / count)
                points.append((cx + c * (x - cx) - s * (y - cy), cy + s * (x - cx) + c * (y - cy)))
    return np.array(points, dtype=float).reshape(-1, 2)
