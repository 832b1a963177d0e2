import json

import cv2
import numpy as np
import pytest

from markergen.detect.batch import Job, job_from_files, overlay_names, to_json
from markergen.detect.sentences import image_lines, summary
from markergen.errors import InputError
from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import angle_between, exponential
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker_json import to_json as marker_to_json
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()
POSE = 130


@pytest.fixture
def job(pentagon):
    return Job((pentagon,), ("marker.json",), PAPER_CAMERA, ErrorSources())


@pytest.fixture
def photo(tmp_path, pentagon):
    rng = np.random.default_rng(0)
    image = render_view(pentagon, PAPER_CAMERA, POSES.rotation[POSE], POSES.translation[POSE], Optics(), rng)
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), image)
    return path


def test_photo_of_the_marker(job, photo):
    outcome = job.run(photo)
    assert outcome.found
    assert outcome.size == (640, 480)
    (entry,) = json.loads(to_json(job, [outcome.without_image()]))
    assert (entry["image"], entry["size"], entry["error"]) == (str(photo), [640, 480], None)
    (found,) = entry["markers"]
    assert (found["marker"], found["found"], found["missing"]) == ("marker.json", True, [])
    assert found["ids"] == [10, 11, 12, 13, 14]
    pose = found["pose"]
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
    assert "5 of 5 dots" in image_lines(job, outcome)[0]
    assert job.overlay(outcome).startswith(b"\x89PNG")


def test_without_a_camera_there_is_a_homography(pentagon, photo):
    job = Job((pentagon,), ("marker.json",), None, ErrorSources())
    (found,) = job.as_dict(job.run(photo))["markers"]
    assert found["pose"] is None
    homography = np.array(found["homography"])
    origin = homography[:2, 2] / homography[2, 2]
    # The camera looks at the origin.
    np.testing.assert_allclose(origin, [320, 240], atol=0.1)


def test_one_bad_file_does_not_stop_the_others(job, photo, tmp_path):
    (tmp_path / "broken.png").write_bytes(photo.read_bytes()[:200])
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((48, 64), np.uint8))
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((480, 640), 200, np.uint8))
    outcomes = [job.run(tmp_path / f"{name}.png") for name in ("broken", "small", "empty", "photo")]
    assert [bool(each.error) for each in outcomes] == [True, True, False, False]
    assert [each.found for each in outcomes] == [False, False, False, True]
    assert "640x480" in outcomes[1].error
    assert "64x48" in outcomes[1].error
    assert outcomes[2].detections[0].reason
    assert job.overlay(outcomes[0]) is None
    json.loads(to_json(job, outcomes))
    assert summary(outcomes) == "found a marker in 1 of 4 images, 2 could not be used"
    for outcome in outcomes:
        assert all("\n" not in line for line in image_lines(job, outcome))


def test_photometric_refinement_is_applied(pentagon, photo):
    plain, refined = (
        Job((pentagon,), ("m",), PAPER_CAMERA, ErrorSources(), photometric).run(photo).detections[0].pixels
        for photometric in (False, True)
    )
    assert 0 < np.abs(plain - refined).max() < 0.1


def test_job_from_files(tmp_path, pentagon):
    path = tmp_path / "marker.json"
    path.write_bytes(marker_to_json(pentagon))
    job = job_from_files([path], print_sigma=0.0, refinement="photometric")
    assert (len(job.markers), job.camera, job.photometric) == (1, None, True)
    with pytest.raises(InputError, match="none or photometric"):
        job_from_files([path], refinement="magic")
    with pytest.raises(InputError, match="--camera"):
        job_from_files([path], camera_covariance=tmp_path / "c.txt")


def test_overlays_of_images_of_one_name_do_not_collide(tmp_path):
    paths = [tmp_path / "a" / "x.png", tmp_path / "b" / "x.jpg", tmp_path / "x-2.png", tmp_path / "y.png"]
    names = overlay_names(paths)
    assert len(set(names)) == 4
    assert names[0] == "x.png"
