import numpy as np
import pytest

from markergen.studies.cells import Cell
from markergen.studies.paper.cells import work
from markergen.studies.paper.options import CAMERAS, COORDINATES
from markergen.studies.paper.shapes import square_misfit


@pytest.fixture(scope="module", params=CAMERAS)
def steps(request):
    return work(Cell("descent", {"camera": request.param, "noise_px": 4.0, "runs": 50, "seed": 0}))


def test_it_goes_down_to_a_square(steps):
    c = steps["c.metric"]
    assert c[0] > 3 * c[-1]
    assert square_misfit(steps["layouts"][-1]) < 0.15
    # The square is the best there is for four points from the front; a descent ends within a few percent.
    assert 0.98 * steps["square.c.metric"][0] < c[-1] < 1.05 * steps["square.c.metric"][0]


def test_errors_fall_with_it(steps):
    for key in ("dlt.he_px2", "epnp.rotation_deg", "ippe.rotation_deg", "lm.translation_pct"):
        mean, std = steps[f"{key}.mean"], steps[f"{key}.std"]
        assert mean[-1] < mean[0]
        assert std[-1] < std[0]
        # Fifty runs tell a mean to a fifth or so.
        assert mean[-1] == pytest.approx(steps[f"square.{key}.mean"][0], rel=0.6)


def test_names_and_shapes_are_those_of_the_made_up_results(steps, fake):
    made = fake(Cell("descent", {"camera": "paper", "noise_px": 4.0, "runs": 50, "seed": 0}))
    assert set(steps) == set(made)
    assert all(len(value) == (1 if key.startswith("square") else len(steps["layouts"])) for key, value in steps.items())


@pytest.mark.parametrize("coordinates", COORDINATES)
def test_shares_of_the_gain(coordinates, fake):
    cell = Cell("early", {"coordinates": coordinates, "n": 4, "poses": [5, 205], "starts": 4, "seed": 0})
    found, made = work(cell), fake(cell)
    assert {key: value.shape for key, value in found.items()} == {key: value.shape for key, value in made.items()}
    # c(A) falls all the way, so that its share of the gain is one; other errors may rise and fall.
    c = found["c"][np.isfinite(found["c"])]
    assert len(c)
    assert np.all(c <= 1)
    assert np.all(found["steps"] >= 5)
