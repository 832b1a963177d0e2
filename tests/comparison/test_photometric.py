import numpy as np
import pytest

from markergen.comparison.baselines import line_up
from markergen.comparison.series import photometric_fit
from markergen.maths.information import apply_pose_step
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.render import DEFAULT_OPTICS
from markergen.validation.bounds import photometric_bounds

POSES = paper()
NAMES = ("ngon:5", "aruco:DICT_4X4_50", "checkerboard:5x5")


@pytest.mark.parametrize("contestant", line_up(NAMES)[0], ids=NAMES)
def test_the_fit_reaches_the_bound_of_each_pattern(contestant):
    scene, errors = contestant.scene(PAPER_CAMERA), []
    rng = np.random.default_rng(0)
    exact = contestant.print_error(0.0, rng)
    for index in (130, 150, 170, 190, 210, 230):
        pose = POSES.rotation[index], POSES.translation[index]
        image = contestant.render(PAPER_CAMERA, pose, DEFAULT_OPTICS, rng, exact)
        # Half a degree and a millimeter: about a pixel.
        step = rng.standard_normal((1, 6)) * np.repeat([np.deg2rad(0.5), 1e-3], 3)
        start = tuple(part[0] for part in apply_pose_step(pose[0][None], pose[1][None], step))
        fitted = photometric_fit(image, scene, PAPER_CAMERA, start, DEFAULT_OPTICS)
        bound = photometric_bounds(scene, PAPER_CAMERA, POSES.taken(np.array([index]), 0), DEFAULT_OPTICS)
        errors.append(float(np.rad2deg(angle_between(fitted[0], pose[0]))) / bound.rotation_deg[0])
    # Six errors of three components each: their RMS is known to 1/sqrt(36), so four sigma are 0.67.
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.67)


def test_a_pose_that_no_step_improves_stays():
    contestant = line_up(NAMES)[0][0]
    blank = np.full((480, 640), 225, dtype=np.uint8)
    pose = POSES.rotation[130], POSES.translation[130]
    fitted = photometric_fit(blank, contestant.scene(PAPER_CAMERA), PAPER_CAMERA, pose, DEFAULT_OPTICS)
    assert np.isfinite(fitted[1]).all()
