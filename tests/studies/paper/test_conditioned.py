import numpy as np
import pytest

from markergen.studies.cells import Cell
from markergen.studies.paper.cells import work
from markergen.studies.paper.options import COORDINATES, OBJECTIVE_OF, objective_for, poses_of

STARTS = 6


@pytest.fixture(scope="module")
def cell():
    optimized = dict.fromkeys(OBJECTIVE_OF, STARTS - 2) | {"metric": STARTS}
    settings = {"n": 5, "poses": [3, 205], "starts": STARTS, "runs": 10, "noise_px": 1.0, "optimized": optimized}
    return Cell("conditioned", {**settings, "seed": 0})


@pytest.fixture(scope="module")
def result(cell):
    return work(cell)


def test_names_and_shapes_are_those_of_the_made_up_results(cell, result, fake):
    made = fake(cell)
    assert {key: (value.shape, value.dtype) for key, value in result.items()} == {
        key: (value.shape, value.dtype) for key, value in made.items()
    }


def test_the_same_cell_gives_the_same_bits(cell, result):
    again = work(Cell(cell.kind, cell.settings))
    assert all(np.array_equal(again[key], value, equal_nan=True) for key, value in result.items())


def test_descents_lower_what_they_descend(result):
    for name in OBJECTIVE_OF:
        for row, index in enumerate((3, 205)):
            objective = objective_for(name, poses_of([index]))
            end, begin = (objective(result[f"{kind}.layouts"][row].astype(float)) for kind in (name, "ill"))
            # To single precision, in which layouts are kept.
            assert np.all(end <= begin[: len(end)] * (1 + 1e-5))


def test_optimized_layouts_have_a_smaller_c_and_smaller_errors(result):
    for coordinates in COORDINATES:
        end, begin = result[f"{coordinates}.c.{coordinates}"], result[f"ill.c.{coordinates}"]
        assert np.all(end <= begin[:, : end.shape[1]] * (1 + 1e-4))
    level = {name: np.nanmedian(result[f"{name}.lm.rotation_deg.mean"]) for name in ("ill", "metric", "pose", "ngon")}
    assert level["pose"] < level["ill"]
    assert level["metric"] < level["ill"]
    assert level["ngon"] < level["ill"]
