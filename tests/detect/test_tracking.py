"""The frame before decides only where tracking looks, and the whole frame has the last word."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from markergen_detect import Detector as Engine

from markergen.detect import Detector
from markergen.errors import InputError
from markergen.maths.rotation import exponential
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import paper_roll
from markergen.model.tag import parse_tag
from markergen.render import Optics, render_view

POSES = paper_roll()
BARREL = replace(PAPER_CAMERA, distortion=Distortion("radtan", (-0.28, 0.09, 0.001, -0.0005, 0.0)))
FISHEYE = replace(PAPER_CAMERA, fx=500.0, fy=500.0, distortion=Distortion("equidistant", (-0.02, 0.005, 0, 0)))
SAME_PX = 0.02
"""Maximum distance of a tracked dot from that of the whole frame: the same grey levels, from another start."""


def sized(scale):
    return Camera(int(640 * scale), int(480 * scale), 800 * scale, 800 * scale, 320 * scale, 240 * scale)


def walk(camera, pose, frames, seed, px=10.0, degrees=2.0):
    """Yield poses: each moves by up to so many px across and as much along, and turns by up to so many degrees."""
    rng = np.random.default_rng([seed, pose])
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    for _ in range(frames):
        yield rotation, translation
        axis = rng.standard_normal(3)
        angle = np.deg2rad(degrees) * rng.random() * axis / np.linalg.norm(axis)
        rotation = exponential(angle[None])[0] @ rotation
        translation = translation + rng.uniform(-1, 1, 3) * px / camera.fx * translation[2]


def view(marker, camera, pose, seed=0, optics=None):
    return render_view(marker, camera, *pose, optics or Optics(), np.random.default_rng(seed))


def placed(result, rotation, translation):
    """Return a result with another pose, as an outdated or a wrong one has."""
    place = result.finding.placed.copy()
    place["R"], place["t"] = rotation.ravel(), translation
    return replace(result, finding=result.finding._replace(placed=place))


def turned(angle):
    return exponential(np.array([[0, 0, angle]]))[0]


def same(finding, other, limit=SAME_PX):
    """Check that two results for one frame agree; return their largest distance in px."""
    assert (finding.ok, finding.index, finding.ids.tolist()) == (other.ok, other.index, other.ids.tolist())
    assert finding.reason == other.reason
    away = float(np.abs(finding.pixels - other.pixels).max(initial=0))
    assert away < limit
    return away


@pytest.fixture
def searched(monkeypatch):
    """Count the searches of whole frames."""
    calls, original = [], Engine.__call__

    def count(*arguments, **options):
        results = original(*arguments, **options)
        if not (results and all(finding.tracked for finding in results)):
            calls.append(1)
        return results

    monkeypatch.setattr(Engine, "__call__", count)
    return calls


@pytest.mark.parametrize(
    ("camera", "pose"),
    [(PAPER_CAMERA, 130), (BARREL, 3), (FISHEYE, 200), (sized(0.5), 350), (sized(2.5), 20), (None, 130)],
    ids=["plain", "barrel", "fisheye", "small", "large", "no camera"],
)
def test_every_frame_of_a_motion_is_as_from_the_whole_frame(irregular, searched, camera, pose):
    finder, lens = Detector(irregular, camera), camera or PAPER_CAMERA
    findings = None
    for k, place in enumerate(walk(lens, pose, 3, seed=1)):
        frame = view(irregular, lens, place, seed=k)
        findings, whole = finder(frame, near=findings), finder(frame)
        # Of dots of more than 32 px, blocks of pixels are averaged: their edges are known a little less well.
        same(findings[0], whole[0], SAME_PX * max(1, lens.width / 640))
        assert findings[0].ok
        if camera is not None:
            sigma = np.sqrt(np.diag(whole[0].pose.budget.total))
            assert (np.abs(findings[0].translation - whole[0].translation) < 0.5 * sigma[3:]).all()
    # The first frame, and each once for comparison.
    assert len(searched) == 4


def test_light_dots_are_tracked_too(irregular, searched):
    points = irregular.control_points
    light = tuple(replace(point, feature=replace(point.feature, polarity="light")) for point in points)
    marker, findings = replace(irregular, control_points=light), None
    finder = Detector(marker, PAPER_CAMERA)
    for k, place in enumerate(walk(PAPER_CAMERA, 130, 2, seed=1)):
        frame = view(marker, PAPER_CAMERA, place, seed=k)
        findings = finder(frame, near=findings)
        assert findings[0].ok
    assert len(searched) == 1
    same(findings[0], finder(frame)[0])


def test_colors_and_depth_do_not_matter(pentagon, searched):
    finder = Detector(pentagon, PAPER_CAMERA)
    first, second = (view(pentagon, PAPER_CAMERA, place) for place in walk(PAPER_CAMERA, 77, 2, seed=0))
    before = finder(first)
    (grey,) = finder(second, near=before)
    color = np.stack([second, second, second], axis=-1)
    for frame in (color, color[::-1][::-1], np.dstack([color, np.full_like(second, 255)]), second[..., None]):
        (finding,) = finder(frame, near=before)
        np.testing.assert_array_equal(finding.pixels, grey.pixels)
    (deep,) = finder((second.astype(np.uint16) * 257).astype(">u2"), near=before)
    # A fit ends when its steps are under 0.002 px.
    np.testing.assert_allclose(deep.pixels, grey.pixels, atol=5e-3)
    assert len(searched) == 1
    # The weights of the colors are those of a whole frame.
    rng = np.random.default_rng(0)
    tinted = np.clip(color * [0.7, 0.9, 0.8] + rng.integers(0, 20, 3), 0, 255).astype(np.uint8)
    (finding,) = finder(tinted, near=before)
    (other,) = finder(cv2.cvtColor(tinted, cv2.COLOR_BGR2GRAY), near=before)
    np.testing.assert_array_equal(finding.pixels, other.pixels)


def test_a_wrong_pose_changes_nothing(irregular, searched):
    """Poses from anywhere: the result is that of the whole frame, or, if the marker happens to be there, its equal."""
    finder = Detector(irregular, PAPER_CAMERA)
    frame = view(irregular, PAPER_CAMERA, (POSES.rotation[100], POSES.translation[100]))
    (whole,) = finder(frame)
    behind = placed(whole, whole.rotation, -whole.translation)
    beside = placed(whole, whole.rotation, whole.translation + [5.0, 0, 0])
    away = [placed(whole, POSES.rotation[k], POSES.translation[k]) for k in (0, 210, 399)]
    quarters = [placed(whole, whole.rotation @ turned(np.pi / 2 * k), whole.translation) for k in (1, 2, 3)]
    for nearby in (behind, beside, *away, *quarters):
        same(finder(frame, near=nearby)[0], whole)
    # The first frame, and poses from which nothing would be seen; the others have it in their windows.
    assert 3 <= len(searched) <= 9


@pytest.mark.parametrize("rings", [(0,), ()], ids=["ring", "no ring"])
def test_a_turn_of_a_nearly_regular_marker_does_not_carry_its_labels_along(make, rings):
    """Turned by a fifth, dots are where others were, to a few px; without a ring nothing but that tells them apart."""
    angle = 2 * np.pi * np.arange(5) / 5
    points = 0.12 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points[2] *= 0.93
    marker = make(points, rings=rings)
    finder = Detector(marker, PAPER_CAMERA)
    frame = view(marker, PAPER_CAMERA, (POSES.rotation[60], POSES.translation[60]))
    (whole,) = finder(frame)
    assert whole.ok
    for k in range(1, 5):
        nearby = placed(whole, whole.rotation @ turned(2 * np.pi * k / 5), whole.translation)
        same(finder(frame, near=nearby)[0], whole)


def test_an_ambiguous_marker_stays_ambiguous(ngon):
    """Only the first frame has the ring: then its labels are remembered by nobody."""
    marker = ngon(6)
    finder = Detector(marker, PAPER_CAMERA)
    place = POSES.rotation[130], POSES.translation[130]
    before = finder(view(marker, PAPER_CAMERA, place))
    covered = view(replace(marker, control_points=marker.control_points[1:]), PAPER_CAMERA, place)
    assert before[0].ok
    same(finder(covered, near=before)[0], finder(covered)[0])


def test_a_marker_that_leaves_is_looked_for_until_it_is_back(irregular, searched):
    finder = Detector(irregular, PAPER_CAMERA)
    frame = view(irregular, PAPER_CAMERA, (POSES.rotation[100], POSES.translation[100]))
    empty = np.full_like(frame, 200)
    findings = finder(frame)
    output = finder(empty)[0].reason
    searched.clear()
    for seen, searches in ((frame, 0), (empty, 1), (empty, 2), (frame, 3), (frame, 3)):
        findings = finder(seen, near=findings)
        assert findings[0].ok == (seen is frame)
        assert findings[0].reason == ("" if seen is frame else output)
        assert len(searched) == searches


def test_occluded_dots_and_those_beyond_the_edge_may_be_missing(irregular, searched):
    finder = Detector(irregular, PAPER_CAMERA)
    place = POSES.rotation[100], POSES.translation[100]
    frame = view(irregular, PAPER_CAMERA, place)
    (finding,) = finder(frame)
    x, y = np.rint(finding.pixels[2]).astype(int)
    covered = frame.copy()
    covered[y - 20 : y + 21, x - 20 : x + 21] = 90
    nearby = finder(covered, near=finding)
    assert nearby[0].ok
    assert finding.ids[2] not in nearby[0].ids
    same(nearby[0], finder(covered)[0])
    (back,) = finder(frame, near=nearby)
    same(back, finding)
    assert len(searched) == 2


def test_several_markers_and_copies(irregular, make, searched):
    """Two copies and another marker; when one copy is gone, or takes the other's place, the whole frame is searched."""
    other = make([(-y, x) for x, y in ((0.1, 0.1), (-0.11, 0.08), (-0.02, -0.1), (0.03, 0.02), (0.12, -0.06))])
    wide = replace(PAPER_CAMERA, width=1400, height=320, cx=700.0, cy=160.0)
    finder = Detector([irregular, other], wide)
    up = np.diag([1.0, -1.0, -1.0])

    def scene(*printed):
        frames = [view(marker, wide, (up, np.array([x, 0.02, 1.0]))) for marker, x in printed]
        light = np.max(np.stack([np.where(f < 120, 0, 1) for f in frames]) * 0, axis=0)
        for frame in frames:
            light = np.maximum(light, 255 - frame)
        return (255 - light).astype(np.uint8)

    first = scene((irregular, -0.5), (irregular, 0.0), (other, 0.5))
    findings = finder(first)
    assert sorted(frame.index for frame in findings if frame.ok) == [0, 0, 1]
    searched.clear()
    second = scene((irregular, -0.49), (irregular, 0.01), (other, 0.49))
    again = finder(second, near=findings)
    assert not searched
    for one in finder(second):
        nearest = min(again, key=lambda frame: np.linalg.norm(frame.translation - one.translation))
        same(nearest, one)
    searched.clear()
    gone = scene((irregular, -0.49), (other, 0.49))
    left = finder(gone, near=again)
    assert sorted(frame.index for frame in left if frame.ok) == [0, 1]
    assert len(searched) == 1
    # Both copies of the frame before are nearest to the one that is left.
    copies = [frame for frame in again if frame.index == 0]
    twice = [copies[0], placed(copies[1], copies[0].rotation, copies[0].translation)]
    assert sum(frame.index == 0 and frame.ok for frame in finder(second, near=twice)) == 2
    assert len(searched) == 2


def test_a_tag_tells_the_member_of_a_family(make, searched):
    """Another member of the family in its place is never taken for the marker, whether it is looked for or not."""
    angle = 2 * np.pi * (np.arange(6) + 0.3) / 6
    points = 0.125 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    plain = make(points, rings=(), diameter=0.03)
    family = [replace(plain, tag=parse_tag(f"aruco:DICT_4X4_50:{k}", 0.09)) for k in (3, 7)]
    places = list(walk(PAPER_CAMERA, 100, 2, seed=3))
    finder = Detector(family, PAPER_CAMERA)
    before = [item for item in finder(view(family[0], PAPER_CAMERA, places[0])) if item.ok]
    assert [item.index for item in before] == [0]
    searched.clear()
    (finding,) = finder(view(family[0], PAPER_CAMERA, places[1]), near=before)
    assert finding.ok
    assert not searched
    (whole, _) = finder(view(family[0], PAPER_CAMERA, places[1]))
    same(finding, whole)
    assert np.abs(finding.tag - whole.tag).max() < 0.1
    swapped = view(family[1], PAPER_CAMERA, places[1])
    assert [(item.index, item.ok) for item in finder(swapped, near=before)] == [(1, True), (0, False)]
    alone = Detector(family[0], PAPER_CAMERA)
    for one, other in zip(alone(swapped, near=before), alone(swapped), strict=True):
        same(one, other)


def test_a_part_of_another_marker_is_not_taken_for_it(irregular, make):
    """The larger marker has all dots of the smaller one, and has taken its place since the frame before."""
    points = irregular.xyz[:, :2]
    larger = make([*points, (0.12, -0.08), (-0.13, 0.0)])
    finder = Detector([irregular, larger], PAPER_CAMERA)
    place = POSES.rotation[100], POSES.translation[100]
    before = [item for item in finder(view(irregular, PAPER_CAMERA, place)) if item.ok]
    assert [item.index for item in before] == [0]
    findings = [item for item in finder(view(larger, PAPER_CAMERA, place), near=before) if item.ok]
    assert [(item.index, len(item.ids)) for item in findings] == [(1, 8)]


def test_what_near_may_be(irregular, pentagon, searched):
    finder = Detector(irregular, PAPER_CAMERA)
    frame = view(irregular, PAPER_CAMERA, (POSES.rotation[100], POSES.translation[100]))
    findings = finder(frame)
    searched.clear()
    for nearby in (findings, findings[0], tuple(findings), iter(findings)):
        assert finder(frame, near=nearby)[0].ok
    assert not searched
    # Of another detector, whose numbers of markers differ.
    both = Detector([pentagon, irregular], PAPER_CAMERA)
    assert [item.index for item in both(frame, near=findings)] == [1]
    assert not searched
    for nearby in (None, [], ()):
        assert finder(frame, near=nearby)[0].ok
    assert len(searched) == 3
    for nearby, message in ((frame, "results for the frame before"), (3, "found 3"), (both(frame), "one for marker 0")):
        with pytest.raises(InputError, match=message):
            finder(frame, near=nearby)
    with pytest.raises(InputError, match="of the camera's"):
        finder(frame[:100], near=findings)


def drawn_at_random(make, rng):
    """A marker of 5 to 12 dots at random places, with or without a key ring."""
    count, points = int(rng.integers(5, 13)), []
    diameter = rng.uniform(0.02, 0.032)
    while len(points) < count:
        point = rng.uniform(-0.13, 0.13, 2)
        if np.hypot(*point) < 0.13 and all(np.hypot(*(point - item)) > 1.15 * diameter for item in points):
            points.append(point)
    return make(points, rings=(0,) if rng.random() < 0.6 else (), diameter=diameter)


def labels_are_right(result, camera, pose):
    """Return whether each dot is nearer to its own place than to any other dot's; covered ones may be off by pixels."""
    places = camera.project(result.marker.xyz, pose[0][None], pose[1][None])[0]
    ids = np.array([point.id for point in result.marker.control_points])
    nearest = np.linalg.norm(result.pixels[:, None] - places, axis=-1).argmin(axis=1)
    return np.array_equal(ids[nearest], result.ids)


@pytest.mark.long
def test_many_motions(make, searched):
    """Noise, blur, light from the side, occluded dots: 2,000 frames, of which some 400 are searched as a whole."""
    frames, lost, fewer, differences = 0, 0, 0, []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        marker, camera = drawn_at_random(make, rng), sized(rng.choice([0.5, 1, 1, 1.5]))
        optics = Optics(
            blur_px=rng.uniform(0.4, 1.4), noise_grey=rng.choice([0.5, 2, 5]), gradient=rng.choice([0, 0.5]),
            motion_px=rng.choice([0, 3]), motion_deg=rng.uniform(0, 180),
        )  # fmt: skip
        finder, finding = Detector(marker, camera), None
        for k, pose in enumerate(walk(camera, int(rng.integers(400)), 20, seed)):
            frame = view(marker, camera, pose, seed=[seed, k], optics=optics)
            covered = 8 <= k < 12 and seed % 2 == 1
            if covered:
                for x, y in camera.project(marker.xyz[:2], pose[0][None], pose[1][None])[0]:
                    corner = np.array([x, y]) + rng.uniform(-20, 0, 2)
                    cv2.rectangle(frame, corner.astype(int), (corner + 20).astype(int), float(rng.integers(255)), -1)
            (whole,) = finder(frame)
            searched.clear()
            (tracked,) = finder(frame, near=finding)
            assert tracked.ok >= whole.ok
            if tracked.ok:
                assert labels_are_right(tracked, camera, pose), (seed, k)
                common = np.isin(whole.ids, tracked.ids)
                at = np.isin(tracked.ids, whole.ids)
                sigma = np.sqrt(np.trace(whole.pixel_covariance[common], axis1=1, axis2=2))
                away = np.linalg.norm(tracked.pixels[at] - whole.pixels[common], axis=-1)
                # The same grey levels, but for the estimates of noise and slope of the light. Of half covered dots,
                # these decide what is left out of the outline, or whether its fit is refused.
                if not covered:
                    differences.append(away)
                    assert (away < 0.3 + 3 * sigma).all(), (seed, k)
                frames, fewer = frames + 1, fewer + (len(tracked.ids) < len(whole.ids))
                lost += bool(searched) and finding is not None and finding.ok
            finding = tracked
    assert np.percentile(np.concatenate(differences), 99) < SAME_PX
    # Where dots leave the image or are covered.
    assert frames > 1700
    assert lost < 0.1 * frames
    assert fewer < 0.05 * frames


@pytest.mark.long
def test_many_wrong_poses(make, ngon):
    """Results of other frames, turned and moved, and nearly regular markers: never a wrong label."""
    output = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        marker = drawn_at_random(make, rng)
        if seed % 3 == 0:
            regular = ngon(int(rng.integers(5, 9))).xyz[:, :2]
            regular[1] *= rng.uniform(0.85, 0.97)
            marker = make(regular, rings=(0,) if seed % 2 else ())
        finder, count = Detector(marker, PAPER_CAMERA), len(marker.control_points)
        pose = POSES.rotation[rng.integers(400)], POSES.translation[rng.integers(400)]
        frame = view(marker, PAPER_CAMERA, pose, seed=seed)
        (whole,) = finder(frame)
        if not whole.ok:
            continue
        for _ in range(8):
            k = int(rng.integers(400))
            rotation, translation = whole.rotation, whole.translation
            if rng.random() < 0.3:
                rotation, translation = POSES.rotation[k], POSES.translation[k]
            angle = 2 * np.pi * rng.integers(count) / count + rng.normal(0, 0.02)
            offset = rng.normal(0, 0.02, 3) * translation[2]
            (finding,) = finder(frame, near=placed(whole, rotation @ turned(angle), translation + offset))
            assert finding.ok
            assert labels_are_right(finding, PAPER_CAMERA, pose), seed
            output += 1
    assert output > 800


@pytest.mark.long
def test_two_copies_that_cross(irregular):
    """One passes in front of the other; each keeps its labels, and two results are never of one copy."""
    finder, seen = Detector(irregular, PAPER_CAMERA), 0
    up = np.diag([1.0, -1.0, -1.0])
    rim = 0.15 * np.stack(
        [np.cos(np.linspace(0, 2 * np.pi, 60)), np.sin(np.linspace(0, 2 * np.pi, 60)), np.zeros(60)], 1
    )
    for seed in range(10):
        rng, findings = np.random.default_rng(seed), []
        behind, before = (up @ turned(angle) for angle in rng.uniform(-3, 3, 2))
        for x in np.linspace(-0.45, 0.45, 80):
            poses = (behind, np.array([-x, 0.05, 1.5])), (before, np.array([x, -0.03, 1.4]))
            frame, over = (view(irregular, PAPER_CAMERA, pose, seed=seed) for pose in poses)
            plate = np.zeros_like(frame)
            outline = PAPER_CAMERA.project(rim, poses[1][0][None], poses[1][1][None])[0]
            cv2.fillPoly(plate, [np.rint(outline).astype(np.int32)], 1)
            frame = np.where(plate > 0, over, frame)
            # A copy that comes back is noticed by a search of the whole frame.
            findings = finder(frame, near=findings if len(findings) == 2 else None)
            printed = [item for item in findings if item.ok]
            assert printed
            for item in printed:
                assert any(labels_are_right(item, PAPER_CAMERA, pose) for pose in poses), (seed, x)
            if len(printed) == 2:
                assert np.linalg.norm(printed[0].translation - printed[1].translation) > 0.05
                seen += 1
    assert seen > 300
