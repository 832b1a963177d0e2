"""How safely dots are distinguished: known layouts, poses, what noise really does, and the search for near rivals."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from sentences import sentence

from markergen.bounds.confusion.perspective import find_rivals, label_safety, representative, safety_of
from markergen.bounds.confusion.rival_fits import seen_layout
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.feature import Feature
from markergen.model.poses import named_poses, paper
from markergen.objectives import Setting
from markergen.objectives.criteria import regular_polygon

CIRCLE = Circle(0.15)
FEW = Setting(CIRCLE, PAPER_CAMERA, named_poses("cone:distance=0.6..1.5,tilt=0..65,count=12,seed=0"))


def without_ring(marker):
    points = tuple(replace(point, feature=Feature(point.feature.diameter)) for point in marker.control_points)
    return replace(marker, control_points=points)


def test_a_pentagon_of_equal_dots_is_ambiguous(pentagon):
    report = label_safety(without_ring(pentagon), FEW)
    np.testing.assert_allclose(report.px, 0, atol=1e-4)
    assert report.sentences == (report.sentence,)
    assert "ambiguous" in report.sentence
    assert report.cycles(report.worst)
    np.testing.assert_allclose(report.undecided, 1)
    np.testing.assert_allclose(report.margin, 0, atol=1e-6)
    assert not report.is_decided


def test_its_key_ring_makes_it_safe(pentagon, setting):
    report = label_safety(pentagon, setting)
    # 7.5 px where the far one is seen at 70 degrees, some 160 px long and 55 px wide.
    assert report.least > 5
    assert np.isinf(report.px[0])
    np.testing.assert_array_equal(report.labels[0], np.arange(5))
    assert report.poses.polar_angle_deg[report.pose[report.worst]] == pytest.approx(70)
    assert "tilt 70 deg" in report.sentences[0]
    results = report.as_dict()
    assert results["dots"][0] == {"id": 0, "px": None}
    assert (results["least_px"], results["noise_px"]) == (report.least, 0.2)
    assert report.undecided.max() == 0
    assert report.margin[0] == np.inf
    assert results["margin"] == report.margin[1:].min()
    assert report.in_words(0) == ""


def test_a_raised_dot_can_be_told_apart(pentagon):
    flat = without_ring(pentagon)
    raised = replace(flat.control_points[2], z=0.05)
    marker = replace(flat, control_points=(*flat.control_points[:2], raised, *flat.control_points[3:]))
    oblique = replace(FEW, poses=named_poses("cone:distance=0.8,tilt=40..60,count=8,seed=0"))
    assert label_safety(marker, oblique).least > 1


def test_safety_in_pixels_grows_with_the_focal_length(make_marker):
    points = np.array([[0.12, 0.0], [0.02, 0.11], [-0.1, 0.06], [-0.08, -0.09], [0.03, -0.05]])
    marker = without_ring(make_marker(points, 0.15, 0.02))
    once = label_safety(marker, FEW)
    twice = label_safety(marker, replace(FEW, camera=replace(PAPER_CAMERA, fx=1600.0, fy=1600.0)))
    # Of the least safe dot: the others' rivals may be at the limit of the tilt, whose price is in px.
    assert twice.least == pytest.approx(2 * once.least, rel=1e-6)
    assert 0.5 < once.least < 10


def test_two_close_dots_are_the_least_safe_and_named_by_their_ids(make_marker):
    points = np.array([[0.12, 0.0], [0.02, 0.11], [-0.1, 0.06], [-0.08, -0.09], [-0.055, -0.09], [0.1, -0.06]])
    marker = without_ring(make_marker(points, 0.15, 0.02))
    renamed = tuple(replace(point, id=point.id + 10) for point in marker.control_points)
    report = label_safety(replace(marker, control_points=renamed), FEW)
    assert report.worst == 3
    assert report.cycles(3) == ((13, 14),)
    assert report.in_words(3) == "13 and 14 exchanged"
    assert "13 and 14 exchanged" in report.sentence
    by_id = {
        dot["id"]: dot for dot in label_safety(replace(marker, control_points=renamed), FEW, 1.0).as_dict()["dots"]
    }
    assert by_id[13]["rival"] == {"13": 14, "14": 13}
    assert by_id[13]["undecided"] == max(dot["undecided"] for dot in by_id.values())
    assert by_id[13]["margin"] == min(dot["margin"] for dot in by_id.values())
    # An exchange moves two of six images by the distance between them: at most sqrt(2/6)/2 of it, less by the fit.
    seen = PAPER_CAMERA.project(points[3:5], FEW.poses.rotation, FEW.poses.translation)
    least = np.linalg.norm(seen[:, 0] - seen[:, 1], axis=-1).min()
    assert 0.2 * np.sqrt(2 / 6) / 2 * least < report.least < np.sqrt(2 / 6) / 2 * least * 1.001


def test_dots_that_all_differ_are_safe():
    points = np.array([[0.1, 0.0], [0.01, 0.1], [-0.1, 0.01], [0.0, -0.09]])
    report = safety_of(seen_layout(points, np.arange(4), PAPER_CAMERA, FEW.poses))
    assert np.isinf(report.px).all()
    assert report.sentences == (sentence("labels safe"),)
    assert report.as_dict()["least_px"] is None


def test_twenty_dots(make_marker):
    points = Circle(0.15).sample(20, 0.02, np.random.default_rng(3))
    report = label_safety(make_marker(points, 0.15, 0.01), FEW)
    assert np.isfinite(report.px[1:]).all()
    # No exchange of two equal dots is nearer than the nearest that was found.
    scene = seen_layout(points, np.array([1] + [0] * 19), PAPER_CAMERA, FEW.poses)
    pose = int(report.pose[report.worst])
    first, second = np.triu_indices(19, 1)
    labelings = np.tile(np.arange(20), (len(first), 1))
    rows = np.arange(len(first))
    labelings[rows, first + 1], labelings[rows, second + 1] = second + 1, first + 1
    assert report.least <= scene.fit(labelings, np.full(len(first), pose)).px.min() * (1 + 1e-6)


def test_longer_cycles_in_words(pentagon):
    report = label_safety(pentagon, FEW)
    rotated = replace(report, labels=np.tile([1, 2, 0, 4, 3], (5, 1)))
    assert rotated.in_words(0) == sentence("exchanged", "0, 1, 2, 0", 3, 4)
    many = replace(report, px=np.ones(12), ids=tuple(range(12)), labels=np.tile(np.roll(np.arange(12), -1), (12, 1)))
    assert many.in_words(0) == sentence("many exchanged", 12)


def test_of_several_rivals_that_are_equally_near_all_are_followed():
    """A layout that was made as safe as demanded: its nearest rival is near where the camera is near, too."""
    points = 1e-3 * np.array([[-120.89, 43.28], [-100.92, -79.38], [7.95, -128.15], [128.4, 0.67], [6.22, 128.25]])
    poses = named_poses("paper").taken(np.arange(0, 400, 2), 0)
    scene = seen_layout(points, np.zeros(5, dtype=np.intp), PAPER_CAMERA, poses)
    labelings = np.array([np.roll(np.arange(5), k) for k in range(1, 5)])
    every = scene.fit(np.repeat(labelings, len(poses), axis=0), np.tile(np.arange(len(poses)), 4))
    assert safety_of(scene).least <= every.px.min() * (1 + 1e-6)


POSES = named_poses("cone:distance=0.7..1.4,tilt=0..65,count=3,seed=2")


def per_dot(rivals):
    return np.where(rivals.moved, rivals.px[:, None], np.inf).min(axis=0)


@pytest.mark.parametrize("n", [4, 5, 6])
@pytest.mark.parametrize("ring", [False, True])
def test_the_search_finds_the_nearest_of_all_permutations(n, ring):
    rng = np.random.default_rng(10 * n + ring)
    kinds = np.zeros(n, dtype=np.intp)
    kinds[0] = ring
    layouts = [Circle(0.15).sample(n, 0.01, rng), regular_polygon(n, 0.13) + rng.normal(scale=0.01, size=(n, 2))]
    labelings = np.array(list(permutations(range(n))))[1:]
    labelings = labelings[(kinds[labelings] == kinds).all(axis=-1)]
    for points in layouts:
        scene = seen_layout(points, kinds, PAPER_CAMERA, POSES)
        result = find_rivals(scene, np.arange(len(POSES)))
        assert (kinds[result.labeling] == kinds).all()
        for pose in range(len(POSES)):
            every = scene.fit(labelings, np.full(len(labelings), pose))
            mine = result.take(np.flatnonzero(result.pose == pose))
            assert mine.distance.min() == pytest.approx(every.distance.min(), rel=1e-6)
            # Far ones end at the limit of the tilt, where a fit that starts elsewhere can end a little lower.
            assert np.all(per_dot(mine) <= 1.03 * per_dot(every))


def test_a_turn_by_one_place_is_found_among_many_dots():
    points = regular_polygon(24, 0.13)
    points[0] *= 0.99
    scene = seen_layout(points, np.zeros(24, dtype=np.intp), PAPER_CAMERA, POSES)
    result = find_rivals(scene, np.array([0]))
    shifts = np.mod(result.labeling - np.arange(24), 24)
    assert (shifts == shifts[:, :1]).all(axis=-1).any()
    assert result.px.min() < 0.2


def test_representative_poses_are_far_from_each_other_and_no_turn_counts():
    poses = paper()
    assert len(representative(poses, 12)) == 12
    # 80 of the 400 are four frontal views, turned: 4 + 320 differ.
    assert len(representative(poses, 400)) == 324
    first = representative(poses, 1)[0]
    assert poses.polar_angle_deg[first] == pytest.approx(70)
    assert poses.distance[first] == pytest.approx(1.5)
