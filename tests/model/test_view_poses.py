"""Poses with the marker anywhere in the view: OpenCV's pixels of it, how they fill the image, and what takes them."""

import json

import cv2
import numpy as np
import pytest
from html_pages import Page

import markergen as mg
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.pose_sources.view import ViewCone
from markergen.model.poses import named_poses
from markergen.optimize.target import at_distance

LENS = (-0.25, 0.08, 0.001, -0.001)
CAMERA = Camera(1280, 720, 700.0, 702.0, 650.0, 350.0, Distortion("radtan", LENS))
TEXT = "view:distance=0.5..1.5m,tilt=0..60,margin=5%,count=600"
DISK = Circle(0.06)


def pixels_of(poses, points):
    """By OpenCV, (P, n, 2)."""
    solid = np.column_stack([points, np.zeros(len(points))])
    vectors = [cv2.Rodrigues(rotation)[0] for rotation in poses.rotation]
    return np.array([
        cv2.projectPoints(solid, vector, translation, CAMERA.matrix, np.array(LENS))[0][:, 0]
        for vector, translation in zip(vectors, poses.translation, strict=True)
    ])  # fmt: skip


def test_the_marker_is_whole_in_the_view_and_anywhere_in_it():
    poses = named_poses(TEXT).seen_whole(DISK, CAMERA)
    assert len(poses) == 600
    assert poses.name == str(ViewCone.parse(TEXT))
    rim = pixels_of(poses, DISK.rim(64))
    free = 0.05 * 720
    assert rim.min() >= free - 0.5 - 1e-6
    assert (rim.max(axis=(0, 1)) <= np.array([1280, 720]) - 0.5 - free + 1e-6).all()
    # Ranges are those that were asked for, about the line of sight.
    assert poses.distance.min() > 0.499
    assert poses.distance.max() < 1.501
    assert poses.polar_angle_deg.max() < 60.001
    np.testing.assert_allclose(np.linalg.det(poses.rotation), 1)
    # The far third fills a grid of 4 x 3 cells over the part of the image that it can be in: 200 / 12 are expected, and
    # a sequence of low discrepancy leaves no cell with less than half of them.
    far = pixels_of(poses.taken(np.argsort(poses.distance)[-200:], 0), np.zeros((1, 2)))[:, 0]
    counts, _, _ = np.histogram2d(*far.T, bins=(4, 3), range=((100, 1180), (100, 620)))
    assert counts.min() >= 200 / 12 / 2


def test_roll_and_azimuth_are_about_the_line_of_sight():
    poses = named_poses("view:distance=0.8,tilt=0,azimuth=0,roll=0,count=50").seen_whole(DISK, CAMERA)
    # Frontal to the line of sight everywhere, and turned from upright by no more than the ray itself.
    np.testing.assert_allclose(poses.cos_tilt, 1, atol=1e-12)
    toward = poses.translation / poses.distance[:, None]
    angles = np.arccos(toward[:, 2])
    rotated = poses.rotation @ np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(np.arccos((np.trace(rotated, axis1=1, axis2=2) - 1) / 2), angles, atol=1e-7)


def test_the_same_text_gives_the_same_poses_and_other_seeds_others():
    first, again = (named_poses(TEXT).seen_whole(DISK, CAMERA) for _ in range(2))
    np.testing.assert_array_equal(first.rotation, again.rotation)
    other = named_poses(f"{TEXT},seed=1").seen_whole(DISK, CAMERA)
    assert not np.array_equal(first.translation, other.translation)
    assert named_poses(first.name).name == first.name


def test_near_poses_that_hardly_fit_are_fewer_and_none_is_an_error():
    with pytest.raises(InputError, match="a pose that sees the whole marker"):
        named_poses("view:distance=0.05").seen_whole(DISK, CAMERA)
    # Where the disk just fits into the height, it is in the middle.
    nearby = named_poses("view:distance=0.2,tilt=0,margin=0%,count=40").seen_whole(Circle(0.095), CAMERA)
    assert 0 < len(nearby) <= 40
    assert abs(pixels_of(nearby, np.zeros((1, 2)))[:, 0, 1] - 350).max() < 60


def test_at_one_distance_they_are_placed_again():
    moved = at_distance(named_poses(TEXT), 0.9).seen_whole(DISK, CAMERA)
    np.testing.assert_allclose(moved.distance, 0.9)
    assert len(moved) == 600


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("view:margin=60%", "a margin from 0% to below 50%"), ("view:margin=0.05", "a margin from"),
        ("view:margin=-1%", "a margin"), ("view:margin=x%", "a margin"), ("view:size=3", "a key of view"),
        ("view:tilt=95", "values of tilt"), ("view:margin=nan%", "a margin"),
    ],
)  # fmt: skip
def test_texts_that_are_no_views(text, phrase):
    with pytest.raises(InputError, match=phrase):
        named_poses(text)


def test_design_and_validate_take_them(tmp_path, undrawn):
    text = "view:distance=0.4..0.8m,tilt=0..50,count=12"
    design = mg.design(n=5, radius="60mm", dot="20mm", restarts=1, poses=text)
    assert design.marker.provenance["spec"]["poses"] == str(ViewCone.parse(text))
    design.marker.save(tmp_path / "m.json")
    validation = mg.validate(tmp_path / "m.json", runs=2, views=0, report=tmp_path / "report.html", workers=1)
    assert "12 poses" in repr(validation)
    # Oblique to the optical axis, most of the poses have their marker off the center.
    seen = named_poses(text).seen_whole(Circle(0.06), PAPER_CAMERA)
    (div,) = (
        attributes
        for attributes in Page((tmp_path / "report.html").read_bytes()).of("div")
        if "data-dome" in attributes
    )
    dome = json.loads(div["data-dome"])["poses"]
    eyes = -np.einsum("pji,pj->pi", seen.rotation, seen.translation)
    np.testing.assert_allclose(np.column_stack([dome[axis] for axis in "xyz"]), eyes, rtol=1e-3, atol=1e-4)
    centers = PAPER_CAMERA.project(np.zeros((1, 2)), seen.rotation, seen.translation)[:, 0]
    assert np.median(np.abs(centers - [320, 240]).max(axis=1)) > 50
    other = mg.validate(tmp_path / "m.json", poses="view:distance=0.5,tilt=0..30,count=20", runs=2, views=2, workers=1)
    assert "20 poses" in repr(other)
