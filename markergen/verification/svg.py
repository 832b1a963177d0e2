"""Read an SVG with all transforms, units and paint, by the outline reader, which shares no code with the writer."""

# tests: tests/verification/test_check.py tests/verification/test_flat.py

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.drawing.colors import luma
from markergen.errors import InputError
from markergen.guard import Content, check_size
from markergen.model.body import Body
from markergen.read.outlines.curves import Arc, Bezier, Curve
from markergen.read.outlines.formats import OUTLINE_FORMATS, OutlineFile, OutlinePiece, Paint
from markergen.read.outlines.svg import fraction, parse_svg
from markergen.verification.lines import Seek, seek_among
from markergen.verification.picture import WHITE, PagePicture
from markergen.verification.reading import READERS, Page, Reading, circles_of, round_shape

PATIENCE = 10
"""Factor by which path data may exceed that of an outline: sheets contain text converted to outlines."""

CUT = "cut"
"""Name of the layer of lines to be cut; that of a spot color may follow."""

OFF = 5e-4
"""Maximum distance in mm of the polygons that stand for curves."""

ROUGH = 0.6
"""Minimum ratio of the sides of the box around the control points of an outline that may be round."""

MOST_ROUGH = 10_000
"""Maximum number of such outlines, each of which takes a fraction of a millisecond."""

UNKNOWN = 128.0
"""Grey level of what is not evaluated: gradients and patterns."""

MOST_PRODUCTS = 4_000_000
"""Number of pairs of a place and a side that are compared at once."""

_ALONG = np.linspace(0, 1, 5)[:-1, None, None]
"""Parameters of the points sampled on a Bezier curve; computed once, since a sheet has thousands of curves."""

_EFFECT = re.compile(
    rb"(?:filter|mix-blend-mode)\s*(?:=\s*[\"']|:)\s*(?!none|normal)[a-z]|marker(?:-\w+)?\s*(?:=\s*[\"']|:)\s*url"
    rb"|<(?:\w+:)?(?:animate\w*|set)\b"
)


@READERS.register(".svg")
def read_svg(data: bytes, name: str, body: Body) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Read the circles, corners and lines of an SVG, and what shows of it."""
    check_size(Content(name, data), "SVG")
    file = OutlineFile(name, data, PATIENCE)
    if _EFFECT.search(data):
        raise InputError(
            f"shapes drawn as they are in {name}",
            "a filter, a blend mode, line ends or animation",
            "save it without effects",
        )
    with np.errstate(all="ignore"):
        drawing = OUTLINE_FORMATS["svg"].read(file, None)
        if drawing.scale is None:
            raise InputError(f"a width and height with units in {name}", "none", "save it with its size in mm")
        scale = 1e3 * drawing.scale
        factor = np.array([scale, -scale])
        circles, corners, lines, cut, rough = [], [], [np.zeros((0, 2, 2))], [], 0
        for piece in drawing.pieces:
            assert piece.look is not None
            if piece.look.style["fill"] == "none":
                points = np.concatenate([curve.flatten(OFF / scale) for curve in piece.curves]) * factor
                ends = np.concatenate([points[1:], points[:1]])
                pieces = np.stack([points, ends], axis=1)
                lines.append(pieces if piece.closed else pieces[:-1])
                on_cut = any(layer.split(" (")[0] == CUT for layer in piece.look.layers)
                cut += [on_cut] * len(lines[-1])
            points = np.concatenate([curve.sketch() for curve in piece.curves]) * factor
            sides = np.ptp(points, axis=0)
            circle = None
            if sides.min() > ROUGH * sides.max():
                rough += 1
                if rough > MOST_ROUGH:
                    raise InputError(f"at most {MOST_ROUGH} shapes as wide as high in {name}", "more", "verify the PDF")
                points = np.concatenate([_points(curve) for curve in piece.curves]) * factor
                circle = round_shape(points)
            if circle and (piece.look.style["fill"] != "none" or not any(cut[-1:])):
                circles.append(circle)
            elif len(points) >= 3:
                corners.append(points)
        painted = [_Painted.of(list(pieces), scale) for _, pieces in groupby(drawing.pieces, _shape_of)]
    root = parse_svg(file)
    size = _size(root.get("width"), root.get("height"))
    is_cut = np.array(cut, dtype=np.bool_)
    page = Page(
        circles_of(circles, name), size, _joined(corners), lines=np.concatenate(lines),
        cut=is_cut if is_cut.any() else None, picture=_picture(painted, _shown(root.get("viewBox"), size, scale)),
        hidden=("some shapes are hidden",) if "hidden shapes" in drawing.others else (),
        unread=tuple((label, corners * factor) for label, corners in drawing.unread),
    )  # fmt: skip
    return Reading("SVG", (page,), tagged=True)


def _shape_of(piece: OutlinePiece) -> int:
    return piece.look.shape if piece.look else 0


def _points(curve: Curve) -> Array:
    """Sample a curve, densely enough to preserve its shape if it is bent."""
    if isinstance(curve, Arc):
        t = np.linspace(curve.start, curve.start + curve.sweep, 33)[:-1, None]
        return np.asarray(curve.center + curve.u * np.cos(t) + curve.v * np.sin(t))
    if isinstance(curve, Bezier):
        points = curve.points[None]
        while points.shape[1] > 1:
            points = (1 - _ALONG) * points[:, :-1] + _ALONG * points[:, 1:]
        return points[:, 0]
    return curve.sketch()


def _joined(corners: list[Array]) -> Array:
    points = np.concatenate(corners) if corners else np.zeros((0, 2))
    return points[np.isfinite(points).all(axis=-1)]


def _size(width: str | None, height: str | None) -> tuple[float, float] | None:
    from svgelements import Length

    try:
        # At 25.4 px per inch, 1 px is 1 mm.
        sides = tuple(float(Length(text or "").value(ppi=25.4)) for text in (width, height))
    except (ValueError, TypeError, AttributeError):
        return None
    return (sides[0], sides[1]) if np.isfinite(sides).all() else None


def _shown(view_box: str | None, size: tuple[float, float] | None, scale: float) -> Array:
    """Left, bottom, right and top in mm of the visible part, y up."""
    everything = np.array([-np.inf, -np.inf, np.inf, np.inf])
    if size is None:
        return everything
    try:
        x, y, width, height = (float(text) * scale for text in (view_box or "").replace(",", " ").split())
    except ValueError:
        x, y, (width, height) = 0.0, 0.0, size
    # A page of another shape shows more on both sides.
    wide, high = (max(both) - inner for both, inner in zip(zip((width, height), size, strict=True), (width, height),
                                                       strict=True))  # fmt: skip
    return np.array([x - wide / 2, -y - height - high / 2, x + width + wide / 2, -y + high / 2])


@dataclass(frozen=True, eq=False)
class _Painted:
    """One shape as it is painted.

    Attributes
    ----------
    scale : float
        mm per unit of the pieces.
    fill, stroke : (grey level, opacity); opacity 0 for none
    width : float
        Of the stroke, mm.
    odd : bool
        True for the even-odd rule.
    box : array (4,)
        Left, bottom, right and top, with the stroke.
    """

    pieces: Sequence[OutlinePiece]
    scale: float
    fill: tuple[float, float]
    stroke: tuple[float, float]
    width: float
    odd: bool
    box: Array

    @staticmethod
    def of(pieces: Sequence[OutlinePiece], scale: float) -> "_Painted":
        look = pieces[0].look
        assert look is not None
        hull = np.concatenate([curve.sketch() for piece in pieces for curve in piece.curves]) * [scale, -scale]
        width = _number(look.style["stroke-width"]) * look.scale * scale
        fill, stroke = (_paint(look, kind) for kind in ("fill", "stroke"))
        spread = width / 2 if stroke[1] else 0.0
        box = np.concatenate([hull.min(axis=0) - spread, hull.max(axis=0) + spread])
        odd = look.style["fill-rule"] == "evenodd"
        return _Painted(pieces, scale, fill, stroke, width, odd, box)

    @cached_property
    def rings(self) -> list[Array]:
        """Points (m, 2) along each piece, mm, y up."""
        factor = np.array([self.scale, -self.scale])
        off = OFF / self.scale
        return [np.concatenate([curve.flatten(off) for curve in piece.curves]) * factor for piece in self.pieces]

    def over(self, points: Array, seen: Array) -> Array:
        """Grey levels (k,) at points (k, 2) after painting over what was seen there."""
        if self.fill[1]:
            level, opacity = self.fill
            inside = self._inside(points)
            seen = np.where(inside, opacity * level + (1 - opacity) * seen, seen)
        if self.stroke[1] and self.width > 0:
            level, opacity = self.stroke
            seen = np.where(self._on_line(points), opacity * level + (1 - opacity) * seen, seen)
        return seen

    def _inside(self, points: Array) -> NDArray[np.bool_]:
        wound = np.zeros(len(points), dtype=np.int64)
        for ring in self.rings:
            start, end = ring, np.roll(ring, -1, axis=0)
            step = max(MOST_PRODUCTS // len(ring), 1)
            for k in range(0, len(points), step):
                x, y = points[k : k + step].T[..., None]
                below, above = start[:, 1] <= y, end[:, 1] <= y
                left = (end[:, 0] - start[:, 0]) * (y - start[:, 1]) - (x - start[:, 0]) * (end[:, 1] - start[:, 1])
                crossed = (below & ~above & (left < 0)).astype(np.int64) - (~below & above & (left > 0))
                wound[k : k + step] += crossed.sum(axis=1)
        return np.asarray(wound % 2 == 1 if self.odd else wound != 0)

    @cached_property
    def _line(self) -> Seek:
        rings = zip(self.rings, (piece.closed for piece in self.pieces), strict=True)
        ends = [(ring, np.roll(ring, -1, axis=0)) if closed else (ring[:-1], ring[1:]) for ring, closed in rings]
        return seek_among(np.concatenate([np.stack(pair, axis=1) for pair in ends]))

    def _on_line(self, points: Array) -> NDArray[np.bool_]:
        return np.asarray(np.linalg.norm(self._line(points, points) - points, axis=1) < self.width / 2)


def _number(text: str) -> float:
    match = re.match(r"[-+.\deE]+", text.strip())
    try:
        return float(match[0]) if match else 0.0
    except ValueError:
        return 0.0


def _paint(look: Paint, kind: str) -> tuple[float, float]:
    """Grey level and opacity of a fill or a stroke."""
    from svgelements import Color

    value = look.style[kind]
    if value in ("none", "transparent"):
        return WHITE, 0.0
    opacity = look.opacity * fraction(look.style[f"{kind}-opacity"])
    if value.startswith("url"):
        return UNKNOWN, opacity
    try:
        color = Color(value)
        text = "#000000" if value == "currentColor" else f"#{color.red:02x}{color.green:02x}{color.blue:02x}"
        return luma(text), opacity * float(color.opacity)
    except (ValueError, TypeError, AttributeError):
        return UNKNOWN, opacity


def _picture(painted: Sequence[_Painted], box_shown: Array) -> PagePicture:
    """What shows of shapes that are painted one after the other."""
    good = [shape for shape in painted if np.isfinite(shape.box).all() and (shape.fill[1] or shape.stroke[1])]
    boxes = np.array([shape.box for shape in good]).reshape(-1, 4)

    def sample(points: Array) -> Array:
        seen = np.full(len(points), WHITE)
        low, high = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
        touched = (boxes[:, :2] <= high).all(axis=1) & (boxes[:, 2:] >= low).all(axis=1)
        for index in np.flatnonzero(touched):
            box = boxes[index]
            inside = np.flatnonzero(((points >= box[:2]) & (points <= box[2:])).all(axis=1))
            if len(inside):
                seen[inside] = good[index].over(points[inside], seen[inside])
        seen[~((points >= box_shown[:2]) & (points <= box_shown[2:])).all(axis=1)] = np.nan
        return seen

    inset = 0.015 * (box_shown[2:] - box_shown[:2])
    paper = WHITE
    if np.isfinite(inset).all():
        low, high = box_shown[:2] + inset, box_shown[2:] - inset
        places = np.array([low, high, [low[0], high[1]], [high[0], low[1]]])
        paper = float(np.nanmedian(sample(places)))
    return PagePicture(sample, 0.0, paper)
