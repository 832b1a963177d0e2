"""Read a DXF by its layers, as cutters and engravers do, with blocks, arcs and polylines, by the outline reader."""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

from typing import TYPE_CHECKING, Any

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief
from markergen.model.body import Body
from markergen.read.outlines.curves import Arc, Curve
from markergen.read.outlines.dxf import CURVES, SCALES, DxfReader, PlacedEntity
from markergen.read.outlines.formats import OutlineFile
from markergen.verification.reading import (
    FLATTEST,
    READERS,
    Page,
    Reading,
    Settings,
    circles_of,
    findings_of,
    round_shape,
)

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

CUT, ENGRAVE = "CUT", "ENGRAVE"
"""Layers of what is made."""

MADE = (CUT, ENGRAVE)
LAYERS = (*MADE, "INFO")
SOLID = ("BYLAYER", "BYBLOCK", "CONTINUOUS", "")
"""Types of lines without gaps."""

OFF, COARSE, LEVEL = 2e-5, 2e-3, 1e-3
"""Maximum distances in mm of straight pieces from a curve to cut, and from others, and of a curve from the plane."""

TWIN = 0.35
"""Maximum distance in mm between two shapes of which one is there for nothing: less than between cells of a tag."""

MOST_LINES = 500_000
"""Maximum number of straight pieces of lines to cut; ours have some 350."""


@READERS.register(".dxf")
def read_dxf(data: bytes, name: str, body: Body, settings: Settings) -> Reading:  # noqa: ARG001
    """Read the circles in the model space, with their layers, and the lines of what is made."""
    file = OutlineFile(name, data)
    reader = DxfReader(file)
    document = reader.document
    shapes = _Shapes(_unit(document, data, name, settings.unit))
    for placed in reader.entities():
        shapes.add(placed, document, file)
    for layout in document.layouts:
        # A viewport shows the model space.
        if layout.is_any_paperspace and any(entity.dxftype() != "VIEWPORT" for entity in layout):
            shapes.unread[f"the layout {brief(layout.name)} in paper space"] = None
    hidden = [*shapes.hidden, *(["a block is hidden"] if "hidden shapes" in reader.others else [])]
    corners = np.concatenate([np.zeros((0, 2)), *shapes.corners])
    page = Page(
        circles_of([(x, y, radius, away) for _, x, y, radius, away in shapes.circles], name),
        None,
        corners[np.isfinite(corners).all(axis=-1)],
        lines=np.concatenate([np.zeros((0, 2, 2)), *shapes.lines[CUT]]),
        are_cut=CUT in {*reader.layers, *(str(layer.dxf.name) for layer in document.layers)},
        layers=tuple(layer for layer, *_ in shapes.circles),
        hidden=tuple(sorted(hidden)),
        unread=tuple((label, np.full((4, 2), np.nan)) for label in shapes.unread),
        engraved=np.concatenate([np.zeros((0, 2, 2)), *shapes.lines[ENGRAVE]]),
    )
    return Reading("DXF", (page,), alone=True, findings=findings_of(shapes.twice))


def _unit(document: "Document", data: bytes, name: str, asked: float | None) -> float:
    """Unit in mm."""
    # ezdxf assumes a unit if there is none.
    code = document.header.get("$INSUNITS", 0) if b"$INSUNITS" in data else None
    scale = SCALES.get(code) if code is not None else None
    if scale is not None:
        return 1e3 * scale
    if asked is not None:
        return asked
    problem = "no $INSUNITS" if code is None else f"$INSUNITS {brief(str(code))}"
    raise InputError(f"a unit of length in {name}", problem, "save it in mm, or give --unit")


class _Shapes:
    """What the entities of a drawing make; mm."""

    def __init__(self, unit: float) -> None:
        self.matrix = unit * np.eye(4)[:3]
        self.circles: list[tuple[str, float, float, float, float]] = []
        self.corners: list[Array] = []
        self.lines: dict[str, list[Array]] = {layer: [] for layer in MADE}
        self.hidden: set[str] = set()
        self.unread: dict[str, None] = {}
        self.twice: list[str] = []
        self._rounds: list[tuple[str, Array, list[Array]]] = []
        self._others: list[tuple[str, Array]] = []

    def add(self, placed: PlacedEntity, document: "Document", file: OutlineFile) -> None:
        """Take an entity."""
        entity, layer, kind = placed.entity, placed.layer, placed.kind
        # Programs take names of layers in any case.
        layer = layer.upper() if layer.upper() in LAYERS else layer
        entry = document.layers.get(layer) if layer in document.layers else None
        if entity.dxf.get("invisible", 0) or entity.dxf.get("paperspace", 0):
            self.hidden.add("an entity is invisible")
            return
        label = layer if layer in LAYERS else brief(layer)
        if kind not in CURVES or layer not in LAYERS:
            if layer not in LAYERS or layer in MADE:
                self.unread[f"the {brief(kind)} on the layer {label}"] = None
            if kind not in CURVES:
                return
        if entry is not None and (entry.is_off() or entry.is_frozen() or not entry.dxf.get("plot", 1)):
            self.hidden.add(f"the layer {label} is switched off")
            return
        if layer in MADE and (flaw := _flaw(entity, entry)):
            self.unread[f"the {brief(kind)} {flaw} on the layer {label}"] = None
        for curves, closed in placed.curves(file):
            self._take(kind, layer, [curve.mapped(self.matrix) for curve in curves], closed)

    def _take(self, kind: str, layer: str, curves: list[Curve], closed: bool) -> None:
        points = np.concatenate([curve.flatten(OFF if layer == CUT else COARSE) for curve in curves])
        if not np.isfinite(points).all() or not (np.abs(points) < 1e7).all():
            return
        if layer in MADE and np.abs(points[:, 2]).max() > LEVEL:
            self.unread[f"the {kind} outside of the plane on the layer {layer}"] = None
        flat = points[:, :2]
        # Splines, and polylines of many programs, end where they begin without a flag.
        closed = closed or bool(np.linalg.norm(flat[0] - flat[-1]) < LEVEL)
        ring = np.concatenate([flat, flat[:1]]) if closed else flat
        circle = _circle(curves, flat) if closed or kind in ("ARC", "ELLIPSE") else None
        if circle is not None:
            self._take_arc(kind, layer, circle, ring)
        elif layer in MADE and kind != "ELLIPSE":
            self.corners.append(flat)
        if layer not in MADE:
            return
        self.lines[layer].append(np.stack([ring[:-1], ring[1:]], axis=1))
        if sum(map(len, self.lines[layer])) > MOST_LINES:
            raise InputError(f"at most {MOST_LINES} pieces of lines", "more", "simplify the drawing")
        if circle is None:
            length = float(np.linalg.norm(np.diff(ring, axis=0), axis=1).sum())
            ends = ring[np.lexsort(ring[:, ::-1].T)[[0, -1]]] if not closed else ring[[0, 0]] * 0
            traits = np.array([*ring.min(axis=0), *ring.max(axis=0), length, *ends.ravel()])
            away = min(TWIN, length / 5)
            if any(there == layer and np.abs(traits - other).max() <= away for there, other in self._others):
                self._again(kind, ring)
            self._others.append((layer, traits))

    def _take_arc(self, kind: str, layer: str, circle: Array, ring: Array) -> None:
        """Take a circle or a piece of one, and tell whether it is there already, or whole with those before."""
        # Half degrees that it covers, the ends of an arc left to the next.
        angle = 2 * np.degrees(np.unwrap(np.arctan2(*(ring - circle[:2]).T[::-1])))
        is_whole = np.allclose(ring[0], ring[-1])
        places = np.arange(720) if is_whole else np.arange(round(angle.min()), round(angle.max())) % 720
        rounds = (drawn for there, other, drawn in self._rounds
                  if there == layer and np.abs((circle - other)[:3]).max() <= min(TWIN, circle[2] / 5))  # fmt: skip
        drawn = next(rounds, None)
        if drawn is None:
            self._rounds.append((layer, circle, drawn := [np.zeros(720, dtype=int)]))
        before = drawn[0].copy()
        np.add.at(drawn[0], places, 1)
        if layer in MADE and len(places) and (before[places] > 0).mean() > 0.05:
            self._again(kind, ring)
        if len(places) == 720 or before.min() == 0 < drawn[0].min():
            x, y, radius, away = circle.tolist()
            self.circles.append((layer, x, y, radius, away))

    def _again(self, kind: str, ring: Array) -> None:
        x, y = (ring.min(axis=0) + ring.max(axis=0)) / 2
        self.twice.append(f"the {kind} around x {x:.4g}, y {y:.4g} mm is there twice, and would be made twice")


def _circle(curves: list[Curve], points: Array) -> Array | None:
    """The circle that curves are, or are a piece of; None if they are of another shape."""
    if len(curves) == 1 and isinstance(curves[0], Arc):
        arc = curves[0]
        sides = np.linalg.svd(np.stack([arc.u[:2], arc.v[:2]]), compute_uv=False)
        whole = abs(abs(arc.sweep) - 2 * np.pi) < 1e-6
        if sides[1] < (FLATTEST if whole else 1 - 1e-6) * sides[0] or not sides[1] > 0:
            return None
        radius = float(np.sqrt(sides.prod()))
        return np.array([*arc.center[:2], radius, np.abs(sides - radius).max()])
    disk = round_shape(points)
    return None if disk is None else np.array(disk)


def _flaw(entity: Any, entry: Any) -> str:
    """What a machine would make of an entity other than a fine whole line."""
    types = [entity.dxf.get("linetype", "BYLAYER"), entry.dxf.get("linetype", "") if entry is not None else ""]
    if any(str(kind).upper() not in SOLID for kind in types):
        return "in a broken line"
    keys = {"LWPOLYLINE": ("const_width",), "POLYLINE": ("default_start_width", "default_end_width")}
    widths = [entity.dxf.get(key, 0.0) for key in keys.get(entity.dxftype(), ())]
    if entity.dxftype() == "LWPOLYLINE":
        widths += [width for row in entity.get_points("se") for width in row]
    return "in a wide line" if any(widths) else ""
