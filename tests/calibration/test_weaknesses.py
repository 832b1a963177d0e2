"""What photographs leave open: degenerate sets are refused, or carry their large errors."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from benchmarks.calibration_sets import hand_held, in_gauge, layout, photographed, printed
from markergen.calibration.adjustment import UndeterminedError, adjust
from markergen.calibration.network import CameraFreedom, Length
from markergen.calibration.weaknesses import explain, findings, rarely_seen, refusal
from markergen.defaults import PRINT_SIGMA
from markergen.maths.rotation import exponential, rotation_z

BASE = ("fx", "cx", "cy", "k1", "k2")
FRONT = np.diag([1.0, -1.0, -1.0])


def _set(n, rotation, translation, names=None, free=True, seed=1, good=False):
    """Photographs of a print that is stretched and bulges, or has errors of 0.1 mm alone: what the design claims."""
    design, rng = layout(n), np.random.default_rng(seed)
    true = printed(design, rng, 1e-4, 0.0, 0.0) if good else printed(design, rng)
    made = photographed(design, true, rotation, translation, rng)
    freedom = None if names is None else CameraFreedom.of_names(made.camera, names)
    return made, replace(made.network(freedom), free=free)


def _found(*arguments, **named):
    made, network = _set(*arguments, **named)
    try:
        return findings(adjust(network, made.views))
    except UndeterminedError:
        return explain(network, made.views)


def _frontal(photos, rng):
    depth = rng.uniform(0.4, 1, photos)
    return FRONT @ rotation_z(rng.uniform(0, 2 * np.pi, photos)), depth[:, None] * [0.0, 0.0, 1.0]


def _tilted(photos, rng, roll=False):
    angle, azimuth = rng.uniform(0.3, 0.9, photos), rng.uniform(0, 2 * np.pi, photos)
    lean = exponential(angle[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * angle], axis=-1))
    aside = np.column_stack([rng.uniform(-0.05, 0.05, (photos, 2)), rng.uniform(0.5, 0.9, photos)])
    return lean @ FRONT @ rotation_z(rng.uniform(0, 2 * np.pi, photos) * roll), aside


@pytest.mark.parametrize("n", [5, 24])
@pytest.mark.parametrize("names", [None, BASE, (*BASE, "fy")])
def test_nothing_is_open_in_a_good_set(n, names):
    assert _found(n, *hand_held(15, np.random.default_rng(0), layout(n)), names=names) == ()


@pytest.mark.parametrize("n", [5, 24])
def test_frontal_photographs_leave_the_heights_open(n):
    """With a known camera they are told by perspective alone, and carry their errors."""
    results = _found(n, *_frontal(20, np.random.default_rng(0)))
    assert sentence("weak heights") in [item.what for item in results]
    assert "tilt" in str(results[0])
    unknown = _found(n, *_frontal(20, np.random.default_rng(0)), names=BASE)
    focal = next(item for item in unknown if item.what == sentence("weak focal length"))
    assert "%" in focal.sentence or "open" in focal.sentence


@pytest.mark.parametrize("n", [5, 24])
@pytest.mark.parametrize("names", [None, BASE])
def test_the_same_photograph_is_refused(n, names):
    rotation, translation = hand_held(1, np.random.default_rng(0), layout(n), tilt=(30, 40))
    results = _found(n, np.repeat(rotation, 12, axis=0), np.repeat(translation, 12, axis=0), names=names)
    assert results[0].refuses
    error = str(refusal(results))
    assert error.startswith("expected photographs that")
    assert "tilt" in error
    assert "\n" not in error
    if names is None:
        assert results[0].what == sentence("weak depths")


@pytest.mark.parametrize(("names", "what"), [(None, "depths of the dots"), (BASE, sentence("weak focal length"))])
def test_photographs_that_are_only_shifted_are_refused(names, what):
    rng = np.random.default_rng(0)
    rotation = hand_held(1, rng, layout(24), tilt=(30, 40))[0]
    shifts = np.column_stack([rng.uniform(-0.1, 0.1, (20, 2)), np.full(20, 0.7)])
    results = _found(24, np.repeat(rotation, 20, axis=0), shifts, names=names, good=True)
    assert results[0].what == what
    assert results[0].refuses
    # They show that a print with half a millimeter of sag is worse than what they leave open.
    carried = _found(24, np.repeat(rotation, 20, axis=0), shifts, names=names)
    assert carried[0].what == what
    assert carried[0].refuses is (names is not None)
    assert "errors of 0.1 mm" in carried[0].sentence


def test_one_roll_leaves_the_ratio_of_the_focal_lengths_open():
    names = (*BASE, "fy")
    results = _found(24, *_tilted(20, np.random.default_rng(0)), names=names)
    assert results[0].what == "fx against fy"
    assert "turn the camera" in results[0].remedy
    assert _found(24, *_tilted(20, np.random.default_rng(0), roll=True), names=names) == ()
    assert _found(24, *_tilted(20, np.random.default_rng(0)), names=BASE) == ()


def test_a_length_that_is_measured_poorly_leaves_the_scale_open():
    made, network = _set(6, *hand_held(15, np.random.default_rng(0), layout(6)))
    results = findings(adjust(replace(network, lengths=(Length(0, 1, 0.11, 5e-4),)), made.views))
    assert [item.what for item in results] == [sentence("weak scale")]
    assert "--measured" in results[0].remedy
    assert not results[0].refuses


def test_too_few_photographs_are_refused():
    poses = hand_held(6, np.random.default_rng(0), layout(5))
    for count, names, more in ((2, BASE, "2 more"), (3, BASE, "1 more"), (1, None, "2 more"), (2, None, "1 more")):
        results = _found(5, poses[0][:count], poses[1][:count], names=names)
        assert results[0].refuses
        assert "more measurements than" in results[0].sentence
        assert more in results[0].remedy
        count = f"{len(poses[0][:count])} photograph"
        assert f"the dots{' and the camera' * bool(names)}, found that {count}" in str(refusal(results))
    assert _found(5, poses[0][:4], poses[1][:4], names=BASE)[0].refuses
    assert not any(item.refuses for item in _found(5, *poses, names=BASE))


def test_dots_seen_once_or_never_are_named():
    rng = np.random.default_rng(0)
    made, network = _set(24, *hand_held(12, rng, layout(24)))
    seen = made.views.seen.copy()
    seen[1:, 3], seen[:, 7] = False, False
    results = explain(network, replace(made.views, seen=seen))
    assert [item.what for item in results] == ["dot 3, dot 7"]
    assert results[0].refuses
    names = [f"dot {k}" for k in range(24)]
    output = rarely_seen(seen.sum(axis=0), names)
    assert [item.what for item in output] == ["dot 3, dot 7"]
    assert not output[0].refuses
    assert rarely_seen(np.full(24, 2), names) == ()


def test_a_camera_alone_needs_tilt():
    rng = np.random.default_rng(0)
    results = _found(24, *_frontal(20, rng), names=BASE, free=False)
    assert results[0].what == sentence("weak focal length")
    assert results[0].refuses
    nearby = hand_held(20, rng, layout(24), tilt=(0, 4))
    carried = _found(24, *nearby, names=BASE, free=False)
    assert sentence("weak focal length") in {item.what for item in carried}
    assert not any(item.refuses for item in carried)
    assert _found(24, *hand_held(20, rng, layout(24)), names=BASE, free=False) == ()


def test_an_exact_print_is_judged_by_the_usual_errors():
    poses = hand_held(20, np.random.default_rng(0), layout(24), tilt=(0, 4))
    simulated, network = _set(24, *poses, names=BASE, free=False)
    adjusted = adjust(network, simulated.views)
    assert findings(adjusted, 0.0) == findings(adjusted, PRINT_SIGMA) != ()


def test_a_refused_set_is_worse_than_the_design_and_an_accepted_one_better():
    """By simulation: the pose of fresh views with the measured dots, against that with the designed ones."""
    rng = np.random.default_rng(0)
    rotation = hand_held(1, rng, layout(8), tilt=(30, 40))[0]
    shifts = np.column_stack([rng.uniform(-0.1, 0.1, (20, 2)), np.full(20, 0.7)])
    one_side = np.repeat(rotation, 20, axis=0), shifts
    all_sides = hand_held(20, rng, layout(8))
    errors = {}
    for title, poses in (("refused", one_side), ("accepted", all_sides)):
        squares, nominal, refused = [], [], []
        for seed in range(6):
            made, network = _set(8, *poses, seed=seed, good=True)
            whole = adjust(network, made.views)
            refused += [refusal(findings(whole)) is not None]
            fresh = hand_held(8, rng, layout(8))
            exact = photographed(made.design, made.true, *fresh, rng, sigma=1e-4)
            truth = in_gauge(network, made.true, *fresh)[1]
            for places, kept in ((whole.places, squares), (made.design, nominal)):
                fitted = adjust(replace(network, design=places, free=False), exact.views)
                kept += [np.sum((fitted.views.rotation - truth) ** 2)]
        errors[title] = np.sqrt(np.sum(squares) / np.sum(nominal))
        assert np.mean(refused) == pytest.approx(float(title == "refused"), abs=0.2)
    assert errors["accepted"] < 0.3
    assert errors["refused"] > 0.9


def test_photographs_without_enough_dots_are_told():
    made, network = _set(5, *hand_held(3, np.random.default_rng(0), layout(5)))
    results = explain(network, replace(made.views, seen=np.zeros((3, 5), dtype=bool)))
    assert results[0].refuses
    assert "no photograph" in results[0].sentence
    alone = np.arange(3)[:, None] == [0, 0, 0, 0, 0]
    assert "that another one shows, too" in explain(network, replace(made.views, seen=alone))[0].sentence
    agreed = explain(network, replace(made.views, seen=np.ones((3, 5), dtype=bool)))
    assert agreed[0].refuses
