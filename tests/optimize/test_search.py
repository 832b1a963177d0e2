"""The search where corners, holes, several regions and large numbers trap a descent."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.boundary import Circle, polygon_from
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.optimize import search as searching
from markergen.optimize.comparisons import comparison_layouts
from markergen.optimize.constraints import MOST_WALLS, contacts
from markergen.optimize.dot_size import choose_dots
from markergen.optimize.layouts import largest_diameter
from markergen.optimize.polish import polish
from markergen.optimize.problem import FeasibleRegion, breach, fewer, objective_of, rough_of
from markergen.optimize.search import Stages, search


def found(objective, room, n, seed=0, dot=0.02, **options):
    return search(objective, FeasibleRegion(room, dot, dot / 10), n, np.random.default_rng(seed), **options)


TYPICAL = "L", "two squares", "drilled"
"""A room with corners, one in several parts, and one with keep-outs; the other tests search in the rest."""


@pytest.mark.parametrize(
    ("names", "n", "dot"),
    [(TYPICAL, 4, 0.036), *(pytest.param(None, n, dot, marks=pytest.mark.long) for n, dot in ((4, 0.036), (8, 0.015)))],
)
def test_constraints_hold_in_every_shape(rooms, criterion, names, n, dot):
    for name in names or rooms:
        room = rooms[name]
        points = found(criterion(room, every=5), room, n, dot=dot, restarts=1).points
        boundary, keep_outs = (room.boundary, room.keep_outs) if name in ("ring", "drilled") else (room, ())
        # A tenth of a nanometer is what a layout may be off before it counts as infeasible.
        assert breach(points, boundary, keep_outs, dot, dot / 10) <= 1.1e-10


def test_what_is_raised_at_the_first_layouts_ends_the_search(criterion, monkeypatch):
    room = polygon_from([np.array([[0, 0], [0.3, 0], [0.3, 0.1], [0, 0.1]])])
    stages, first = [], []

    def progress(stage, *_):
        stages.append(stage)

    class Enough(Exception):
        pass

    def stop(points):
        first.append(points)
        raise Enough

    with pytest.raises(Enough):
        found(criterion(room, every=5), room, 12, dot=0.01, restarts=3, progress=progress, first=stop)
    assert set(stages) == {"exchange"}
    assert FeasibleRegion(room, 0.01, 0.001).holds(np.array(first)).all()
    stages.clear()
    monkeypatch.setattr(searching, "HOPS", 4)
    monkeypatch.setattr(searching, "FEWEST_HOPS", 2)
    end = found(criterion(room, every=5), room, 12, dot=0.01, restarts=1, progress=progress)
    assert stages[-1] == "hops"
    assert end.value <= criterion(room, every=5)(first[0][None])[0] * (1 + 1e-6)


@pytest.mark.long
@pytest.mark.parametrize("n", [4, 7])
def test_seeds_agree_in_every_shape(rooms, criterion, n):
    for room in rooms.values():
        objective = criterion(room)
        values = [found(objective, room, n, seed, 0.01, restarts=1).value for seed in range(2)]
        assert max(values) <= 1.005 * min(values)


@pytest.mark.long
def test_seeds_agree_where_dots_nearly_fill_the_room(rooms, criterion):
    # 90 % of the largest dots that fit: they jam, and hold each other in hundreds of ways.
    room = rooms["two squares"]
    objective, largest = criterion(room), largest_diameter(room, 11)
    values = [found(objective, room, 11, seed, 0.9 * largest).value for seed in range(2)]
    assert max(values) <= 1.005 * min(values)


@pytest.mark.parametrize("dot", [0.036, *(pytest.param(dot, marks=pytest.mark.long) for dot in (0.01, 0.0))])
def test_a_rectangle_is_no_worse_than_its_four_corners(setting, dot):
    boundary = polygon_from([np.array([[0, 0], [0.2, 0], [0.2, 0.1], [0, 0.1]])])
    poses = setting.poses.seen_whole(boundary, setting.camera)
    region = FeasibleRegion(boundary, dot, dot / 10)
    objective = OBJECTIVES["pose"](Setting(boundary, setting.camera, poses))
    rough = OBJECTIVES["pose"](Setting(boundary, setting.camera, fewer(poses)))
    x, y = 0.1 - region.inset, 0.05 - region.inset
    corners = np.array([[x, y], [-x, y], [-x, -y], [x, -y]])
    optimum = search(objective, region, 4, np.random.default_rng(0), rough=rough, restarts=1)
    assert optimum.value <= objective(corners[None])[0] * (1 + 1e-9)


@pytest.mark.long
def test_it_finds_what_descents_find_in_a_disk(criterion):
    disk = Circle(0.15)
    objective, region = criterion(disk), FeasibleRegion(disk, 0.02, 0.002)
    for n in (5, 8):
        result = Stages(objective, objective, region, n).exchanged(np.random.default_rng(0), 3)
        assert region.holds(result.points[None])[0]
        assert result.value <= search(objective, region, n, np.random.default_rng(0)).value * 1.001


def test_exchanges_of_many_dots_in_a_disk_end_where_a_regular_layout_is_as_good(criterion, monkeypatch):
    monkeypatch.setattr(searching, "STARTS", 5)
    monkeypatch.setattr(searching, "FINE_EDGE", 60)
    disk, printed, stages = Circle(0.15), [], []
    objective, region = criterion(disk, every=5), FeasibleRegion(disk, 0.01, 0.001)
    task = Stages(objective, objective, region, 25, lambda stage, *_: stages.append(stage), first=printed.append)
    monkeypatch.setattr(Stages, "finished", lambda *_: [])

    def ended(*values):
        """Result of exchanges whose quick polishes, that of the layout beside first, end at these values."""
        stages.clear()
        ends = iter(values)
        monkeypatch.setattr(Stages, "quick", lambda self, start: (start, next(ends, values[-1])))
        return task.exchanged(np.random.default_rng(0), 0, beside)

    monkeypatch.setattr(Stages, "quick", lambda self, start: (start, float(self.objective(start[None])[0])))
    beside = task.from_regular(np.random.default_rng(0), 0, leading=True)
    assert [len(points) for points in printed] == [25]
    monkeypatch.setattr(Stages, "finished", lambda self, ends, *_: ends)
    assert ended(1.0) is beside
    assert set(stages) == {"exchange"}
    assert ended(1.0, 0.9).value == 0.9
    assert stages[-1] == "polish"
    assert len(printed) == 1


@pytest.mark.parametrize(
    ("name", "n"),
    [
        ("rotation", 10),
        ("homography", 16),
        *(pytest.param(*case, marks=pytest.mark.long) for case in (("rotation", 16), ("homography", 20))),
    ],
)
def test_it_is_no_worse_than_a_regular_polygon(criterion, name, n):
    # Descents from random layouts alone end 1 to 4 % above the polygon.
    objective = criterion(Circle(0.15), name)
    dots = choose_dots(Spec(n=n, boundary=Circle(0.15)), objective.setting.poses)
    region = FeasibleRegion(Circle(0.15), dots.diameter, dots.clearance)
    polygon = regular_polygon(n, 0.15 - region.inset)
    optimum = search(objective, region, n, np.random.default_rng(0), restarts=1)
    assert region.holds(polygon[None])[0]
    assert region.holds(optimum.points[None])[0]
    assert optimum.value <= objective(polygon[None])[0] * (1 + 1e-6)


@pytest.mark.parametrize(
    ("room", "name"),
    [
        ("L", "rotation"),
        *(pytest.param(*case, marks=pytest.mark.long) for case in (("rectangle", "homography"), ("ring", "condition"))),
    ],
)
def test_it_is_no_worse_than_what_it_is_compared_with(rooms, criterion, room, name):
    region, objective = FeasibleRegion(rooms[room], 0.02, 0.002), criterion(rooms[room], name)
    optimum = search(objective, region, 6, np.random.default_rng(0), restarts=1)
    for setting in (None, objective.setting):
        polygon = comparison_layouts(region, 6, setting=setting)["ngon"]
        assert optimum.value <= objective(polygon)[0] * (1 + 1e-6)


@pytest.mark.parametrize("name", ["condition", pytest.param("homography", marks=pytest.mark.long)])
def test_other_objectives_are_searched_as_well(rooms, criterion, name):
    room = rooms["L"]
    objective = criterion(room, name, every=3)
    optimum = found(objective, room, 4, restarts=1)
    region = FeasibleRegion(room, 0.02, 0.002)
    assert region.holds(optimum.points[None])[0]
    sampled = objective(region.sample(200, 4, np.random.default_rng(1)))
    assert optimum.value < 0.7 * sampled.min()


@pytest.mark.long
def test_the_worst_pose_and_lost_dots_are_searched_as_well(rooms, setting):
    room = rooms["rectangle"]
    poses = fewer(setting.poses.seen_whole(room, setting.camera))
    for spec in (Spec(n=6, aggregate="max"), Spec(n=6, survive=1)):
        objective = objective_of(spec, Setting(room, setting.camera, poses))
        optimum = found(objective, room, 6, restarts=2)
        sampled = objective(FeasibleRegion(room, 0.02, 0.002).sample(100, 6, np.random.default_rng(1)))
        assert optimum.value < 0.8 * sampled.min()


def test_rough_poses_only_guide(rooms, setting):
    room = rooms["star"]
    spec = Spec(n=5, boundary=room)
    judged = Setting(room, setting.camera, setting.poses.seen_whole(room, setting.camera))
    objective, rough = objective_of(spec, judged), rough_of(spec, judged)
    assert len(rough.setting.poses) < 0.25 * len(judged.poses)
    optimum = found(objective, room, 5, rough=rough)
    assert optimum.value == pytest.approx(objective(optimum.points[None])[0], rel=1e-12)
    # Five tips for five dots.
    np.testing.assert_allclose(np.ptp(np.hypot(*optimum.points.T)), 0, atol=1e-6)


@pytest.mark.long
def test_dots_that_nearly_fill_the_room_still_get_a_layout(rooms, setting, criterion):
    for name in ("two squares", "L", "drilled"):
        room = rooms[name]
        dots = choose_dots(Spec(n=12, boundary=room, dot=None), setting.poses)
        region = FeasibleRegion(room, dots.diameter, dots.clearance)
        assert region.holds(found(criterion(room), room, 12, dot=dots.diameter, restarts=2).points[None])[0]


def test_dots_that_can_only_be_in_one_line_are_refused(criterion):
    strip = polygon_from([np.array([[0, 0], [0.2, 0], [0.2, 0.022], [0, 0.022]])])
    with pytest.raises(InputError, match="in one line"):
        found(criterion(strip), strip, 4, restarts=2)


def test_a_toothed_outline_costs_no_more_than_a_smooth_one(criterion):
    angles = 2 * np.pi * np.arange(400) / 400
    radius = np.where(np.arange(400) // 2 % 2, 0.15, 0.14)
    gear = polygon_from([radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)])
    region = FeasibleRegion(gear, 0.02, 0.002)
    assert len(region.walls) == 400
    dots = region.sample(1, 12, np.random.default_rng(0))[0]
    assert len(contacts(region.walls, dots, region.inset, 0.1, -1.0).dot) <= 12 * MOST_WALLS
    assert region.holds(found(criterion(gear, every=5), gear, 5, restarts=1).points[None])[0]


@pytest.mark.long
def test_many_dots(rooms, criterion):
    room = rooms["plate"]
    objective = criterion(room)
    region = FeasibleRegion(room, 0.012, 0.0012)
    optimum = search(objective, region, 60, np.random.default_rng(0))
    assert region.holds(optimum.points[None])[0]
    assert optimum.value < 0.9 * objective(region.sample(8, 60, np.random.default_rng(1))).min()


def test_the_same_seed_gives_the_same_layout(rooms, criterion):
    first, second = (found(criterion(rooms["star"], every=5), rooms["star"], 5, restarts=1) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)


def test_a_polish_goes_straight_into_a_corner(rooms, criterion):
    room = rooms["L"]
    region = FeasibleRegion(room, 0.02, 0.002)
    corners = np.concatenate(room.outlines())[[0, 1, 2, 4, 5]]
    into = room.project(corners, region.inset)
    shaken = room.project(into + np.random.default_rng(0).normal(scale=0.004, size=into.shape), region.inset)
    points, _ = polish(criterion(room), region, shaken)
    # The five outer corners of the L are the best places for five dots; a polish that saw one edge at a time stopped
    # millimeters before them.
    np.testing.assert_allclose(points, into, atol=1e-7)


def test_progress_is_told(rooms, criterion):
    calls = []
    found(criterion(rooms["L"], every=5), rooms["L"], 5, restarts=2, progress=lambda *call: calls.append(call))
    last = {stage: (done, total) for stage, done, total in calls}
    assert set(last) == {"exchange", "polish", "regular"}
    assert all(done == total for done, total in last.values())
    for stage in last:
        steps = [done for name, done, _ in calls if name == stage]
        assert steps == sorted(steps)


def test_every_step_is_recorded(rooms, criterion):
    from markergen.optimize.trace import Recorder

    recorder, objective = Recorder(), criterion(rooms["L"], every=5)
    optimum = found(objective, rooms["L"], 5, restarts=1, record=recorder)
    way = recorder.way(optimum.points)
    stages = [stage for stage, _ in way]
    assert stages[0] == "start"
    assert "exchange" in stages
    np.testing.assert_array_equal(way[-1][1], optimum.points)
    assert objective(way[0][1][None])[0] > objective(way[-1][1][None])[0]


@pytest.mark.long
@pytest.mark.parametrize("n", range(4, 13))
def test_nine_of_ten_seeds_find_the_best(shape, setting, n):
    spec = Spec(n=n, boundary=shape)
    judged = Setting(shape, setting.camera, setting.poses.seen_whole(shape, setting.camera))
    dots = choose_dots(spec, judged.poses)
    objective, rough = objective_of(spec, judged), rough_of(spec, judged)
    options = {"dot": dots.diameter, "rough": rough}
    values = np.array([found(objective, shape, n, seed, **options).value for seed in range(10)])
    best = min(values.min(), found(objective, shape, n, 10_000, restarts=60, **options).value)
    assert np.sum(values <= 1.005 * best) >= 9
