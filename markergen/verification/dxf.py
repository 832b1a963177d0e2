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

Group = tuple[int, str]

MM = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 9: 0.0254, 13: 1e-3, 14: 100.0}
"""Units that $INSUNITS can name, in mm."""

MOST_GROUPS = 3_000_000
"""Maximum number of groups, pairs of lines, in a file; those that we write for a marker have some 2,000."""


CUT, ENGRAVE = "CUT", "ENGRAVE"
"""Layers of what is made."""

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
    unit = _unit(groups, name)
    off = _switched_off(groups)
    circles: list[tuple[float, float, float]] = []
    layers: list[str] = []
    corners: list[Array] = []
    lines, cut, hidden = [np.zeros((0, 2, 2))], list[bool](), set[str]()
    unread: list[tuple[str, Array]] = []
    for number, (kind, entity) in enumerate(_entities(groups)):
        if number == MOST_ENTITIES:
            raise InputError(f"at most {MOST_ENTITIES} entities in {name}", "more", "verify a smaller file")
        if kind == "INSERT":
            raise InputError(f"entities in place in {name}", "an inserted block", "explode the blocks")
        layer = next((value for code, value in entity if code == 8), "0")
        if (60, "1") in entity:
            hidden.add("an entity is invisible")
            continue
        if layer in (CUT, ENGRAVE) and kind not in READ:
            unread.append((f"the {brief(kind)} on the layer {layer}", np.full((4, 2), np.nan)))
        if layer in off:
            hidden.add(f"the layer {brief(layer)} is switched off")
            continue
        # An extrusion that points down mirrors the entity's plane.
        flip = -1.0 if _values(entity, 230)[:1] == [-1.0] else 1.0
        for x, y, r in _circles(kind, entity, corners, flip * unit, unit):
            circles.append((flip * unit * x, unit * y, unit * r))
            layers.append(layer)
        # Circles on other layers are dots or pictures of something; only lines to cut are compared.
        if layer == CUT and len(ring := _line(kind, entity)) > 1:
            points = ring * [flip * unit, unit]
            lines.append(np.stack([points[:-1], points[1:]], axis=1))
            cut += [True] * len(lines[-1])
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
    )
    return Reading("DXF", (page,), tagged=True)


def _names(groups: list[Group]) -> set[str]:
    """Names of all layers that are used or defined."""
    return {value for code, value in groups if code in (2, 8)}


def _switched_off(groups: list[Group]) -> set[str]:
    """Names of layers that are off or frozen."""
    off = set()
    starts = [index for index, (code, _) in enumerate(groups) if code == 0]
    for start, end in zip(starts, [*starts[1:], len(groups)], strict=True):
        if groups[start][1] != "LAYER":
            continue
        entry = groups[start:end]
        name = next((value for code, value in entry if code == 2), "")
        # A negative color is off, the first bit of the flags is frozen.
        if any(value < 0 for value in _values(entry, 62)) or any(int(value) & 1 for value in _values(entry, 70)
                                                                 if abs(value) < 1e6):  # fmt: skip
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


def _unit(groups: list[Group], name: str) -> float:
    for (code, key), (_, value) in pairwise(groups):
        if (code, key) == (9, "$INSUNITS"):
            unit = int(value) if value.isdecimal() and len(value) < 4 else -1
            if unit not in MM:
                raise InputError(f"a unit of length in {name}", f"$INSUNITS {brief(value)}", "save it in mm")
            return MM[unit]
    raise InputError(f"a unit of length in {name}", "no $INSUNITS", "save it in mm")


def _entities(groups: list[Group]) -> Iterator[tuple[str, list[Group]]]:
    """Kind and groups of each entity in the ENTITIES section."""
    inside, entity = False, list[Group]()
    starts = [index for index, (code, _) in enumerate(groups) if code == 0]
    for start, end in zip(starts, [*starts[1:], len(groups)], strict=True):
        kind, entity = groups[start][1], groups[start + 1 : end]
        if kind == "SECTION":
            inside = (2, "ENTITIES") in entity
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
