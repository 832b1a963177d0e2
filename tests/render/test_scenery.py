import numpy as np
import pytest

from benchmarks.detection_scenes import scattered
from markergen.errors import InputError
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.poses import paper
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS, Occluder, clutter, hiding, photo

CAMERA = Camera(160, 120, 200, 200, 80, 60)
POSES = paper()
POSE = POSES.rotation[66], POSES.translation[66]
SHARP = Optics(0, 0)


def test_background_ends_at_the_plate(pentagon):
    texture = np.random.default_rng(0).integers(0, 256, (480, 640))
    image = render_view(pentagon, PAPER_CAMERA, *POSE, SHARP, None, Scenery(texture))
    # The plate's rim from its default margin of one dot diameter.
    angle = 2 * np.pi * np.arange(360) / 360
    for factor, inside in ((0.98, True), (1.02, False)):
        rim = factor * 0.186 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        pixels = np.rint(PAPER_CAMERA.project(rim, POSE[0][None], POSE[1][None])[0]).astype(int)
        pixels = pixels[PAPER_CAMERA.sees(pixels)]
        assert len(pixels) > 100
        printed = image[pixels[:, 1], pixels[:, 0]]
        np.testing.assert_array_equal(printed, 225 if inside else texture[pixels[:, 1], pixels[:, 0]])


def test_levels_beyond_ink_and_substrate_come_out_as_they_are(pentagon):
    for level in (0.0, 255.0, 17.0):
        image = render_view(pentagon, PAPER_CAMERA, *POSE, SHARP, None, Scenery(level))
        assert image[0, 0] == level


@pytest.mark.parametrize("background", [np.zeros((480, 641)), np.zeros(480), np.zeros((480, 640, 3))])
def test_backgrounds_of_another_shape_are_refused(background, pentagon):
    with pytest.raises(InputError, match="640x480"):
        render_view(pentagon, PAPER_CAMERA, *POSE, SHARP, None, Scenery(background))


@pytest.mark.parametrize("background", [float("nan"), np.full((480, 640), np.inf)])
def test_backgrounds_that_are_no_levels_are_refused(background):
    with pytest.raises(InputError, match="finite"):
        Scenery(background)


@pytest.mark.parametrize("name", list(BACKGROUNDS))
def test_backgrounds_fill_the_image_and_repeat_with_their_seed(name):
    first, again, other = (BACKGROUNDS[name](CAMERA, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (120, 160)
    assert first.min() >= 0
    assert first.max() <= 255
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_there_is_clutter_and_photo():
    assert set(BACKGROUNDS) == {"clutter", "photo"}


def test_clutter_has_contrast_all_over():
    spread = [clutter(PAPER_CAMERA, np.random.default_rng(seed)).reshape(4, 120, 4, 160).std(axis=(1, 3)).min()
              for seed in range(4)]  # fmt: skip
    assert min(spread) > 10


def test_photos_are_pictures_of_many_kinds():
    views = [photo(CAMERA, np.random.default_rng(seed)) for seed in range(60)]
    # All of them have something to see in almost all of their parts; the moon has the least.
    assert np.median([view.std() for view in views]) > 20
    assert len({view.tobytes() for view in views}) == 60


@pytest.mark.parametrize("share", [0.0, 0.05, 0.4])
def test_scattered_things_cover_the_asked_share(share):
    things = scattered(share, CAMERA, np.random.default_rng(7))
    covered = np.zeros((120, 160), dtype=bool)
    before = Scenery(225.0)
    for marked in (Occluder(thing.outlines, 0.0) for thing in things):
        covered |= _covered(marked, before) > 0.5
    # Pixels are counted whole here: half of those on the outlines, which are a few hundred of 19200.
    assert covered.mean() == pytest.approx(share, abs=0.01)


def _covered(thing, before):
    ink = before.ink_behind(CAMERA, SHARP, 1)
    Scenery(occluders=(thing,)).cover(ink, Optics(0, 0, 0, 225), 1)
    return ink


def test_scattered_things_are_dark_bright_and_textured_and_repeat():
    first, again = (scattered(0.5, CAMERA, np.random.default_rng(3)) for _ in range(2))
    assert {np.ndim(thing.grey) for thing in first} == {0, 2}
    assert [np.sum(thing.outlines[0]) for thing in first] == [np.sum(thing.outlines[0]) for thing in again]


@pytest.mark.parametrize("share", [-0.1, 0.95, float("nan")])
def test_impossible_shares_are_refused(share):
    with pytest.raises(InputError, match="share"):
        scattered(share, CAMERA, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("pose", "hidden"),
    [
        pytest.param(pose, hidden, marks=() if k % 3 == j else pytest.mark.long)
        for k, hidden in enumerate([[], [0], [1, 3], [0, 1, 2, 3, 4]])
        for j, pose in enumerate([3, 66, 95])
    ],
)
def test_hidden_dots_are_gone_and_all_others_are_whole(hidden, pose, pentagon):
    rotation, translation = POSES.rotation[pose], POSES.translation[pose]
    optics = Optics(0, 0, 0, 255)
    for seed in range(3):
        things = hiding(pentagon, hidden, PAPER_CAMERA, rotation, translation, np.random.default_rng(seed))
        assert len(things) == len(hidden)
        with_things = render_view(
            pentagon, PAPER_CAMERA, rotation, translation, optics, None, Scenery(occluders=things)
        )
        without = render_view(pentagon, PAPER_CAMERA, rotation, translation, optics, None)
        y, x = np.indices(without.shape)
        for k, point in enumerate(pentagon.control_points):
            # Pixels from whose middle the line of sight meets the dot.
            rays = PAPER_CAMERA.from_pixels(np.stack([x, y], axis=-1))
            ahead = np.concatenate([rays, np.ones((*x.shape, 1))], axis=-1) @ rotation
            eye = -rotation.T @ translation
            place = eye - eye[2] / ahead[..., 2:] * ahead
            on_dot = np.hypot(place[..., 0] - point.x, place[..., 1] - point.y) < point.feature.diameter / 2
            if k in hidden:
                # One level all over, darker than the substrate and lighter than ink.
                assert len(np.unique(with_things[on_dot])) == 1
                assert 40 <= with_things[on_dot][0] < 240
            else:
                np.testing.assert_array_equal(with_things[on_dot], without[on_dot])


def test_dots_hemmed_in_are_hidden_by_a_round_piece(make_marker):
    # Seven dots as near to each other as their clearance lets them: the middle one has no way out.
    angle = np.pi / 3 * np.arange(6)
    marker = make_marker(np.vstack([[[0, 0]], 0.0396 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)]), 0.15, 0.036)
    (piece,) = hiding(marker, [0], PAPER_CAMERA, *POSE, np.random.default_rng(0))
    seen = PAPER_CAMERA.project(marker.xyz, POSE[0][None], POSE[1][None])[0]
    width = np.ptp(piece.outlines[0], axis=0).max()
    assert width < 1.2 * np.linalg.norm(seen[1:] - seen[0], axis=-1).max()
