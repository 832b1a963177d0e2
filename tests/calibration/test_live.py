"""A rendered video: a print held still before a camera again and again, and moved between."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import markergen as mg
from markergen.calibration.next_photo import photographs_of
from markergen.cli import main
from markergen.render import DEFAULT_OPTICS, render_view

CAMERA = mg.Camera(640, 480, 800, 800, 319.5, 239.5)
STOPS = 16


def pose(stop):
    """A view of the print at a time in stops, between two of which it moves."""
    lean = np.deg2rad(20 + 25 * abs(np.sin(stop))) * np.array([np.cos(2.4 * stop), np.sin(2.4 * stop), 0])
    rotation = Rotation.from_rotvec(lean) * Rotation.from_euler("x", 180, degrees=True)
    rotated = (rotation * Rotation.from_euler("z", 90 * round(stop), degrees=True)).as_matrix()
    return rotated, np.array([0.05 * np.cos(1.3 * stop), 0.04 * np.sin(1.3 * stop), 0.5 + 0.1 * np.sin(stop)])


def without_similarity(offsets, marker):
    """RMS of offsets (n, 2) that no shift, turn and scale explain."""
    basis = np.column_stack([np.ones(len(marker)), marker.xyz[:, 0] + 1j * marker.xyz[:, 1]])
    complex_offsets = offsets[:, 0] + 1j * offsets[:, 1]
    left = complex_offsets - basis @ np.linalg.lstsq(basis, complex_offsets, rcond=None)[0]
    return np.sqrt(np.mean(np.abs(left) ** 2))


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("filmed"), np.random.default_rng(0)
    marker = mg.design(n=8, radius="80mm", restarts=1).marker
    errors = rng.normal(0, 1e-4, (8, 2))
    printed = mg.Marker.from_points(marker.xyz[:, :2] + errors, marker.dot_diameter)
    # The ring is the marker's own.
    dots = zip(marker.control_points, printed.control_points, strict=True)
    printed = type(marker)(
        tuple(type(dot)(dot.id, moved.x, moved.y, 0.0, dot.feature) for dot, moved in dots),
        marker.boundary,
        marker.clearance,
    )
    video = cv2.VideoWriter(str(folder / "walk.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 25, (640, 480))
    for stop in range(STOPS):
        still = render_view(printed, CAMERA, *pose(stop), DEFAULT_OPTICS, rng)
        for grey in (still, still, render_view(printed, CAMERA, *pose(stop + 0.5), DEFAULT_OPTICS, rng)):
            noise = rng.normal(0, 1, grey.shape)
            video.write(cv2.cvtColor(np.clip(grey + noise, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR))
    video.release()
    marker.save(folder / "marker.json")
    CAMERA.save(folder / "camera.yaml")
    return folder, errors


@pytest.mark.long
def test_still_views_of_a_video_measure_the_print(filmed, capsys):
    folder, errors = filmed
    output = ["-o", str(folder / "measured.json")]
    command = [
        "calibrate",
        str(folder / "marker.json"),
        str(folder / "walk.avi"),
        "--camera",
        str(folder / "camera.yaml"),
    ]
    assert main([*command, *output]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("photograph ")]
    # One for each stop at most, and none of those on the way.
    assert 8 <= len(lines) <= STOPS
    assert "enough" in lines[-1]
    design, measured = (mg.Marker.load(folder / name) for name in ("marker.json", "measured.json"))
    # Frame and scale are the design's, so what is left and what was there are compared without a similarity.
    left, before = (
        without_similarity(off, design) for off in (measured.xyz[:, :2] - design.xyz[:, :2] - errors, errors)
    )
    assert left < before / 4


def test_a_video_without_the_marker_is_refused(tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "grey.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 25, (640, 480))
    for _ in range(3):
        video.write(np.full((480, 640, 3), 128, np.uint8))
    video.release()
    with pytest.raises(mg.InputError, match=r"a still view.*in no two frames in a row"):
        mg.calibrate(mg.design(n=5, restarts=1).marker, tmp_path / "grey.avi", CAMERA)


def dots_at_grey_level(image):
    """What a detector finds: four dots, 20 px farther right for each grey level."""
    pixels = np.array([[100.0, 100], [200, 100], [200, 200], [100, 200]]) + [20.0 * np.round(image.mean()), 0]
    return [SimpleNamespace(ok=True, ids=np.arange(4), pixels=pixels)]


def film(path, levels):
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25, (320, 240))
    for level in levels:
        video.write(np.full((240, 320, 3), level, np.uint8))
    video.release()
    return str(path)


def test_a_request_is_printed_where_it_changes(tmp_path):
    lines = []

    def judge(taken):
        raise mg.InputError("more", "less" if len(taken) < 10 else "still less", "go on")

    source = film(tmp_path / "stops.avi", np.repeat(np.arange(12), 2))
    assert len(photographs_of(source, dots_at_grey_level, judge, lines.append)) == 12
    requests = [line.partition(": ")[2] for line in lines]
    repeated = [later == requests[1] for later in requests]
    # Seven of the first request, two and three of the judge's.
    assert repeated == [False, *[True] * 6, False, True, False, True, True]


def test_a_video_that_is_never_still_says_how_far_it_moves(tmp_path):
    source = film(tmp_path / "moving.avi", np.arange(5))
    # 20 of 400 px.
    with pytest.raises(mg.InputError, match=r"0.05 % .*, found 5 % at least"):
        photographs_of(source, dots_at_grey_level, None, None)
