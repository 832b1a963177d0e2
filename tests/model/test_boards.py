"""Markers with given patterns: against OpenCV's conventions, and found in rendered views."""

import numpy as np
import pytest

import markergen as mg
from markergen.maths.rotation import exponential
from markergen.render import DEFAULT_OPTICS, render_view

ROTATION = exponential(np.array([0.3, 0.2, 0.4])) @ np.diag([1.0, -1, -1])


def test_an_asymmetric_grid_is_opencvs():
    marker = mg.Marker.grid("4x11 asymmetric", pitch="20mm")
    # As in OpenCV's calibration sample, y down: ((2 j + i % 2) square, i square).
    expected = [((2 * j + i % 2) * 0.02, -i * 0.02) for i in range(11) for j in range(4)]
    assert np.allclose(marker.xyz[:, :2] - marker.xyz[0, :2], expected)
    assert np.allclose(marker.xyz.min(axis=0) + marker.xyz.max(axis=0), 0)
    assert marker.dot_diameter == pytest.approx(0.01)


def test_a_larger_dot_is_the_origin_of_ros_industrials_grid():
    marker = mg.Marker.grid("5x7", pitch="30mm", dot="15mm", origin_dot="20mm")
    [origin] = [point for point in marker.control_points if point.feature.diameter == 0.02]
    assert (origin.x, origin.y) == (0, 0)
    assert np.allclose(marker.xyz.min(axis=0), 0)
    assert np.allclose(marker.xyz.max(axis=0), [0.12, 0.18, 0])


def test_neighbors_of_a_lattice_are_a_pitch_apart():
    marker = mg.Marker.hexagonal("6x5", pitch="15mm")
    apart = np.linalg.norm(marker.xyz[:, None] - marker.xyz, axis=-1)
    # An inner dot has six neighbors.
    assert (np.abs(apart - 0.015) < 1e-9).sum(axis=1).max() == 6
    assert apart[apart > 0].min() == pytest.approx(0.015)


def test_circles_have_their_radii_and_begin_straight_up():
    marker = mg.Marker.circles([(6, "40mm"), (11, 0.08)], "10mm")
    assert np.allclose(np.linalg.norm(marker.xyz, axis=1), [0.04] * 6 + [0.08] * 11)
    assert np.allclose(marker.xyz[[0, 6]], [[0, 0.04, 0], [0, 0.08, 0]])
    assert str(marker.boundary) == "disk of radius 86 mm"


@pytest.mark.parametrize(
    "marker",
    [
        mg.Marker.grid("4x11 asymmetric", "15mm"),
        mg.Marker.from_points([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.13]], "10mm"),
    ],
)
def test_they_are_found_and_saved_as_any_other(marker, tmp_path):
    camera = mg.Camera(640, 480, 800, 800, 320, 240)
    view = render_view(marker, camera, ROTATION, np.array([0, 0, 0.45]), DEFAULT_OPTICS, np.random.default_rng(0))
    [finding] = mg.Detector(marker, camera)(view)
    assert len(finding.ids) == len(marker)
    assert np.abs(finding.rotation - ROTATION).max() < 1e-3
    marker.save(tmp_path / "board.json", tmp_path / "board.pdf", paper="A3")
    assert mg.verify(tmp_path / "board.json", tmp_path / "board.pdf").passed


@pytest.mark.parametrize(
    "make",
    [
        lambda: mg.Marker.grid("4 by 11", "20mm"),
        lambda: mg.Marker.grid("1x2", "20mm"),
        lambda: mg.Marker.grid("4x4", "20"),
        lambda: mg.Marker.hexagonal("4x4", "wide"),
        lambda: mg.Marker.circles([6, 12], "10mm"),
        lambda: mg.Marker.from_points([0, 1, 2], "10mm"),
        lambda: mg.Marker.from_points([[0, 0]] * 4, "0mm"),
    ],
)
def test_what_is_no_pattern_is_refused(make):
    with pytest.raises(mg.InputError):
        mg.validate(make(), mg.Camera(640, 480, 800, 800, 320, 240), poses="cone:count=5", runs=0, views=0)


@pytest.mark.parametrize(
    ("points", "dot", "phrase"),
    [
        ([(0, 0), (0.1, 0), (0, 0.1)], "10mm", "four or more"),
        ([(0, 0), (0.1, 0), (0, 0.1), (np.nan, 0)], "10mm", "finite"),
        ([(0, 0), (0.1, 0), (0, 0.1), (0.1, 0.1)], "110mm", "centers 100 mm apart"),
        ([(0, 0), (0.1, 0), (0, 0.1), (0.1, 0)], "1mm", "centers 0 mm apart"),
    ],
)
def test_points_that_are_no_marker_are_refused(points, dot, phrase):
    with pytest.raises(mg.InputError, match=phrase):
        mg.Marker.from_points(points, dot)


@pytest.mark.parametrize(
    ("make", "phrase"),
    [
        (lambda: mg.Marker.grid("7x5", -1), "a pitch above 0, found pitch=-1"),
        (lambda: mg.Marker.hexagonal("7x5", "0mm"), "a pitch above 0, found pitch='0mm'"),
        (lambda: mg.Marker.circles([(6, "-40mm")], "10mm"), "radii of 0 or more"),
        (lambda: mg.Marker.circles([(0, "40mm"), (6, "80mm")], "10mm"), "one dot or more"),
        (lambda: mg.Marker.from_points([(0, 0), (0.1, 0), (0, 0.1), (0.1, 0.1)], -1), "a dot above 0, found dot=-1"),
        (lambda: mg.Marker.from_points([("0mm", "0mm")] * 4, "10mm"), "points .* in m, found"),
        (lambda: mg.Marker.from_points([(0, 0), (0.1, 0), (0, 0.1), (0.1,)], "10mm"), "points .* in m, found"),
    ],
)
def test_the_argument_that_is_wrong_is_named(make, phrase):
    with pytest.raises(mg.InputError, match=phrase):
        make()
