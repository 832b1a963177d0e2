from dataclasses import replace

import numpy as np
import pytest

from markergen.geometry.region import signed_area
from markergen.model.boundary import Circle
from markergen.model.camera import Camera, Distortion
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker, light_marker
from markergen.model.poses import paper
from markergen.model.tag import Tag
from markergen.render.view import INK, SUBSTRATE, marker_patches

POSES = paper()
LENS = Distortion("radtan", (-0.35, 0.12, 0.003, -0.002))
# Dots so near to each other that pillars hide parts of their neighbors, of others' pillars, and of the plate's dots.
PLACES = [(-0.03, 0, 0.05), (0.03, 0, 0.02), (0, 0.045, 0), (0, -0.045, 0.08), (0.07, 0.04, 0.03), (0.08, -0.03, 0)]
RELIEF = Marker(
    tuple(ControlPoint(i, *p, key_ring(0.036) if i == 0 else Feature(0.036)) for i, p in enumerate(PLACES)),
    Circle(0.15),
    0.0036,
)


def inks(patches):
    return [patch for patch in patches if patch.reflectance == INK]


@pytest.mark.parametrize(
    ("pose", "distortion"),
    [
        (3, LENS),
        (95, Distortion()),
        pytest.param(76, LENS, marks=pytest.mark.long),
        pytest.param(390, LENS, marks=pytest.mark.long),
    ],
)
def test_pillars_hide_what_rays_do_not_reach(pose, distortion, ink_of, traced):
    camera = Camera(80, 60, 125, 125, 41, 29, distortion)
    rotation, translation = POSES.rotation[pose], 0.6 * POSES.translation[pose]
    eye = -rotation.T @ translation
    patches = marker_patches(RELIEF, eye=eye)
    result = ink_of(patches, camera, rotation, translation)
    difference = np.abs(result - traced(RELIEF, camera, rotation, translation))
    # Two straight edges through 16 x 16 points are each counted to half a row, 1/32. Pixels through which outlines of
    # two things pass are mixed as if these had nothing to do with each other; there are few of them.
    assert np.mean(difference > 1 / 16) < 4e-3
    assert difference.max() < 0.25
    # A sum of some hundred such errors, half of which are of one sign.
    assert difference.sum() < 0.01 * result.sum() + 1
    unhidden = ink_of(inks(patches), camera, rotation, translation).sum()
    assert (unhidden > result.sum() + 5) == (POSES.polar_angle_deg[pose] > 1)


def test_camera_below_a_pillars_top_sees_its_side_and_not_its_dot(ink_of, traced):
    camera = Camera(80, 60, 125, 125, 40, 30)
    tilt = np.deg2rad(80)
    ahead, down = np.array([0, np.sin(tilt), -np.cos(tilt)]), np.array([0, -np.cos(tilt), -np.sin(tilt)])
    rotation, eye = np.stack([np.cross(down, ahead), down, ahead]), np.array([0, -0.25, 0.06])
    result = ink_of(marker_patches(RELIEF, eye=eye), camera, rotation, -rotation @ eye)
    # As above.
    np.testing.assert_allclose(result, traced(RELIEF, camera, rotation, -rotation @ eye), rtol=0, atol=0.25)
    assert result.sum() > 5


def test_without_relief_all_dots_are_drawn_in_their_order():
    flat = replace(RELIEF, control_points=tuple(replace(point, z=0.0) for point in RELIEF.control_points))
    for eye in (None, np.array([0.1, -0.2, 0.5])):
        plate, *dots = marker_patches(flat, eye=eye, count=64)
        assert plate.reflectance == SUBSTRATE
        assert [dot.reflectance for dot in dots] == [INK] * 6
        assert [len(dot.outlines) for dot in dots] == [2, 1, 1, 1, 1, 1]
        np.testing.assert_allclose([dot.outlines[0].mean(axis=0) for dot in dots], flat.xyz, rtol=0, atol=1e-15)


def test_a_light_marker_has_the_same_outlines_in_the_other_color():
    dark = replace(RELIEF, tag=Tag("aruco:DICT_4X4_50", 7, 0.04))
    eye = np.array([0.1, -0.2, 0.5])
    for ours, other in zip(marker_patches(dark, eye=eye), marker_patches(light_marker(dark), eye=eye), strict=True):
        assert other.reflectance == SUBSTRATE + INK - ours.reflectance
        np.testing.assert_array_equal(np.concatenate(other.outlines), np.concatenate(ours.outlines))


def test_plate_reaches_a_margin_beyond_the_boundary():
    for margin, radius in ((None, 0.186), (0.0, 0.15), (0.01, 0.16)):
        (outline,) = marker_patches(RELIEF, margin)[0].outlines
        np.testing.assert_allclose(np.linalg.norm(outline[:, :2], axis=-1), radius, rtol=1e-12)
        assert not outline[:, 2].any()


def test_plate_of_any_shape(shape, make_in):
    marker = make_in(shape, 5, 0.01)
    sizes = []
    for margin in (0.0, 0.002, 0.02):
        plate = marker_patches(marker, margin)[0]
        # Outlines are turned so that holes count against what they are cut from.
        sizes.append(sum(signed_area(outline[:, :2]) for outline in plate.outlines))
        points = np.concatenate(plate.outlines)[:, :2]
        assert np.max(shape.depth(points)) <= 1e-12 - margin
        # A corner of an arc in 64 steps per quarter lies on the arc, an edge is up to r (pi/256)^2 / 2 inside of it.
        assert np.min(shape.depth(points)) >= -margin * (1 + 1e-6) - 1e-12
    assert sizes[0] == pytest.approx(shape.area, rel=1e-9)
    assert sizes[0] < sizes[1] < sizes[2]


def test_plate_lies_no_higher_than_the_deepest_dot():
    sunk = replace(RELIEF, control_points=tuple(replace(p, z=p.z - 0.02) for p in RELIEF.control_points))
    patches = marker_patches(sunk)
    assert np.unique(patches[0].outlines[0][:, 2]) == -0.02
    # The two dots at its height need no pillars, the other four do.
    assert [patch.reflectance for patch in patches].count(SUBSTRATE) == 1 + 4


def test_bare_points_are_not_drawn():
    bare = replace(RELIEF, control_points=tuple(replace(p, feature=Feature(0)) for p in RELIEF.control_points))
    assert len(marker_patches(bare)) == 1


def test_a_tag_is_painted_on_the_plate():
    tag = Tag("aruco:DICT_4X4_50", 7, 0.06, (0.01, -0.02))
    plain, tagged = (marker_patches(replace(RELIEF, tag=item)) for item in (None, tag))
    assert len(tagged) == len(plain) + 1
    # Before the dots, whose pillars may hide it.
    assert tagged[1].reflectance == INK
    corners = np.concatenate(tagged[1].outlines)
    assert np.all(corners[:, 2] == 0)
    assert corners[:, :2].min(axis=0) == pytest.approx([-0.02, -0.05])
    # Ink is what the black cells, 10 mm square each, cover.
    area = sum(signed_area(outline[:, :2]) for outline in tagged[1].outlines)
    assert area == pytest.approx(tag.ink.sum() * 1e-4)
