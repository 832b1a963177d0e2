"""Bodies of several constellations: rigs, and markers with dots of several sizes."""

from dataclasses import replace

import numpy as np
import pytest
from plain_blobs import plain_blobs
from rigs import rectangle
from scipy.spatial.transform import Rotation

from markergen.detect import Detector, detect
from markergen.detect.conic_projection import body_outlines
from markergen.detect.detection import identify, prepare
from markergen.detect.joining import Spare, joined, of_body, spatial_errors
from markergen.detect.pose import PoseEstimate
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources, PoseBudget
from markergen.maths.rotation import angle_between, exponential, logarithm, skew
from markergen.model.body import Plate
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, JointCovariance, Marker
from markergen.model.rig import Rig
from markergen.render import DEFAULT_OPTICS, render_view

EXACT = ErrorSources(print_sigma=0.0)
TURNS = {
    "+z": np.eye(3),
    "-z": np.diag([1.0, -1, -1]),
    "+x": np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]]),
    "-x": np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0.0]]),
    "+y": np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0.0]]),
    "-y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]),
}


def dots_of(points, diameters, keys=(0,)):
    return tuple(
        ControlPoint(k, float(x), float(y), 0.0, key_ring(d) if k in keys else Feature(d))
        for k, ((x, y), d) in enumerate(zip(points, diameters, strict=True))
    )


def scattered(seed, n=6, reach=0.032, gap=0.016):
    """Random places at least a gap apart, no two markers alike."""
    rng, points = np.random.default_rng(seed), list[np.ndarray]()
    while len(points) < n:
        place = rng.uniform(-reach, reach, 2)
        if all(np.linalg.norm(place - other) > gap for other in points):
            points.append(place)
    return np.array(points)


@pytest.fixture(scope="module")
def cube():
    markers = [Marker(dots_of(scattered(k), [0.012] * 6), rectangle(0.08, 0.08), 0.001) for k in range(6)]
    faces = zip(TURNS.items(), markers, strict=True)
    return Rig(tuple(Plate(name, marker, turn, 0.04 * turn[:, 2]) for (name, turn), marker in faces))


@pytest.fixture(scope="module")
def pad():
    turn = 2 * np.pi * np.arange(6) / 6 + 0.3, 2 * np.pi * np.arange(5) / 5
    rings = [reach * np.column_stack([np.cos(t), np.sin(t)]) for reach, t in zip((0.42, 0.075), turn, strict=True)]
    diameters = [0.13] * 6 + [0.024] * 5
    return Marker(dots_of(np.concatenate(rings), diameters, keys=(0, 6)), Circle(0.5), 0.002)


def seen(rig, rotation, translation, rng, sigma=0.02, hidden=()):
    """Blobs of the dots of a rig that face the camera, with noise in px, in any order, and which dot each is."""
    body, camera = rig, PAPER_CAMERA
    drawn = body_outlines(body, rotation[None], translation[None])
    dots = rng.permutation(np.setdiff1d(np.flatnonzero(body.facing(rotation, translation) > 0.3), hidden))
    values, vectors = np.linalg.eigh(drawn.shape[0, dots] * camera.fx * camera.fy)
    center = camera.to_pixels(drawn.center[0, dots]) + sigma * rng.standard_normal((len(dots), 2))
    angle = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
    covariance = np.broadcast_to(sigma**2 * np.eye(2), (len(dots), 2, 2))
    return plain_blobs(center, np.sqrt(values[:, ::-1]), angle, body.is_ring[dots], covariance), dots


def found_in(rig, blobs, errors=EXACT):
    sought = prepare([rig], True)
    found = identify(blobs, sought, PAPER_CAMERA, True, errors)
    return joined(found, sought.bodies, PAPER_CAMERA, errors, 32, Spare(blobs, blobs.take))


def random_pose(rng, distance=(0.3, 0.8)):
    rotation = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return rotation, np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(*distance)])


def errors_of(pose, rotation, translation):
    return np.concatenate([logarithm(rotation @ pose.rotation.T), translation - pose.translation])


def test_one_pose_follows_from_all_faces_with_its_covariance(cube):
    rng, nees = np.random.default_rng(0), list[float]()
    for _ in range(40):
        rotation, translation = random_pose(rng)
        blobs, dots = seen(cube, rotation, translation, rng)
        (found,) = found_in(cube, blobs)
        assert found.found
        truth = PAPER_CAMERA.project(cube.xyz, rotation[None], translation[None])[0]
        assert np.abs(found.pixels - truth[found.ids]).max() < 0.2
        assert len(found.ids) >= 0.9 * len(dots)
        error = errors_of(found.pose, rotation, translation)
        nees.append(float(error @ np.linalg.solve(found.pose.budget.image, error)) * found.pose.scale)
    # The median of chi2 with six degrees of freedom is 5.35; that of 40 of them has a standard deviation of 0.66.
    assert 4.2 < np.median(nees) < 7.5


def test_faces_settle_each_other_s_flips_and_share_their_dots(cube):
    """A face far away has two poses; together with another one it has one. A face with three dots in view counts."""
    rotation, translation = TURNS["+z"] @ np.diag([1.0, -1, -1]), np.array([0, 0, 0.9])
    turned = exponential(np.array([0.0, 0.75, 0])) @ rotation
    # Of the second face only three dots are seen, too few to be found alone.
    second = np.flatnonzero(cube.normals @ turned.T[:, 2] < -0.3)
    face = next(k for k in np.unique(cube.owner[second]) if k != 0)
    hidden = np.flatnonzero(cube.owner == face)[:3]
    blobs, dots = seen(cube, turned, translation, np.random.default_rng(1), hidden=hidden)
    (found,) = found_in(cube, blobs)
    assert len(found.parts) == 1
    assert set(found.ids) == set(dots)
    assert len(found.ids) == 9
    assert found.pose.alternative is None
    assert np.rad2deg(angle_between(found.pose.rotation, turned)) < 1


def test_one_or_two_dots_of_another_face_settle_a_flip(cube):
    ambiguous = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rotation, translation = exponential(rng.normal(0, 0.25, 3)) @ np.diag([1.0, -1, -1]), np.array([0, 0, 1.6])
        blobs, dots = seen(cube, rotation, translation, rng, sigma=0.05)
        place = np.array([np.count_nonzero(cube.owner[dots[:k]] == cube.owner[dot]) for k, dot in enumerate(dots)])
        few = (cube.owner[dots] == 0) | (place < 2)
        blobs, dots = blobs.take(few), dots[few]
        alone = [each for each in identify(blobs, prepare([cube], True), PAPER_CAMERA, True, EXACT) if each.found]
        if len(np.unique(cube.owner[dots])) < 2 or not alone or alone[0].pose.alternative is None:
            continue
        ambiguous += 1
        (found,) = found_in(cube, blobs)
        assert found.pose.alternative is None
        assert np.rad2deg(angle_between(found.pose.rotation, rotation)) < 3
    assert ambiguous >= 4


def test_two_rigs_are_two_copies_and_a_wrong_rig_is_refused(cube):
    rng = np.random.default_rng(3)
    poses = [(random_pose(rng)[0], np.array([x, 0, 0.6])) for x in (-0.12, 0.12)]
    both = [seen(cube, *pose, rng)[0] for pose in poses]
    found = found_in(cube, both[0].joined(both[1]))
    assert [each.found for each in found] == [True, True]
    assert sorted(round(float(each.pose.translation[0]), 2) for each in found) == [-0.12, 0.12]
    # A face that is mounted a quarter turn off contradicts the others: with three faces in view two agree.
    turn = exponential(np.array([0, 0, np.pi / 2]))
    off = replace(cube.markers[0], rotation=cube.markers[0].rotation_matrix @ turn)
    wrong = Rig((off, *cube.markers[1:]))
    rotation = exponential(np.array([0.5, 0.5, 0.2])) @ np.diag([1.0, -1, -1])
    blobs, dots = seen(cube, rotation, np.array([0, 0, 0.4]), rng)
    (found,) = found_in(wrong, blobs)
    truth = PAPER_CAMERA.project(cube.xyz, rotation[None], np.array([[0, 0, 0.4]]))[0]
    assert not found.found or np.abs(found.pixels - truth[found.ids]).max() < 1
    assert not set(found.ids) & set(np.flatnonzero(cube.owner == 0))
    pair = Rig((off, cube.markers[2]))
    alone = np.isin(cube.owner[dots], (0, 2))
    (found,) = found_in(pair, blobs.take(alone))
    assert not found.found
    assert "does it look as its file says" in found.reason


def test_the_frame_of_an_estimate_changes_with_its_covariance(cube):
    """The covariance of T_camera_rig is that of numerical derivatives of the composed pose."""
    rng = np.random.default_rng(5)
    root = rng.standard_normal((6, 6))
    budget = PoseBudget(*[root @ root.T] * 4)
    rotation, translation = random_pose(rng)
    placed = cube.markers[2]
    pose = of_body(PoseEstimate(rotation, translation, budget, 0.0, 1, 1.0), placed)
    turned, moved = placed.camera_pose(pose.rotation, pose.translation)
    assert turned == pytest.approx(rotation, abs=1e-15)
    assert moved == pytest.approx(translation, abs=1e-15)
    step, rows = 1e-6, []
    for k in range(6):
        change = step * np.eye(6)[k]
        near = PoseEstimate(exponential(change[:3]) @ rotation, translation + change[3:], budget, 0.0, 1, 1.0)
        rows.append(errors_of(pose, *(lambda each: (each.rotation, each.translation))(of_body(near, placed))) / step)
    through = np.array(rows).T
    assert pose.budget.total == pytest.approx(through @ budget.total @ through.T, rel=1e-5, abs=1e-5)


def test_errors_of_places_and_of_the_relation_are_those_of_samples(cube):
    rng = np.random.default_rng(6)
    matrix = 1e-10 * np.eye(12) + 4e-11
    joint = JointCovariance(tuple(range(6)), "xy", tuple(map(tuple, matrix)))
    measured = replace(cube.markers[2], marker=replace(cube.markers[2].marker, joint_covariance=joint))
    root = np.kron(np.eye(6), np.diag([1e-3] * 3 + [1e-4] * 3)) @ rng.standard_normal((36, 36))
    rig = Rig((*cube.markers[:2], measured, *cube.markers[3:]), tuple(map(tuple, root @ root.T)))
    body, dots = rig, np.array([0, 3, 12, 13, 17])
    plate = body.plates[2]
    sources = spatial_errors(body, dots, plate.rotation_matrix, ErrorSources(print_sigma=5e-5))
    samples = []
    for _ in range(5_000):
        step = root @ rng.standard_normal(36)
        moved = []
        shift = np.linalg.cholesky(matrix) @ rng.standard_normal(12)
        for dot in dots:
            each, first = body.plates[body.owner[dot]], 6 * body.owner[dot]
            local = each.marker.xyz[dot - body.first[body.owner[dot]]].copy()
            number = dot - body.first[body.owner[dot]]
            local[:2] += shift[2 * number : 2 * number + 2] if body.owner[dot] == 2 else 5e-5 * rng.standard_normal(2)
            turn = np.eye(3) + skew(step[first : first + 3])
            place = turn @ each.rotation_matrix @ local + each.translation_vector + step[first + 3 : first + 6]
            moved.append(plate.to_marker(place))
        samples.append(np.ravel(moved))
    expected = sources.whole(len(dots), 3)
    sigma = np.sqrt(np.diag(expected))
    # A correlation of 5,000 samples has a standard deviation of at most 0.014, and a variance of 0.02.
    assert np.cov(np.array(samples).T) / np.outer(sigma, sigma) == pytest.approx(
        expected / np.outer(sigma, sigma), abs=0.08
    )


def view_of(pad, distance, tilt, seed=0, roll=0.3):
    tilted = np.diag([1.0, -1, -1]) @ exponential(np.array([tilt, 0, 0]))
    rotation, translation = exponential(np.array([0, 0, roll])) @ tilted, np.array([0, 0, distance])
    image = render_view(pad, PAPER_CAMERA, rotation, translation, DEFAULT_OPTICS, np.random.default_rng(seed))
    return image, rotation, translation


@pytest.mark.parametrize(("distance", "ids"), [(0.3, range(6, 11)), (2.2, range(11)), (9.5, range(6))])
def test_a_pad_is_found_by_the_dots_in_view(pad, distance, ids):
    image, rotation, translation = view_of(pad, distance, 0.5)
    found = detect(image, pad, PAPER_CAMERA, EXACT)
    assert set(ids) <= set(found.ids)
    truth = PAPER_CAMERA.project(pad.xyz, rotation[None], translation[None])[0]
    assert np.abs(found.pixels - truth[found.ids]).max() < 0.2
    assert np.rad2deg(angle_between(found.pose.rotation, rotation)) < 0.2
    assert found.homography is not None
    assert len(found.parts) == (2 if distance == 2.2 else 1)


def test_dots_of_nearly_one_size_are_one_constellation(pad, cube):
    assert [len(part.dots) for part in pad.constellations] == [6, 5]
    alike = replace(pad, control_points=dots_of(pad.xyz[:, :2], [0.024] * 6 + [0.02] * 5))
    few = replace(pad, control_points=dots_of(pad.xyz[:, :2], [0.13] * 8 + [0.02] * 3))
    # One dot of another size, such as the origin of a grid, or a few, belong to the others.
    odd = replace(pad, control_points=dots_of(pad.xyz[:, :2], [0.13] + [0.024] * 10))
    for marker in (alike, few, odd):
        body = marker
        assert len(body.constellations) == 1
        assert len(body.constellations[0].dots) == 11
    assert alike.is_single
    assert [plate.name for plate in cube.plates] == list(TURNS)


def test_a_pad_is_tracked_and_drawn(pad):
    detector, near = Detector(pad, PAPER_CAMERA), None
    for step in range(3):
        image, *_ = view_of(pad, 2.2 - 0.01 * step, 0.5, step)
        (whole,) = detector(image)
        (near,) = detector(image, near)
        assert set(near.ids) == set(whole.ids)
        assert np.abs(near.translation - whole.translation).max() < 1e-4
    assert near.draw(image).shape == (480, 640, 3)
    assert near.as_dict()["ids"] == near.ids.tolist()


def test_without_a_camera_a_pad_has_a_homography_and_a_rig_is_refused(pad, cube):
    image, *_ = view_of(pad, 2.2, 0.5)
    (found,) = Detector(pad)(image)
    assert len(found.ids) == 6
    assert found.homography is not None
    with pytest.raises(InputError, match="a camera for a rig"):
        Detector(cube)
    with pytest.raises(InputError, match="markers for --refine photometric"):
        Detector(cube, PAPER_CAMERA, refine="photometric")


def test_a_rig_that_is_not_there_says_why(cube, tmp_path):
    cube.save(tmp_path / "cube.json")
    detector = Detector(tmp_path / "cube.json", PAPER_CAMERA)
    (found,) = detector(np.full((480, 640), 200, np.uint8))
    assert not found.ok
    assert found.reason.startswith("found none of its 6 markers; +z: found 0 dots")


def test_a_rendered_rig_is_told_and_drawn(cube):
    rotation, translation = exponential(np.array([0.5, 0.4, 0.2])) @ np.diag([1.0, -1, -1]), np.array([0, 0, 0.35])
    image = render_view(cube, PAPER_CAMERA, rotation, translation, DEFAULT_OPTICS, np.random.default_rng(0))
    (found,) = Detector(cube, PAPER_CAMERA)(image)
    assert np.rad2deg(angle_between(found.rotation, rotation)) < 0.1
    assert "on 3 of 6 markers, 0.35" in str(found)
    told = found.as_dict()
    assert told["dots"] == [list(cube.dots[number]) for number in told["ids"]]
    assert found.xyz.shape == (len(told["ids"]), 3)
    drawn = found.draw(image)
    # Outlines, crosses and labels leave most of the image as it is.
    assert (drawn != image[..., None]).any(axis=-1).mean() < 0.2
