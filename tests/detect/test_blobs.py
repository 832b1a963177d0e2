import numpy as np
import pytest

from markergen.detect.blobs import detect_dots
from markergen.errors import InputError
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()


def view(marker, pose, optics=None, seed=0):
    rng = np.random.default_rng(seed)
    return render_view(marker, PAPER_CAMERA, POSES.rotation[pose], POSES.translation[pose], optics or Optics(), rng)


@pytest.mark.parametrize("pose", [0, 90, 275, 399])
def test_finds_the_dots_and_the_ring(pentagon, pose):
    blobs = detect_dots(view(pentagon, pose))
    assert len(blobs) == 5
    assert blobs.ring.sum() == 1
    assert (blobs.semi[:, 0] >= blobs.semi[:, 1]).all()


def test_more_bits_give_the_same_dots(pentagon):
    image = view(pentagon, 90)
    eight, sixteen = detect_dots(image), detect_dots(image.astype(np.uint16) * 257)
    # The fit does not depend on the unit of the grey levels, to its last step of 1e-3 px.
    np.testing.assert_allclose(eight.center, sixteen.center, rtol=0, atol=1e-3)
    np.testing.assert_array_equal(eight.ring, sixteen.ring)


def test_uneven_light_is_no_hindrance(pentagon):
    image = view(pentagon, 130)
    shaded = (image * np.linspace(0.3, 1.0, image.shape[1])).astype(np.uint8)
    blobs = detect_dots(shaded)
    assert len(blobs) == 5
    assert blobs.ring.sum() == 1


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (2, 640), (480, 2), (3, 3), (480, 640)])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_flat_images_have_no_dots(shape, level):
    assert len(detect_dots(np.full(shape, level, np.uint8))) == 0


@pytest.mark.parametrize("seed", range(3))
def test_noise_has_no_dots(seed):
    rng = np.random.default_rng(seed)
    assert len(detect_dots(rng.integers(0, 256, (480, 640)).astype(np.uint8))) == 0
    assert len(detect_dots((128 + 5 * rng.standard_normal((480, 640))).astype(np.uint8))) == 0
    assert len(detect_dots(rng.integers(0, 65536, (480, 640)).astype(np.uint16))) == 0


def test_dots_cut_off_by_the_edge_are_left_out(pentagon):
    image = view(pentagon, 0)
    center = detect_dots(image).center
    leftmost = int(center[:, 0].min())
    assert len(detect_dots(np.ascontiguousarray(image[:, leftmost:]))) == 4


def test_rectangles_and_letters_are_no_dots(pentagon):
    image = view(pentagon, 130)
    image[20:50, 20:50] = 30
    image[400:470, 30:38] = 30
    image[400:408, 30:90] = 30
    assert len(detect_dots(image)) == 5


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.zeros(9, np.uint8), np.zeros((4, 4), np.int64)]
)
def test_other_images_are_refused(image):
    with pytest.raises(InputError, match="uint8 or uint16"):
        detect_dots(image)
