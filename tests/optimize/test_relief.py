from dataclasses import replace

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.body_json import from_json, to_json
from markergen.model.boundary import Circle
from markergen.model.occlusion import eyes_of, hidden
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES
from markergen.optimize import relief
from markergen.optimize.design import design
from markergen.optimize.problem import FeasibleRegion, breach, check
from markergen.optimize.relief import ReliefRoom, polish_relief, relief_breach, search_relief

ONE_SIDED = "cone:distance=0.6..1.5,tilt=40..70,azimuth=-30..30,count=6"
QUICK = Spec(n=6, dot=0.03, relief=0.02, restarts=1, poses=ONE_SIDED)


@pytest.fixture
def room(setting):
    return ReliefRoom(FeasibleRegion(Circle(0.15), 0.03, 0.003), 0.05, eyes_of(setting.poses))


def some_layout(room, n=6, seed=0):
    rng = np.random.default_rng(seed)
    return np.column_stack([room.region.sample(1, n, rng)[0], room.height * rng.uniform(0, 1, n)])


@pytest.mark.parametrize(
    ("spec", "most"),
    [
        (Spec(n=6, dot=0.0, clearance=0.0, relief=0.05, restarts=2), 1.15),
        *(
            pytest.param(Spec(n=6, relief=0.02, objective="rotation", restarts=4, **dots), most, marks=pytest.mark.long)
            for dots, most in (({"dot": 0.0, "clearance": 0.0}, 1.75), ({"dot": 0.03}, 1.95))
        ),
        (Spec(n=6, dot=0.03, relief=0.05, restarts=2), 1.55),
    ],
)
def test_what_relief_buys(spec, most):
    actual = design(spec)
    assert actual.criteria["design"]["rotation_deg"] <= most
    assert actual.criteria["flat"]["rotation_deg"] > 2.5
    assert 0 < actual.marker.height <= spec.relief
    assert not hidden(actual.marker, actual.setting.poses).any()
    assert len(actual.setting.poses) == 400


def test_a_relief_goes_all_the_way():
    done: list[tuple[str, int, int]] = []
    actual = design(QUICK, lambda *step: done.append(step), traced=True)
    marker = actual.marker
    assert to_json(marker) == to_json(design(QUICK).marker)
    read = from_json(to_json(marker).decode())
    np.testing.assert_array_equal(read.xyz, marker.xyz)
    assert read.height == marker.height > 0
    assert marker.control_points[0].feature.kind == "ring"
    assert ("relief", 0, 1) in done
    assert done[-1][1] == done[-1][2]
    # A relief has no homography and no c(A); what lies beside it does.
    assert set(actual.criteria["design"]) == {"pose_m", "rotation_deg", "translation_pct"}
    assert {"design", "flat", "ngon", "square", "random"} == set(actual.criteria)
    assert actual.criteria["design"]["pose_m"] < actual.criteria["flat"]["pose_m"]
    assert [step.stage for step in actual.trace[:2]] == ["start", "relief"]
    assert actual.trace[-1].objective == pytest.approx(actual.criteria["design"]["pose_m"], rel=1e-6)
    assert np.isnan(actual.trace[-1].condition)


@pytest.mark.parametrize(
    "spec",
    [
        replace(QUICK, aggregate="max"),
        replace(QUICK, survive=1, n=5),
        replace(QUICK, dot=0.02, noise_model="image"),
        replace(QUICK, n=8, dot=0.02),
    ],
)
def test_every_kind_of_spec_can_have_a_relief(spec):
    actual = design(spec)
    assert actual.marker.height > 0
    assert not hidden(actual.marker, actual.setting.poses).any()


@pytest.mark.parametrize("name", ["L", "two squares"])
def test_a_relief_in_any_room(name, shapes):
    shape = shapes[name]
    spec = Spec(n=5, boundary=shape, dot=0.015, relief=0.03, restarts=1, poses=ONE_SIDED)
    actual = design(spec)
    assert breach(actual.marker.xyz, shape, (), 0.015, 0.0015) <= 1e-9
    assert actual.criteria["design"]["pose_m"] <= actual.criteria["flat"]["pose_m"]
    assert actual.marker.height > 0


def test_it_is_never_worse_than_flat(room, setting, monkeypatch):
    objective = OBJECTIVES["pose"](setting)
    monkeypatch.setattr(relief, "polish_relief", lambda objective, room, start, *_, **__: (start, np.inf))
    flat = some_layout(room)[:, :2]
    result = search_relief(objective, room, flat, np.random.default_rng(0), 1)
    np.testing.assert_array_equal(result.points, np.column_stack([flat, np.zeros(6)]))
    assert result.value == pytest.approx(objective(flat[None])[0])


def test_a_polish_ends_in_sight_and_not_worse_than_lowered(room, setting):
    objective = OBJECTIVES["pose"](setting)
    start = some_layout(room, seed=3)
    assert room.hides(start) > 0.001
    lowered = room.within(start)
    assert room.holds(lowered)
    points, value = polish_relief(objective, room, start, 30, 3)
    assert room.holds(points)
    assert value == objective(points[None])[0] < objective(lowered[None])[0]


@pytest.mark.parametrize("seed", range(5))
def test_layouts_are_lowered_until_all_is_in_sight(room, seed):
    points = some_layout(room, seed=seed)
    within = room.within(points)
    assert room.holds(within)
    assert relief_breach(within, room.height, 0.03, 0.003, room.eyes) <= 1e-9
    lowered = np.flatnonzero(within[:, 2] < points[:, 2])
    assert bool(len(lowered)) == (room.hides(points) > 0)
    for dot in lowered:
        # A hair higher, and it hides something.
        assert room.hides(within + 1e-6 * np.outer(np.arange(len(points)) == dot, [0, 0, 1])) > 0
    np.testing.assert_allclose(within[:, :2], points[:, :2])


def test_dots_that_no_process_raises_are_laid_on_the_plate(room, setting, monkeypatch):
    points = room.within(some_layout(room, seed=2))
    points[:2, 2] = 3.5e-5, 2e-4
    points = room.within(points)
    assert sorted(np.flatnonzero(points[:, 2] < 5e-4)) == [0, 1]
    made = room.without_low_pillars(points)
    assert made[:2, 2].tolist() == [0, 2e-4]
    assert room.holds(made)
    np.testing.assert_allclose(made, points, atol=1e-4)
    assert room.without_low_pillars(made) is made
    # A tenth of a low relief is a pillar, and bare points need none.
    low = replace(room, height=3e-4)
    np.testing.assert_array_equal(low.without_low_pillars(points * [1, 1, 0.001])[0], [*points[0, :2], 0])
    objective = OBJECTIVES["pose"](setting)
    monkeypatch.setattr(relief, "polish_relief", lambda *_, **__: (points, 0.0))
    result = search_relief(objective, room, points[:, :2], np.random.default_rng(0), 1)
    np.testing.assert_array_equal(result.points, made)
    assert result.value == pytest.approx(objective(made[None])[0])


@pytest.mark.parametrize("seed", range(5))
def test_gaps_have_the_gradient_of_differences(room, seed):
    points = some_layout(room, seed=seed)
    sights = room.tightest(points, 0.02, 3)
    assert len(sights) > 5
    step = 1e-7
    moves = step * np.eye(points.size).reshape(-1, *points.shape)
    numeric = np.stack([(sights.gap(points + m) - sights.gap(points - m)) / (2 * step) for m in moves], axis=-1)
    # Central differences of what is smooth but for a kink of the second derivative: rounding of 1e-17/1e-7 and bends.
    np.testing.assert_allclose(sights.gap_jacobian(points).reshape(numeric.shape), numeric, atol=1e-5)


def test_lines_of_sight_are_those_of_all_pillars(room):
    points = some_layout(room, seed=1)
    sights = room.tightest(points, np.inf, len(room.eyes))
    higher = points[sights.triples[:, 1], 2] > points[sights.triples[:, 0], 2]
    # Whatever is too far away to be hidden is left out, and nothing else.
    assert -room.hides(points) == pytest.approx(sights.gap(points)[higher].min())
    far = replace(room, eyes=room.eyes * [0, 0, 1])
    assert far.shadow < room.shadow


def test_the_check_sees_what_is_wrong_with_a_relief(room):
    points = room.within(some_layout(room, seed=2))
    check(relief_breach(points, room.height, 0.03, 0.003, room.eyes))
    for wrong in (points * [1, 1, -1], points + [0, 0, room.height], some_layout(room, seed=3)):
        with pytest.raises(RuntimeError, match="breaks its constraints"):
            check(relief_breach(wrong, room.height, 0.03, 0.003, room.eyes))
    with pytest.raises(RuntimeError, match="breaks its constraints"):
        check(relief_breach(points, room.height, 0.03, 0.003, room.eyes * [1, 1, 0.01]))
    # Bare points hide nothing.
    check(relief_breach(some_layout(room, seed=3), room.height, 0.0, 0.0, room.eyes))


def test_poses_that_do_not_see_over_the_relief_are_left_out(setting):
    low = "cone:distance=0.3..0.4,tilt=60..80,azimuth=0..360,count=100"
    boundary = Circle(0.05)
    flat, raised = (design(Spec(n=4, boundary=boundary, dot=0, relief=h, poses=low, restarts=1)) for h in (0, 0.045))
    assert raised.setting.poses.dropped >= flat.setting.poses.dropped
    assert np.all(eyes_of(raised.setting.poses)[:, 2] > raised.marker.height)
    grazing = "cone:distance=0.3..0.31,tilt=79..80,azimuth=0..360,count=100"
    with pytest.raises(InputError, match="100 from below"):
        design(Spec(n=4, boundary=Circle(0.06), dot=0, relief=0.06, poses=grazing))
