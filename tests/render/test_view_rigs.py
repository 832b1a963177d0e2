"""Views of rigs against rays, and against views of their markers alone."""

import numpy as np
import pytest

import markergen as mg
from markergen.maths.rotation import exponential
from markergen.model.body import Plate
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.rig import Rig
from markergen.render import Optics, Scenery, render_view
from tests.support.rigs import corner, cube, first_hits, plate, scattered, wall

CAMERA = Camera(160, 120, 150, 150, 79.5, 59.5, Distortion("radtan", (-0.2, 0.05, 0.003, -0.002)))
SHARP = Optics(blur_px=0, noise_grey=0, dark=0, light=200)
BEHIND = 100


def toward(direction, distance):
    """Pose of a camera that looks at the rig's origin from a direction."""
    z = -np.array(direction) / np.linalg.norm(direction)
    x = np.cross([0.0, 0, 1], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z]), np.array([0, 0, distance])


def pose(seed, distance):
    rng = np.random.default_rng(seed)
    return exponential(rng.normal(size=3) * 2), np.array([0.02, -0.01, distance])


@pytest.mark.parametrize("rig", [cube(), wall(), corner(True), corner(False), scattered(0), scattered(1)])
def test_a_view_shows_what_rays_meet(rig):
    offsets = np.array([[0, 0], [0.49, 0.49], [0.49, -0.49], [-0.49, 0.49], [-0.49, -0.49]])
    x, y = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2) + offsets
    rays = np.concatenate([CAMERA.from_pixels(pixels.reshape(-1, 2)), np.ones((pixels.size // 2, 1))], axis=-1)
    seen = set()
    for seed in range(4):
        rotation, translation = pose(seed, 0.35)
        image = render_view(rig, CAMERA, rotation, translation, SHARP, np.random.default_rng(0), Scenery(BEHIND))
        eye = -rotation.T @ translation
        owner, places = first_hits(rig, eye, rays @ rotation)
        grey = np.full(len(rays), BEHIND)
        for k, marker in enumerate(rig.markers):
            facing = marker.to_marker(eye)[2] > 0
            mine = np.flatnonzero((owner == k) & (facing or not rig.is_convex))
            radii = [[p.feature.diameter / 2, p.feature.inner_diameter / 2] for p in marker.marker.control_points]
            far = np.linalg.norm(places[mine, None] - marker.marker.xyz[:, :2], axis=-1)[..., None]
            grey[mine] = np.where(facing & (np.sum(far < radii, axis=-1) == 1).any(axis=-1), 0, 200)
        grey = grey.reshape(-1, len(offsets))
        # Edges within a pixel are for other tests.
        plain = np.ptp(grey, axis=-1) == 0
        thin = np.abs(grey[plain, 0] - image.ravel()[plain].astype(float)) > 1
        assert plain.mean() > 0.8
        assert thin.mean() < 0.002
        seen |= set(np.unique(grey))
    assert seen == {0, 200, BEHIND}


def test_a_rig_of_one_marker_is_seen_as_that_marker():
    marker, (rotation, translation) = plate(0), (exponential(np.array([3.0, 0.4, 0])), np.array([0, 0, 0.3]))
    rig, scenery = Rig((Plate("a", marker, np.eye(3).tolist(), (0, 0, 0)),)), Scenery(70.0)
    alone, one = (
        render_view(body, CAMERA, rotation, translation, Optics(), np.random.default_rng(0), scenery)
        for body in (marker, rig)
    )
    assert (alone == one).all()


def test_nothing_shows_through_the_edge_of_a_cube():
    rig, (rotation, translation) = cube(), toward([0.5, 0.6, 0.65], 0.3)
    black, white = (
        render_view(rig, PAPER_CAMERA, rotation, translation, SHARP, np.random.default_rng(0), Scenery(level))
        for level in (0.0, 200.0)
    )
    shows = (black != white).astype(np.uint8)
    import cv2

    # One background around the cube, and nothing of it inside.
    assert cv2.connectedComponents(shows, connectivity=4)[0] == 2
    assert np.ptp(black[shows == 0]) == 200


def test_the_faces_of_a_cube_are_found_at_their_poses():
    rig, (rotation, translation) = cube(seed=10), toward([0.5, 0.6, 0.65], 0.25)
    image = render_view(rig, PAPER_CAMERA, rotation, translation, Optics(), np.random.default_rng(0), Scenery(40.0))
    facing = [marker for marker in rig.markers if marker.to_marker(-rotation.T @ translation)[2] > 0.05]
    assert len(facing) == 3
    for marker in facing:
        R, offset = marker.camera_pose(rotation, translation)
        (finding,) = mg.Detector(marker.marker, PAPER_CAMERA)(image)
        assert np.arccos((np.trace(finding.rotation.T @ R) - 1) / 2) < np.deg2rad(0.5)
        assert finding.translation == pytest.approx(offset, abs=1e-3)
