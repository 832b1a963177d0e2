from dataclasses import replace

import numpy as np
import pytest

from markergen.api.design import design
from markergen.bounds.confusion.affine import likeness
from markergen.errors import InputError
from markergen.model.boundary import Circle
from markergen.model.poses import named_poses
from markergen.model.sight import coverage
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Setting
from markergen.objectives.base import Sight
from markergen.objectives.observation import DotNoise
from markergen.optimize import constellations
from markergen.optimize.dot_size import needs_scales
from markergen.optimize.problem import breach
from markergen.optimize.search import search

WIDE = "cone:distance=0.3..10m,tilt=0..45"


def setting(count=12, sight=None):
    poses = named_poses(f"cone:distance=0.5..4m,tilt=0..45,count={count}")
    return Setting(Circle(0.3), Spec().camera, poses, DotNoise(0.03, print_sigma=1e-4), sight)


def sight(n=6, count=12):
    rng = np.random.default_rng(0)
    reference = rng.normal(size=(count, 6, 6))
    return Sight(rng.random((count, n)) < 0.6, 1e6 * reference @ reference.swapaxes(-1, -2))


def test_gradients_of_dots_partly_in_view_agree_with_differences():
    rng = np.random.default_rng(1)
    points, along, step = rng.uniform(-0.25, 0.25, (2, 6, 2)), rng.normal(size=(2, 6, 2)), 1e-7
    objective = OBJECTIVES["pose"](setting(sight=sight()), "logmean")
    numeric = (objective(points + step * along) - objective(points - step * along)) / (2 * step)
    gradient = objective.value_and_gradient(points)[1]
    np.testing.assert_allclose(np.sum(gradient * along, axis=(1, 2)), numeric, rtol=1e-5)


def test_dots_out_of_view_add_nothing_wherever_they_are():
    mine, here = sight(), setting()
    points = np.random.default_rng(1).uniform(-0.25, 0.25, (6, 2))
    covered = OBJECTIVES["pose"](setting(sight=mine)).covariance(points[None])[0]
    for pose in range(12):
        ours = here.poses.taken(np.array([pose]), 0)
        subset = points[mine.seen[pose]]
        alone = OBJECTIVES["pose"](Setting(here.boundary, here.camera, ours, here.noise)).information(subset[None])[0]
        np.testing.assert_allclose(np.linalg.inv(covered[pose]), alone[0, 0] + mine.known[pose], rtol=1e-6, atol=1.0)


def test_several_scales_are_for_open_sizes_and_wide_ranges():
    wide = named_poses(WIDE)
    assert needs_scales(Spec(n=0, boundary=Circle(0.5), poses=WIDE), wide)
    assert not needs_scales(Spec(n=0, boundary=Circle(0.5), poses=WIDE, dot=0.1), wide)
    assert not needs_scales(Spec(n=0, boundary=Circle(0.05), poses=WIDE), wide)
    nearby = "cone:distance=0.3..1m"
    assert not needs_scales(Spec(n=0, boundary=Circle(0.5), poses=nearby), named_poses(nearby))


def test_forecasts_of_scales_serve_all_poses_and_fit():
    spec = Spec(n=0, boundary=Circle(0.5), poses=WIDE)
    poses = named_poses(spec.poses)
    scales = constellations._forecasts(spec, poses, 2)
    seen = constellations.seen_by(scales, spec.camera, poses)
    assert seen.served.all()
    assert scales[0].diameter >= 2 * scales[1].diameter
    assert breach(seen.points, spec.boundary, (), seen.diameters, scales[1].region.clearance) <= 0
    with pytest.raises(InputError, match="room for 5 dots"):
        constellations._forecasts(replace(spec, boundary=Circle(0.08)), poses, 1)


def test_with_little_room_scales_have_fewer_dots_and_are_found_although_jammed():
    spec = Spec(n=0, boundary=Circle(0.15), poses="cone:distance=0.2..5m,tilt=0..60")
    scale = constellations._forecasts(spec, named_poses(spec.poses), 2)[0]
    assert constellations.FEWEST_DOTS <= scale.spec.n < constellations.DOTS
    setting = replace(scale.setting, poses=scale.poses.taken(np.arange(0, len(scale.poses), 20), 0))
    optimum = search(OBJECTIVES["pose"](setting), scale.region, scale.spec.n, np.random.default_rng(0), restarts=1)
    assert scale.region.holds(optimum.points[None])[0]


def test_figures_are_compared_up_to_affine_maps():
    rng = np.random.default_rng(0)
    one = rng.normal(size=(6, 2))
    moved = one @ np.array([[0.3, 0.1], [-0.05, 0.2]]) + 0.4
    assert likeness(one, moved[[0, 3, 5, 1, 2, 4]]) < 1e-9
    assert likeness(one, rng.normal(size=(6, 2))) > 0.05
    assert likeness(one, one[:5]) == np.inf


@pytest.mark.long
def test_a_pad_serves_its_range():
    actual = design(n="auto", radius="0.5m", poses=WIDE)
    marker = actual.marker
    assert not actual.warnings
    assert actual.covered.served.all()
    counts = [len(scale) for scale in actual.covered.scales]
    assert len(counts) >= 2
    assert len(set(counts)) == len(counts)
    assert sum(point.feature.kind == "ring" for point in marker.control_points) == len(counts)
    dense = coverage(marker, actual.spec.camera, named_poses(f"{WIDE},count=4000,seed=5"))
    assert dense.served.all()
    assert "mm" in str(actual)
    with pytest.raises(InputError, match="to trace"):
        design(n="auto", radius="0.5m", poses=WIDE, trace="way.svg")


def test_what_poses_see_is_drawn(tmp_path):
    path = tmp_path / "seen.svg"
    design(n=4, radius="0.15m", poses="cone:distance=0.2..1m,count=8", restarts=1, coverage=path)
    text = path.read_text()
    assert "dots in view" in text
    with pytest.raises(InputError, match="a picture"):
        design(n=4, coverage="seen.txt")
