import numpy as np
import pytest

from markergen.maths.dlt import condition, dlt_matrix, relative_error_bounds
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.validation.relative_error import relative_error_of, relative_error_sentence
from markergen.validation.trials import run_experiment

RNG = np.random.default_rng(0)


def test_bounds_are_those_of_the_paper():
    objects, exact = RNG.uniform(-1, 1, (50, 6, 2)), RNG.uniform(-1, 1, (50, 6, 2))
    noisy = exact + 1e-5 * RNG.standard_normal(exact.shape)
    error, lower, upper = relative_error_bounds(objects, exact, noisy)
    for k in range(50):
        a, b = dlt_matrix(objects[k], exact[k]), dlt_matrix(objects[k], noisy[k])
        assert upper[k] == pytest.approx(
            condition(objects[k], exact[k]) * np.linalg.norm(a - b, 2) / np.linalg.norm(a, 2), rel=1e-6
        )
        h, g = (np.linalg.svd(matrix)[2][8] for matrix in (a, b))
        g = g if h @ g > 0 else -g
        assert error[k] == pytest.approx(np.linalg.norm(h - g) / np.linalg.norm(g), rel=1e-9)
        assert lower[k] == pytest.approx(np.linalg.norm(b @ (h - g)) / np.linalg.norm(b, 2), rel=1e-6)
    # Points without a homography have no small ninth singular value, so these bounds do not hold for them by a rule.
    assert (lower <= error * (1 + 1e-9)).all()


def test_errors_of_trials_are_between_them(pentagon):
    poses = paper()
    results = run_experiment(pentagon, PAPER_CAMERA, poses, runs=2, estimators=["dlt"], condition=np.ones(len(poses)))
    row = relative_error_of(results)
    assert row["count"] == len(poses)
    assert row["beyond"] == 0
    assert row["lower"] < row["error"] < row["upper"]
    assert 0 < row["tightness"]["lower"] < 1
    assert 0 < row["tightness"]["upper"] < 1
    assert str(row["count"]) in relative_error_sentence(row)
    assert relative_error_of(run_experiment(pentagon, PAPER_CAMERA, poses, runs=0)) is None
