from dataclasses import replace

import numpy as np
import pytest

from markergen.detect import kernel
from markergen.detect.blobs import undo_lens
from markergen.detect.conic_projection import outlines
from markergen.detect.labeling_hypotheses import LEAST_DOTS, find_labelings, fit_labelings, misfits
from markergen.detect.pose_hypotheses import layout_of
from markergen.detect.seen_models import Planes, Poses
from markergen.maths.projection import plane_homography
from markergen.maths.rotation import angle_between
from markergen.model.camera import PAPER_CAMERA


def by_dot(view):
    """Labeling (1, n) of the blobs of a sight, and their ellipses."""
    order = np.argsort(view.dot)
    return order[view.dot[order] >= 0][None], undo_lens(view.blobs, PAPER_CAMERA)


def best_of(found):
    """The labeling of least misfit, a pixel for each dot that it lacks: subsets fit best of all."""
    return found.blobs[(found.misfit - found.count).argmin()]


def named(view, blobs):
    """Which dots the blobs of a labeling are."""
    return np.where(blobs >= 0, view.dot[blobs], -1)


@pytest.mark.parametrize("heights", [None, [0, 0.02, 0.01, 0.02, 0]])
def test_exact_blobs_have_no_misfit(ngon, sight, heights):
    layout = layout_of(ngon(5, heights=heights))
    for pose in range(0, 400, 41):
        view = sight(ngon(5, heights=heights), pose, noise=0, semi_noise=0)
        blobs, ellipses = by_dot(view)
        drawn = outlines(layout.points, layout.radii, view.rotation[None], view.translation[None])
        # Rounding of nearly equal semi-axes.
        assert misfits(drawn, ellipses, blobs, 800.0)[0] < 1e-5
        # All dots larger by a tenth are ink that spreads; one of them is not.
        wider = replace(ellipses, shape=1.21 * ellipses.shape)
        assert misfits(drawn, wider, blobs, 800.0)[0] < 1e-5
        one = ellipses.shape.copy()
        one[blobs[0, 2]] *= 1.21
        assert misfits(drawn, replace(ellipses, shape=one), blobs, 800.0)[0] > 0.1
        # An offset of one dot by 1 px, over the two that five dots have left.
        moved = ellipses.center.copy()
        moved[blobs[0, 2], 0] += 1 / 800
        error = misfits(drawn, replace(ellipses, center=moved), blobs, 800.0)
        np.testing.assert_allclose(error, np.sqrt(0.5), rtol=1e-4)


def test_fits_find_pose_and_homography(pentagon, sight):
    layout = layout_of(pentagon)
    view = sight(pentagon, 130, noise=0, semi_noise=0)
    blobs, ellipses = by_dot(view)
    start = Poses(view.rotation[None], view.translation[None] * 1.05)
    found = start.fitted(blobs, ellipses, layout, 800.0)
    # The fit ends where its misfit changes by less than a thousandth.
    assert angle_between(found.rotation, view.rotation)[0] < 1e-3
    homography = plane_homography(view.rotation[None], view.translation[None], np.eye(3))
    plane = Planes(np.eye(3)[None]).fitted(blobs, ellipses, layout, 800.0).homography
    np.testing.assert_allclose(plane / plane[:, 2:, 2:], homography / homography[:, 2:, 2:], rtol=0, atol=1e-6)


@pytest.mark.parametrize("calibrated", [True, False])
def test_the_true_labeling_comes_first_and_no_labeling_twice(pentagon, sight, calibrated):
    for pose in range(5, 400, 61):
        view = sight(pentagon, pose, strangers=15)
        ellipses = undo_lens(view.blobs, PAPER_CAMERA)
        found = find_labelings(ellipses, layout_of(pentagon), 800.0, calibrated)
        np.testing.assert_array_equal(named(view, best_of(found)), np.arange(5))
        assert len(np.unique(found.blobs, axis=0)) == len(found)
        assert (found.count >= LEAST_DOTS).all()
        assert (np.diff(found.count) <= 0).all()
        for blobs in found.blobs:
            used = blobs[blobs >= 0]
            assert len(np.unique(used)) == len(used)


def test_a_stranger_near_a_hidden_dots_place_is_let_go(ngon, sight):
    marker = ngon(6)
    for pose in range(5, 400, 61):
        view = sight(marker, pose, noise=0.01)
        place = np.flatnonzero(view.dot == 3)[0]
        view.blobs.center[place] += 0.7 * view.blobs.semi[place].min()
        found = find_labelings(undo_lens(view.blobs, PAPER_CAMERA), layout_of(marker), 800.0)
        np.testing.assert_array_equal(named(view, best_of(found)), [0, 1, 2, -1, 4, 5])


@pytest.mark.parametrize("heights", [None, [0, 0.02, 0.01, 0.02, 0, 0.005]])
@pytest.mark.parametrize("n", [6, 14])
def test_the_compiled_part_finds_the_same(ngon, sight, monkeypatch, heights, n):
    if kernel.library() is None:
        pytest.skip(kernel.missing())
    marker = ngon(n, diameter=0.024, heights=heights and (3 * heights)[:n])
    for pose in (5, 250):
        view = sight(marker, pose, strangers=15, noise=0.1)
        ellipses = undo_lens(view.blobs, PAPER_CAMERA)
        compiled = find_labelings(ellipses, layout_of(marker), 800.0)
        with monkeypatch.context() as without:
            without.setattr(kernel, "library", lambda: None)
            plain = find_labelings(ellipses, layout_of(marker), 800.0)
        both = [each.take(np.argsort(each.misfit - each.count)[:1]) for each in (compiled, plain)]
        np.testing.assert_array_equal(both[0].blobs, both[1].blobs)
        # Fits end where their misfit changes by less than a thousandth.
        np.testing.assert_allclose(both[0].misfit, both[1].misfit, rtol=1e-3)
        np.testing.assert_allclose(both[0].model.translation, both[1].model.translation, rtol=0, atol=1e-5)
        # The same poses fitted to the same labels.
        start = both[1].model
        again = fit_labelings(both[1].blobs, start, ellipses, layout_of(marker), 800.0, rings_tell=True)
        with monkeypatch.context() as without:
            without.setattr(kernel, "library", lambda: None)
            numpy = fit_labelings(both[1].blobs, start, ellipses, layout_of(marker), 800.0, rings_tell=True)
        np.testing.assert_array_equal(again.blobs, numpy.blobs)
        np.testing.assert_allclose(again.misfit, numpy.misfit, rtol=1e-3)
