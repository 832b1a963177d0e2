"""Layouts of equal dots that can be distinguished: as safe as demanded, by other means than the search."""

from itertools import permutations

import numpy as np
import pytest

from markergen.bounds.confusion.perspective import find_rivals
from markergen.bounds.confusion.rival_fits import seen_layout
from markergen.errors import InputError
from markergen.model.boundary import Circle, Polygon
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import named_poses
from markergen.objectives import OBJECTIVES, Setting
from markergen.optimize import keyless
from markergen.optimize.keyless import asymmetric_search, safety_gradient
from markergen.optimize.problem import FeasibleRegion

POSES = named_poses("cone:distance=0.8..1.2,tilt=0..60,count=8,seed=0")
FISHY = Camera(640, 480, 800.0, 800.0, 320.0, 240.0, Distortion("radtan", (-0.2, 0.05, 0.001, -0.002)))


@pytest.fixture(autouse=True)
def few_starts(monkeypatch):
    """Fewer starts than a user's, for time."""
    monkeypatch.setattr(keyless, "SHAKES", (0.1,))


def least_of_all(points):
    """Label safety by brute force: every permutation at every pose."""
    n = len(points)
    scene = seen_layout(points, np.zeros(n, dtype=np.intp), PAPER_CAMERA, POSES)
    labelings = np.array(list(permutations(range(n))))[1:]
    poses = np.arange(len(POSES))
    result = scene.fit(np.repeat(labelings, len(poses), axis=0), np.tile(poses, len(labelings)))
    return result.px.min()


@pytest.mark.parametrize("camera", [PAPER_CAMERA, FISHY])
def test_the_gradient_is_the_derivative_of_the_safety(camera):
    points = Circle(0.13).sample(5, 0.01, np.random.default_rng(1))
    kinds = np.zeros(5, dtype=np.intp)
    scene = seen_layout(points, kinds, camera, POSES)
    rivals = find_rivals(scene, np.array([0, 3]))
    gradient = safety_gradient(scene, rivals)
    step = 1e-6
    for dot, axis in [(0, 0), (2, 1), (4, 0)]:
        change = np.zeros_like(points)
        change[dot, axis] = step
        ends = [seen_layout(points + s * change, kinds, camera, POSES).refit(rivals).px for s in (1, -1)]
        # The fits end when the sum of squares, of up to 1e5 px^2, is known to 1e-9: some px per m in a difference.
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), gradient[:, dot, axis], atol=2, rtol=0.02)


@pytest.mark.long
def test_a_safe_pentagon_costs_little():
    objective = OBJECTIVES["pose"](Setting(Circle(0.15), PAPER_CAMERA, POSES))
    region = FeasibleRegion(Circle(0.15), 0.02, 0.002)
    result = asymmetric_search(objective, region, 5, np.random.default_rng(0), 2.0, restarts=1)
    assert result.reached
    assert least_of_all(result.points) >= 2.0 * (1 - 1e-6)
    assert least_of_all(result.free.points) < 2.0
    assert region.holds(result.points[None])[0]
    assert result.value == pytest.approx(objective(result.points[None])[0])
    assert -1e-9 < result.cost < 0.1
    assert "without a key ring" in result.sentence
    assert result.or_refuse() is result


@pytest.mark.long
def test_what_cannot_be_reached_is_told(monkeypatch):
    monkeypatch.setattr(keyless, "ROUNDS", 2)
    objective = OBJECTIVES["pose"](Setting(Circle(0.15), PAPER_CAMERA, POSES))
    region = FeasibleRegion(Circle(0.15), 0.02, 0.002)
    result = asymmetric_search(objective, region, 4, np.random.default_rng(0), 500.0, restarts=1)
    assert not result.reached
    assert result.safety.least > 1
    assert "the 500 px demanded" in result.sentence
    with pytest.raises(InputError, match=r"safer than [\d.]+ px; use --asymmetric [\d.]+") as refusal:
        result.or_refuse()
    assert "\n" not in str(refusal.value)


def test_what_no_image_has_room_for_is_refused_at_once(monkeypatch):
    monkeypatch.setattr(keyless, "search", lambda *_: pytest.fail("searched"))
    objective = OBJECTIVES["pose"](Setting(Circle(0.15), PAPER_CAMERA, POSES))
    region = FeasibleRegion(Circle(0.15), 0.02, 0.002)
    with pytest.raises(InputError, match=r"of 800 px, found 1e\+09 px"):
        asymmetric_search(objective, region, 4, np.random.default_rng(0), 1e9)


def test_a_boundary_with_corners():
    square = Polygon((((0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1)),))
    objective = OBJECTIVES["pose"](Setting(square, PAPER_CAMERA, POSES))
    region = FeasibleRegion(square, 0.02, 0.002)
    result = asymmetric_search(objective, region, 4, np.random.default_rng(0), 2.0, restarts=1)
    assert result.reached
    assert region.holds(result.points[None])[0]
    assert least_of_all(result.points) >= 2.0 * (1 - 1e-6)
