import numpy as np
import pytest

from markergen.studies.paper.cells import cells_of, seconds_of
from markergen.studies.paper.options import COORDINATES, NOISE_PX, NUMBERS, OBJECTIVE_OF, PaperOptions


def compared(options, everything):
    """Cells of the comparison, and poses by n."""
    cells = [c for c in cells_of(options) if c.kind == "conditioned" and c.settings["noise_px"] == NOISE_PX]
    return [c for c in cells if (len(c.settings["optimized"]) == len(OBJECTIVE_OF)) == everything]


@pytest.mark.parametrize("scale", [1e-4, 0.01, 1.0])
def test_every_pose_is_compared_once_for_every_n(scale):
    options = PaperOptions(scale=scale)
    cells = cells_of(options)
    assert len(set(cells)) == len(cells)
    for everything, poses in ((False, options.poses), (True, options.fewer_poses)):
        for n in NUMBERS:
            own = [c.settings["poses"] for c in compared(options, everything) if c.settings["n"] == n]
            assert [pose for block in own for pose in block] == poses


def test_the_full_study_is_the_one_of_the_paper_and_fits_into_half_an_hour_of_two_cores():
    full = [c for c in compared(PaperOptions(), False) if c.settings["n"] == 6]
    assert {c.settings["starts"] for c in full} == {100}
    assert all(c.settings["optimized"] == {COORDINATES[0]: 100} for c in full)
    cells = cells_of(PaperOptions())
    assert sum(map(seconds_of, cells)) < 2 * 1800
    # Short cells lose little when they are interrupted, and keep all cores busy until the end.
    assert max(map(seconds_of, cells)) < 60


def test_the_cost_is_linear_in_poses_starts_n_and_runs():
    def cost(options):
        return sum(map(seconds_of, compared(options, False)))

    whole = cost(PaperOptions())
    # Half the starts are descended from in a batch half as large, whose steps cost a little more than half.
    assert cost(PaperOptions(scale=0.25)) == pytest.approx(whole / 4, rel=0.1)
    # Descents cost the same, whatever is done with the layouts afterwards.
    ten = cost(PaperOptions(runs=30)) - whole
    assert cost(PaperOptions(runs=1000)) == pytest.approx(whole + 98 * ten, rel=0.01)
    # The paper's own number of runs is cut into small cells, too, as far as one pose goes.
    assert max(map(seconds_of, compared(PaperOptions(runs=1000), False))) < 90


def test_the_seed_changes_every_cell():
    assert not set(cells_of(PaperOptions(scale=0.01))) & set(cells_of(PaperOptions(scale=0.01, seed=1)))


def test_a_pose_has_the_same_numbers_whatever_its_cell_holds():
    """Settings differ, and so do seeds; but within a cell a pose does not depend on those before it."""
    from markergen.studies.cells import Cell
    from markergen.studies.paper.conditioned import _rng

    cell = Cell("conditioned", {"n": 4, "poses": [3, 5]})
    assert _rng(cell, 5).random() == _rng(cell, 5).random() != _rng(cell, 3).random()
    assert isinstance(_rng(cell, 5), np.random.Generator)
