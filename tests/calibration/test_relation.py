"""The relation of a rig's markers: found within its covariance, and refused where photographs do not connect them."""

from dataclasses import replace

import numpy as np
import pytest
import rigs
from scipy.spatial.transform import Rotation
from simulated_photos import CAMERA

import markergen as mg
from benchmarks import stereo
from markergen.calibration.adjustment import adjust
from markergen.calibration.network import CameraFreedom, Network, RigidPoses, Views
from markergen.calibration.relation import relate
from markergen.errors import InputError
from markergen.maths.information import apply_pose_step
from markergen.maths.rotation import exponential, logarithm
from markergen.model.body import Plate
from markergen.model.rig import Rig
from markergen.render import Optics, render_view

SIGMA = 0.01
CUBE = rigs.cube()


def assembled(rig, rng, rotation=0.005, offset=5e-4, apart=1.0):
    """The rig as it was put together: markers turned by some rad and shifted by some m."""
    return Rig(
        tuple(
            Plate(
                marker.name,
                marker.marker,
                exponential(rng.normal(0, rotation, 3)) @ marker.rotation_matrix,
                apart * marker.translation_vector + rng.normal(0, offset, 3),
            )
            for marker in rig.markers
        )
    )


def photographed(rig, rng, count, freedom=None):
    """Adjusted photographs of a rig from all sides, each marker with poses of its own, and the photo of each view."""
    design = np.concatenate([marker.marker.xyz for marker in rig.markers])
    parts = np.repeat(np.arange(len(rig.markers)), [len(marker.marker) for marker in rig.markers])
    pixels, seen, rotations, translations, photo = [], [], [], [], []
    for k in range(count):
        rotation = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
        translation = np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.3, 0.5)])
        for number, marker in enumerate(rig.markers):
            own_rotation, own_translation = marker.camera_pose(rotation, translation)
            toward = -own_translation / np.linalg.norm(own_translation)
            if own_rotation[:, 2] @ toward < 0.25:
                continue
            place = CAMERA.project(design, own_rotation[None], own_translation[None])[0]
            pixels.append(place + rng.normal(0, SIGMA, place.shape))
            seen.append(parts == number)
            rotations.append(exponential(rng.normal(0, 0.01, 3)) @ own_rotation)
            translations.append(own_translation)
            photo.append(k)
    spread = np.broadcast_to(SIGMA**2 * np.eye(2), (*np.shape(pixels)[:2], 2, 2))
    views = Views(np.array(pixels), spread, np.array(seen), np.array(rotations), np.array(translations))
    network = Network(design, np.zeros(len(design)), (CAMERA,), freedom or CameraFreedom.held(CAMERA), parts)
    return adjust(network, views), np.array(photo)


def errors_of(result, truth):
    """Errors (w, dt) of the markers' poses in the rig frame, once the truth is moved to the frame of the result."""
    from markergen.calibration.relation import _as_designed

    poses = np.array([plate.rotation_matrix for plate in truth.plates]), np.array([p.translation for p in truth.plates])
    (turns, shifts), _ = _as_designed(CUBE, poses, np.zeros((36, 36)))
    return np.concatenate(
        [
            np.r_[logarithm(marker.rotation_matrix @ rotation.T), marker.translation_vector - offset]
            for marker, rotation, offset in zip(result.markers, turns, shifts, strict=True)
        ]
    )


def nees(error, covariance):
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-9 * values[-1]
    return float(np.sum((vectors[:, kept].T @ error) ** 2 / values[kept])), int(kept.sum())


@pytest.mark.parametrize("count", [pytest.param(30, marks=pytest.mark.long), 6])
def test_the_relation_is_found_within_its_covariance(count):
    rng, total, freedom = np.random.default_rng(0), 0.0, 0
    for _ in range(count):
        truth = assembled(CUBE, rng)
        adjustment, photo = photographed(truth, rng, 30)
        result = relate(CUBE, adjustment, photo, 1e-4)
        error = errors_of(result.rig, truth)
        size, rank = nees(error, result.rig.relation_covariance)
        assert rank == 30
        total, freedom = total + size, freedom + rank
        assert result.looseness == pytest.approx(1, abs=0.3)
        assert result.turned_deg.max() > 0.1
        assert not result.is_as_designed
        assert np.median(result.sigma[0]) < 0.1
        assert np.median(result.sigma[1]) < 1e-4
    assert total / freedom == pytest.approx(1, abs=3 * np.sqrt(2 / freedom))


def test_a_camera_of_limited_accuracy_counts():
    rng, truth = np.random.default_rng(1), CUBE
    count = len(CAMERA.parameter_names)
    covariance = np.diag([4.0, 4.0, 4.0, 4.0] + [0.0] * (count - 4))
    adjustment, photo = photographed(truth, rng, 25, CameraFreedom.of_covariance(covariance))
    held, _ = photographed(truth, np.random.default_rng(1), 25)
    loose = relate(CUBE, adjustment, photo, 1e-4)
    exact = relate(CUBE, held, photo, 1e-4)
    assert np.all(loose.sigma[1] >= exact.sigma[1] * 0.999)
    assert exact.is_as_designed
    assert np.linalg.eigvalsh(loose.rig.relation_covariance).min() > -1e-12


def test_markers_that_move_are_noticed():
    rng = np.random.default_rng(2)
    halves = [photographed(assembled(CUBE, rng), rng, 8) for _ in range(2)]
    first, second = (item.views for item, _ in halves)
    views = Views(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in vars(first)))
    network = halves[0][0].network
    photo = np.concatenate([halves[0][1], 8 + halves[1][1]])
    result = relate(CUBE, adjust(network, views), photo, 1e-4)
    assert "seem to move" in result.warnings[0]


def test_unconnected_markers_are_named():
    adjustment, photo = photographed(CUBE, np.random.default_rng(3), 10)
    apart = np.arange(len(photo))
    with pytest.raises(InputError, match=r"connect all markers.*plate 1, plate 2.*"):
        relate(CUBE, adjustment, apart, 1e-4)


def test_the_frame_is_that_of_the_design():
    truth = assembled(CUBE, np.random.default_rng(4))
    moved = replace(
        truth,
        markers=tuple(
            replace(
                marker,
                rotation=exponential(np.array([0, 0, 0.3])) @ marker.rotation_matrix,
                translation=marker.translation_vector + 0.1,
            )
            for marker in truth.markers
        ),
    )
    adjustment, photo = photographed(moved, np.random.default_rng(5), 20)
    result = relate(CUBE, adjustment, photo, 1e-4)
    assert np.abs(result.rig.xyz.mean(axis=0) - CUBE.xyz.mean(axis=0)).max() < 1e-4


def test_a_rig_is_measured_by_photographs_of_it(tmp_path):
    """Three plates of a cube, put together half a degree and half a millimeter off, in six rendered photographs."""
    rng = np.random.default_rng(6)
    corner = Rig(tuple(CUBE.markers[k] for k in (0, 2, 4)))
    # Plates of a cube that are put together like this would cut into each other.
    truth = assembled(corner, rng, apart=1.05)
    camera = replace(CAMERA, width=400, height=300, fx=500, fy=500, cx=200, cy=150)
    photos = []
    for _ in range(6):
        looking = rigs.looking(truth, rng)
        photos.append(render_view(truth, camera, *looking, Optics(), rng))
    truth.save(tmp_path / "truth.json")
    calibration = mg.calibrate(corner, photos, camera, save=tmp_path / "measured.json", report=tmp_path / "report.html")
    measured = mg.Rig.load(tmp_path / "measured.json")
    assert measured.relation is not None
    assert "markers are" in str(calibration)
    assert "of the rig" in (tmp_path / "report.html").read_text()
    assert len(calibration.as_dict()["relation"]["markers"]) == 3

    def off(rig):
        first, second = rig.xyz - rig.xyz.mean(axis=0), truth.xyz - truth.xyz.mean(axis=0)
        left, stretch, right = np.linalg.svd(second.T @ first)
        return np.sqrt(np.mean((first @ (left @ right).T * stretch.sum() / np.sum(first**2) - second) ** 2))

    # Centers are measured to 0.01 px, that is 6 um in a photograph.
    assert off(measured) < 2e-5 < off(corner) / 5
    with pytest.raises(InputError, match="a rig alone"):
        mg.calibrate(corner, photos, camera, also=tmp_path / "truth.json")


def test_derivatives_of_bound_poses_are_those_of_differences():
    """Two plates and two cameras, each view of another pair."""
    rng, step = np.random.default_rng(7), 1e-6
    held = np.array([True, False, True, False])
    rotated, away = exponential(rng.normal(0, 0.5, (4, 3))), rng.normal(0, 0.2, (4, 3))
    rotated[held], away[held] = np.eye(3), 0.0
    bound = RigidPoses(rotated, away, np.array([0, 0, 1, 1]), np.array([0, 1, 1, 0]), np.array([2, 3, 2, 3]), held)
    bodies = exponential(rng.normal(0, 0.5, (2, 3))), rng.normal(0, 0.2, (2, 3)) + [0, 0, 1]
    blank = Views(
        np.zeros((4, 1, 2)), np.zeros((4, 1, 2, 2)), np.ones((4, 1), bool), np.zeros((4, 3, 3)), np.zeros((4, 3))
    )
    views = bound.composed(blank, bodies)
    for ours, again in zip(bodies, bound.bodies(views), strict=True):
        np.testing.assert_allclose(again, ours, atol=1e-12)
    by_body, by_poses = bound.derivatives(views)
    for k in range(6):
        change = step * np.eye(6)[k]
        moved = bound.composed(views, apply_pose_step(*bodies, np.tile(change, (2, 1))))
        np.testing.assert_allclose(_step(views, moved) / step, by_body[:, :, k], atol=1e-5)
    for k in range(12):
        moved = bound.stepped(step * np.eye(12)[k]).composed(views, bodies)
        np.testing.assert_allclose(_step(views, moved) / step, by_poses[:, :, k], atol=1e-5)


def _step(before, after):
    rotation = logarithm(after.rotation @ before.rotation.swapaxes(-1, -2))
    return np.concatenate([rotation, after.translation - before.translation], axis=-1)


@pytest.mark.parametrize("reference", ["exact", "covariance", pytest.param("unknown", marks=pytest.mark.long)])
def test_two_cameras_are_found_within_their_covariance(reference):
    """NEES of 8 sets of 6 unknowns, and errors below those of two calibrations by themselves."""
    sets = [stereo.one_set(np.random.default_rng(seed), 8, reference) for seed in range(8)]
    squares = [nees(*stereo.scaled(error, spread))[0] for error, spread, _ in sets]
    assert sum(squares) / 48 == pytest.approx(1, abs=3 * np.sqrt(2 / 48))
    together, apart = (np.array([row[k] for row in sets]).std(axis=0) for k in (0, 2))
    assert np.median(apart / together) > 1.5


def test_cameras_that_never_see_a_marker_at_once_are_named():
    rng = np.random.default_rng(8)
    made = [
        stereo.photographed(stereo.layout(12), stereo.layout(12), *stereo.hand_held(4, rng, stereo.layout(12)), rng)
    ] * 2
    views = made[0].views.joined(replace(made[1].views, camera=np.ones(4, dtype=int)))
    network = replace(made[0].network(), cameras=(CAMERA, CAMERA))
    network = replace(network, freedom=CameraFreedom.joined([CameraFreedom.held(CAMERA)] * 2))
    with pytest.raises(InputError, match=r"connect all cameras.*right"):
        relate(None, adjust(network, views), np.arange(8), 1e-4, ("left", "right"))


@pytest.mark.parametrize("order", [[0, 2, 1, 3, 4, 5], [0, 1, 2, 3, 4, 5]], ids=["exchanged", "right"])
def test_photographs_that_are_paired_wrongly_are_named(order):
    rng, design = np.random.default_rng(9), stereo.layout(12)
    poses = stereo.hand_held(6, rng, design)
    made = [stereo.photographed(design, design, *poses, rng) for _ in range(2)]
    views = made[0].views.joined(replace(made[1].views.take(np.array(order)), camera=np.ones(6, dtype=int)))
    network = replace(made[0].network(), cameras=(CAMERA, CAMERA))
    network = replace(network, freedom=CameraFreedom.joined([CameraFreedom.held(CAMERA)] * 2))
    names = [f"{side}/{k}.png" for side in ("left", "right") for k in range(6)]
    adjustment, moment = adjust(network, views), np.tile(np.arange(6), 2)
    if order == sorted(order):
        assert not relate(None, adjustment, moment, 1e-4, ("left", "right"), names).warnings
        return
    with pytest.raises(InputError, match=r"others: left/1.png and right/1.png, left/2.png and right/2.png; .* 4 pairs"):
        relate(None, adjustment, moment, 1e-4, ("left", "right"), names)
    # Two pairs against two others are no evidence.
    few = np.isin(moment, [1, 2, 3, 4])
    relate(None, adjust(network, views.take(few)), moment[few], 1e-4, ("left", "right"), list(np.array(names)[few]))
