"""Objectives without a closed form: gradients against differences in every setting, and one that is known otherwise."""

from dataclasses import replace

import autograd.numpy as anp
import numpy as np
import pytest

from markergen.errors import InputError
from markergen.model.camera import Distortion
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES
from markergen.objectives.autograd import AutogradObjective
from markergen.objectives.criteria import regular_polygon
from markergen.objectives.observation import DotNoise
from markergen.objectives.survive import SurvivalObjective
from markergen.optimize.problem import objective_of

STEP = 1e-7


class Volume(AutogradObjective):
    def values(self, points):
        return anp.exp(-anp.linalg.slogdet(self.information(points))[1] / 12)


class Trace(AutogradObjective):
    """What `PoseObjective` has in closed form."""

    def values(self, points):
        return anp.sqrt(anp.einsum("pij,bpji->bp", self._pose.weight, self.covariance(points)))


class Spread(AutogradObjective):
    """Inverse of how far the images of the points lie from their mean."""

    knows_noise = False

    def values(self, points):
        pixels = self.pixels(points)
        return 1 / anp.sqrt(anp.mean((pixels - anp.mean(pixels, axis=-2, keepdims=True)) ** 2, axis=(-2, -1)))


@pytest.fixture
def few(setting):
    return replace(setting, poses=setting.poses.taken(np.arange(0, 400, 29), 0))


def settings(few):
    lens = replace(few.camera, distortion=Distortion("radtan", (-0.283, 0.074, 1.9e-4, 1.8e-5)))
    return {
        "plain": few,
        "lens": replace(few, camera=lens),
        "image": replace(few, noise=DotNoise(0.03)),
        "lens and image": replace(few, camera=lens, noise=DotNoise(0.03, print_sigma=1e-4)),
    }


def slope(objective, points, along):
    ahead, behind = (objective(points + h * along) for h in (STEP, -STEP))
    return (ahead - behind) / (2 * STEP)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kind", [Volume, Spread])
@pytest.mark.parametrize("name", ["plain", "lens", "image", "lens and image"])
def test_gradient_agrees_with_differences(few, name, kind, dimension):
    rng = np.random.default_rng(0)
    points = regular_polygon(6, 0.1) + rng.normal(scale=0.01, size=(3, 6, 2))
    if dimension == 3:
        points = np.concatenate([points, rng.uniform(0, 0.02, (3, 6, 1))], axis=-1)
    along = rng.normal(size=points.shape)
    for objective in (kind(settings(few)[name]), SurvivalObjective(kind(settings(few)[name]), 1)):
        value, gradient = objective.value_and_gradient(points)
        np.testing.assert_allclose(value, objective(points), rtol=1e-12)
        exact = np.sum(gradient * along, axis=(1, 2))
        # Central differences over 1e-6 of the marker's size leave eight digits.
        np.testing.assert_allclose(exact, slope(objective, points, along), rtol=2e-6, atol=1e-8 * value.max())


@pytest.mark.parametrize("name", ["plain", "lens", "image", "lens and image"])
def test_what_is_known_in_closed_form_comes_out_the_same(few, name):
    points = regular_polygon(5, 0.12) + np.random.default_rng(1).normal(scale=0.01, size=(4, 5, 2))
    written, closed = Trace(settings(few)[name]), OBJECTIVES["pose"](settings(few)[name])
    for result, reference in zip(written.value_and_gradient(points), closed.value_and_gradient(points), strict=True):
        np.testing.assert_allclose(result, reference, rtol=1e-7, atol=1e-9)


def test_a_layout_that_determines_nothing_has_no_value_and_no_gradient(few):
    good = regular_polygon(5, 0.1)
    both = np.stack([np.zeros((5, 2)), good])
    for kind in (Volume, Trace):
        value, gradient = kind(few).value_and_gradient(both)
        assert not np.isfinite(value[0])
        np.testing.assert_array_equal(gradient[0], 0)
        alone, reference = kind(few).value_and_gradient(good[None])
        np.testing.assert_allclose(value[1], alone[0], rtol=1e-12)
        np.testing.assert_allclose(gradient[1], reference[0], rtol=1e-9)


def test_what_an_objective_does_not_know_is_told(few):
    class Flat(Spread):
        planar_only = True

    for spec, stated, phrase in (
        (Spec(objective="flat", relief=0.01), few, "points in space with a relief, found objective='flat'"),
        (Spec(objective="flat"), settings(few)["image"], "that depends on the noise"),
    ):
        try:
            OBJECTIVES._entries["flat"] = Flat
            with pytest.raises(InputError, match=phrase):
                objective_of(spec, stated)
        finally:
            del OBJECTIVES._entries["flat"]


@pytest.mark.parametrize("values", [np.mean, lambda values: np.mean(values, axis=1)])
def test_values_of_another_shape_are_refused(few, values):
    class Reduced(Spread):
        def values(self, points):
            return values(super().values(points))

    with pytest.raises(InputError, match=rf"values of Reduced of shape \(2, {len(few.poses)}\), .* found shape"):
        Reduced(few).per_pose(np.stack([regular_polygon(5, 0.1)] * 2))
