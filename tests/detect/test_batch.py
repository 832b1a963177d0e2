import io
import json
import os
from threading import Event

import cv2
import numpy as np
import pytest

from markergen.detect import Detector, batch
from markergen.detect.batch import Outcome, Outcomes, detect_files, look_at, overlay_names
from markergen.errors import InputError, OutputError
from markergen.maths.rotation import angle_between, exponential
from markergen.model.body_json import to_json as marker_to_json
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.read.images import quiet
from markergen.render import Optics, render_view

POSES = paper()
POSE = 130


@pytest.fixture
def detector(pentagon, tmp_path):
    path = tmp_path / "marker.json"
    path.write_bytes(marker_to_json(pentagon))
    return Detector(path, PAPER_CAMERA)


@pytest.fixture
def photo(tmp_path, pentagon):
    rng = np.random.default_rng(0)
    image = render_view(pentagon, PAPER_CAMERA, POSES.rotation[POSE], POSES.translation[POSE], Optics(), rng)
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), image)
    return path


def test_photo_of_the_marker(detector, photo):
    outcome = look_at(detector, photo)
    assert outcome.found
    assert outcome.size == (640, 480)
    (entry,) = json.loads(Outcomes((outcome.without_image(),)).to_json())
    assert (entry["image"], entry["size"], entry["error"]) == (str(photo), [640, 480], None)
    (findings,) = entry["markers"]
    assert (findings["marker"], findings["found"], findings["missing"]) == (
        str(photo.with_name("marker.json")),
        True,
        [],
    )
    assert findings["ids"] == [10, 11, 12, 13, 14]
    pose = findings["pose"]
    # Five times what the image's noise of 2 grey levels was found to cost, 0.03 deg RMS.
    assert np.rad2deg(angle_between(np.array(pose["rotation"]), POSES.rotation[POSE])) < 0.15
    np.testing.assert_allclose(exponential(np.array(pose["rotation_vector"])), pose["rotation"], atol=1e-12)
    x, y, z, w = pose["quaternion_xyzw"]
    np.testing.assert_allclose(np.linalg.norm([x, y, z, w]), 1, atol=1e-12)
    covariance = np.array(pose["covariance"])
    assert covariance.shape == (6, 6)
    assert np.linalg.eigvalsh(covariance)[0] > 0
    # The parts of the budget add up in squares.
    for parts in pose["sigma"].values():
        squares = sum(parts[source] ** 2 for source in ("image", "print", "camera"))
        assert parts["total"] ** 2 == pytest.approx(squares)
    assert "5 of 5 dots" in outcome.lines()[0]
    assert outcome.overlay().startswith(b"\x89PNG")


def test_without_a_camera_there_is_a_homography(pentagon, photo):
    (findings,) = look_at(Detector(pentagon), photo).as_dict()["markers"]
    assert findings["pose"] is None
    homography = np.array(findings["homography"])
    origin = homography[:2, 2] / homography[2, 2]
    # The camera looks at the origin.
    np.testing.assert_allclose(origin, [320, 240], atol=0.1)


def test_one_bad_file_does_not_stop_the_others(detector, photo, tmp_path):
    (tmp_path / "broken.png").write_bytes(photo.read_bytes()[:200])
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((48, 64), np.uint8))
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((480, 640), 200, np.uint8))
    names = ("broken", "small", "empty", "photo")
    outcomes = Outcomes(tuple(look_at(detector, tmp_path / f"{name}.png") for name in names))
    assert [bool(item.error) for item in outcomes] == [True, True, False, False]
    assert [item.found for item in outcomes] == [False, False, False, True]
    assert "640x480" in outcomes[1].error
    assert "64x48" in outcomes[1].error
    assert outcomes[2].markers[0].reason
    assert outcomes[0].overlay() is None
    json.loads(outcomes.to_json())
    assert str(outcomes) == "found a marker in 1 of 4 images, 2 could not be used"
    assert outcomes.status == 2
    for outcome in outcomes:
        assert all("\n" not in line for line in outcome.lines())


def test_files_from_python(detector, photo, tmp_path, capfd):
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((48, 64), np.uint8))
    images, marker, camera = [photo, str(tmp_path / "small.png")], tmp_path / "marker.json", PAPER_CAMERA
    output, warned, steps, stream = [], [], [], io.StringIO()
    outcomes = detect_files(
        images,
        marker,
        camera,
        json=stream,
        overlay=str(tmp_path / "seen"),
        progress=lambda *step: steps.append(step),
        tell=output.append,
        warn=warned.append,
    )
    assert [item.found for item in outcomes] == [True, False]
    assert all(item.image is None for item in outcomes)
    assert outcomes.status == 2
    assert [item["image"] for item in json.loads(stream.getvalue())] == [str(item) for item in images]
    assert [path.name for path in (tmp_path / "seen").iterdir()] == ["photo.png"]
    assert output[-1] == "found a marker in 1 of 2 images, 1 could not be used" == str(outcomes)
    assert "5 of 5 dots" in output[0]
    assert len(warned) == 1
    assert "small.png" in warned[0]
    assert steps == [("detecting", done, 2) for done in range(3)]
    # Nobody who listens: nothing is said.
    assert detect_files(photo, [marker], camera, print_sigma=0.0).status == 0
    assert detect_files(str(photo), marker, None).status == 0
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((480, 640), 200, np.uint8))
    assert detect_files(tmp_path / "empty.png", marker, camera).status == 1
    assert capfd.readouterr() == ("", "")


def test_the_number_of_workers_does_not_show(detector, photo, tmp_path):
    """Neither in the results, nor in their order, nor in what is left of standard error."""
    image, before = cv2.imread(str(photo)), os.fstat(2)
    (tmp_path / "shots").mkdir()
    for number in range(6):
        # The first ones take longest.
        cv2.imwrite(str(tmp_path / "shots" / f"{number}.png"), np.roll(image, 5 * number) if number < 3 else 0 * image)
    (tmp_path / "shots" / "3.png").write_bytes(photo.read_bytes()[:300])
    written, output = [], []
    for workers in (1, 4):
        stream, lines = io.StringIO(), []
        options = {"workers": workers, "json": stream, "overlay": tmp_path / f"{workers}"}
        detect_files(tmp_path / "shots", tmp_path / "marker.json", PAPER_CAMERA, tell=lines.append, **options)
        output.append(lines)
        written.append([stream.getvalue(), *(item.read_bytes() for item in sorted(options["overlay"].iterdir()))])
    assert output[0] == output[1]
    assert written[0] == written[1]
    assert len(written[0]) == 6
    assert os.path.samestat(os.fstat(2), before)


def test_what_is_told_while_others_decode_is_not_lost(detector, tmp_path, monkeypatch, capfd):
    """Decoders are kept from standard error, which is that of the whole process."""
    decoding, output = Event(), Event()

    def look_at(detector, path, deadline=None):
        if path.stem == "slow":
            with quiet:
                decoding.set()
                assert output.wait(20)
        assert decoding.wait(20)
        return Outcome(path, None, None, (), (), "for a reason")

    def warn(line):
        os.write(2, f"{line}\n".encode())
        output.set()

    monkeypatch.setattr(batch, "look_at", look_at)
    images = [tmp_path / "fast.png", tmp_path / "slow.png"]
    for path in images:
        path.touch()
    detect_files(images, tmp_path / "marker.json", workers=2, warn=warn)
    assert capfd.readouterr().err == "".join(f"{path}: not used: for a reason\n" for path in images)


def test_what_cannot_begin_is_refused(detector, photo, tmp_path):
    marker = tmp_path / "marker.json"
    with pytest.raises(InputError, match="none or any"):
        detect_files(photo, marker, symmetric="magic")
    with pytest.raises(InputError, match="--camera"):
        detect_files(photo, marker, camera_covariance=tmp_path / "c.txt")
    with pytest.raises(InputError, match=r"a name for JSON, found found.csv"):
        detect_files(photo, marker, json="found.csv")
    with pytest.raises(InputError, match="a deadline above 0 s"):
        detect_files(photo, marker, deadline=-1)
    with pytest.raises(InputError, match="show no velocity"):
        detect_files(photo, marker, readout="30ms")
    with pytest.raises(InputError, match="1 to 256 workers"):
        detect_files(photo, marker, workers=0, overlay=tmp_path / "seen")
    assert not (tmp_path / "seen").exists()
    with pytest.raises(InputError, match="one or more images"):
        detect_files([], marker)
    with pytest.raises(OutputError, match="one of the inputs"):
        detect_files(photo, marker, json=str(marker))


def test_overlays_of_images_of_one_name_do_not_collide(tmp_path):
    paths = [tmp_path / "a" / "x.png", tmp_path / "b" / "x.jpg", tmp_path / "x-2.png", tmp_path / "y.png"]
    names = overlay_names(paths)
    assert len(set(names)) == 4
    assert names[0] == "x.png"
