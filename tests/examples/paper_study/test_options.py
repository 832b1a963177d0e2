import numpy as np
import pytest
from markergen_paper.options import (
    BOUNDARY,
    CAMERAS,
    GROUPS,
    OBJECTIVE_OF,
    PaperOptions,
    objective_for,
    poses_of,
)

from markergen.errors import InputError
from markergen.model.poses import paper


def test_all_of_it_is_the_papers_400_poses_and_100_starts():
    options = PaperOptions()
    assert options.poses == list(range(400))
    assert (options.starts, options.runs, options.step_runs) == (100, 20, 1000)
    # 800,000 trials are pooled for each n.
    assert len(options.poses) * options.starts * options.runs == 800_000
    assert len(options.fewer_poses) == 60


@pytest.mark.parametrize("scale", [1e-4, 0.01, 0.1, 0.5, 1.0])
def test_every_distance_and_polar_angle_is_kept_at_any_scale(scale):
    options = PaperOptions(scale=scale)
    whole = paper()
    for indices in (options.poses, options.fewer_poses):
        assert len(set(indices)) == len(indices)
        assert set(indices) <= set(options.poses)
        kept = poses_of(indices)
        pairs = {(round(d, 3), round(p, 1)) for d, p in zip(kept.distance, kept.polar_angle_deg, strict=True)}
        # Outside the paper's own setting, at the least scales one pose at each polar angle.
        assert len(pairs) == (GROUPS if indices == options.poses or scale >= 0.5 else len(indices))
        assert len({p for _, p in pairs}) == 5
        assert np.array_equal(kept.rotation, whole.rotation[indices])
    # Down to four starts at one azimuth the work goes with the scale, to rounding.
    if scale >= 0.01:
        assert len(options.poses) * options.starts == pytest.approx(40_000 * scale, rel=0.06)


@pytest.mark.parametrize(
    "stated", [{"runs": 1}, {"runs": 10**9}, {"scale": 0}, {"scale": 1.1}, {"scale": np.nan}, {"seed": -1}]
)
def test_numbers_out_of_range_are_refused(stated):
    with pytest.raises(InputError):
        PaperOptions(**stated)


@pytest.mark.parametrize("camera", CAMERAS)
def test_both_cameras_see_the_disk_whole_from_all_poses(camera):
    assert paper().seen_whole(BOUNDARY, CAMERAS[camera]).dropped == 0


def test_objectives_are_those_of_their_names():
    poses = poses_of([0])
    made = {name: objective_for(name, poses) for name in OBJECTIVE_OF if name != "hartley"}
    square = 0.15 * np.array([[[1, 0], [0, 1], [-1, 0], [0, -1]]])
    # Each tells something else of the same layout.
    assert len({round(float(item(square)[0]), 6) for item in made.values()}) == len(made)
    # Hartley's alone forget the size.
    small = objective_for("hartley", poses)(square / 10)
    assert small == pytest.approx(objective_for("hartley", poses)(square), rel=1e-6)
