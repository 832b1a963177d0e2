import numpy as np
import pytest

from markergen.model.spec import ImageNoise
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.observation import DotNoise
from markergen.optimize.exchange import (
    AnyExchangeTable,
    TraceExchangeTable,
    distances,
    edge,
    exchange,
    exchange_table,
    places,
    random_layout,
)
from markergen.optimize.problem import FeasibleRegion, fewer


def test_fewer_poses_are_spread_over_all(setting):
    few = fewer(setting.poses)
    assert 40 <= len(few) <= 80
    # Every distance, tilt and azimuth of the paper's grid is still there, and none twice as often as another.
    for groups in (few.by_distance(), few.by_polar_angle()):
        counts = [int(mask.sum()) for mask in groups.values()]
        assert max(counts) < 2 * min(counts)
    assert len(groups) == 5
    assert len(fewer(few)) == len(few)


def test_places_are_in_the_region_and_hold_its_corners(rooms):
    for room in rooms.values():
        region = FeasibleRegion(room, 0.02, 0.002)
        results = places(region, 8)
        assert 100 < len(results) < 700
        assert room.depth(results).min() >= region.inset - 1e-10
        # Some are as deep as the middle of the widest part, about.
        assert room.depth(results).max() > 0.7 * room.depth(room.sample(2000, 0.0, np.random.default_rng(0))).max()
    # The corner of the inset rectangle, 100 mm x 50 mm from the middle.
    corner = np.array([0.1, 0.05]) - region_inset(shape := rooms["rectangle"])
    rim = edge(FeasibleRegion(shape, 0.02, 0.002), 50)
    assert np.linalg.norm(rim - corner, axis=-1).min() < 1e-9


def region_inset(boundary):
    return FeasibleRegion(boundary, 0.02, 0.002).inset


@pytest.mark.parametrize("name", ["pose", "homography", "rotation", "translation"])
@pytest.mark.parametrize("aggregate", ["rms", "max"])
def test_the_fast_table_says_what_the_objective_says(rooms, criterion, name, aggregate):
    room = rooms["plate"]
    objective = criterion(room, name, aggregate)
    here = places(FeasibleRegion(room, 0.02, 0.002), 8)[::7]
    fast, slow = TraceExchangeTable(objective, here), AnyExchangeTable(objective, here)
    candidates = np.arange(len(here))
    for count in (4, 5, 9):
        rest = np.random.default_rng(count).choice(len(here), count, replace=False)
        expected = slow.values(rest, candidates)
        # The little that keeps three points from being singular tells something where all else tells nothing.
        good = expected < 5 * expected.min()
        np.testing.assert_allclose(fast.values(rest, candidates)[good], expected[good], rtol=1e-4)


def test_the_fast_table_knows_the_noise_of_dots(rooms, setting):
    room = rooms["L"]
    poses = fewer(setting.poses.seen_whole(room, setting.camera))
    objective = OBJECTIVES["pose"](Setting(room, setting.camera, poses, DotNoise(0.03, ImageNoise())))
    here = places(FeasibleRegion(room, 0.03, 0.003), 8)[::5]
    rest = np.array([0, 9, 20, 30])
    candidates = np.arange(len(here))
    expected = AnyExchangeTable(objective, here).values(rest, candidates)
    np.testing.assert_allclose(TraceExchangeTable(objective, here).values(rest, candidates), expected, rtol=1e-5)


@pytest.mark.parametrize("name", ["pose", "condition"])
def test_further_places_come_first(rooms, criterion, name):
    room = rooms["L"]
    objective = criterion(room, name)
    here = edge(FeasibleRegion(room, 0.02, 0.002), 30)
    more = room.sample(6, 0.012, np.random.default_rng(0))
    joined, whole = (
        exchange_table(objective, here).joined(more),
        exchange_table(objective, np.concatenate([more, here])),
    )
    np.testing.assert_array_equal(joined.places, whole.places)
    np.testing.assert_array_equal(joined.apart, whole.apart)
    rest, candidates = np.array([0, 3, 8, 20, 27]), np.arange(len(joined.places))
    # What keeps it from being singular is the average of other places.
    np.testing.assert_allclose(joined.values(rest, candidates), whole.values(rest, candidates), rtol=1e-5)


def test_three_points_and_one_are_told_apart_from_none(rooms, criterion):
    # With three points the pose is hardly known, the homography not at all; the fourth decides.
    room = rooms["two squares"]
    for name in ("pose", "homography"):
        objective = criterion(room, name)
        here = edge(FeasibleRegion(room, 0.02, 0.002), 40)
        rest = np.array([0, 10, 25])
        candidates = np.setdiff1d(np.arange(len(here)), rest)
        fast, slow = (
            table(objective, here).values(rest, candidates) for table in (TraceExchangeTable, AnyExchangeTable)
        )
        # A thousandth is what keeps the three from being singular.
        assert slow[np.argmin(fast)] <= 1.001 * slow.min()


def test_no_single_move_improves_what_an_exchange_ends_with(rooms, criterion):
    room = rooms["star"]
    region, n = FeasibleRegion(room, 0.02, 0.002), 7
    objective = criterion(room)
    table = exchange_table(objective, places(region, n))
    start = random_layout(table.apart, region.spacing, n, np.random.default_rng(0))
    end = exchange(table, region.spacing, start)
    before, after = objective(table.places[np.array([start, end])])
    assert after < 0.8 * before
    assert distances(table.places[end])[np.triu_indices(n, 1)].min() >= region.spacing - 1e-10
    for i in range(n):
        rest = np.delete(end, i)
        gaps = np.linalg.norm(table.places[:, None] - table.places[rest], axis=-1).min(axis=1)
        free = table.places[gaps >= region.spacing]
        kept = np.broadcast_to(table.places[rest], (len(free), n - 1, 2))
        assert objective(np.concatenate([kept, free[:, None]], axis=1)).min() >= after * (1 - 2e-4)


def test_any_objective_can_be_exchanged(rooms, criterion):
    room = rooms["rectangle"]
    objective = criterion(room, "condition")
    table = exchange_table(objective, edge(FeasibleRegion(room), 24))
    assert isinstance(table, AnyExchangeTable)
    start = np.arange(5)
    end = exchange(table, 0.01, start)
    assert objective(table.places[end][None])[0] < 0.8 * objective(table.places[start][None])[0]


def test_random_layouts_keep_the_spacing_or_are_none():
    here = np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2) * 0.01
    rng = np.random.default_rng(0)
    layout = random_layout(distances(here), 0.02, 4, rng)
    assert distances(here[layout])[np.triu_indices(4, 1)].min() >= 0.02 - 1e-10
    assert random_layout(distances(here), 0.02, 14, rng) is None
    # Bare points may be as near as they like, but not in one place.
    assert len(set(random_layout(distances(here), 0.0, 25, rng).tolist())) == 25
