"""Rigs are laid out for the joint pose."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import pattern, sentence

import markergen as mg
from markergen.bounds.dot_covariances import body_bounds
from markergen.errors import InputError
from markergen.maths.information import covariance, rotation_bound
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import exponential
from markergen.model.body_json import rig_to_json
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import build_marker
from markergen.model.poses import named_poses
from markergen.model.rig import Rig
from markergen.model.rig_shapes import rig_shape
from markergen.model.sight import dots_in_view
from markergen.model.spec import ImageNoise, Spec
from markergen.objectives import OBJECTIVES
from markergen.optimize.dot_size import DotSize
from markergen.optimize.rig_layouts import RigLayouts, best_views, seen_plates

QUICK = {"n": 4, "restarts": 1, "tag": "aruco:DICT_4X4_50:3", "poses": "cone:distance=0.3..0.8,tilt=0..60,count=30"}
SQUARE = 0.02 * np.array([[1, 1], [-1, 1.1], [-1, -1], [1, -1.2]])


@pytest.fixture(scope="module")
def layouts():
    shape = rig_shape("cube", edge=0.08)
    poses = named_poses("sphere:distance=0.3..0.5,count=30")
    spec = Spec(n=4, noise_model="image", print_sigma=1e-4)
    plates = seen_plates(shape.faces, poses, spec)
    specs = [replace(spec, boundary=plate.face.boundary) for plate in plates]
    found = RigLayouts(plates, specs, [DotSize(0.01, 0.001, "")] * 6, {}, len(poses))
    found.layouts = [SQUARE * (1 + 0.05 * k) for k in range(6)]
    return found, poses


def test_information_of_all_plates_is_that_of_all_dots_in_view(layouts):
    found, poses = layouts
    every = sum(found.information(k) for k in range(6))
    step = 1e-6
    for p in range(0, len(poses), 7):
        whole = np.zeros((6, 6))
        for k, plate in enumerate(found.plates):
            if p not in plate.index:
                continue
            face, own = plate.face, np.flatnonzero(plate.index == p)
            xyz = np.column_stack([found.layouts[k], np.zeros(4)]) @ np.array(face.rotation).T + face.translation

            def seen(change, xyz=xyz, p=p):
                rotation = exponential(change[:3]) @ poses.rotation[p]
                spots = to_camera(xyz, rotation[None], (poses.translation[p] + change[3:])[None])
                return PAPER_CAMERA.to_pixels(perspective(spots))[0]

            rows = np.stack([(seen(step * e) - seen(-step * e)) / (2 * step) for e in np.eye(6)], axis=-1)
            objective = OBJECTIVES["pose"](found.setting(k))
            weights = np.linalg.inv(
                covariance(objective.information(found.layouts[k][None])[0][0])[own[0]]
            )  # Of the plate alone, in its own frame: the second way is the derivative in the rig's.
            own_rows = objective._distorted(found.layouts[k][None])[0][0, own[0]].reshape(4, 2, 6)
            assert weights == pytest.approx(weights.T, rel=1e-6)
            noise = _dot_weights(objective, found.layouts[k], own[0])
            assert np.einsum("nik,nij,njl->kl", own_rows, noise, own_rows) == pytest.approx(weights, rel=1e-6)
            whole += np.einsum("nik,nij,njl->kl", rows, noise, rows)
        scale = np.sqrt(np.diag(whole))
        assert every[p] / scale / scale[:, None] == pytest.approx(whole / scale / scale[:, None], abs=1e-6)


def _dot_weights(objective, layout, pose):
    """Information (n, 2, 2) of each dot's image."""
    jacobian = objective._distorted(layout[None])[0]
    weighed, _ = objective._weighed(jacobian)
    j, w = (rows[0, pose].reshape(4, 2, 6) for rows in (jacobian, weighed))
    return np.stack([wk @ np.linalg.pinv(jk) for jk, wk in zip(j, w, strict=True)])


@pytest.mark.parametrize("name", ["pose", "rotation", "translation"])
def test_gradients_know_what_is_known_elsewhere(layouts, name):
    found, _ = layouts
    objective = OBJECTIVES[name](found.joint_setting(0))
    points = found.layouts[0][None]
    value, gradient = objective.value_and_gradient(points)
    assert value < OBJECTIVES[name](found.setting(0))(points) * 1.001 or name == "pose"
    step, change = 1e-7, np.zeros_like(points)
    change[0, 2, 1] = step
    slope = (objective(points + change) - objective(points - change)) / (2 * step)
    assert gradient[0, 2, 1] == pytest.approx(slope[0], rel=1e-4)


def test_more_plates_lower_the_bound(layouts):
    found, poses = layouts
    markers = [build_marker(points, found.plates[0].face.boundary, 0.01, 0.001) for points in found.layouts]
    rig = Rig(tuple(plate.face.mounted(marker) for plate, marker in zip(found.plates, markers, strict=True)))
    seen = dots_in_view(rig, PAPER_CAMERA, poses)
    joint, single = body_bounds(rig, seen, PAPER_CAMERA, poses, ImageNoise(), 1e-4)
    assert (joint <= single * (1 + 1e-9)).all()
    several = np.stack([seen[:, rig.owner == k].any(axis=1) for k in range(6)]).sum(axis=0) > 1
    assert several.any()
    assert (joint[:, several] < single[:, several]).all()
    # Where all dots of the plates in view are seen, the search takes the same information.
    every = sum(found.information(k) for k in range(6))
    counted = np.stack([np.isin(np.arange(len(poses)), plate.index) for plate in found.plates], axis=1)
    alike = (np.repeat(counted, 4, axis=1) == seen).all(axis=1)
    assert alike.any()
    expected = np.rad2deg(rotation_bound(covariance(every[alike])))
    assert joint[0, alike] == pytest.approx(expected, rel=1e-3)


def test_dots_are_sized_where_a_plate_is_seen_best(layouts):
    found, poses = layouts
    views = best_views(found.plates, len(poses))
    assert sum(map(len, views)) > 0.9 * len(poses)
    for plate, chosen in zip(found.plates, views, strict=True):
        # From above a corner at 0.3 m, where the middles of three faces are seen from 61.4 degrees.
        assert plate.poses.polar_angle_deg[chosen].max() < 61.5


def test_a_rig_with_tags():
    found = mg.rig("pair", plate="100mm", **QUICK)
    assert [str(each.marker.tag) for each in found.rig.markers] == ["aruco:DICT_4X4_50:3", "aruco:DICT_4X4_50:4"]
    assert "by their tags" in str(found)
    assert found.rig.provenance["camera"] == PAPER_CAMERA.as_dict()
    assert rig_to_json(found.rig) == rig_to_json(mg.rig("pair", plate="100mm", **QUICK).rig)
    assert not found.warnings


def test_plates_that_look_the_same_are_warned_about():
    found = mg.rig("prism:3", edge="90mm", n=4, restarts=1, poses="sphere:distance=0.24..0.62,count=8")
    assert found.warnings == (found.told_apart + sentence("tell apart"),)
    assert found.told_apart.endswith("are the same")


def test_files_are_checked_before_the_search(tmp_path):
    with pytest.raises(InputError, match=pattern("no rig suffix")):
        mg.rig("pair", output=tmp_path / "x.nothing", **QUICK)
    with pytest.raises(InputError, match="sees each plate"):
        mg.rig("cube", **QUICK)
    with pytest.raises(InputError, match="tag-size alone"):
        mg.rig("cube", tag_size="10mm")
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_faces_of_a_cube_are_not_confused():
    """No face is taken for another one in 240 views of single faces, and none that is seen well is missed."""
    from markergen.render import Optics, render_view

    found = mg.rig("cube", edge="80mm", n=6)
    assert found.safety >= 1
    markers = [each.marker for each in found.rig.markers]
    detector, rng = mg.Detector(markers, PAPER_CAMERA), np.random.default_rng(3)
    poses = named_poses("sphere:distance=0.24..0.62,count=1500,seed=4,sampling=random")
    for k, plate in enumerate(seen_plates(rig_shape("cube", edge=0.08).faces, poses, Spec())):
        for p in rng.choice(len(plate.index), 40, replace=False):
            rotation, translation = plate.poses.rotation[p], plate.poses.translation[p]
            frame = render_view(markers[k], PAPER_CAMERA, rotation, translation, Optics(), rng)
            ok = {each.index for each in detector(frame) if each.ok}
            assert ok <= {k}
            assert ok or plate.poses.cos_tilt[p] < 0.5
