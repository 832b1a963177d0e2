"""What every kind of sheet has to keep to, and the marks and dots of a PDF as another program reads them."""

import ctypes
from itertools import combinations

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
import pytest
from gaps import box_distance, segment_distance

from markergen.drawing.scene import Disk, Line, Sheet, bounds

ROUNDING = 1e-6  # mm; sums of doubles of a few hundred mm
MM = 25.4 / 72
LEAST = 4.0  # mm; diameter of the smallest dots


def apart(a: tuple, b: tuple) -> bool:
    return a[2] < b[0] or b[2] < a[0] or a[3] < b[1] or b[3] < a[1]


def check_ink(sheet: Sheet, margin: float = 9.4) -> None:
    """All ink keeps the margin, names are unique, quiet zones blank but for cut marks and holes, no two texts touch."""
    shapes = list(sheet.scene)
    boxes = {id(shape): bounds(shape) for shape in shapes}
    assert len({shape.name for shape in shapes}) == len(shapes), "names become ids"
    for shape in shapes:
        left, bottom, right, top = boxes[id(shape)]
        white = min(left, bottom, sheet.paper.width - right, sheet.paper.height - top)
        assert white >= margin - ROUNDING, f"{shape.name} is {white:.2f} mm from the edge"
    dots = [shape for shape in sheet.scene["dots"] if isinstance(shape, Disk)]
    others = [shape for layer in sheet.scene.layers if layer.name not in ("dots", "ground") for shape in layer.shapes]
    for dot in dots:
        center = np.array([dot.x, dot.y])
        on_origin = any(np.hypot(*(center - origin)) < dot.radius for origin in sheet.origins_mm)
        for shape in others:
            if box_distance(center, boxes[id(shape)]) >= 2 * dot.radius:
                continue
            if (shape.name.split("-")[-2:-1] == ["center"] and on_origin) or "hole-" in shape.name:
                continue
            gap = segment_distance(center, shape) - shape.width / 2 if isinstance(shape, Line) else None
            gap = box_distance(center, boxes[id(shape)]) if gap is None else gap
            assert gap >= 2 * dot.radius - ROUNDING, f"{shape.name} is in the quiet zone of {dot.name}"
    for a, b in combinations(sheet.scene["text"], 2):
        assert apart(boxes[id(a)], boxes[id(b)]), (a.name, b.name)


@pytest.fixture(scope="session")
def check_page():
    return check_ink


def paths_of(page) -> list[tuple[np.ndarray, list[int], float]]:
    """Points (m, 2) in mm, segment types and stroke width in mm (0 if it is filled) of the paths of a PDF's page.

    Filled ones smaller than `LEAST` are left out: most are letters, which take long to read.
    """
    result = []
    for thing in page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_PATH]):
        points, kinds = [], []
        stroke, fill = ctypes.c_int(), ctypes.c_int()
        pdfium.FPDFPath_GetDrawMode(thing.raw, fill, stroke)
        left, bottom, right, top = thing.get_bounds()
        if fill.value and max(right - left, top - bottom) * MM < LEAST:
            continue
        for index in range(pdfium.FPDFPath_CountSegments(thing.raw)):
            segment = pdfium.FPDFPath_GetPathSegment(thing.raw, index)
            x, y = ctypes.c_float(), ctypes.c_float()
            pdfium.FPDFPathSegment_GetPoint(segment, x, y)
            points.append((x.value * MM, y.value * MM))
            kinds.append(pdfium.FPDFPathSegment_GetType(segment))
        width = ctypes.c_float()
        pdfium.FPDFPageObj_GetStrokeWidth(thing.raw, width)
        result.append((np.array(points), kinds, width.value * MM if stroke.value else 0.0))
    return result


def dots_of(paths) -> np.ndarray:
    """Centers (n, 2) in mm of filled circles and rings larger than `LEAST`."""
    centers = []
    for points, kinds, stroke in paths:
        curves = np.array(kinds) == pdfium.FPDF_SEGMENT_BEZIERTO
        if stroke or curves.sum() < 48 or curves.sum() % 48:
            continue
        # Every third point of a curve is on it: 16 to a circle.
        rings = points[curves][2::3].reshape(-1, 16, 2)
        middles = rings.mean(axis=1)
        radii = np.hypot(*np.moveaxis(rings - middles[:, None], -1, 0))
        if np.ptp(radii, axis=1).max() < 1e-3 and radii.max() > LEAST / 2:
            centers.append(middles[0])
    return np.array(centers).reshape(-1, 2)


def crosses_of(paths) -> np.ndarray:
    """Centers (n, 2) in mm of registration crosses: two strokes of 0.2 mm that halve each other."""
    strokes = [points for points, _, width in paths if abs(width - 0.2) < 1e-3 and len(points) == 2]
    level = [points.mean(axis=0) for points in strokes if np.ptp(points[:, 1]) < 1e-6]
    upright = [points.mean(axis=0) for points in strokes if np.ptp(points[:, 0]) < 1e-6]
    centers = [a for a in level if any(np.hypot(*(a - b)) < 1e-4 for b in upright)]
    assert len(centers) == len(level) == len(upright)
    return np.array(centers).reshape(-1, 2)


@pytest.fixture(scope="session")
def read_pdf():
    """Per page its size in mm, the centers of its dots and of its registration crosses."""

    def read(data: bytes) -> list[tuple[tuple[float, float], np.ndarray, np.ndarray]]:
        document = pypdfium2.PdfDocument(data)
        pages = []
        for page in document:
            paths = paths_of(page)
            pages.append((tuple(side * MM for side in page.get_size()), dots_of(paths), crosses_of(paths)))
        document.close()
        return pages

    return read
