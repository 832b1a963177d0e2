"""The lower bound of `markergen.optimize.certificate`: closed forms, its ingredients, and attempts to break it."""

from dataclasses import replace

import numpy as np
import pytest

from markergen.model.boundary import Circle, polygon_from
from markergen.model.camera import Distortion
from markergen.model.poses import named_poses, paper
from markergen.model.rig_shapes import rig_shape
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.criteria import regular_polygon
from markergen.objectives.observation import DotNoise
from markergen.objectives.survive import SurvivalObjective
from markergen.optimize import certificate
from markergen.optimize.certificate import certify
from markergen.optimize.constellations import Block, nested_scales, pad_problem
from markergen.optimize.design import design
from markergen.optimize.layouts import lattice
from markergen.optimize.problem import FeasibleRegion, fewer
from markergen.optimize.rig import RigSearch, plate_views
from markergen.optimize.search import search

AGGREGATES = ("rms", "mean", "logmean", "max", "cvar:0.8")
TRACES = ("pose", "rotation", "translation", "homography")


def room_of(objective, region):
    return certificate.Room(objective, region, np.zeros((0, 2)))


def layouts(region, n, count, rng):
    """Feasible layouts (B, n, 2) of many kinds: random, on the edge, in rings, of lattices."""
    r = region.boundary.radius
    results = [region.sample(count, n, rng)]
    for _ in range(count // 4):
        angles = 2 * np.pi * (np.arange(n) / n + rng.random()) + rng.normal(scale=0.1, size=n)
        rim = r * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        ring = rim * np.where(np.arange(n) % rng.integers(1, 4), 0.5, 1.0)[:, None]
        results += [region.project(item[None]) for item in (rim, ring)]
    places = lattice(region.boundary, region.diameter or r / n, region.clearance)
    for _ in range(count // 4 if len(places) >= n else 0):
        taken = places[rng.permutation(len(places))[:n]]
        results.append(region.project(taken[None]))
    results = np.concatenate(results)
    return results[region.holds(results)]


def attempt_to_break(objective, region, n, count=1000, restarts=6):
    """Values of many layouts, all of which the bound for the best of them must not exceed."""
    rng = np.random.default_rng(n)
    tried = layouts(region, n, count, rng)
    values = objective(tried)
    best = search(objective, region, n, rng, restarts, rough=objective)
    certificate = certify(objective, region, best.points)
    assert certificate.lower_bound > 0.5 * best.value
    assert len(tried) > count / 2
    # The layout itself may be the optimum; then the bound is below it by its tolerance alone.
    assert min(values.min(), best.value) >= certificate.lower_bound
    return certificate


def test_regular_polygons_of_bare_points_are_as_good_as_a_ring(setting):
    # A measure on the disk is best when uniform on its rim, whose information a polygon of many corners has.
    region, objective = FeasibleRegion(Circle(0.15)), OBJECTIVES["pose"](setting)
    ring = objective(regular_polygon(120, 0.15)[None])[0] * np.sqrt(120)
    for n in (4, 8):
        certificate = certify(objective, region, regular_polygon(n, 0.15))
        assert certificate.lower_bound * np.sqrt(n) == pytest.approx(ring, rel=2e-4)
        assert certificate.lower_bound * np.sqrt(n) <= ring
        assert certificate.gap < (7e-4 if n == 4 else 2e-4)


@pytest.mark.parametrize("aggregate", AGGREGATES)
@pytest.mark.parametrize("name", ["pose", "homography"])
def test_sensitivity_is_the_derivative_and_bounds_every_measure(criterion, aggregate, name):
    region, rng = FeasibleRegion(Circle(0.15), 0.03, 0.003), np.random.default_rng(1)
    objective = criterion(region.boundary, name, aggregate)
    fields, measure = certificate._Fields(room_of(objective, region), 18), certificate._Worth(objective)
    places = region.sample(1, 9, rng)[0]
    x, y = fields.basis(places)

    def worth(weights):
        return measure.worth(fields.information((x * weights[:, None]).T @ y))

    weights = rng.uniform(0.5, 1.5, len(places))
    moments = (x * weights[:, None]).T @ y
    sensitivity = measure.sensitivity(fields.information(moments), 0.0)
    slopes = np.sum(x @ fields.polynomial(sensitivity) * y, axis=1)
    step = 1e-5 * np.eye(len(places))
    differences = [(worth(weights + item) - worth(weights - item)) / 2e-5 for item in step]
    np.testing.assert_allclose(slopes, differences, rtol=1e-5, atol=1e-6 * slopes.max())
    assert weights @ slopes == pytest.approx(worth(weights))
    for softness in (0.0, 0.03):
        slopes = np.sum(x @ fields.polynomial(measure.sensitivity(fields.information(moments), softness)) * y, axis=1)
        for _ in range(20):
            other = rng.exponential(size=len(places))
            assert worth(other) <= other @ slopes * (1 + 1e-9)
    ones = np.ones(len(places))
    assert worth(ones) == pytest.approx(float(objective(places[None])[0]) ** -2, rel=1e-7)


def test_no_more_than_one_dot_is_in_a_cap():
    rng, pitch = np.random.default_rng(0), 1.0
    hexagonal = np.stack([np.array([1, 0]), np.array([0.5, np.sqrt(0.75)])])
    sites = np.array([i * hexagonal[0] + j * hexagonal[1] for i in range(-3, 4) for j in range(-3, 4)])
    region = FeasibleRegion(Circle(2.2), 0.9, 0.1)
    packed = region.sample(40, 10, rng)
    packed = packed[region.holds(packed)]
    assert len(packed) > 20
    for points in [sites, *packed]:
        centers = np.concatenate([rng.uniform(-2, 2, (500, 2)), points, (points[:1] + points) / 2])
        assert certificate._overlap(centers, points, pitch).sum(axis=1).max() <= 1 + 1e-9


def test_the_highest_place_of_a_disk_is_bounded_closely(criterion):
    """At the edge, where u still grows outward, and inside, as sampled finely."""
    region, rng = FeasibleRegion(Circle(0.15), 0.03, 0.003), np.random.default_rng(0)
    points = regular_polygon(7, 0.13)
    objective = criterion(region.boundary)
    program = certificate._Program(objective, [certificate.Room(objective, region, points)], 12, 1.0).parts[0]
    measure = certificate._Worth(objective)
    rim = regular_polygon(5000, region.boundary.radius - region.inset)
    places = np.concatenate([rim, region.boundary.sample(20_000, region.inset, rng)])
    x, y = program.fields.basis(places)
    for one_sided in (points[:4], points):
        along_x, along_y = program.fields.basis(one_sided)
        cut = measure.sensitivity(program.fields.information(along_x.T @ along_y), 0.1)
        seen = np.sum(x @ program.fields.polynomial(cut) * y, axis=1)
        caps, prices = region.sample(1, 9, rng)[0], rng.uniform(0, 0.2, 9) * seen.max()
        for count in (0, 9):
            u = seen - certificate._cap(places, caps[:count], prices[:count], program.pitch, 0.0)[0]
            tolerance = 1e-3 * u.max()
            highest, _ = program.highest(cut, caps[:count], prices[:count], -np.inf, tolerance)
            assert u.max() <= highest <= u.max() + 2 * tolerance


def test_orbits_bound_as_closely_as_single_places(setting, monkeypatch, criterion):
    disk, poses = Circle(0.15), setting.poses
    # All rolls and tilts at one distance.
    at_one_distance = poses.taken(np.flatnonzero(next(iter(poses.by_distance().values()))), 0)
    region, few = FeasibleRegion(disk, 0.05, 0.005), criterion(disk)
    objective = OBJECTIVES["pose"](Setting(disk, setting.camera, at_one_distance))
    best = search(few, region, 12, np.random.default_rng(0), 2, rough=few).points
    value, turns = float(objective(best[None])[0]), []
    for judge in (objective, few):
        program = certificate._Program(judge, [certificate.Room(judge, region, best)], 12, value).parts[0]
        turns.append(len(program.turns))
    # The paper's poses are a grid of rolls, of which few of them keep only a part.
    assert turns == [certificate.ORBIT, 1]
    around = certify(objective, region, best)
    monkeypatch.setattr(certificate, "ORBIT", 1)
    assert certify(objective, region, best).lower_bound * 0.999 < around.lower_bound <= value


def test_other_layouts_do_not_break_the_bound(rooms, criterion):
    region = FeasibleRegion(rooms["rectangle"], 0.03, 0.003)
    bound = attempt_to_break(criterion(rooms["rectangle"]), region, 7, 200, restarts=1)
    assert bound.gap < 0.05
    assert bound.proven


@pytest.mark.parametrize("name", TRACES)
def test_the_interpolation_is_no_worse_than_is_proven(setting, name):
    """Compares the error bound with the largest error at hundreds of places, for degrees that are far too low, too."""
    boundary = polygon_from([np.array([[-0.1, -0.06], [0.14, -0.06], [0.14, 0.06], [-0.1, 0.06]])])
    rng = np.random.default_rng(2)
    objective = OBJECTIVES[name](Setting(boundary, setting.camera, fewer(setting.poses)))
    region = FeasibleRegion(boundary, 0.01, 0.001)
    places = boundary.sample(800, region.inset, rng)
    bounds = []
    for degree in (4, 7, 12):
        fields = certificate._Fields(room_of(objective, region), degree)
        assert fields.proven
        x, y = fields.basis(region.sample(1, 9, rng)[0])
        cut = (
            certificate._Worth(objective).sensitivity(fields.information(x.T @ y), 0.0)
            if degree == 12
            else rng.normal(size=fields._exact.shape[1])
        )
        x, y = fields.basis(places)
        error = np.abs(np.sum(x @ fields.polynomial(cut) * y, axis=1) - fields._packed(places) @ cut).max()
        scale = np.abs(fields._packed(places) @ cut).max()
        bounds.append(fields.error(cut) / scale)
        assert error <= fields.error(cut) + 1e-11 * scale
    assert bounds[0] > bounds[1] > bounds[2]
    assert bounds[2] < 1e-4


def test_poses_that_count_nothing_add_no_error(criterion):
    """Under a worst case, sensitivities of other poses vanish, even to the last digit."""
    fields = certificate._Fields(room_of(criterion(Circle(0.15)), FeasibleRegion(Circle(0.15), 0.03, 0.003)), 12)
    assert fields.error(np.zeros(fields._exact.shape[1])) == 0.0


@pytest.mark.long
@pytest.mark.parametrize("aggregate", AGGREGATES)
@pytest.mark.parametrize("name", TRACES)
def test_no_layout_in_any_room_breaks_the_bound(rooms, criterion, name, aggregate):
    for place, boundary in enumerate(rooms.values()):
        region = FeasibleRegion(boundary, 0.02, 0.002)
        attempt_to_break(criterion(boundary, name, aggregate), region, (4, 6, 9, 14)[place % 4])
    disk = Circle(0.15)
    for n in (4, 9, 20):
        attempt_to_break(criterion(disk, name, aggregate), FeasibleRegion(disk, 0.02, 0.002), n)


def test_bound_with_lens_and_noise_of_dots(criterion):
    camera = replace(Spec(n=4).camera, distortion=Distortion("radtan", (-0.1, 0.05, 1e-3, -1e-3)))
    boundary = polygon_from([np.array([[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]])])
    poses = fewer(paper().seen_whole(boundary, camera))
    objective = OBJECTIVES["rotation"](Setting(boundary, camera, poses, DotNoise(0.02, print_sigma=1e-4)))
    bound = attempt_to_break(objective, FeasibleRegion(boundary, 0.02, 0.002), 5, 100, restarts=1)
    assert bound.gap < 0.05
    assert not bound.proven
    assert "tested" in bound.sentence


def test_smaller_rooms_and_fewer_dots_have_larger_bounds(monkeypatch, criterion):
    monkeypatch.setattr(certificate, "ROUNDS", 4)
    objective = criterion(Circle(0.15), "rotation")
    points = regular_polygon(6, 0.1)

    def bound(radius, diameter=0.03, count=6):
        region = FeasibleRegion(Circle(radius), diameter, 0.003)
        return certify(objective, region, np.concatenate([points, [[0.0, 0.0]]])[:count]).lower_bound

    bounds = [bound(0.15, count=7), bound(0.15, 0.02), bound(0.15), bound(0.13)]
    assert np.all(np.diff(bounds) > 0)


def test_a_coarse_search_for_the_bound_gives_a_lower_one(monkeypatch, rooms, criterion):
    region, objective = FeasibleRegion(rooms["L"], 0.03, 0.003), criterion(rooms["L"])
    best = search(objective, region, 8, np.random.default_rng(0), 1, rough=objective)
    fine = certify(objective, region, best.points).lower_bound
    for name, value in {"EDGE": 15, "INSIDE": 15, "COARSE": 1, "BOXES": 3, "LEVELS": 4, "ROUNDS": 3}.items():
        monkeypatch.setattr(certificate, name, value)
    coarse = certify(objective, region, best.points).lower_bound
    assert 0 < coarse <= fine * 1.0005 <= best.value * 1.0005
    assert coarse < 0.999 * fine


def test_reasons_for_no_bound(criterion):
    region, points = FeasibleRegion(Circle(0.15)), regular_polygon(6, 0.15)
    pose = criterion(region.boundary)
    high = np.concatenate([points, np.linspace(0, 0.02, 6)[:, None]], axis=1)
    cases = [
        (criterion(region.boundary, "condition"), points, "not a convex function"),
        (SurvivalObjective(pose, 1), points, "not a convex function"),
        (pose, high, "hide each other"),
    ]
    for objective, layout, phrase in cases:
        certificate = certify(objective, region, layout)
        assert phrase in certificate.sentence
        assert certificate.lower_bound == 0
        assert certificate.gap == 1


def test_a_design_says_how_much_better_another_layout_can_be():
    result = design(Spec(n=5, restarts=1))
    assert result.certificate.lower_bound <= result.value
    assert "more than 0.1 % better" in str(result)
    assert result.certificate is result.certify()


def test_a_gap_that_the_dots_keep_is_said_with_the_bound(monkeypatch):
    monkeypatch.setattr(certificate, "ROUNDS", 2)
    poses = "cone:distance=0.6..1.2,tilt=0..60,count=12"
    actual = design(Spec(n=6, dot=0.02, gap=0.02, boundary=Circle(0.1), poses=poses, restarts=1))
    assert "no 6 dots in this room, 20 mm" in actual.certificate.sentence


def body_of_plates(count):
    faces = rig_shape("cube", edge=0.08).faces[:count]
    poses = named_poses("sphere:distance=0.3..0.5,count=30")
    spec = Spec(n=4, noise_model="image", dot=0.01, clearance=0.001)
    plates = plate_views(faces, [0.01] * count, poses, spec)
    square = 0.02 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1.1]])
    blocks = [
        Block(replace(spec, boundary=face.boundary), plate.poses, square, face)
        for face, plate in zip(faces, plates, strict=True)
    ]
    return RigSearch(blocks, spec, poses, {})


def plates():
    search = body_of_plates(6)
    return search.problem, search.blocks


def pad():
    spec = Spec(boundary=Circle(0.1), poses="cone:distance=0.15..1.5,tilt=0..50,count=40", noise_model="image")
    poses = named_poses(spec.poses)
    return pad_problem(spec, poses), nested_scales(spec, poses)


def moved(block, points):
    return replace(block, points=points)


@pytest.mark.parametrize(
    ("body", "count"), [(plates, 30), *(pytest.param(body, 1000, marks=pytest.mark.long) for body in (plates, pad))]
)
def test_other_layouts_do_not_break_the_bound_of_several_rooms(body, count):
    problem, blocks = body()
    rng, served = np.random.default_rng(0), problem.see(blocks).served

    def value(blocks):
        covered = problem.see(blocks)
        if not np.array_equal(covered.served, served):
            return np.inf
        return problem.value(covered, problem.errors(covered, problem.information(blocks, covered)))[1]

    best = value(blocks)
    bound = problem.certify(blocks, problem.see(blocks), best)
    assert not bound.reason
    assert not bound.proven
    assert bound.lower_bound > 0.5 * best

    def layouts(block):
        """Random ones, and the block's perturbed by up to a quarter of its room's radius."""
        scale = block.spec.boundary.radius * rng.uniform(0, 0.25, (count // 2, 1, 1))
        shaken = block.points + scale * rng.normal(size=(count // 2, *block.points.shape))
        return np.concatenate([block.region.sample(count, len(block.points), rng), block.region.project(shaken)])

    values = [best]
    for tried in zip(*map(layouts, blocks), strict=True):
        if all(block.region.holds(points[None])[0] for block, points in zip(blocks, tried, strict=True)):
            values.append(value(tuple(map(moved, blocks, tried))))
    assert np.isfinite(values).sum() > 0.5 * count
    assert min(values) >= bound.lower_bound


def test_a_rig_of_one_plate_has_the_bound_of_the_plate():
    search = body_of_plates(1)
    block = search.blocks[0]
    objective = OBJECTIVES["pose"](search.problem.setting(search.blocks, 0))
    poses = objective.setting.poses
    plain = replace(objective.setting, sight=None)
    alone = certify(OBJECTIVES["pose"](plain), block.region, block.points)
    assert len(poses) == search.see(search.blocks).served.sum()
    assert search.certify(search.value).lower_bound == pytest.approx(alone.lower_bound, rel=1e-3)
