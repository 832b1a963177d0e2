"""Files as programs write them are read as their programs mean them, or refused by name; the book's table counts them.

Truth is of other make: cv2 and its fisheye module for cameras, scipy's rotations for poses, areas in closed form and by
ezdxf and shapely for outlines; pycolmap writes what COLMAP reads, where it is installed.
"""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from camera_programs import CAMERAS, MATRIX
from outline_programs import OUTLINES
from pose_programs import POSES, ROT, T

from markergen.errors import InputError
from markergen.geometry.contour import area
from markergen.geometry.outlines import polygons_of
from markergen.read.cameras import CAMERA_FORMATS, read_camera, sized_document
from markergen.read.formats import recognized
from markergen.read.outlines.boundary import outline_reading
from markergen.read.poses import pose_reading
from markergen.read.poses.conventions import PoseConvention
from markergen.read.remarks import collected_remarks

FILE = "file"
RAYS = np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))


def opencv_pixels(model, terms, matrix):
    import cv2

    points, zero = np.column_stack([RAYS, np.ones(len(RAYS))])[:, None], np.zeros(3)
    if model == "equidistant":
        return cv2.fisheye.projectPoints(points, zero, zero, np.array(matrix), np.array(terms))[0][:, 0]
    return cv2.projectPoints(points, zero, zero, np.array(matrix), np.array(terms or [0.0] * 4))[0][:, 0]


def as_camera(path, row):
    _, lens, suffix = row
    camera = read_camera(f"{path}{suffix}")
    matrix = [[700, 0, 639.5], [0, 700, 359.5], [0, 0, 1]] if "perspective" in path.name else MATRIX
    off = np.abs(camera.to_pixels(RAYS) - opencv_pixels(*lens, matrix)).max() if lens != "refused" else np.inf
    # KITTI rounds to seven digits.
    is_right = off < (1e-3 if "kitti" in path.name else 1e-9) and (camera.width, camera.height) == (1280, 720)
    return recognized(CAMERA_FORMATS, sized_document(f"{path}{suffix}")[0]), is_right, False


def as_poses(path, row):
    _, convention, ends = row
    poses, form, _, _ = pose_reading(path, PoseConvention(**convention))
    count = 1 if ends == "read1" else len(T)
    doubt = bool(poses.plausibility())
    same = len(poses) == count and np.allclose(poses.rotation, ROT[:count], atol=1e-9)
    return form, (same and np.allclose(poses.translation, T[:count], atol=1e-9)) or ends == "doubt", doubt


def as_outline(path, row):
    contours, form, _ = outline_reading(path, **row[2])
    wanted = row[1] if isinstance(row[1], float) else np.inf
    total = sum(map(area, contours))
    polygons = sum(abs(float(np.sum(ring[:, 0] * np.roll(ring[:, 1], -1) - ring[:, 1] * np.roll(ring[:, 0], -1)))) / 2
                   for ring in polygons_of(contours)[:1])  # fmt: skip
    return form, abs(total / wanted - 1) < 2e-4 and polygons > 0, False


READERS = {"camera": (CAMERAS, as_camera), "poses": (POSES, as_poses), "outline": (OUTLINES, as_outline)}
FILES = [(kind, name) for kind, (files, _) in READERS.items() for name in files]


def ending(path, kind, name):
    """Read a file; return its format and whether it is read, warned of, refused or wrong."""
    files, read = READERS[kind]
    row = files[name]
    path = path / name.replace(" ", "_").replace("/", "_")
    path.write_bytes(row[0] if isinstance(row[0], bytes) else row[0].encode())
    with collected_remarks() as remarks:
        try:
            form, is_right, doubt = read(path, row)
        except InputError as error:
            return "", "refused", error.args
    return form, ("warned" if remarks or doubt else "read") if is_right else "wrong", tuple(remarks)


@pytest.mark.parametrize(("kind", "name"), FILES)
def test_each_file_is_read_right_or_refused_by_name(tmp_path, kind, name):
    _, outcome, details = ending(tmp_path, kind, name)
    row = READERS[kind][0][name]
    wanted = row[1] if kind != "poses" else row[2]
    if wanted in ("refused", "asked"):
        assert outcome == "refused", details
        assert "\n" not in "".join(details)
        assert len(details[2]) > 8  # A way out.
    elif wanted == "doubt":
        assert outcome == "warned"
    else:
        assert outcome in ("read", "warned"), details


def test_the_table_of_the_book_counts_these_files(tmp_path):
    counts = Counter()
    for kind, name in FILES:
        form, outcome, _ = ending(tmp_path, kind, name)
        counts[kind, form or "named, with a way out", outcome] += 1
    rows = {(kind, form) for kind, form, _ in counts}
    ends = ("read", "warned", "refused", "wrong")
    table = "".join(
        f"| {kind} | {form} | {' | '.join(str(counts[kind, form, end]) for end in ends)} |\n"
        for kind, form in sorted(rows)
    )
    book = (Path(__file__).parents[2] / "docs/formats.md").read_text()
    stated = re.search(r"\| kind \| format \|[^\n]*\n\|[-|]*\n((?:\|[^\n]*\n)+)", book)
    assert stated is not None
    assert stated[1] == table


@pytest.mark.parametrize(
    ("model", "terms", "lens"),
    [
        ("SIMPLE_RADIAL", (0.1,), ("radtan", (0.1, 0, 0, 0))),
        ("OPENCV", (0.1, -0.2, 0.001, -0.002), None),
        ("OPENCV_FISHEYE", (-0.01, 0.003, -0.001, 0.0002), None),
        ("FULL_OPENCV", (0.1, -0.2, 0.001, -0.002, 0.03, 0.02, -0.01, 0.004), None),
        ("RADIAL", (0.1, -0.2), None),
    ],
)
@pytest.mark.parametrize("form", [".txt", ".bin"])
def test_colmap_s_own_files(tmp_path, model, terms, lens, form):
    pycolmap = pytest.importorskip("pycolmap")
    del lens
    focal = [700.25] if model in ("SIMPLE_RADIAL", "RADIAL") else [700.25, 701.5]
    reconstruction = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model=model, width=1280, height=720, params=[*focal, 642.625, 356.25, *terms], camera_id=1)
    reconstruction.add_camera(camera)
    (reconstruction.write_text if form == ".txt" else reconstruction.write_binary)(str(tmp_path))
    mine = read_camera(tmp_path / f"cameras{form}")
    pixels = np.array([camera.img_from_cam(np.array([x, y, 1.0])) for x, y in RAYS])
    np.testing.assert_allclose(mine.to_pixels(RAYS), pixels - 0.5, atol=1e-6)
