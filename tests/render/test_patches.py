import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markergen.maths.projection import circle_image, plane_homography
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import paper
from markergen.render.patches import (
    CIRCLE_ERROR_PX,
    EDGE_ERROR_PX,
    Patch,
    circle_polygon,
    circle_vertices,
    project_patches,
)

POSES = paper()
FACING = np.diag([1.0, -1.0, -1.0])
BARREL = Distortion("radtan", (-0.35, 0.12, 0.003, -0.002))
PINCUSHION = Distortion("radtan", (0.2, 0.05, 0.0, 0.0))
FISHEYE = Distortion("equidistant", (0.01, 0.0, 0.0, 0.0))


def square(side, x=0.0, y=0.0, z=0.0):
    return np.array([[x + i * side / 2, y + j * side / 2, z] for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def looking(tilt_deg, height):
    """Pose of a camera at that height over the marker, its axis that far from straight down; 90 is level."""
    tilt = np.deg2rad(tilt_deg)
    ahead = np.array([0, np.sin(tilt), -np.cos(tilt)])
    down = np.array([0, -np.cos(tilt), -np.sin(tilt)])
    rotation = np.stack([np.cross(down, ahead), down, ahead])
    return rotation, -rotation @ [0, 0, height]


@given(radius=st.floats(1e-3, 1), count=st.integers(3, 300))
def test_circles_keep_their_area(radius, count):
    x, y, z = circle_polygon(np.array([0.1, -0.2, 0.05]), radius, count).T
    assert (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 == pytest.approx(np.pi * radius**2, rel=1e-9)
    assert np.unique(z) == 0.05


@pytest.mark.parametrize("radius_px", [0.5, 3.0, 24.0, 100.0, 2000.0])
def test_circles_have_vertices_enough_for_their_size(radius_px):
    outline = circle_polygon(np.zeros(3), radius_px, circle_vertices(radius_px))[:, :2]
    corners = np.linalg.norm(outline, axis=-1)
    middles = np.linalg.norm(outline + np.roll(outline, -1, axis=0), axis=-1) / 2
    assert np.abs(np.concatenate([corners, middles]) - radius_px).max() <= CIRCLE_ERROR_PX


@pytest.mark.parametrize("pose", [3, 47, 95, 230, 395])
def test_circles_become_the_ellipses_of_their_conics(pose):
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    homography = plane_homography(rotation[None], translation[None], PAPER_CAMERA.matrix)[0]
    center, semi, angle = circle_image(np.array([0.07, -0.1]), 0.018, homography)
    # A third larger than the dot appears: magnification changes across it.
    patch = Patch((circle_polygon(np.array([0.07, -0.1, 0]), 0.018, circle_vertices(4 / 3 * semi[0])),), 0)
    (outline,) = project_patches([patch], PAPER_CAMERA, rotation, translation)[0]
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for points in (outline, (outline + np.roll(outline, -1, axis=0)) / 2):
        unit = (points - center) @ R / semi
        level, slope = np.sum(unit**2, axis=-1) - 1, 2 * np.linalg.norm(unit / semi, axis=-1)
        # Distance from the ellipse to first order.
        assert np.abs(level / slope).max() <= CIRCLE_ERROR_PX


@pytest.mark.parametrize("distortion", [BARREL, PINCUSHION, FISHEYE])
def test_straight_edges_bend_as_the_lens_has_it(distortion):
    camera = Camera(640, 480, 400, 410, 330, 235, distortion)
    rotation, translation = POSES.rotation[47], POSES.translation[47]
    # Wide enough to fill the image, but all of it in view.
    (outline,) = project_patches([Patch((square(0.4),), 0)], camera, rotation, translation)[0]
    corners = square(0.4)
    edges = corners[:, None] + np.linspace(0, 1, 300)[:, None] * (np.roll(corners, -1, axis=0) - corners)[:, None]
    truth = camera.project(edges.reshape(-1, 3), rotation[None], translation[None])[0]
    start, step = outline, np.roll(outline, -1, axis=0) - outline
    share = np.sum((truth[:, None] - start) * step, axis=-1) / np.sum(step**2, axis=-1)
    nearest = start + np.clip(share, 0, 1)[..., None] * step
    distance = np.linalg.norm(truth[:, None] - nearest, axis=-1).min(axis=1)
    # Edges bend more at one end than at the other: twice the mean.
    assert distance.max() < 2 * EDGE_ERROR_PX
    # The test can fail: the edges are bent by much more.
    assert len(outline) > 40


@pytest.mark.parametrize("distortion", [Distortion(), BARREL, PINCUSHION, FISHEYE])
@pytest.mark.parametrize("tilt", [0, 60, 85, 100])
def test_a_floor_without_end_ends_at_the_horizon(distortion, tilt, ink_of, rays_of):
    # Reaches behind the camera and far out of the view on all sides, where the lens model has long turned over.
    camera = Camera(60, 40, 45.0, 45.0, 31.0, 18.0, distortion)
    rotation, translation = looking(tilt, 1.5)
    stripes = Patch((square(200, y=99.5), square(1, y=2)), 0)
    eye, ray = rays_of(camera, rotation, translation, 16)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -eye[2] / ray[..., 2]
        x, y = np.abs(eye[0] + reach * ray[..., 0]), eye[1] + reach * ray[..., 1]
    ink = (reach > 0) & (x < 100) & (y > -0.5) & (y < 199.5) & ~((x < 0.5) & (y > 1.5) & (y < 2.5))
    expected = ink.reshape(40, 16, 60, 16).mean(axis=(1, 3))
    # Two edges of 16 x 16 points through a pixel, each counted to half a row.
    np.testing.assert_allclose(ink_of([stripes], camera, rotation, translation), expected, rtol=0, atol=1 / 16)
    assert expected.any()


@settings(max_examples=30)
@given(flips=st.lists(st.booleans(), min_size=4, max_size=4), order=st.permutations(range(4)))
def test_outlines_within_outlines_are_holes_whichever_way_they_turn(flips, order):
    sides = [0.4, 0.3, 0.2]
    outlines = [square(side) for side in sides] + [square(0.1, x=0.35)]
    patch = Patch(tuple(outlines[k][:: -1 if flips[k] else 1] for k in order), 0)
    areas = [np.cross(o - o[0], np.roll(o, -1, axis=0) - o[0])[:, 2].sum() / 2 for o in patch.outlines]
    expected = dict(zip(range(4), [0.16, -0.09, 0.04, 0.01], strict=True))
    np.testing.assert_allclose(areas, [expected[k] for k in order], rtol=1e-12)


def test_cells_side_by_side_leave_no_seam(ink_of):
    # A chessboard's cells in one patch, with shared edges and corners, against the same area as one square.
    pose = POSES.rotation[66], POSES.translation[66]
    cells = tuple(square(0.05, 0.05 * i - 0.075, 0.05 * j - 0.075) for i in range(4) for j in range(4))
    apart, whole = (ink_of([Patch(o, 0)], PAPER_CAMERA, *pose) for o in (cells, (square(0.2),)))
    # Single precision.
    np.testing.assert_allclose(apart, whole, rtol=0, atol=1e-6)


@pytest.mark.parametrize("outline", [square(0.2), square(0.2)[::-1]])
@pytest.mark.parametrize(("rotation", "seen"), [(FACING, True), (np.eye(3), False)])
def test_only_the_printed_face_is_seen(outline, rotation, seen):
    (outlines,) = project_patches([Patch((outline,), 0)], PAPER_CAMERA, rotation, np.array([0, 0, 1.0]))
    assert bool(outlines) == seen


def test_upright_patches_are_seen_from_both_sides(ink_of):
    wall = Patch((square(0.2)[:, [0, 2, 1]] + [0, 0, 0.1],), 0)
    rotation, translation = looking(80, 0.1)
    before, behind = (ink_of([wall], PAPER_CAMERA, rotation, translation + rotation @ [0, y, 0]) for y in (1.0, -3.0))
    assert before.sum() == pytest.approx(160 * 160, rel=0.05)
    assert not behind.any()
    R = np.diag([-1.0, -1, 1])
    assert ink_of([wall], PAPER_CAMERA, rotation @ R, translation + rotation @ [0, 1.0, 0]).sum() == pytest.approx(
        before.sum(), rel=1e-6
    )


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        (FACING, (0, 0, -1)),  # behind the camera
        (FACING, (5, 0, 1)),  # beside the image
        (np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), (0, 0, 0.01)),  # edge-on
        (np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), (0, 0, 0)),  # the camera within the patch
    ],
)
def test_what_cannot_be_seen_has_no_outline(rotation, translation):
    patches = [Patch((square(0.2),), 0), Patch((square(0.2)[:2],), 0)]
    assert project_patches(patches, PAPER_CAMERA, rotation, np.array(translation, dtype=float)) == [(), ()]


def test_a_lens_that_sees_less_than_the_image_draws_what_it_sees(ink_of):
    # The image's corners are outside the domain of this lens; its own limit is at a radius of 231 px.
    camera = Camera(640, 480, 300, 300, 320, 240, Distortion("radtan", (-0.25, 0.0, 0.0, 0.0)))
    image = ink_of([Patch((square(100),), 0)], camera, FACING, np.array([0, 0, 1.0]))
    assert image[240, 320] == pytest.approx(1, abs=1e-6)
    assert image[240, 120] == pytest.approx(1, abs=1e-6)


def test_a_hole_may_touch_its_rim(ink_of):
    # The hole shares a part of an edge with what it is cut from, and another outline both corner and edge with it.
    hole, island = square(0.1, x=0.05), square(0.05, x=0.025, y=0.025)
    image = ink_of([Patch((island, square(0.2), hole), 0)], PAPER_CAMERA, FACING, np.array([0, 0, 1.0]))
    assert image.sum() == pytest.approx((160**2 - 80**2 + 40**2), rel=1e-6)
