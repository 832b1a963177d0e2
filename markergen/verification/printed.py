"""Compare what is printed around a marker with our own sheet: rulers, lengths to measure, axes and numbers of dots.

Users rescale prints by these. A page that is not laid out as ours has its own, of which nothing is known.
"""

# tests: tests/verification/test_printed.py

from collections.abc import Callable, Sequence
from functools import lru_cache
from re import match

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array, Mask
from markergen.drawing.colors import BLACK_ON_WHITE, Colors
from markergen.drawing.paper import PAPERS, SheetOptions
from markergen.drawing.scene import Box, Line, Shape, Sheet, bounds
from markergen.drawing.sheet_layout import pages_for
from markergen.errors import InputError
from markergen.geometry.contour import flattened
from markergen.model.marker import Marker
from markergen.verification.findings import PlaneMotion
from markergen.verification.lines import sheet_lines
from markergen.verification.reading import WHITE, Page, PagePicture
from markergen.verification.result import REMOVE, Finding

DPI = 200.0
"""Resolution of the picture of our own sheet: a line has two pixels."""

ON_PAPER, HOW = r"ruler|check-(?!plan)", "remedy"
MEASURED = rf"{ON_PAPER}|number-|ax[ei]s"
"""Names of the shapes that users measure, and of those that say how: these must be there, but name a file, and differ,
as the rest may, by the version that printed it. Light numbers and axes on a dark ground are not compared."""

DARKEST, SHADE = 128.0, 3.0
"""Grey level below which a ground is dark, and difference from the page's from which on it is printed."""

DARK, LEAST = 0.3, 0.2
"""Minimum share of the page's contrast of what counts as ink, and area in mm^2 that may be missing or extra."""

HOLES = 0.03
"""Share of the ink of letters that may be missing if that is more: small grey ones lose 0.02 in a picture of 150 dpi,
and at 0.03 no digit may. Lines have none: 0.03 of a ruler is 4 mm."""

BLANK = 0.5
"""Share of the ink of our words below which there are none: other versions have 0.9 to 1.1 of it."""

SPARSE, FINE = 2, 0.1
"""Pixels from one place to the next that is looked at inside of the outline, and accuracy in mm of this."""

COARSE = 0.15
"""Size of a pixel in mm from which letters are not compared: at 150 dpi, in black and white, they have holes."""

AROUND = ("marks", "text")
"""Layers of what is printed around the marker."""

OURS, SWITCHED_OFF, PLACES = 0.8, 0.02, 3000
"""Minimum share of a layer's ink that shows on a page that is laid out as ours, maximum share of a layer that is
switched off, and number of places looked at. Text moved by 5 mm shows 0.27 of it, with marks 0.97."""


@lru_cache(maxsize=2)
def _own(
    marker: Marker,
    size: tuple[float, float],
    compensate: bool,
    labels: tuple[Shape, ...] = (),
    colors: Colors = BLACK_ON_WHITE,
) -> tuple[Sheet, NDArray[np.uint8]] | None:
    """Our sheet of a marker on paper of that size in mm, and its picture; None if it does not fit."""
    import cv2

    from markergen.exporters.png import write_png

    names = [name for name, paper in PAPERS.items() if np.allclose((paper.width, paper.height), size, atol=0.05)]
    paper = names[0] if names else f"{size[0]:.6g}x{size[1]:.6g}mm"
    try:
        options = SheetOptions(paper, tile=False, compensate=compensate, colors=colors)
        (sheet,) = pages_for([marker], options, [labels] if labels else ())
    except InputError:
        return None
    picture = cv2.imdecode(np.frombuffer(write_png(sheet, DPI), np.uint8), cv2.IMREAD_GRAYSCALE)
    return sheet, np.asarray(picture, dtype=np.uint8)


def printed_findings(
    marker: Marker, compensate: bool, page: Page, motion: PlaneMotion, has_others: bool
) -> list[Finding]:
    """Findings about what is measured and read on a page with one marker.

    With `compensate` it is drawn for the printer that it was measured on. If it `has_others`, dots which are reported
    by themselves, these have numbers.
    """
    if page.size is None or page.picture is None:
        return []
    picture, ground = page.picture, _ground(marker, page.picture, motion)
    sheet_of_ours = _own(marker, page.size, compensate, page.labels, _colors_on(ground))
    if sheet_of_ours is None:
        return []
    sheet, expected = sheet_of_ours
    origin = np.array(sheet.origins_mm[0])
    wanted = _Page(expected, lambda points: motion.to_page(points - origin), picture)
    shares = {layer: wanted.share(_around(sheet, expected, (layer,))) for layer in AROUND}
    if max(shares.values()) < OURS:
        return []
    rooms, measured = _rooms(sheet), MEASURED if ground > DARKEST else ON_PAPER
    changed = [
        shape.name
        for name in AROUND
        if shares[name] > SWITCHED_OFF
        for shape in sheet.scene[name]
        if (isinstance(shape, Line) or not (picture.bilevel or picture.grain > COARSE))
        and (
            (match(measured, shape.name) and wanted.differs(shape, rooms.get(shape.name)))
            or (match(HOW, shape.name) and wanted.is_blank(shape))
        )
    ]
    called = dict.fromkeys(_called(name) for name in changed)
    findings = [Finding("marks", f"{name} not as printed by us", "export the sheet again") for name in called]
    places = wanted.extra(_inside(marker, origin, expected.shape))
    if not (findings or has_others) and len(places) * (SPARSE * 25.4 / DPI) ** 2 > LEAST:
        x, y = np.median(places - origin, axis=0)
        sentence = f"there is ink inside of the outline that is not the marker's, around x {x:.4g}, y {y:.4g} mm"
        findings.append(Finding("extra", sentence, REMOVE))
    return findings


def _ground(marker: Marker, picture: PagePicture, motion: PlaneMotion) -> float:
    """Grey level of the ground on which dots stand, in the middle of their quiet zones; white if it is the page's."""
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    around = 1.5 * marker.radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    places = 1e3 * (marker.xyz[:, None, :2] + around).reshape(-1, 2)
    ground = float(np.nanmedian([WHITE, *picture.sample(motion.to_page(places))]))
    return ground if abs(ground - picture.paper) > SHADE else WHITE


def _colors_on(ground: float) -> Colors:
    """Colors of a sheet on a ground of some grey level."""
    grey = "#" + f"{round(ground):02x}" * 3
    return BLACK_ON_WHITE if ground == WHITE else Colors("#000000" if ground > DARKEST else "#ffffff", grey)


def _rooms(sheet: Sheet) -> dict[str, tuple[float, float]]:
    """Where along x, mm, the columns of lengths to measure may stand: closer or wider apart by what others say.

    Half the way to the next column, so that none is taken for another.
    """
    shapes = [shape for shape in sheet.scene["text"] if shape.name.startswith("check-")]
    slugs = [shape.name.split("-")[1] for shape in shapes]
    boxes = np.array([bounds(shape) for shape in shapes]).reshape(-1, 4)
    lefts = np.unique([min(boxes[k, 0] for k in range(len(slugs)) if slugs[k] == slug) for slug in slugs])
    limits = np.array([0.0, *(lefts[1:] + lefts[:-1]) / 2, np.inf])
    rooms = {}
    for shape, (left, _, right, _) in zip(shapes, boxes, strict=True):
        column = int(np.searchsorted(limits, left, side="right"))
        rooms[shape.name] = (float(limits[column - 1]), float(min(limits[column] + right - left, sheet.paper.width)))
    return rooms


def _inside(marker: Marker, origin: Array, shape: tuple[int, ...]) -> Mask:
    """Pixels of our sheet inside of the outline, but for the lines to cut, which are whole if a machine cuts them."""
    import cv2

    inside = np.zeros(shape, dtype=np.uint8)
    rings = list[NDArray[np.int32]]()
    for line in sheet_lines(marker):
        ring = (np.array(flattened(line.contour, FINE)) + origin) * DPI / 25.4
        rings.append(np.column_stack([ring[:, 0], shape[0] - ring[:, 1]]).round().astype(np.int32))
        cv2.fillPoly(inside, rings[-1:], int(not line.hole))
    cv2.polylines(inside, rings, True, 0, thickness=int(DPI / 25.4))
    return np.asarray(inside > 0)


def reads_upright(marker: Marker, box: Sequence[float], picture: PagePicture) -> bool | None:
    """Tell whether our sheet shows unmirrored on a page (left, bottom, right, top) in mm; None if it does not show."""
    size = np.array(box[2:]) - box[:2]
    sheet_of_ours = _own(marker, (round(size[0], 1), round(size[1], 1)), False)
    if sheet_of_ours is None:
        return None
    sheet, expected = sheet_of_ours
    ink = _around(sheet, expected, AROUND)

    def share(x: float, y: float) -> float:
        return _Page(expected, lambda points: (points - size / 2) * [x, y] + size / 2 + box[:2], picture).share(ink)

    plain, mirrored = (max(share(mirror, 1.0), share(-mirror, -1.0)) for mirror in (1.0, -1.0))
    return plain > mirrored if max(plain, mirrored) > OURS else None


def _around(sheet: Sheet, expected: NDArray[np.uint8], layers: Sequence[str]) -> Mask:
    """Pixels of our sheet with ink of layers, without any of the marker itself."""
    is_there = np.zeros(expected.shape, dtype=bool)
    for layer in (*layers, "dots", "tag", "cut"):
        for shape in sheet.scene[layer]:
            left, bottom, right, top = (np.array(bounds(shape)) * DPI / 25.4).astype(int)
            rows = slice(max(len(expected) - top - 3, 0), len(expected) - bottom + 3)
            is_there[rows, max(left - 2, 0) : right + 3] = layer in layers
    return np.asarray((expected < 128) & is_there)


class _Page:
    """A page and the picture of ours, with the way from our sheet to the page."""

    def __init__(self, expected: NDArray[np.uint8], to_page: Callable[[Array], Array], picture: PagePicture) -> None:
        self.expected, self.to_page, self.picture = expected, to_page, picture

    def _darkness(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
        """Share of ink at pixels of our sheet; nan beyond the page."""
        points = np.column_stack([columns + 0.5, len(self.expected) - rows - 0.5]) * 25.4 / DPI
        return np.asarray(np.abs(self.picture.sample(self.to_page(points)) - self.picture.paper) / 255)

    def share(self, ink: Mask) -> float:
        """Share of ink that is there too, at places spread over the page."""
        rows, columns = np.nonzero(ink)
        chosen = np.linspace(0, max(len(rows) - 1, 0), PLACES).astype(int)
        return float((self._darkness(rows[chosen], columns[chosen]) > DARK).mean()) if len(rows) else 0.0

    def extra(self, inside: Mask) -> Array:
        """Places (k, 2) in mm on our sheet, of a grid in an area, with ink that ours does not have nearby."""
        import cv2

        ours = cv2.dilate((self.expected < 230).astype(np.uint8), np.ones((3, 3), np.uint8), iterations=2)
        rows, columns = SPARSE * np.array(np.nonzero((inside & (ours == 0))[::SPARSE, ::SPARSE]))
        is_dark = self._darkness(rows, columns) > DARK
        return np.column_stack([columns, len(self.expected) - rows])[is_dark] * 25.4 / DPI

    def _window(self, box: Box, aside: int = 0) -> tuple[NDArray[np.uint8], Array]:
        """Grey levels of ours in a box in mm, and darkness on the page there, or some pixels to the right of it."""
        left, bottom, right, top = np.array(box) * DPI / 25.4
        height, width = self.expected.shape
        first, last = max(int(height - top) - 2, 0), min(int(height - bottom) + 3, height)
        start, end = max(int(left) - 2, 0), min(int(right) + 3, width)
        window = self.expected[first:last, start:end]
        rows, columns = np.mgrid[first:last, start:end].reshape(2, -1)
        return window, self._darkness(rows, columns + aside).reshape(window.shape)

    def _aside(self, box: Box, room: tuple[float, float]) -> int:
        """Pixels to the right of a box, within a room along x in mm, where the page shows best what ours has in it."""
        import cv2

        ours = (self._window(box)[0] < 128).astype(np.float32)
        wide = (room[0], box[1], room[1], box[3])
        fit = cv2.matchTemplate(np.nan_to_num(self._window(wide)[1]).astype(np.float32), ours, cv2.TM_CCORR_NORMED)
        starts = [max(int(side * DPI / 25.4) - 2, 0) for side in (room[0], box[0])]
        return int(fit[0].argmax()) + starts[0] - starts[1]

    def differs(self, shape: Shape, room: tuple[float, float] | None) -> bool:
        """Tell whether ink of a shape is missing, or more, in its place, or anywhere in a room along x in mm."""
        import cv2

        box = bounds(shape)
        window, dark = self._window(box, 0 if room is None else self._aside(box, room))
        seen = (dark > DARK).astype(np.uint8)
        ink, around = (window < 128).astype(np.uint8), np.ones((3, 3), np.uint8)
        missing = (ink > 0) & (cv2.dilate(seen, around) == 0) & np.isfinite(dark)
        extra = (seen > 0) & (cv2.dilate((window < 230).astype(np.uint8), around, iterations=2) == 0)
        least = LEAST * (DPI / 25.4) ** 2
        most = max(least, 0.0 if isinstance(shape, Line) else HOLES * float(ink.sum()))
        return bool(missing.sum() > most or extra.sum() > least)

    def is_blank(self, shape: Shape) -> bool:
        """Tell whether there is little ink where our words are."""
        window, dark = self._window(bounds(shape))
        return bool((dark > DARK).sum() < BLANK * (window < 128).sum())


def _called(name: str) -> str:
    if name.startswith("ruler"):
        return f"the ruler along {'y' if name.startswith('ruler-y') else 'x'} is"
    if name.startswith(("check", "remedy")):
        return f"the {'lengths to measure' if name.startswith('check') else 'lines on how to measure'} are"
    return "the axes are" if name.startswith("ax") else f"the number of dot {name.removeprefix('number-')} is"
