"""From photographs to labeled dots: rendered ones, and real ones where they are."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow
from sentences import sentence
from simulated_photos import hand_held, layout

import markergen as mg
from markergen.calibration.network import CameraFreedom, Network
from markergen.calibration.photos import Labeled, _started, find_dots
from markergen.calibration.residuals import adjust_robustly
from markergen.errors import InputError
from markergen.maths.conics import outlines
from markergen.maths.rotation import exponential
from markergen.model.boundary import Circle
from markergen.model.camera import Camera, Distortion
from markergen.model.marker import Marker, build_marker
from markergen.read.images import ORIENTATION_NOTE
from markergen.render import Optics, render_view

PHOTOS = Path(__file__).parents[3] / "shared" / "photos"
CAMERA = Camera(640, 480, 700.0, 700.0, 322.0, 238.0, Distortion("radtan", (-0.2, 0.05, 0.0, 0.0, 0.0)))


def grid_marker(columns=6, rows=5, pitch=0.03):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows)[::-1])
    places = np.column_stack([x.ravel(), y.ravel()]) * pitch
    return build_marker(places - places.mean(axis=0), Circle(0.13), diameter=0.014, clearance=0.002, keyed=False)


def dots_marker(n):
    diameter = 0.03 if n == 5 else 0.012
    places = layout(5)[:, :2] * 0.9 if n == 5 else _scattered(n)
    return build_marker(places, Circle(0.13), diameter=diameter, clearance=0.002)


def _scattered(n):
    rng, places = np.random.default_rng(3), np.zeros((0, 2))
    while len(places) < n:
        new = rng.uniform(-0.09, 0.09, 2)
        if np.hypot(*new) < 0.11 and (np.hypot(*(places - new).T) > 0.022).all():
            places = np.vstack([places, new])
    return places


def misprinted(marker, rng, sigma=1e-4):
    """The marker as it was printed: dots off by sigma."""
    points = tuple(
        replace(point, x=point.x + dx, y=point.y + dy)
        for point, (dx, dy) in zip(marker.control_points, rng.normal(0, sigma, (len(marker), 2)), strict=True)
    )
    return replace(marker, control_points=points)


def rendered(marker, count, rng):
    rotation, translation = hand_held(count, rng, (15, 45))
    translation *= 0.5 / translation[:, 2:]
    poses = zip(rotation, translation, strict=True)
    return [render_view(marker, CAMERA, *pose, Optics(), rng) for pose in poses], rotation, translation


def check(result, marker, rotation, translation, relabeled=None):
    """Every dot seen is where the marker's own dot of this label, or `turn` of it, is."""
    truth = CAMERA.project(marker.xyz, rotation, translation)
    views = result.views
    np.testing.assert_array_equal(result.photo, np.arange(len(rotation)))
    assert views.seen.mean() > 0.95
    place = np.arange(len(marker)) if relabeled is None else relabeled
    off = np.linalg.norm(views.pixels - truth[:, place], axis=-1)
    assert off[views.seen].max() < 0.6  # centers of ellipses are not images of centers


@pytest.mark.parametrize("n", [5, 24])
def test_dots_of_rendered_photographs_are_found_and_labeled(n):
    rng = np.random.default_rng(n)
    marker = dots_marker(n)
    frames, rotation, translation = rendered(misprinted(marker, rng), 4, rng)
    result, camera = find_dots([marker], frames, CAMERA)
    assert camera is CAMERA
    assert not result.unused
    assert not result.doubts
    assert result.size == (640, 480)
    check(result, marker, rotation, translation)
    np.testing.assert_allclose(result.views.translation, translation, rtol=0.01, atol=1e-3)
    np.testing.assert_allclose(result.views.rotation, rotation, rtol=0, atol=0.05)


@pytest.mark.parametrize("reference", [False, True])
def test_a_symmetric_grid_is_labeled_by_all_photographs_together(reference):
    rng = np.random.default_rng(7)
    marker = grid_marker()
    frames, rotation, translation = rendered(misprinted(marker, rng), 4, rng)
    result, camera = find_dots([marker], frames, CAMERA if reference else None)
    assert not result.unused
    (doubt,) = result.doubts
    assert "turned together" in doubt
    off = np.linalg.norm(result.views.pixels[0, 0] - CAMERA.project(marker.xyz, rotation, translation)[0], axis=1)
    relabeled = np.arange(30) if off.argmin() == 0 else np.arange(30)[::-1]
    check(result, marker, rotation, translation, relabeled)
    if not reference:
        assert abs(camera.fx / 700 - 1) < 0.05
        assert abs(camera.distortion.coefficients[0] + 0.2) < 0.05


def test_photographs_that_cannot_be_used_say_why():
    rng = np.random.default_rng(5)
    marker = dots_marker(5)
    frames, *_ = rendered(marker, 2, rng)
    aside = [np.array([x, 0.0, 1.0]) for x in (-0.17, 0.17)]
    level = np.diag([1.0, -1.0, -1.0])
    twice = np.minimum(*(render_view(marker, CAMERA, level, item, Optics(), rng) for item in aside))
    result, _ = find_dots([marker], [frames[0], np.full((480, 640), 200, np.uint8), twice, frames[1]], CAMERA)
    assert result.photo.tolist() == [0, 3]
    assert "found 0 dots" in result.unused[1]
    assert "2 copies" in result.unused[2]


@pytest.fixture(scope="module")
def shots():
    rng = np.random.default_rng(5)
    marker = dots_marker(5)
    return marker, rendered(marker, 4, rng)[0]


@pytest.mark.parametrize(
    ("reference", "odd"),
    # To find a camera takes long.
    [(True, 0), (True, 2), (True, 4), (False, 0), *(pytest.param(False, k, marks=pytest.mark.long) for k in (2, 4))],
)
def test_a_photograph_of_another_size_is_left_out_wherever_it_stands(shots, tmp_path, odd, reference):
    marker, frames = shots
    for k, frame in enumerate(np.insert(np.array(frames), odd, 0, axis=0)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), frame[:240, :320] if k == odd else frame)
    result, _ = find_dots([marker], tmp_path, CAMERA if reference else None)
    assert result.photo.tolist() == [k for k in range(5) if k != odd]
    assert result.size == (640, 480)
    assert result.unused == {odd: f"320x240 px, {'the camera has' if reference else 'the others have'} 640x480 px"}
    assert len(result.photos) == 5


def test_photographs_without_a_usual_size_are_refused_with_counts(shots, tmp_path):
    marker, frames = shots
    mixed = [*frames[:3], *(frame[:400] for frame in frames[:2])]
    message = (
        r"one size, found 3 of 640x480 px \(photo 0\.\.\.\), 2 of 640x400 px \(photo 3\.\.\.\); give all as the camera"
    )
    with pytest.raises(InputError, match=message):
        find_dots([marker], mixed, None)
    assert find_dots([marker], mixed, CAMERA)[0].photo.tolist() == [0, 1, 2]
    with pytest.raises(InputError, match=r"640x480 px, found 1 of 640x400 px \(photo 0\)"):
        find_dots([marker], mixed[3], CAMERA)


def test_files_that_cannot_be_read_are_told_apart(shots, tmp_path):
    marker, frames = shots
    (tmp_path / "0.png").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"^expected a PNG, .* in .*0\.png, found another"):
        find_dots([marker], tmp_path, None)
    cv2.imwrite(str(tmp_path / "1.png"), frames[0])
    (tmp_path / "2.HEIC").write_bytes(b"")
    (tmp_path / "3.jpg").write_bytes(turned(frames[1], tmp_path))
    result, _ = find_dots([marker], tmp_path, CAMERA)
    assert result.photo.tolist() == [1, 2]
    assert "another format" in result.unused[0]
    unread, oriented = result.notes
    assert unread == f"{tmp_path}: {sentence('HEIC file')}"
    assert oriented == ORIENTATION_NOTE


def turned(frame, folder):
    """A JPEG that says that it is to be turned."""
    exif = Pillow.Exif()
    exif[0x0112] = 6
    Pillow.fromarray(frame).save(folder / "turned", "JPEG", exif=exif, quality=95)
    return (folder / "turned").read_bytes()


REAL = pytest.mark.skipif(not PHOTOS.is_dir(), reason=f"no photographs in {PHOTOS}")


def _real(kind, reference):
    folder = PHOTOS / kind
    marker = Marker.load(folder / "marker.json")
    result, camera = find_dots([marker], str(folder), Camera.load(folder / "camera.yaml") if reference else None)
    labels = {item["image"]: item for item in json.loads((folder / "labels.json").read_text())}
    assert sorted(Path(result.photos[photo]).name for photo in result.photo) == sorted(labels)
    return marker, result, camera, [labels[Path(result.photos[photo]).name] for photo in result.photo]


def _adjusted_rms(marker, result, camera, names):
    """RMS in px along an axis of the residuals of dots that are free."""
    radii = np.array([point.feature.diameter / 2 for point in marker.control_points])
    freedom = CameraFreedom.of_names(camera, names)
    network = Network(marker.xyz, radii, (camera,), freedom, np.zeros(len(marker), dtype=np.intp))
    adjusted = adjust_robustly(network, result.views).adjustment
    return adjusted.rms / np.sqrt(2), adjusted.camera


@REAL
def test_real_photographs_of_a_symmetric_grid_agree_on_one_print():
    marker, result, camera, labels = _real("circle_grid", True)
    for pixels, label in zip(result.views.pixels, labels, strict=True):
        stated = np.array(label["centres_px_row_major"])
        assert min(np.linalg.norm(pixels - stated[::rotation], axis=1).max() for rotation in (1, -1)) < 0.5
    assert _adjusted_rms(marker, result, camera, ())[0] < 0.06


@pytest.mark.long
@REAL
def test_real_photographs_of_a_strong_lens_need_no_camera():
    marker, result, camera, _ = _real("hex_grid", False)
    assert result.views.seen.all()
    rms, camera = _adjusted_rms(marker, result, camera, ("fx", "cx", "cy", "k1", "k2"))
    assert rms < 0.03
    assert abs(camera.fx - 700) < 15
    assert abs(camera.distortion.coefficients[0] + 0.26) < 0.03


@pytest.mark.long
@REAL
@pytest.mark.parametrize("reference", [False, True])
def test_real_photographs_of_a_square_grid_are_labeled_by_its_larger_dot(reference):
    _, result, _, labels = _real("robot_grid", reference)
    assert not result.doubts
    # The labels run from the larger dot along x, then y; the marker's from the top row down.
    place = np.arange(100).reshape(10, 10)[::-1].ravel()
    for pixels, seen, label in zip(result.views.pixels, result.views.seen, labels, strict=True):
        assert seen.all()
        assert np.linalg.norm(pixels - np.array(label["centres_px_row_major"])[place], axis=1).max() < 0.5


@pytest.mark.parametrize(
    ("lens", "focal"),
    [
        pytest.param(("radtan", (-0.45, 0.2, 0.0, 0.0, 0.0)), 400.0, marks=pytest.mark.long),
        (("equidistant", (0.02, -0.01, 0.0, 0.0)), 220.0),
    ],
)
def test_a_start_has_the_lens_that_fits(lens, focal):
    """From the centers of dots alone, in four views up to the corners."""
    rng, marker = np.random.default_rng(8), grid_marker()
    camera = replace(CAMERA, fx=focal, fy=focal, cx=315.0, cy=245.0, distortion=Distortion(*lens))
    seen = []
    while len(seen) < 4:
        middle = np.append(camera.from_pixels(rng.uniform(0.2, 0.8, 2) * [camera.width, camera.height]), 1.0)
        lean = exponential(rng.uniform(-0.7, 0.7, 3) * [1, 1, 3]) @ np.diag([1.0, -1.0, -1.0])
        drawn = outlines(marker.xyz, marker.radii, lean[None], 0.12 * middle[None] / np.linalg.norm(middle))
        centers = camera.dot_centers(drawn.center, drawn.shape)[0]
        if drawn.seen.all() and camera.sees(centers).all():
            spread = np.broadcast_to(1e-4 * np.eye(2), (len(marker), 2, 2))
            seen.append(Labeled(np.arange(len(marker)), centers, spread, photo=len(seen)))
    result = _started([marker], seen, (camera.width, camera.height))
    assert result.distortion.model == lens[0]
    assert result.fx == pytest.approx(focal, rel=0.02)


@pytest.mark.parametrize("seed", [1, 11])
def test_exact_dots_without_distortion_do_not_start_with_a_fisheye(seed):
    rng, places = np.random.default_rng(seed), layout(6)[:, :2] * 0.4
    marker = build_marker(places, Circle(0.06), diameter=0.02, clearance=0.002)
    camera = Camera(1280, 960, 1400.0, 1400.0, 640.0, 480.0)
    rotation, translation = hand_held(8, rng, (5, 45))
    drawn = outlines(marker.xyz, marker.radii, rotation, translation * [0, 0, 0.5])
    spread = np.broadcast_to(1e-6 * np.eye(2), (len(marker), 2, 2))
    centers = camera.dot_centers(drawn.center, drawn.shape) + rng.normal(0, 1e-3, (8, len(marker), 2))
    seen = [Labeled(np.arange(len(marker)), center, spread, photo=k) for k, center in enumerate(centers)]
    assert _started([marker], seen, (camera.width, camera.height)).distortion.model == "radtan"


@pytest.mark.long
def test_a_dropped_photograph_is_found_through_another_lens_than_the_cameras():
    """Of 40 small dots through a lens with k1 -0.55, by a camera that is given without it."""
    marker = mg.design(n=40, radius="100mm", dot="10mm", restarts=1, seed=3).marker
    pinhole = Camera(640, 480, 380.0, 380.0, 319.5, 239.5)
    true, photos = replace(pinhole, distortion=Distortion("radtan", (-0.55, 0.32, 0.0, 0.0, -0.08))), []
    for seed in (0, 2, 8):
        rng, seen = np.random.default_rng(seed), False
        while not seen:
            rotated = exponential(rng.uniform(-0.5, 0.5, 3) * [1, 1, 3]) @ np.diag([1.0, -1.0, -1.0])
            place = np.array([*rng.uniform(-0.06, 0.06, 2), 1]) * rng.uniform(0.17, 0.3)
            pixels = true.project(marker.xyz, rotated[None], place[None])[0]
            seen = np.isfinite(pixels).all() and (pixels > 12).all() and (pixels < [628, 468]).all()
        photos.append(render_view(marker, true, rotated, place, Optics(), rng))
    result, _ = find_dots([marker], photos, pinhole)
    assert result.unused
    assert all("its lens is not the camera's" in reason for reason in result.unused.values())
    assert not find_dots([marker], photos, true)[0].unused
