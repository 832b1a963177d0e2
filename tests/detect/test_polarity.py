"""Markers with light dots on a dark ground are found as those with dark dots are, and neither for the other."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from markergen.detect import Detector, detect
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import light_marker
from markergen.model.poses import paper_roll
from markergen.model.tag import parse_tag
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS

POSES = paper_roll()
SEEN = range(7, 400, 49)


def look(marker, pose, optics=None, **options):
    rng = np.random.default_rng(pose)
    return render_view(
        marker, PAPER_CAMERA, POSES.rotation[pose], POSES.translation[pose], optics or Optics(), rng, **options
    )


def errors(result, marker, pose):
    truth = PAPER_CAMERA.project(marker.xyz, POSES.rotation[[pose]], POSES.translation[[pose]])[0]
    ids = [point.id for point in marker.control_points]
    return np.linalg.norm(result.pixels - truth[[ids.index(i) for i in result.ids]], axis=-1)


@pytest.fixture(scope="module")
def tagged(pentagon):
    return replace(pentagon, tag=parse_tag("aruco:DICT_4X4_50:7", 0.06))


def test_without_noise_a_light_marker_is_the_negative_of_a_dark_one(tagged):
    """With levels of 30 and 225, 255 minus one is the other; the ground ends at the plate."""
    quiet = Optics(noise_grey=0)
    for pose in (3, 130):
        dark = look(tagged, pose, quiet, scenery=Scenery(30.0)).astype(int)
        light = look(light_marker(tagged), pose, quiet, scenery=Scenery(225.0)).astype(int)
        assert np.abs(255 - light - dark).max() <= 1


def test_light_dots_are_found_as_precisely_as_dark_ones(tagged):
    findings = {False: [], True: []}
    for marker in (tagged, light_marker(tagged)):
        ours, other = (Detector(item, PAPER_CAMERA) for item in (marker, light_marker(tagged)))
        if marker.light:
            other = Detector(tagged, PAPER_CAMERA)
        for pose in SEEN:
            image = look(marker, pose)
            (seen,) = ours(image)
            assert seen.ok, seen.reason
            assert seen.tag is not None
            findings[marker.light] += errors(seen, marker, pose).tolist()
            assert not other(image)[0].ok
    # 45 dots each: the RMS of 90 coordinates is known to 7.5 %, the ratio of two to 11 %; three times that.
    dark, light = (np.sqrt(np.mean(np.square(findings[item]))) for item in (False, True))
    assert max(findings[True]) < 0.05
    assert 0.65 < light / dark < 1.5


def test_both_kinds_in_one_frame(tagged, ngon):
    both = [tagged, light_marker(ngon(6))]
    frame = np.concatenate([look(marker, pose) for marker, pose in zip(both, (387, 130), strict=True)], axis=1)
    detector = Detector(both)
    first, second = detector(frame)
    # Best first: the one with more dots.
    assert (first.index, first.ids.size, second.index, second.ids.size) == (1, 6, 0, 5)
    for finding, pose, offset in ((first, 130, 640), (second, 387, 0)):
        shifted = SimpleNamespace(ids=finding.ids, pixels=finding.pixels - [offset, 0])
        assert errors(shifted, finding.marker, pose).max() < 0.05
    # Dark dots, then light ones; each search sees the dots of its kind, and what looks like one.
    dots = detector.dots(frame)
    for pixels in (first.pixels, second.pixels):
        distance = np.linalg.norm(dots[:, None] - pixels, axis=-1).min(axis=0)
        assert distance.max() < 0.3
    for item, finding in zip(both[::-1], (first, second), strict=True):
        alone = Detector(item).dots(frame)
        assert len(alone) < len(dots)
        assert np.linalg.norm(alone[:, None] - finding.pixels, axis=-1).min(axis=0).max() < 0.3
    # With the light one's index in the reason.
    assert [item.index for item in detector(np.zeros_like(frame))] == [0, 1]


def test_both_kinds_are_tracked(tagged, ngon):
    both = [tagged, light_marker(ngon(6))]
    frame = np.concatenate([look(marker, pose) for marker, pose in zip(both, (387, 130), strict=True)], axis=1)
    detector = Detector(both)
    findings = detector(frame)
    again = detector(np.roll(frame, 3, axis=1), near=findings)
    assert [item.index for item in again] == [item.index for item in findings]
    for one, other in zip(again, findings, strict=True):
        assert one.ok
        assert one.finding.tracked
        assert one.ids.tolist() == other.ids.tolist()
        assert np.abs(one.pixels - other.pixels - [3, 0]).max() < 0.02


def test_two_light_markers_that_claim_the_same_dots_name_each_other(pentagon):
    light = light_marker(pentagon)
    dark, *lights = Detector([pentagon, light, light])(look(light, 130))
    assert not dark.ok
    assert [item.index for item in lights] == [1, 2]
    assert [item.reason[-21:] for item in lights] == ["marker 1 and marker 2", "marker 2 and marker 1"]


def test_light_dots_in_clutter(tagged):
    light = light_marker(tagged)
    for pose in SEEN[::3]:
        clutter = Scenery(BACKGROUNDS["clutter"](PAPER_CAMERA, np.random.default_rng(pose)))
        finding = detect(look(light, pose, scenery=clutter), light, PAPER_CAMERA)
        assert finding.ok, finding.reason
        assert errors(finding, light, pose).max() < 0.05
