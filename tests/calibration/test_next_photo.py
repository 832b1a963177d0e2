"""Which photograph to take next: what is claimed of it, what it is worth against random ones, and its words."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import sentence

from benchmarks.calibration_sets import CAMERA, hand_held, in_gauge, layout, photographed, printed
from markergen.calibration.adjustment import adjust
from markergen.calibration.network import Views
from markergen.calibration.next_photo import LEAST_DIAMETER, MARGIN, candidate_photos, next_photos
from markergen.calibration.working_error import sensitivity
from markergen.maths.conics import outlines
from markergen.maths.rotation import exponential, rotation_z
from markergen.model.camera import Camera, Distortion

NOISE = 0.03
FRONT = np.diag([1.0, -1.0, -1.0])


def _working(n):
    return hand_held(60, np.random.default_rng(99), layout(n))


def _set(n, photos, seed, tilt=(10.0, 60.0)):
    design, rng = layout(n), np.random.default_rng(seed)
    return photographed(design, printed(design, rng), *hand_held(photos, rng, design, tilt=tilt), rng)


def _with(views, more):
    return Views(
        *(
            np.concatenate([getattr(views, name), getattr(more, name)])
            for name in ("pixels", "covariance", "seen", "rotation", "translation")
        )
    )


def _taken(made, rotation, translation, rng):
    return photographed(made.design, made.true, rotation[None], translation[None], rng).views


def _expected(result, poses):
    n = len(result.places)
    joint = result.joint / result.scale
    blocks = np.stack([joint[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(n)])
    return sensitivity(result.places, result.camera, *poses, NOISE, blocks).expected(joint)


@pytest.mark.parametrize(("n", "photos", "reference"), [(5, 3, True), (5, 10, False), (24, 8, True), (24, 8, False)])
def test_photographs_lower_the_error_as_claimed(n, photos, reference):
    """Each is simulated from the print as it is, and the whole adjusted again; claims are of the first order."""
    made, rng = _set(n, photos, 3), np.random.default_rng(0)
    network = made.network() if reference else made.unknown_camera()
    first, poses = adjust(network, made.views), _working(n)
    result = next_photos(first, poses, count=3)
    assert result.photos
    views, factor = made.views, np.sqrt(first.scale)
    for photo in result.photos:
        views = _with(views, _taken(made, photo.candidate.rotation[0], photo.candidate.translation[0], rng))
        real = _expected(adjust(network, views), poses)
        assert photo.after.rotation_deg / factor == pytest.approx(real.rotation_deg, rel=0.02)
        assert photo.after.translation / factor == pytest.approx(real.translation, rel=0.02)
        assert photo.after.rotation_deg < photo.before.rotation_deg


def test_the_first_is_the_best_of_all_candidates():
    """Of 40 others, adjusted one by one, none is better by more than its tie-break and what a subset of dots costs."""
    made, rng, poses = _set(6, 5, 2), np.random.default_rng(0), _working(6)
    network = made.unknown_camera()
    first = adjust(network, made.views)
    best = next_photos(first, poses, count=1).photos[0].after.rotation_deg / np.sqrt(first.scale)
    others = candidate_photos(first.places, network.radii, first.camera)
    for k in rng.choice(len(others), 40, replace=False):
        added = adjust(network, _with(made.views, _taken(made, others.rotation[k], others.translation[k], rng)))
        assert _expected(added, poses).rotation_deg > 0.97 * best


@pytest.mark.parametrize("n", [5, 24])
def test_frontal_photographs_with_an_unknown_camera_ask_for_a_tilt(n):
    rng, design = np.random.default_rng(4), layout(n)
    depth = rng.uniform(0.4, 1, 10)
    poses = FRONT @ rotation_z(rng.uniform(0, 2 * np.pi, 10)), depth[:, None] * [0.0, 0.0, 1.0]
    made = photographed(design, printed(design, rng), *poses, rng)
    result = next_photos(adjust(made.unknown_camera(), made.views), _working(n))
    assert result.photos[0].candidate.tilt_deg[0] >= 40
    assert result.photos[-1].after.rotation_deg < 0.15
    assert result.sentence.startswith("Next photograph: tilt")
    assert "1 deg or more" in result.sentence


def test_a_single_photograph_is_enough_to_ask():
    made = _set(5, 1, 1)
    result = next_photos(adjust(made.network(), made.views), _working(5))
    assert result.helps
    assert np.isfinite([photo.after.rotation_deg for photo in result.photos]).all()


def test_after_many_photographs_more_hardly_help():
    made = _set(5, 60, 1)
    result = next_photos(adjust(made.network(), made.views), _working(5))
    assert len(result.photos) == 1
    assert not result.helps
    assert result.sentence.startswith("More photographs hardly")


def test_a_camera_alone_is_asked_for_as_well():
    design, rng = layout(24), np.random.default_rng(5)
    made = photographed(design, design, *hand_held(4, rng, design), rng)
    held = replace(made.unknown_camera(), free=False)
    first, poses = adjust(held, made.views), _working(24)
    photo = next_photos(first, poses, count=1).photos[0]
    views = _with(made.views, _taken(made, photo.candidate.rotation[0], photo.candidate.translation[0], rng))
    real = sensitivity(design, CAMERA, *poses, NOISE, np.zeros((24, 3, 3)))
    joint = np.pad((again := adjust(held, views)).joint / again.scale, ((72, 0), (72, 0)))
    assert photo.before.print == (0, 0)
    output = photo.after.rotation_deg / np.sqrt(first.scale)
    assert output == pytest.approx(real.expected(joint).rotation_deg, rel=0.02)


def test_of_several_markers_the_first_is_shown():
    """Both are in half of the photographs each; the second does not matter for the first, with a known camera."""
    made, second = _set(5, 6, 1), _set(6, 6, 2)
    n, v = 11, 12
    pixels, seen = np.zeros((v, n, 2)), np.zeros((v, n), dtype=bool)
    pixels[:6, :5], pixels[6:, 5:] = made.views.pixels, second.views.pixels
    seen[:6, :5] = seen[6:, 5:] = True
    poses = (
        np.concatenate([getattr(item.views, name) for item in (made, second)]) for name in ("rotation", "translation")
    )
    views = Views(pixels, np.broadcast_to(NOISE**2 * np.eye(2), (v, n, 2, 2)), seen, *poses)
    one = made.network()
    both = replace(
        one, design=np.concatenate([made.design, second.design]), radii=np.zeros(n), marker=np.repeat([0, 1], [5, 6])
    )
    together = adjust(both, views)
    alone = adjust(one, made.views)
    names = [f"dot {k}" for k in "abcdefghijk"]
    result, expected = next_photos(together, _working(5), names), next_photos(alone, _working(5))
    assert result.names == ("dot a", "dot b", "dot c", "dot d", "dot e")
    assert np.allclose(result.photos[0].candidate.rotation, expected.photos[0].candidate.rotation)
    ratio = np.sqrt(together.scale / alone.scale)
    assert result.photos[0].after.rotation_deg == pytest.approx(ratio * expected.photos[0].after.rotation_deg, rel=1e-3)


@pytest.mark.parametrize("radius", [0.0, 0.01])
def test_candidates_are_in_view_and_as_large_as_told(radius):
    points, radii = layout(8), np.full(8, radius)
    result = candidate_photos(points, radii, CAMERA)
    images = outlines(points, radii, result.rotation, result.translation)
    assert images.seen.all()
    angle = np.linspace(0, 2 * np.pi, 12)
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    pixels = CAMERA.project((points[:, None] + ring).reshape(-1, 3), result.rotation, result.translation)
    assert CAMERA.sees(pixels).all()
    size = np.array([CAMERA.width, CAMERA.height])
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    share = ((high - low) / size / (1 - 2 * MARGIN)).max(axis=1)
    assert share == pytest.approx(result.fill, rel=0.03)
    for axis, length in enumerate(size):
        side = result.place[:, axis]
        at = np.select([side < 0, side > 0], [low[:, axis], high[:, axis]], (low + high)[:, axis] / 2)
        goal = np.select([side < 0, side > 0], [MARGIN * length, (1 - MARGIN) * length], length / 2)
        assert abs(at - goal).max() < 0.015 * length
    if radius:
        short = 2 * CAMERA.fx * np.sqrt(np.linalg.eigvalsh(images.shape)[..., 0])
        assert short.min() > 0.9 * LEAST_DIAMETER


@pytest.mark.parametrize(
    "camera",
    [
        Camera(640, 480, 300.0, 300.0, 320.0, 240.0, Distortion("equidistant", (0.01, 0.0, 0.0, 0.0))),
        Camera(480, 640, 250.0, 260.0, 200.0, 350.0, Distortion("radtan", (-0.5, 0.1, 0.0, 0.0, 0.0))),
        Camera(640, 480, 8000.0, 8000.0, 320.0, 240.0),
    ],
)
def test_other_cameras_see_their_candidates(camera):
    """A fish-eye, a lens whose model folds over inside the image, and a long lens."""
    points = layout(5)
    results = candidate_photos(points, np.zeros(5), camera)
    assert len(results) > 100
    pixels = camera.project(points, results.rotation, results.translation)
    assert camera.sees(pixels).all()
    assert (abs(np.linalg.det(results.rotation) - 1) < 1e-9).all()


def test_dots_too_small_are_not_asked_for():
    results = candidate_photos(layout(8), np.full(8, 2.5e-3), CAMERA)
    assert 0 < len(results) < 300
    assert results.fill.min() > 0.6
    assert not len(candidate_photos(layout(8), np.full(8, 1e-3), CAMERA))


def test_the_request_is_in_the_photographers_words():
    made = _set(5, 3, 3)
    result = next_photos(adjust(made.network(), made.views), _working(5))
    assert result.photos[0].request == sentence("hold turned", "90 deg to the right", 0)
    second = result.photos[1]
    assert second.request.startswith(f"tilt the marker {second.candidate.tilt_deg[0]:.0f} deg, its ")
    assert "away from" in second.request
    place = result.points @ second.candidate.rotation[0].T + second.candidate.translation[0]
    top = int(np.argmin(CAMERA.to_pixels(place[:, :2] / place[:, 2:])[:, 1]))
    assert f"(dot {top} at the top" in second.request
    ax = result.draw(which=1)
    assert [text.get_text() for text in ax.texts][:5] == list("01234")
    # Numbers stand beside the dots, where they can be read.
    for text, dot in zip(ax.texts[:5], ax.patches[:5], strict=True):
        assert not dot.get_path().contains_point(np.add(text.xy, (1, -1)))
    assert {"farther", "nearer"} < {text.get_text() for text in ax.texts}


@pytest.mark.long
@pytest.mark.parametrize(("photos", "more"), [(3, 2), (3, 4), (4, 4)])
def test_chosen_photographs_are_better_than_random_ones(photos, more):
    """RMS of the true rotation error over 60 sets; chosen ones are held by hand: off by 5 deg, 2 % aside, 10 % away."""
    n, sets = 5, 60
    poses, errors = _working(n), []
    for k in range(sets):
        rng = np.random.default_rng([k, photos, more])
        made = _set(n, photos, [k, photos, more])
        network, views = made.network(), made.views
        random = _with(views, photographed(made.design, made.true, *hand_held(more, rng, made.design), rng).views)
        for _ in range(more):
            asked = next_photos(adjust(network, views), poses, count=1).photos[0]
            views = _with(views, _taken(made, *_held_by_hand(asked, made.true, rng), rng))
        errors.append([_true_error(adjust(network, item), made, poses) for item in (random, views)])
    squares = np.square(errors)
    again = np.random.default_rng(0).integers(0, sets, (2000, sets))
    ratio = np.sqrt(squares[again, 1].mean(axis=1) / squares[again, 0].mean(axis=1))
    low, high = np.quantile(ratio, [0.025, 0.975])
    print(f"{photos}+{more}: random, chosen {np.sqrt(squares.mean(axis=0))} deg, ratio {low:.2f} to {high:.2f}")
    assert high < 0.85


def _held_by_hand(photo, places, rng):
    for _ in range(50):
        rotation = exponential(rng.normal(0, np.deg2rad(5), 3)) @ photo.candidate.rotation[0]
        translation = photo.candidate.translation[0] * (1 + 0.1 * abs(rng.normal()))
        translation[:2] += rng.normal(0, 0.02 * translation[2], 2)
        if CAMERA.sees(CAMERA.project(places, rotation[None], translation[None])).all():
            break
    return rotation, translation


def _true_error(result, made, poses):
    """RMS rotation error in deg of poses by the dots as found, from their true errors and the image's noise."""
    places = in_gauge(result.network, made.true, made.rotation[:1], made.translation[:1])[0]
    off, size = (result.places - places).ravel(), 3 * len(places)
    blocks = np.stack([result.covariance[i : i + 3, i : i + 3] for i in range(0, size, 3)])
    output = sensitivity(result.places, result.camera, *poses, NOISE, blocks)
    squares = np.zeros((output.transfer.shape[-1],) * 2)
    squares[:size, :size] = np.outer(off, off)
    return output.expected(squares).rotation_deg
