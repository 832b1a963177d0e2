"""Copies of a photograph count once, and photographs from one place are left out together; dots have their widths."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image as Pillow

import markergen as mg
from benchmarks.calibration_sets import CAMERA, hand_held
from markergen.calibration.photos import find_dots
from markergen.calibration.pictures import same_noise, stations
from markergen.errors import InputError
from markergen.render import Optics, render_view


@pytest.fixture(scope="module")
def photographs(make_marker):
    """A marker of nine dots, five photographs, and one more from the first one's place."""
    rng, around = np.random.default_rng(0), np.pi / 6 * np.array([0, 1, 2, 4, 5, 7, 8, 10])
    places = [[0.0, 0.0], *(0.08 * np.stack([np.cos(around), np.sin(around)], axis=-1))]
    marker = make_marker(np.array(places), 0.11, 0.025)
    rotation, translation = hand_held(5, rng, marker.xyz)
    poses = [*zip(rotation, translation, strict=True), (rotation[0], translation[0])]
    return marker, [render_view(marker, CAMERA, *pose, Optics(), rng) for pose in poses]


def _encoded(image, quality):
    file = BytesIO()
    Pillow.fromarray(image).save(file, "JPEG", quality=quality)
    return np.asarray(Pillow.open(file))


@pytest.mark.parametrize("quality", [90, 95])
def test_copies_are_told_from_photographs_of_the_same_place(photographs, quality):
    _, images = photographs
    assert same_noise(images[0], _encoded(images[0], quality))
    assert not same_noise(images[0], images[5])
    assert not same_noise(_encoded(images[0], quality), _encoded(images[5], quality))


def test_a_copy_is_listed_with_its_original_and_counts_once(photographs):
    marker, images = photographs
    result, _ = find_dots([marker], [*images, images[0], _encoded(images[3], 85)], CAMERA)
    assert set(result.unused) == {6, 7}
    assert "photo 0" in result.unused[6]
    assert "photo 3" in result.unused[7]
    assert sorted(result.photo.tolist()) == list(range(6))
    assert stations(result.views, result.photo) == {5: 0}


def test_copies_of_one_photograph_are_named_where_another_is_missing(photographs):
    marker, images = photographs
    with pytest.raises(InputError, match=r"two photographs or more .* found one .*photo 1: a copy of photo 0"):
        mg.calibrate(marker, images[:1] * 2)


def test_a_dot_of_another_width_than_stated_is_named(photographs):
    marker, images = photographs
    assert not find_dots([marker], images, CAMERA)[0].doubts
    points = list(marker.control_points)
    points[2] = replace(points[2], feature=replace(points[2].feature, diameter=0.020))
    wrong = replace(marker, control_points=tuple(points))
    (doubt,) = find_dots([wrong], images, CAMERA)[0].doubts
    assert f"dot {points[2].id} is 1 times" in doubt
    assert "0.8 times by marker.json" in doubt
