"""Cones of poses, what a camera sees of a marker, and poses that go with a design."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sentences import pattern, sentence

from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.pose_sources.cone import MOST_POSES, Cone
from markergen.model.poses import PoseDistribution, is_named, named_poses, paper, silhouette
from markergen.model.recorded_poses import MOST_KEPT, RecordedPoses
from markergen.model.spec import Spec


def centers(poses):
    """Camera centers (P, 3) in the marker frame."""
    return -np.einsum("pji,pj->pi", poses.rotation, poses.translation)


def of(cone):
    return PoseDistribution(str(cone), *cone.sample())


angles = st.tuples(st.integers(0, 89), st.integers(0, 89)).map(sorted).map(tuple)
arcs = st.tuples(st.integers(-360, 360), st.integers(0, 360)).map(lambda arc: (arc[0], arc[0] + arc[1]))
cones = st.builds(
    Cone,
    distance=st.tuples(st.floats(0.01, 10), st.floats(0, 10)).map(lambda pair: (pair[0], pair[0] + pair[1])),
    tilt=angles,
    azimuth=arcs,
    roll=arcs,
    count=st.integers(1, 50),
    seed=st.integers(0, 2**63 - 1),
    sampling=st.sampled_from(["even", "random"]),
    weight=st.sampled_from(["1", "1/distance", "1/distance^2"]),
)


@given(cones)
def test_poses_of_a_cone_look_at_the_origin_from_within_its_ranges(cone):
    poses = of(cone)
    assert len(poses) == cone.count
    np.testing.assert_allclose(poses.rotation @ poses.rotation.swapaxes(-1, -2), np.tile(np.eye(3), (len(poses), 1, 1)),
                               atol=1e-14)  # fmt: skip
    np.testing.assert_allclose(np.linalg.det(poses.rotation), 1, atol=1e-14)
    # The origin lies on the optical axis, to the last bit.
    np.testing.assert_array_equal(poses.translation[:, :2], 0)
    slack = 1e-12 * cone.distance[1]
    assert cone.distance[0] - slack <= poses.distance.min() <= poses.distance.max() <= cone.distance[1] + slack
    x, y, z = (centers(poses) / poses.distance[:, None]).T
    # From both parts of the direction, because the cosine alone keeps half the digits near the normal.
    tilt, azimuth = np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x))
    # arccos of a cosine, which is how tilts are drawn, is off by up to 2e-8 rad at the normal.
    assert cone.tilt[0] - 2e-6 <= tilt.min() <= tilt.max() <= cone.tilt[1] + 2e-6
    beyond = np.mod(azimuth - cone.azimuth[0] + 1e-6, 360) - (cone.azimuth[1] - cone.azimuth[0]) - 2e-6
    assert np.all((beyond <= 0) | (tilt < 1e-3))


@given(cones)
def test_a_cone_as_text_reads_back(cone):
    assert Cone.parse(str(cone)) == cone
    assert str(Cone.parse(str(cone))) == str(cone)
    np.testing.assert_array_equal(named_poses(str(cone)).rotation, cone.sample()[0])


def test_ranges_are_filled_to_their_ends():
    poses = of(Cone((0.5, 2.0), (40, 70), (-15, 15), (0, 0), count=1000))
    center = centers(poses)
    azimuth = np.degrees(np.arctan2(center[:, 1], center[:, 0]))
    # An even sequence of 1000 leaves gaps of a few thousandths of the range at its ends.
    for values, low, high in ((poses.distance, 0.5, 2.0), (poses.polar_angle_deg, 40, 70), (azimuth, -15, 15)):
        assert values.min() == pytest.approx(low, abs=0.01 * (high - low))
        assert values.max() == pytest.approx(high, abs=0.01 * (high - low))


@pytest.mark.parametrize("sampling", ["even", "random"])
def test_directions_are_uniform_over_the_solid_angle(sampling):
    poses = of(Cone((1, 2), (0, 60), count=4000, sampling=sampling))
    # A uniform number has mean 1/2 and second moment 1/3; the bound is four standard deviations of random numbers.
    bound = 4 * math.sqrt(1 / 12 / 4000)
    for share in ((1 - poses.cos_tilt) / (1 - math.cos(math.pi / 3)), poses.distance - 1):
        assert np.mean(share) == pytest.approx(1 / 2, abs=bound)
        assert np.mean(share**2) == pytest.approx(1 / 3, abs=4 * math.sqrt(4 / 45 / 4000))
    flat = centers(poses)[:, :2]
    assert np.abs(np.mean(flat / np.linalg.norm(flat, axis=-1, keepdims=True), axis=0)).max() < 4 * math.sqrt(
        0.5 / 4000
    )


def test_an_even_cone_is_more_even_than_a_random_one():
    def unevenness(sampling, seed):
        poses = of(Cone((1, 2), (0, 60), (0, 360), (0, 0), count=200, seed=seed, sampling=sampling))
        share = np.sort(poses.distance - 1)
        return np.abs(share - (np.arange(200) + 0.5) / 200).max()

    worst = max(unevenness("even", seed) for seed in range(20))
    # Random numbers are off by 0.8 / sqrt(200) = 0.06 in the mean (Kolmogorov).
    assert worst < 0.03 < np.mean([unevenness("random", seed) for seed in range(20)])


def test_roll_zero_swings_the_upright_frontal_camera_over():
    frontal = of(Cone((1, 1), (0, 0), (0, 360), (0, 0), count=7))
    np.testing.assert_allclose(frontal.rotation, np.tile(np.diag([1, -1, -1]), (7, 1, 1)), atol=1e-15)
    aside = of(Cone((1, 1), (40, 40), (0, 0), (0, 0), count=1)).rotation[0]
    # From the right of an upright marker: up stays up in the image, and the marker's right side is farther away.
    np.testing.assert_allclose(aside @ [0, 1, 0], [0, -1, 0], atol=1e-15)
    tilt = math.radians(40)
    np.testing.assert_allclose(aside @ [1, 0, 0], [math.cos(tilt), 0, -math.sin(tilt)], atol=1e-15)
    rolled = of(Cone((1, 1), (40, 40), (0, 0), (90, 90), count=1)).rotation[0]
    # A quarter turn clockwise: what was up is at the right.
    np.testing.assert_allclose(rolled @ [0, 1, 0], [1, 0, 0], atol=1e-15)


def test_the_seed_decides():
    for sampling in ("even", "random"):
        first, again, other = (of(Cone(seed=seed, sampling=sampling)) for seed in (3, 3, 4))
        np.testing.assert_array_equal(first.rotation, again.rotation)
        assert not np.allclose(first.rotation, other.rotation)


def test_texts_that_mean_the_same_are_one():
    name = "cone:distance=0.6..1.5,tilt=40..70,azimuth=0..360,roll=-5..5,count=400,seed=0,sampling=even"
    for text in (
        "cone:tilt=40..70,roll=-5..5",
        " cone : roll = -5 .. 5 , tilt=40.0..7e1 ",
        "cone:distance=600mm..1500mm,tilt=40..70,azimuth=-0..360,roll=-5..5,count=0400",
        "cone:distance=60cm..1.5m,tilt=40..70,roll=-5..5",
        "cone:distance=60..150cm,tilt=40..70deg,roll=-5deg..5deg",
        "cone:distance=600 .. 1500 mm,tilt=40..70,roll=-5..5",
        "cone:distance=0.6..1.5m,tilt=40..70,roll=-5..5,sampling=even",
    ):
        assert named_poses(text).name == name
        assert Spec(poses=text) == Spec(poses=name)
        assert Spec(poses=text).hash == Spec(poses=name).hash
    assert named_poses("cone").name == str(Cone())
    assert "distance=1,tilt=20," in str(Cone.parse("cone:distance=1m,tilt=20"))
    assert Spec(poses=" paper-roll ").poses == "paper-roll"
    assert is_named("cone:whatever")
    assert not is_named("cones.csv")


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        ("cone:tilt=70..40", "a range of tilt in rising order, found tilt=70..40"),
        ("cone:azimuth=30..-30", "an arc across 0 is such as azimuth=-30..30"),
        ("cone:tilt=0..90", "values of tilt from 0 to below 90 degrees, found tilt=0..90"),
        ("cone:tilt=-1..9", "values of tilt from 0 to below 90 degrees"),
        ("cone:azimuth=0..361", "of at most a whole turn"),
        ("cone:roll=800", "of at most a whole turn between -360 and 720 degrees"),
        ("cone:distance=0..1", "distances above 0"),
        ("cone:distance=1e9", "distances above 0, of at most 1000 km"),
        ("cone:distance=-1..1", "distances above 0"),
        ("cone:distance=0.4..800mm", "a unit at both ends, found distance='0.4..800mm'"),
        ("cone:distance=6in..15", "a unit at both ends"),
        ("cone:distance=1furlong", "a length for distance"),
        ("cone:distance=nan..1", "a finite distance"),
        ("cone:distance=1..", "a length for distance"),
        ("cone:tilt=nan", "degrees for tilt"),
        ("cone:tilt=1_0", "degrees for tilt"),
        ("cone:tilt=", "degrees for tilt"),
        ("cone:tilt=1..2..3", "degrees for tilt"),
        ("cone:count=0", f"a count of 1 to {MOST_POSES} poses"),
        ("cone:count=10001", f"a count of 1 to {MOST_POSES} poses"),
        ("cone:count=1e3", "a whole number for count"),
        ("cone:count=-1", "a whole number for count"),
        ("cone:count=" + "9" * 5000, "a whole number for count"),
        ("cone:seed=9999999999999999999", "a seed from 0 to below 2^63"),
        ("cone:sampling=sobol", "known: even, random"),
        ("cone:weight=distance", "did you mean '1/distance'? Known: 1, 1/distance, 1/distance^2"),
        ("cone:tilt=1,tilt=2", "tilt once in a cone"),
        (
            "cone:angle=1",
            "a key of cone: distance, tilt, azimuth, roll, count, seed, sampling, weight, found 'angle=1'",
        ),
        ("cone:tilt", "a key of cone"),
        ("cone:tilt=1,", "a key of cone"),
        ("papr", "did you mean 'paper'?"),
        ("", "known: paper, paper-roll, cone:distance=A..B"),
        ("a\nb" * 1000, "a known pose distribution"),
    ],
)
def test_texts_that_are_no_poses(text, phrase):
    for make in (named_poses, lambda text: Spec(poses=text)):
        with pytest.raises(InputError) as caught:
            make(text)
        assert phrase in str(caught.value)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 500


@given(st.text(max_size=30).map(lambda text: "cone:" + text) | st.text("cone:tilasd=.,0123456789", max_size=40))
def test_any_text_is_a_cone_or_one_line(text):
    message = ""
    try:
        assert np.isfinite(Cone.parse(text).sample()[0]).all()
    except InputError as error:
        message = str(error)
    assert len(message.splitlines()) <= 1


def test_presets_keep_their_hash_and_their_word():
    assert Spec().hash == "2b6ca07a"
    assert Spec().as_dict()["poses"] == "paper"
    assert Spec(poses="paper-roll").as_dict()["poses"] == "paper-roll"


def looking(rotation, translation):
    return PoseDistribution("test", np.array(rotation, dtype=float), np.array(translation, dtype=float))


FRONTAL = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize(
    ("rotation", "translation", "phrase"),
    [
        (FRONTAL, [0, 0, -1], "1 behind the camera"),
        (FRONTAL, [0, 0, 0], "1 behind the camera"),
        (np.eye(3), [0, 0, 1], "1 from the back"),
        (FRONTAL, [0.5, 0, 1], "1 outside the image"),
        (FRONTAL, [0, 0, 0.1], "1 outside the image"),
        # Seen from the marker's very plane.
        ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 1], "1 from the back"),
    ],
)
def test_why_none_is_seen_is_told(rotation, translation, phrase):
    with pytest.raises(InputError) as caught:
        looking([rotation], [translation]).seen_whole(Circle(0.15), PAPER_CAMERA)
    assert f"none of 1 (test) for {sentence('disk', '150 mm')}: {phrase};" in str(caught.value)


def test_reasons_are_counted():
    rotation = [FRONTAL, FRONTAL, np.eye(3), FRONTAL, FRONTAL]
    translation = [[0, 0, -1], [9, 0, 1], [0, 0, 1], [0, 9, 1], [0, 0, 0.2]]
    with pytest.raises(InputError, match=pattern("unseen", 1, 1, 3)):
        looking(rotation, translation).seen_whole(Circle(0.15), PAPER_CAMERA)
    with pytest.raises(InputError, match=r"none of 0 \(test\)"):
        looking(np.zeros((0, 3, 3)), np.zeros((0, 3))).seen_whole(Circle(0.15), PAPER_CAMERA)


def test_a_marker_larger_than_its_distance_is_probably_a_length_without_a_unit():
    with pytest.raises(InputError, match="such as 80mm"):
        looking([FRONTAL], [[0, 0, 1]]).seen_whole(Circle(80.0), PAPER_CAMERA)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.3), st.sampled_from(["none", "radtan", "equidistant"]))
def test_what_is_kept_is_seen_at_a_thousand_points_and_what_is_dropped_is_not(seed, radius, model):
    lens = {"none": Distortion(), "radtan": Distortion("radtan", (-0.3, 0.1, 1e-3, -1e-3)),
            "equidistant": Distortion("equidistant", (0.05, 0.0, 0.0, 0.0))}  # fmt: skip
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, lens[model])
    rng = np.random.default_rng(seed)
    rotation, translation = Cone((0.3, 1.0), count=40, seed=seed % 1000).sample()
    poses = looking(rotation, translation + rng.normal(scale=0.1, size=translation.shape))
    boundary = Circle(radius)
    try:
        seen = poses.seen_whole(boundary, camera)
    except InputError:
        kept = np.zeros(40, dtype=bool)
    else:
        assert len(seen) + seen.dropped == 40
        kept = np.isin(poses.translation, seen.translation).all(axis=-1)
    fine = boundary.rim(1000)
    depth = np.einsum("pj,nj->pn", poses.rotation[:, 2, :2], fine) + poses.translation[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = camera.project(fine, poses.rotation, poses.translation)
        # Between its 64 points the rim sags by 0.12 % of the radius, of which at most 250 px are seen here.
        sag = np.array([0.5, 0.5])
        low, high = np.array([-0.5, -0.5]) - sag, np.array([639.5, 479.5]) + sag
        for_sure = np.all((pixels >= low + 2 * sag) & (pixels <= high - 2 * sag), axis=(-2, -1))
        at_best = np.all((pixels >= low) & (pixels <= high), axis=(-2, -1))
    front = np.all(depth > 0, axis=-1) & (centers(poses)[:, 2] > 0)
    assert np.all(kept[for_sure & front])
    assert not np.any(kept & ~(at_best & front))


STAR = np.array([[r * math.sin(a * math.pi / 5), r * math.cos(a * math.pi / 5)] for a, r in enumerate([0.1, 0.04] * 5)])
L = np.array([[0, 0], [0.2, 0], [0.2, 0.05], [0.05, 0.05], [0.05, 0.2], [0, 0.2]])
SQUARES = [np.array([[x, 0], [x + 0.05, 0], [x + 0.05, 0.05], [x, 0.05]]) for x in (0.0, 0.2)]


@pytest.mark.parametrize("outlines", [[STAR], [L], SQUARES])
def test_the_corners_of_any_shape_count(outlines):
    boundary = polygon_from([outline[::-1] for outline in outlines])
    points = silhouette(boundary)
    corners = np.concatenate(boundary.outlines())
    hull_corners = [corner for corner in corners if np.linalg.norm(corner) > 0.95 * boundary.radius]
    assert hull_corners
    for corner in hull_corners:
        assert np.linalg.norm(points - corner, axis=-1).min() < 1e-12
    # By a hair: the corner farthest to the right is at the edge of the sensor, at 640.5 px.
    focal = 320.5 / max(corner[0] for corner in corners)
    pose = looking([FRONTAL], [[0, 0, 1]])
    assert len(pose.seen_whole(boundary, Camera(641, 5001, focal * (1 - 1e-9), focal, 320.0, 2500.0))) == 1
    with pytest.raises(InputError, match="1 outside the image"):
        pose.seen_whole(boundary, Camera(641, 5001, focal * (1 + 1e-9), focal, 320.0, 2500.0))


def test_a_round_rim_stands_for_itself():
    # What was seen of a disk before there were other shapes is seen still: presets keep their markers.
    np.testing.assert_array_equal(silhouette(Circle(0.15)), Circle(0.15).rim(64))
    counts = {radius: paper().seen_whole(Circle(radius), PAPER_CAMERA).dropped for radius in (0.15, 0.25, 0.35)}
    assert counts == {0.15: 0, 0.25: 100, 0.35: 240}


def test_beyond_what_the_lens_model_covers_nothing_is_seen():
    # k1 = -0.5 turns over at r = 0.82, well within this wide image.
    camera = Camera(2000, 2000, 500.0, 500.0, 1000.0, 1000.0, Distortion("radtan", (-0.5, 0.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="1 beyond what the lens"):
        looking([FRONTAL], [[1.0, 0, 1]]).seen_whole(Circle(0.05), camera)
    assert len(looking([FRONTAL], [[1.0, 0, 1]]).seen_whole(Circle(0.05), camera.ideal)) == 1


def recorded(rotation, translation, name="poses.csv", sha256="0" * 64):
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return RecordedPoses.of(np.concatenate([translation, quaternion], axis=-1), name, sha256)


@pytest.mark.parametrize(
    ("mistake", "phrase"),
    [
        (lambda r, t: (r.swapaxes(1, 2), -np.einsum("pji,pj->pi", r, t)), "held their inverses"),
        (lambda r, t: (FRONTAL @ r, t @ FRONTAL), "were for a camera frame with y up and z backward"),
        (
            lambda r, t: ((FRONTAL @ r).swapaxes(1, 2), -np.einsum("pji,pj->pi", r, t)),
            "held inverses for a camera frame with y up and z backward",
        ),
        (lambda r, t: (r @ FRONTAL, t), "were for a marker frame with y down and z into the face"),
    ],
)
def test_poses_that_are_meant_the_other_way_are_recognized(mistake, phrase):
    # Less tilted poses see the marker either way.
    rotation, translation = Cone((0.8, 1.5), (35, 50), count=50).sample()
    boundary = Circle(0.05)
    assert len(recorded(rotation, translation).seen_whole(boundary, PAPER_CAMERA)) == 50
    with pytest.raises(InputError) as caught:
        recorded(*mistake(rotation, translation)).seen_whole(boundary, PAPER_CAMERA)
    assert sentence("seen if", phrase) in str(caught.value)
    # A preset or a cone cannot be the wrong way round.
    with pytest.raises(InputError, match="use a smaller marker"):
        looking(*mistake(rotation, translation)).seen_whole(boundary, PAPER_CAMERA)


def test_poses_of_which_few_see_the_marker_raise_a_doubt():
    rotation, translation = Cone((0.8, 1.5), (10, 50), count=200).sample()
    back = recorded(rotation.swapaxes(1, 2), -np.einsum("pji,pj->pi", rotation, translation))
    seen = back.seen_whole(Circle(0.05), PAPER_CAMERA)
    assert 0 < len(seen) < 100
    assert seen.doubt == f"most poses do not see the whole marker; {sentence('seen if', 'held their inverses')}"
    assert not recorded(rotation, translation).seen_whole(Circle(0.05), PAPER_CAMERA).doubt
    # Half of these are too near: nothing is wrong with them.
    nearby = recorded(*Cone((0.05, 0.6), (10, 50), count=200).sample()).seen_whole(Circle(0.15), PAPER_CAMERA)
    assert 0 < len(nearby) < 100
    assert not nearby.doubt


def test_of_too_many_poses_a_sample_is_kept():
    rotation, translation = Cone(count=5000).sample()
    poses = recorded(rotation, translation)
    seen = poses.seen_whole(Circle(0.3), PAPER_CAMERA)
    everything = looking(rotation, translation).seen_whole(Circle(0.3), PAPER_CAMERA)
    assert len(everything) > MOST_KEPT == len(seen)
    assert seen.dropped == everything.dropped == 5000 - seen.sampled_from
    assert seen.name == f"poses.csv, a sample of {len(everything)}"
    np.testing.assert_array_equal(seen.rotation, poses.seen_whole(Circle(0.3), PAPER_CAMERA).rotation)
    # A sample of the seen ones, in their order, with numbers that belong to the poses.
    results = [np.flatnonzero((poses.numbers == row).all(axis=1))[0] for row in seen.numbers[::100]]
    assert results == sorted(results)
    np.testing.assert_array_equal(poses.rotation[results], seen.rotation[::100])
    # Looked at again, nothing more is lost, and nothing is forgotten.
    again = seen.seen_whole(Circle(0.3), PAPER_CAMERA)
    assert (again.name, again.dropped, again.sampled_from) == (seen.name, seen.dropped, seen.sampled_from)
    np.testing.assert_array_equal(again.numbers, seen.numbers)


def test_a_spec_is_told_apart_by_what_is_in_the_file():
    rotation, translation = Cone(count=5).sample()
    spec = Spec(poses=recorded(rotation, translation))
    renamed = Spec(poses=recorded(rotation, translation, "other.csv"))
    changed = Spec(poses=recorded(rotation, translation, sha256="1" * 64))
    assert spec == renamed
    assert spec.hash == renamed.hash
    assert spec != changed
    assert spec.hash != changed.hash
    assert spec != Spec()
    assert len({spec, renamed, changed}) == 2
    assert spec.as_dict()["poses"]["file"] == "poses.csv"


def test_poses_count_by_their_distance():
    poses = named_poses("cone:distance=0.5..8,count=50,weight=1/distance^2")
    np.testing.assert_allclose(poses.weight * poses.distance**2, 1.0)
    subset = poses.taken(np.array([3, 7]), 0)
    np.testing.assert_array_equal(subset.weight, poses.weight[[3, 7]])
    assert named_poses(poses.name).name == poses.name
    assert named_poses("cone:weight=1").weight is None
