import numpy as np
import pytest
from markergen_paper.results import aligned, best_square_misfit, least_gap, mirror_misfit, square_misfit, typical

from markergen.maths.rotation import rotation_z
from markergen.objectives.criteria import regular_polygon


def test_a_square_is_one_wherever_it_is_and_in_any_order():
    rng = np.random.default_rng(0)
    for _ in range(20):
        rotation = rotation_z(rng.uniform(0, 7))[:2, :2]
        square = rng.permutation(regular_polygon(4, rng.uniform(0.01, 1)) @ rotation) + rng.normal(size=2)
        # The root of a rounding error.
        assert square_misfit(square) < 1e-6


def test_misfit_is_the_rms_distance_of_the_corners():
    square = regular_polygon(4, 1.0)
    # A corner that is out by d along its diagonal pulls the square along by d/4 and stretches it by d/4: what is left
    # of the four offsets is of length d/2 in all, d/4 RMS.
    d = 1e-3
    moved = square.copy()
    moved[0] *= 1 + d
    assert square_misfit(moved) == pytest.approx(np.sqrt(2) * d / 4, rel=0.01)
    rectangle = square @ rotation_z(np.pi / 4)[:2, :2] * [1.0, 0.5]
    # Of sides 2:1 the square of the mean side is left, and half their difference is off: 0.25 / sqrt(0.75^2 + 0.25^2).
    assert square_misfit(rectangle) == pytest.approx(1 / np.sqrt(10), rel=1e-6)
    assert square_misfit(np.array([[0.0, 0], [1, 0], [2, 0], [3, 0]])) > 0.5


def test_five_points_hold_the_square_that_is_in_them():
    five = np.concatenate([regular_polygon(4, 1.0), [[0.1, 0.2]]])
    assert best_square_misfit(five) < 1e-6
    assert best_square_misfit(regular_polygon(5, 1.0)) > 0.2


@pytest.mark.parametrize("n", [4, 5])
def test_aligned_layouts_lie_on_one_another(n):
    rng = np.random.default_rng(1)
    rotated = np.stack([regular_polygon(n, 0.15) @ rotation_z(angle)[:2, :2] for angle in rng.uniform(0, 7, 50)])
    placed = aligned(rotated)
    first = placed[0]
    distance = np.linalg.norm(placed[:, :, None] - first, axis=-1).min(axis=2)
    assert distance.max() < 1e-9
    # As the paper draws them: a square on its side, a pentagon on its edge.
    highest = first[:, 1].max()
    assert highest == pytest.approx(0.15 * (np.sqrt(0.5) if n == 4 else 1.0), rel=1e-9)


def test_typical_layouts_are_those_of_the_largest_groups():
    rng = np.random.default_rng(2)
    pentagons = regular_polygon(5, 0.15) + rng.normal(0, 1e-3, (70, 5, 2))
    centered = np.concatenate([regular_polygon(4, 0.15), [[0, 0]]]) + rng.normal(0, 1e-3, (30, 5, 2))
    (one, most), (other, rest) = typical(np.concatenate([centered, pentagons]), 2)
    assert (most, rest) == (0.7, 0.3)
    assert np.linalg.norm(one, axis=-1).min() > 0.14
    assert np.linalg.norm(other, axis=-1).min() < 0.01


def test_least_gap():
    assert least_gap(np.array([[0.0, 0], [3, 4], [3, 5], [10, 0]])) == 1


def test_mirror_images():
    for n in (4, 5, 8):
        assert mirror_misfit(regular_polygon(n, 0.15) @ rotation_z(0.3)[:2, :2] + [0.2, 0.1]) < 1e-9
    kite = np.array([[0.0, 1], [0.4, 0.2], [-0.4, 0.2], [0, -1]])
    assert mirror_misfit(kite) < 1e-9
    # A parallelogram has no axis; one turned by half is itself, which is another symmetry.
    assert mirror_misfit(np.array([[0.0, 0], [1, 0], [1.5, 0.6], [0.5, 0.6]])) > 0.1


def test_more_points_hold_a_square_as_well():
    assert best_square_misfit(regular_polygon(8, 1.0)) < 1e-6
    assert best_square_misfit(regular_polygon(6, 1.0)) > 0.1
