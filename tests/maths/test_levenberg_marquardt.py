from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from markergen.maths.levenberg_marquardt import Damping, LeastSquares, levenberg_marquardt

TIMES = np.linspace(0, 2, 9)


def decay(height, rate):
    return height[..., None] * np.exp(-rate[..., None] * TIMES)


@dataclass(frozen=True, eq=False)
class Decays(LeastSquares):
    """Curves a exp(-b t) fitted to measurements (k, 9); the unknowns are two arrays (k,)."""

    measured: np.ndarray
    tolerance: float = 1e-12

    def residuals(self, unknowns):
        residual = self.measured - decay(*unknowns)
        return np.sum(residual**2, axis=-1), residual

    def jacobian(self, unknowns, results):
        return np.stack([decay(np.ones(len(results[0])), unknowns[1]), -TIMES * decay(*unknowns)], axis=-1)

    def moved(self, unknowns, step):
        return unknowns[0] + step[:, 0], unknowns[1] + step[:, 1]

    def converged(self, attempt):
        return np.abs(attempt.step).max(axis=-1) < self.tolerance

    def take(self, chosen):
        return replace(self, measured=self.measured[chosen])


@pytest.fixture
def problems():
    rng = np.random.default_rng(4)
    height, rate = rng.uniform(1, 3, 20), rng.uniform(0.2, 2, 20)
    return Decays(decay(height, rate) + 0.05 * rng.normal(size=(20, 9)))


def start(count=20):
    return np.full(count, 0.3), np.full(count, 1.0)


DAMPING = Damping(slack=1e-12)


def test_minima_are_those_of_scipy(problems):
    results, cost = levenberg_marquardt(problems, start(), DAMPING, 50)
    for k, measured in enumerate(problems.measured):
        other = least_squares(
            lambda x, y=measured: decay(x[:1], x[1:])[0] - y, [0.3, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        np.testing.assert_allclose([results[0][k], results[1][k]], other.x, rtol=1e-6)
        assert cost[k] == pytest.approx(2 * other.cost, rel=1e-9)


def test_a_batch_solves_each_problem_as_if_it_were_alone(problems):
    together, cost = levenberg_marquardt(problems, start(), DAMPING, 50)
    for k in range(20):
        alone, ours = levenberg_marquardt(Decays(problems.measured[k : k + 1]), start(1), DAMPING, 50)
        np.testing.assert_allclose([item[k] for item in together], [item[0] for item in alone], rtol=1e-12)
        assert cost[k] == pytest.approx(ours[0], rel=1e-12)


def test_what_converged_leaves_the_batch(problems, monkeypatch):
    sizes = []
    residuals = Decays.residuals
    monkeypatch.setattr(Decays, "residuals", lambda self, at: sizes.append(len(at[0])) or residuals(self, at))
    easy = Decays(np.concatenate([decay(*start(5)), problems.measured]))
    levenberg_marquardt(easy, start(25), DAMPING, 50)
    assert sizes[0] == 25
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[2] <= 20


def test_the_cost_never_rises_and_starts_stay_as_they_were(problems):
    costs, begin = [], start()
    for steps in range(6):
        result, cost = levenberg_marquardt(problems, begin, DAMPING, steps)
        np.testing.assert_allclose(problems.residuals(result)[0], cost, rtol=1e-12)
        costs.append(cost)
    assert (np.diff(costs, axis=0) <= 1e-12).all()
    np.testing.assert_array_equal(begin, start())


def test_problems_that_are_not_worth_a_step_stay_where_they_are(problems):
    @dataclass(frozen=True, eq=False)
    class Choosy(Decays):
        def worth_a_step(self, cost):
            return np.arange(len(cost)) % 2 == 0

    results, cost = levenberg_marquardt(Choosy(problems.measured), start(), DAMPING, 50)
    usual, least = levenberg_marquardt(problems, start(), DAMPING, 50)
    np.testing.assert_array_equal(results[0][1::2], start()[0][1::2])
    np.testing.assert_allclose(results[0][::2], usual[0][::2], rtol=1e-12)
    assert (cost[1::2] > least[1::2]).all()


def test_a_problem_that_no_step_helps_is_given_up(problems):
    @dataclass(frozen=True, eq=False)
    class Hopeless(Decays):
        def residuals(self, unknowns):
            moved = unknowns[0] != 0.3
            cost, residual = super().residuals(unknowns)
            return np.where(moved, np.inf, cost), residual

        def converged(self, attempt):
            return np.zeros(len(attempt.good), dtype=bool)

    taken = []
    moved = Decays.moved
    Hopeless.moved = lambda self, at, step: taken.append(1) or moved(self, at, step)
    result, _ = levenberg_marquardt(Hopeless(problems.measured), start(), Damping(start=1.0, most=1e3), 50)
    np.testing.assert_array_equal(result, start())
    # lambda is 1, 10, 100 and 1000; the next would be more than the most.
    assert len(taken) == 4


def test_a_ridge_holds_what_the_residuals_leave_free():
    @dataclass(frozen=True, eq=False)
    class Flat(Decays):
        def normal_equations(self, jacobian, residual):
            normal, gradient = super().normal_equations(jacobian, residual)
            normal[:, 1], normal[:, :, 1], gradient[:, 1] = 0, 0, 0
            return normal, gradient

    problems = Flat(decay(np.array([2.0]), np.array([1.0])))
    with pytest.raises(np.linalg.LinAlgError):
        levenberg_marquardt(problems, start(1), DAMPING, 50)
    (height, rate), cost = levenberg_marquardt(problems, start(1), replace(DAMPING, ridge=1e-14), 50)
    assert (height, rate) == (pytest.approx(2.0), 1.0)
    assert cost < 1e-20


def test_no_problems_at_all_are_solved_at_once():
    result, cost = levenberg_marquardt(Decays(np.zeros((0, 9))), start(0), DAMPING, 50)
    assert [len(item) for item in (*result, cost)] == [0, 0, 0]
