"""A layout of its own for each image: the same estimates, to the last bit, as one layout at a time."""

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.estimators import ESTIMATORS, Correspondences
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper


@pytest.fixture(scope="module")
def scenes():
    """Three layouts in the plane, one of them a line, and four noisy images of each."""
    rng, poses = np.random.default_rng(0), paper().taken(np.array([205]), 0)
    layouts = Circle(0.15).sample(15, 0, rng).reshape(3, 5, 2)
    layouts[1] = np.linspace(-0.1, 0.1, 5)[:, None] * np.array([1.0, 0.5])
    exact = PAPER_CAMERA.project(layouts, poses.rotation, poses.translation)
    return layouts, exact + 0.5 * rng.standard_normal((3, 4, 5, 2))


@pytest.mark.parametrize("name", ESTIMATORS.names())
@pytest.mark.parametrize("height", [0.0, 0.03])
def test_together_as_alone(name, height, scenes):
    layouts, images = scenes
    estimator = ESTIMATORS[name]
    if height and estimator.planar_only:
        return
    if height:
        layouts = np.concatenate([layouts, np.tile([0, height, 0, height, 0], (3, 1))[..., None]], axis=-1)
    together = Correspondences(np.repeat(layouts, 4, axis=0), images.reshape(12, 5, 2), PAPER_CAMERA)
    result = together.once(estimator)
    for i, layout in enumerate(layouts):
        alone = Correspondences(layout, images[i], PAPER_CAMERA).once(estimator)
        part = slice(4 * i, 4 * i + 4)
        pairs = [(result, alone)] if isinstance(result, np.ndarray) else list(zip(result.best, alone.best, strict=True))
        for ours, theirs in pairs:
            # Products of small matrices may be summed in another order.
            np.testing.assert_allclose(ours[part], theirs, rtol=1e-9, atol=1e-9)


def test_what_cannot_be_solved_is_told_layout_by_layout(scenes):
    layouts, images = scenes
    batch = Correspondences(np.repeat(layouts, 4, axis=0), images.reshape(12, 5, 2), PAPER_CAMERA)
    assert batch.solvable.tolist() == [True] * 4 + [False] * 4 + [True] * 4
    assert batch.planar
    assert batch.of(np.array([0, 11])).shape == (2, 5, 3)


def test_as_many_layouts_as_images(scenes):
    layouts, images = scenes
    with pytest.raises(InputError, match="or more correspondences"):
        Correspondences(layouts, images.reshape(12, 5, 2), PAPER_CAMERA)
