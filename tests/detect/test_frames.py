"""Whatever a frame's type, memory, size and content, and whatever is looked for in it: found, or a reason, no error."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from markergen.detect import Detector
from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.marker import light_marker
from markergen.model.tag import parse_tag
from markergen.render import Optics, render_view

CAMERA = Camera(320, 240, 400, 400, 160, 120)
AHEAD = np.diag([1.0, -1.0, -1.0])
TILTED = cv2.Rodrigues(np.array([0.5, 0.3, 0.2]))[0] @ AHEAD
FACING = cv2.Rodrigues(np.array([0.1, -0.2, 0.1]))[0] @ AHEAD


def locked(image):
    image = image.copy()
    image.flags.writeable = False
    return image


def spread(image):
    """Every second column of a larger one."""
    wide = np.full((image.shape[0], 2 * image.shape[1] + 7, *image.shape[2:]), 99, image.dtype)
    wide[:, 7::2] = image
    return wide[:, 7::2]


def color(image):
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)


EQUAL = {
    "one channel": lambda image: image[..., None],
    "BGR": color,
    "BGRA": lambda image: cv2.cvtColor(image, cv2.COLOR_GRAY2BGRA),
    "every second column": lambda image: spread(color(image)),
    "turned twice": lambda image: np.rot90(np.rot90(image).copy(), -1),
    "mirrored twice": lambda image: image[:, ::-1].copy()[:, ::-1],
    "columns first": lambda image: np.asfortranarray(image),
    "read-only": locked,
    "a subclass": lambda image: image.view(np.ma.MaskedArray),
}
"""The same grey levels in another form."""

DEEP = {
    "16 bits": lambda image: image.astype(np.uint16) * 257,
    "16 bits, bytes swapped": lambda image: (image.astype(np.uint16) * 257).astype(">u2"),
    "16 bits BGR": lambda image: color(image.astype(np.uint16) * 257),
    "12 bits": lambda image: image.astype(np.uint16) * 16,
    "a narrow range of 16 bits": lambda image: 900 + 2 * image.astype(np.uint16),
    "a narrow range at the top": lambda image: 65535 - 3 * (255 - image.astype(np.uint16)),
    "read-only columns of 16 bits": lambda image: locked(spread(image.astype(np.uint16) * 257)),
}
"""The same picture in other levels."""


def seen(marker, rotation, translation, optics=None, camera=CAMERA):
    return render_view(marker, camera, rotation, np.array(translation), optics or Optics(), np.random.default_rng(1))


class Scene:
    """Markers, what is looked for, and a frame with a truth for each that is in it."""

    def __init__(self, light, placed, absent=(), optics=None):
        made = [light_marker(item) if light else item for item, _, _ in placed]
        self.sought = list(dict.fromkeys([*made, *(light_marker(item) if light else item for item in absent)]))
        views = [seen(item, *place, optics) for item, (_, *place) in zip(made, placed, strict=True)]
        self.frame = np.minimum.reduce(views)
        self.truth = [
            (self.sought.index(item), CAMERA.project(item.xyz, place[0][None], np.array(place[1])[None])[0])
            for item, (_, *place) in zip(made, placed, strict=True)
        ]
        self.flat = not any(item.xyz[:, 2].any() for item in self.sought)

    def check(self, findings, most=0.1):
        """All that is there has been found with the right labels, in its place, and nothing else."""
        assert len([item for item in findings if item.ok]) == len(self.truth), [str(item) for item in findings]
        for index, truth in self.truth:
            nearby = [
                item
                for item in findings
                if item.ok and item.index == index and np.abs(item.pixels.mean(axis=0) - truth.mean(axis=0)).max() < 20
            ]
            assert len(nearby) == 1
            ids = [point.id for point in nearby[0].marker.control_points]
            assert nearby[0].ids.tolist() == ids
            assert np.abs(nearby[0].pixels - truth).max() < most
        for item in findings:
            assert item.ok or (item.reason and "\n" not in item.reason)


LEFT, RIGHT, MIDDLE = (FACING, (-0.17, 0.0, 0.85)), (TILTED, (0.19, 0.02, 0.9)), (TILTED, (0.0, 0.01, 0.6))


@pytest.fixture(scope="module")
def scene(pentagon, irregular, ngon):
    """scene(name, light): rendered once."""
    tag = {k: replace(pentagon, tag=parse_tag(f"aruco:DICT_4X4_50:{k}", 0.07)) for k in (7, 8, 9)}
    raised = ngon(5, heights=[0, 0.01, 0.02, 0, 0.03])
    placed = {
        "one": ([(pentagon, *MIDDLE)],),
        "copies": ([(pentagon, *LEFT), (pentagon, *RIGHT)],),
        "two markers": ([(pentagon, *RIGHT), (irregular, *LEFT)], [ngon(8)]),
        "a family": ([(tag[7], *LEFT), (tag[9], *RIGHT)], [tag[8]]),
        "relief": ([(raised, *MIDDLE)],),
        "saturated": ([(pentagon, *MIDDLE)], [], Optics(exposure=1.4, dark=0)),
        "faint": ([(pentagon, *MIDDLE)], [], Optics(dark=90, light=130, noise_grey=1)),
    }
    made = {}

    def get(name, light):
        if (name, light) not in made:
            made[name, light] = Scene(light, *placed[name])
        return made[name, light]

    return get


@pytest.mark.parametrize("light", [False, True], ids=["dark", "light"])
@pytest.mark.parametrize("name", ["one", "copies", "two markers", "a family", "relief", "saturated", "faint"])
def test_what_is_in_the_frame_is_found(scene, name, light):
    here = scene(name, light)
    assert np.isin([0, 255], here.frame).any() == (name == "saturated")
    detector = Detector(here.sought, CAMERA)
    findings = detector(here.frame)
    here.check(findings)
    here.check(detector(here.frame, near=[item for item in findings if item.ok]))
    for item in findings:
        if item.ok:
            assert item.covariance.shape == (6, 6)
            assert (item.homography is None) == (name == "relief")
            assert (item.tag is not None) == (name == "a family")
    if here.flat:
        here.check(Detector(here.sought)(here.frame))
    # As if they were not there for a detector of the other kind.
    if not light:
        other = [light_marker(item) for item in here.sought]
        assert not any(item.ok for item in Detector(other, CAMERA)(here.frame))


@pytest.mark.parametrize("light", [False, True], ids=["dark", "light"])
def test_colors_channels_and_memory_do_not_matter(scene, light):
    here = scene("a family", light)
    detector = Detector(here.sought[:2], CAMERA)
    grey = detector(here.frame)
    for name, form in EQUAL.items():
        other = form(here.frame)
        before = np.array(other)
        for one, same in zip(grey, detector(other), strict=True):
            np.testing.assert_array_equal(same.pixels, one.pixels, err_msg=name)
            np.testing.assert_array_equal(same.rvec, one.rvec, err_msg=name)
        np.testing.assert_array_equal(other, before, err_msg=name)
    np.testing.assert_array_equal(detector.dots(color(here.frame)), detector.dots(here.frame))


@pytest.mark.parametrize("light", [False, True], ids=["dark", "light"])
@pytest.mark.parametrize("form", DEEP)
def test_deep_frames(scene, form, light):
    here = scene("a family", light)
    detector = Detector(here.sought[:2], CAMERA)
    image = DEEP[form](here.frame)
    findings = detector(image)
    here.check(findings)
    eight = {item.name: item for item in detector(here.frame) if item.ok}
    for item in findings:
        if item.ok:
            # The same levels up to a factor: the fit only starts a little elsewhere. Slopes of the light are reckoned
            # from black, so that an offset changes them, and what they cost, which is up to a third of the information.
            # Noise is 0.004 px.
            atol, rtol = (1e-2, 0.5) if "narrow" in form else (1e-3, 0.05)
            np.testing.assert_allclose(item.pixels, eight[item.name].pixels, atol=atol)
            np.testing.assert_allclose(
                item.pixel_covariance, eight[item.name].pixel_covariance, rtol=rtol, atol=rtol * 1e-5
            )


def test_colors_are_weighed_as_in_files(pentagon, scene, tmp_path):
    """A red sheet with green dots: only with the right weights is it bright with dark dots, or the other way around."""
    from markergen.read.images import read_image

    share = scene("one", False).frame.astype(float) / 255
    colors = [np.array([40, 60, 200]) * share[..., None] + np.array([90, 70, 10]) * (1 - share[..., None])]
    colors.append(np.concatenate([colors[0], 255 * (share[..., None] > 0.2)], axis=-1))
    detector = Detector(pentagon, CAMERA)
    for k, color in enumerate(colors):
        image = np.rint(color).astype(np.uint8)
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
        from_file = detector(read_image(tmp_path / f"{k}.png").grey)
        for one, other in zip(detector(image), from_file, strict=True):
            assert (one.ok, one.reason) == (other.ok, other.reason)
            np.testing.assert_array_equal(one.pixels, other.pixels)
    assert detector(np.rint(colors[0]).astype(np.uint8))[0].ok


SIZES = [(1, 1), (1, 2), (2, 1), (3, 5), (1, 320), (240, 1), (2, 320), (7, 7), (16, 16), (17, 60)]
RNG = np.random.default_rng(5)
CONTENTS = {
    "black": lambda shape: np.zeros(shape, np.uint8),
    "white": lambda shape: np.full(shape, 255, np.uint8),
    "grey": lambda shape: np.full(shape, 77, np.uint8),
    "black in 16 bits": lambda shape: np.zeros(shape, np.uint16),
    "white in 16 bits": lambda shape: np.full(shape, 65535, np.uint16),
    "squares": lambda shape: (255 * ((np.indices(shape) // 2).sum(axis=0) % 2)).astype(np.uint8),
    "every second pixel": lambda shape: (255 * (np.indices(shape).sum(axis=0) % 2)).astype(np.uint8),
    "one dark pixel": lambda shape: np.where(np.arange(np.prod(shape)).reshape(shape) == 0, 0, 255).astype(np.uint8),
    "noise": lambda shape: RNG.integers(0, 256, shape, np.uint8),
    "noise in 16 bits": lambda shape: RNG.integers(0, 65536, shape, np.uint16),
    "faint noise in 16 bits": lambda shape: RNG.integers(30000, 30003, shape, np.uint16),
    "ramp": lambda shape: np.broadcast_to(np.linspace(0, 255, shape[1]).astype(np.uint8), shape),
}


@pytest.mark.parametrize("content", CONTENTS)
def test_frames_without_anything(pentagon, content):
    """Tiny, thin, empty, saturated: nothing is found, with a reason, and nothing is a dot that is none."""
    tagged = replace(pentagon, tag=parse_tag("aruco:DICT_4X4_50:7", 0.05))
    detector = Detector([tagged, light_marker(tagged)])
    for shape in [*SIZES, (120, 160)]:
        image = CONTENTS[content](shape)
        findings = detector(image)
        assert [item.ok for item in findings] == [False, False]
        assert all(item.reason for item in findings)
        dots = detector.dots(image)
        assert dots.shape[1:] == (2,)
        if "noise" not in content:
            assert len(dots) == 0


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (None, "found None; cv2.imread returns None when it cannot read the file: check the path"),
        ("photo.png", "expected a readable image at photo.png"),
        (Path("photo.png"), "expected a readable image at photo.png"),
        ((True, np.zeros((240, 320), np.uint8)), "returns (ok, frame)"),
        ([[1, 2], [3, 4]], "found list"),
        (7, "found int"),
        (np.zeros((240, 320), bool), "found bool; give 255 *"),
        (np.zeros((240, 320, 3), np.float32), "found float32; give (255 * frame)"),
        (np.zeros((240, 320), np.int64), "found int64"),
        (np.zeros((240, 320), object), "found object"),
        (np.zeros((240, 320), "U5"), "found <U5"),
        (np.zeros((0, 320), np.uint8), "with pixels"),
        (np.zeros((240, 320, 0), np.uint8), "with pixels"),
        (np.zeros((3, 240, 320), np.uint8), "frame.transpose(1, 2, 0)"),
        (np.zeros((2, 240, 320, 3), np.uint8), "one image at a time"),
        (np.zeros((240, 320, 2), np.uint8), "shape (240, 320, 2)"),
        (np.zeros(320, np.uint8), "shape (320,)"),
        (np.uint8(3), "found numpy.uint8"),
        (np.array(3, np.uint8), "shape ()"),
        (np.broadcast_to(np.uint8(0), (10**6, 10**6)), "at most 400 megapixels, found 1000000x1000000 px"),
        (np.broadcast_to(np.uint8(0), (10**6, 10**6, 3)), "at most 400 megapixels"),
        (np.zeros((320, 240, 3), np.uint8), "320x240 px, found 240x320 px; give the file's path"),
        (np.zeros((480, 640, 3), np.uint8), "320x240 px, found 640x480 px; give the calibration for this size"),
    ],
)
def test_what_is_no_frame_is_refused_in_one_line(pentagon, image, message):
    detector = Detector(pentagon, CAMERA)
    for use in (detector, detector.dots):
        with pytest.raises(InputError) as caught:
            use(image)
        line = str(caught.value)
        assert message in line
        assert "\n" not in line


@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_photographs_are_read_as_the_sensor_took_them(pentagon, tmp_path, orientation):
    detector, frame, path = Detector(pentagon, CAMERA), seen(pentagon, *MIDDLE), tmp_path / "photo.png"
    exif = Pillow.Exif()
    exif[0x0112] = orientation
    Pillow.fromarray(frame).save(path, exif=exif)
    (direct,), (by_path,), (by_name,) = detector(frame), detector(path), detector(str(path))
    assert direct.ok
    for finding in (by_path, by_name):
        np.testing.assert_array_equal(finding.tvec, direct.tvec)
    np.testing.assert_array_equal(detector.dots(path), detector.dots(frame))
    # As in the documentation: OpenCV turns what is marked as turned.
    assert np.array_equal(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), frame) == (orientation == 1)
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    np.testing.assert_array_equal(detector(cv2.imread(str(path), flags))[0].tvec, direct.tvec)
