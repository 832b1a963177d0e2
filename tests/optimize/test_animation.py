"""Movies of a search: every dot where it is, in the marker and in the image."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import cv2
import numpy as np
import pytest

from markergen.objectives import OBJECTIVES
from markergen.objectives.criteria import regular_polygon
from markergen.optimize.trace import FRAMES, HEIGHT, HELD, RATE, SECONDS, WIDTH, Movie, trace_of

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def few(setting):
    """A twentieth of the paper's poses."""
    return replace(setting, poses=setting.poses.taken(np.arange(0, len(setting.poses), 20), 0))


@pytest.fixture(scope="module")
def movie(few):
    way = [
        ("start" if k == 0 else "polish", regular_polygon(5, radius))
        for k, radius in enumerate(np.linspace(0.05, 0.12, 200))
    ]
    return Movie(trace_of(way, OBJECTIVES["pose"](few)), few, 0.036, "pose <= 1, m")


def numbers(text):
    return np.array(text.split(), dtype=float).reshape(-1, 2)


def test_a_browser_reads_the_movie_and_every_frame_has_its_dots(movie):
    root = ET.fromstring(movie.svg())
    polygons = root.findall(f"{SVG}polygon")
    assert len(polygons) == 10
    steps = movie.steps
    assert (len(steps), steps[0].step, steps[-1].step) == (FRAMES, 0, 199)
    for polygon, first, last in zip(polygons, movie.polygons(steps[0]), movie.polygons(steps[-1]), strict=True):
        frames = polygon.find(f"{SVG}animate").get("values").split(";")
        times = polygon.find(f"{SVG}animate").get("keyTimes").split(";")
        assert len(frames) == len(times) == FRAMES + 1
        assert (float(times[0]), float(times[-1])) == (0, 1)
        np.testing.assert_allclose(numbers(frames[0]), first, atol=0.051)
        np.testing.assert_allclose(numbers(frames[-1]), last, atol=0.051)
    captions = root.findall(f"{SVG}text")
    assert [text.get("opacity") for text in captions].count("1") == 1
    assert f"{steps[3].objective:.4g}" in captions[3].text
    assert movie.svg() == movie.svg()


def test_dots_are_where_the_camera_sees_them(movie, few):
    step, poses = movie.steps[-1], few.poses
    middle = np.argsort(poses.polar_angle_deg, kind="stable")[len(poses) // 2]
    pixels = few.camera.project(
        step.points, poses.rotation[middle : middle + 1], poses.translation[middle : middle + 1]
    )[0]
    results = movie.polygons(step)[5:].mean(axis=1)
    scale = 440 / 640
    np.testing.assert_allclose((results - results[0]) / scale, pixels - pixels[0], atol=1.0)
    np.testing.assert_allclose(movie.polygons(step).min() > 0, True)


def test_a_player_reads_the_video(movie, tmp_path):
    path = tmp_path / "way.mp4"
    path.write_bytes(movie.mp4())
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == round(RATE * (SECONDS + HELD))
    is_read, first = video.read()
    assert is_read
    assert first.shape == (HEIGHT, WIDTH, 3)
    x, y = movie.polygons(movie.steps[0])[0].mean(axis=0).astype(int)
    assert first[y, x].max() < 90
