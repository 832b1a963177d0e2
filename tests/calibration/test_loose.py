"""Weak knowledge of a print: about as designed."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration_sets import CAMERA, claims, hand_held, layout, photographed, printed, simulate
from markergen.calibration.adjustment import adjust
from markergen.calibration.calibration import Known
from markergen.calibration.judging import cross_validate
from markergen.errors import InputError
from markergen.model.spec import Spec
from markergen.read.poses import poses_from

LOOSE = (2e-4, 1e-3)


def test_the_minimum_is_that_of_the_image_and_the_knowledge_together():
    """The gradient vanishes, by differences of the cost; the gauge stays, and with it the degrees of freedom."""
    made = simulate(6, 4, np.random.default_rng(0))
    network = replace(made.network(), loose=LOOSE)
    result, free = adjust(network, made.views), adjust(made.network(), made.views)
    assert result.degrees_of_freedom == free.degrees_of_freedom
    assert result.chi2 > free.chi2
    gauge = network.gauge(network.design)
    assert np.abs(gauge.T @ (result.places - network.design).ravel()).max() < 1e-10

    def cost(places):
        held = adjust(replace(made.network(), design=places, free=False), result.views)
        off = (places - network.design).ravel()
        return held.chi2 + off @ network.looseness(result.places) @ off

    rng = np.random.default_rng(1)
    for _ in range(6):
        step = rng.normal(0, 1e-6, result.places.shape)
        step -= (gauge @ (np.linalg.pinv(gauge) @ step.ravel())).reshape(-1, 3)
        slope = (cost(result.places + step) - cost(result.places - step)) / 2
        curvature = cost(result.places + step) + cost(result.places - step) - 2 * cost(result.places)
        # Where the knowledge that moves along with the dots turns by a mil, the minimum moves by less than a sigma.
        assert abs(slope) < 0.1 * np.sqrt(curvature)


def test_the_covariance_is_less_and_stays_one():
    made = simulate(8, 4, np.random.default_rng(2))
    result, free = (adjust(replace(made.network(), loose=item), made.views) for item in (LOOSE, None))
    values = np.linalg.eigvalsh(result.unscaled)
    assert values[0] > -1e-12 * values[-1]
    assert (values > 1e-9 * values[-1]).sum() == 3 * 8 - 7
    assert (np.diag(result.unscaled) < np.diag(free.unscaled) * (1 + 1e-6)).all()


def test_many_photographs_overrule_it():
    made = simulate(8, 20, np.random.default_rng(3))
    result, free = (adjust(replace(made.network(), loose=item), made.views) for item in (LOOSE, None))
    moved = np.abs(result.places - free.places).ravel()
    assert (moved < np.sqrt(np.diag(free.covariance))).all()


def test_few_photographs_with_a_poor_camera_are_predicted_better_with_it():
    """A focal length 4 % off: free dots take up its error, and left-out photographs show it."""
    rng, design = np.random.default_rng(4), layout(24)
    made = photographed(design, printed(design, rng), *hand_held(4, rng, design, tilt=(10, 40)), rng)
    wrong = replace(CAMERA, fx=770.0, fy=770.0)
    free = adjust(made.network(camera=wrong), made.views)
    sigma = np.array(LOOSE) / np.sqrt(free.scale)
    loose = adjust(replace(free.network, loose=tuple(sigma)), free.views)
    before, after = (cross_validate(item, np.arange(4)) for item in (free, loose))
    assert after.measured.rms < 0.9 * before.measured.rms


@pytest.mark.long
@pytest.mark.parametrize(("n", "photos"), [(5, 10), (24, 10)])
def test_claims_are_true_with_it(n, photos):
    result = []
    for k in range(150):
        rng = np.random.default_rng([k, n])
        made = simulate(n, photos, rng)
        result.append(claims(made, adjust(replace(made.network(), loose=LOOSE), made.views), rng))
    dots, pose = np.mean(result, axis=0)
    assert 0.85 < dots < 1.15
    assert 0.85 < pose < 1.15


def test_a_marker_that_no_pose_of_its_design_sees_is_judged_where_it_was_photographed(calibrated, make_ngon):
    poses = "cone:distance=2..3cm"
    marker = replace(make_ngon(9, 0.11, 0.02), provenance={"spec": Spec(poses=poses).as_dict()})
    judged = calibrated([marker], 12, Known(CAMERA))
    assert 0 < judged.after.rotation_deg < judged.before.rotation_deg
    with pytest.raises(InputError, match="sees the whole marker"):
        calibrated([marker], 12, Known(CAMERA, poses=poses_from(poses)))
