"""Rigs are laid out for the joint pose."""

from dataclasses import replace

import numpy as np
import pytest
from sentences import pattern, sentence

import markergen as mg
from markergen.bounds.dot_covariances import body_bounds, dot_covariances, image_jacobian, image_slopes
from markergen.errors import InputError
from markergen.maths.information import covariance, rotation_bound
from markergen.maths.projection import perspective, to_camera
from markergen.maths.rotation import exponential
from markergen.model.body_json import rig_to_json
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import named_poses
from markergen.model.rig_shapes import rig_shape
from markergen.model.spec import ImageNoise, Spec
from markergen.objectives import OBJECTIVES
from markergen.objectives.base import Sight
from markergen.optimize.constellations import Block, views_of
from markergen.optimize.rig import RigSearch, best_views, plate_views

QUICK = {"n": 4, "restarts": 1, "tag": "aruco:DICT_4X4_50:3", "poses": "cone:distance=0.3..0.8,tilt=0..60,count=10"}
SQUARE = 0.02 * np.array([[1, 1], [-1, 1.1], [-1, -1], [1, -1.2]])


@pytest.fixture(scope="module")
def search():
    faces = rig_shape("cube", edge=0.08).faces
    poses = named_poses("sphere:distance=0.3..0.5,count=30")
    spec = Spec(n=4, noise_model="image", print_sigma=1e-4)
    plates = plate_views(faces, [0.01] * 6, poses, spec)
    specs = [replace(spec, boundary=face.boundary, dot=0.01, clearance=0.001) for face in faces]
    blocks = [
        Block(plate_spec, plate.poses, SQUARE * (1 + 0.05 * k), plate.face)
        for k, (plate_spec, plate) in enumerate(zip(specs, plates, strict=True))
    ]
    return RigSearch(blocks, spec, poses, {})


def test_information_of_all_plates_is_that_of_all_dots_in_view(search):
    poses, covered = search.problem.poses, search.see(search.blocks)
    information = search.problem.information(search.blocks, covered)
    step = 1e-6
    for p in range(0, len(poses), 7):
        whole = np.zeros((6, 6))
        for k, block in enumerate(search.blocks):
            dots = covered.seen[p, 4 * k : 4 * k + 4]
            face, points = block.face, block.points[dots]
            if not dots.any():
                continue
            xyz = np.column_stack([points, np.zeros(len(points))]) @ np.array(face.rotation).T + face.translation

            def seen(change, xyz=xyz, p=p):
                rotation = exponential(change[:3]) @ poses.rotation[p]
                spots = to_camera(xyz, rotation[None], (poses.translation[p] + change[3:])[None])
                return PAPER_CAMERA.to_pixels(perspective(spots))[0]

            rows = np.stack([(seen(step * e) - seen(-step * e)) / (2 * step) for e in np.eye(6)], axis=-1)
            view, _ = views_of(face, poses.taken(np.array([p]), 0))
            slopes = image_slopes(image_jacobian(points, PAPER_CAMERA, view), view)
            noise = np.linalg.inv(dot_covariances(slopes, 0.01, ImageNoise(), 1e-4)[0])
            whole += np.einsum("nik,nij,njl->kl", rows, noise, rows)
        scale = np.sqrt(np.diag(whole))
        assert information[p] / scale / scale[:, None] == pytest.approx(whole / scale / scale[:, None], abs=1e-6)


@pytest.mark.parametrize("name", ["pose", "rotation", "translation"])
def test_gradients_know_what_is_known_elsewhere(search, name):
    setting, points = search.problem.setting(search.blocks, 0), search.blocks[0].points[None]
    objective = OBJECTIVES[name](setting)
    value, gradient = objective.value_and_gradient(points)
    without = Sight(setting.sight.seen, np.zeros_like(setting.sight.known))
    assert value < OBJECTIVES[name](replace(setting, sight=without))(points)
    step, change = 1e-7, np.zeros_like(points)
    change[0, 2, 1] = step
    slope = (objective(points + change) - objective(points - change)) / (2 * step)
    assert gradient[0, 2, 1] == pytest.approx(slope[0], rel=1e-4)


def test_more_plates_lower_the_bound(search):
    poses, covered = search.problem.poses, search.see(search.blocks)
    joint, single = body_bounds(search.rig(search.blocks), covered.seen, PAPER_CAMERA, poses, ImageNoise(), 1e-4)
    served = covered.served
    assert (joint <= single * (1 + 1e-9)).all()
    several = served & (covered.plates > 1)
    assert several.any()
    assert (joint[:, several] < single[:, several]).all()
    # The search takes the same information.
    information = search.problem.information(search.blocks, covered)[served]
    assert joint[0, served] == pytest.approx(np.rad2deg(rotation_bound(covariance(information))), rel=1e-9)


def test_plates_in_view_are_those_of_validate(search):
    poses, rig = "sphere:distance=0.3..0.5,count=30", search.rig(search.blocks)
    validation = mg.validate(rig, poses=poses, runs=0, views=0)
    covered = search.see(search.blocks)
    assert (validation.setting.sight.seen == covered.seen).all()
    by_plates = {key: int(mask.sum()) for key, mask in covered.by_plates().items()}
    assert {key: row["poses"] for key, row in validation.results["headline"]["by_plates"].items()} == by_plates


def test_dots_are_sized_where_a_plate_is_seen_best(search):
    poses = search.problem.poses
    plates = plate_views([block.face for block in search.blocks], [0.01] * 6, poses, search.problem.spec)
    views = best_views(plates, len(poses))
    assert sum(map(len, views)) > 0.9 * len(poses)
    for plate, chosen in zip(plates, views, strict=True):
        # From above a corner at 0.3 m, where the middles of three faces are seen from 61.4 degrees.
        assert plate.poses.polar_angle_deg[chosen].max() < 61.5


def test_a_rig_with_tags():
    rig = mg.rig("pair", plate="100mm", **QUICK)
    assert [str(marker.marker.tag) for marker in rig.rig.markers] == ["aruco:DICT_4X4_50:3", "aruco:DICT_4X4_50:4"]
    assert "by their tags" in str(rig)
    assert rig.rig.provenance["camera"] == PAPER_CAMERA.as_dict()
    assert rig_to_json(rig.rig) == rig_to_json(mg.rig("pair", plate="100mm", **QUICK).rig)
    assert not rig.warnings


def test_a_plate_in_meters_that_were_millimeters_is_doubted():
    pair = mg.rig("pair", plate=100, n=4, restarts=1, tag="aruco:DICT_4X4_50")
    assert pair.warnings == ("a plate is 140 m across: is the unit another? Write lengths as 80mm",)


def test_dots_too_small_beside_a_plate_in_meters_are_refused(tmp_path):
    path = tmp_path / "plates.csv"
    path.write_text("name,radius,x,y,z\nsmall,60mm,0,0,0\nlarge,60,0,0,100\n")
    with pytest.raises(InputError, match=r"sees the dots of each plate, found none of \d+ for small"):
        mg.rig(path, n=4, restarts=1)


@pytest.mark.long
def test_plates_that_look_the_same_are_warned_about():
    rig = mg.rig("prism:3", edge="90mm", n=4, restarts=1, poses="sphere:distance=0.24..0.62,count=8")
    assert rig.warnings == (rig.told_apart + sentence("tell apart"),)


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

    rig = mg.rig("cube", edge="80mm", n=6)
    assert not rig.warnings
    assert rig.safety > 0.3
    markers = [marker.marker for marker in rig.rig.markers]
    detector, rng = mg.Detector(markers, PAPER_CAMERA), np.random.default_rng(3)
    poses = named_poses("sphere:distance=0.24..0.62,count=1500,seed=4,sampling=random")
    for k, plate in enumerate(plate_views(rig_shape("cube", edge=0.08).faces, [0.01] * 6, poses, Spec())):
        for p in rng.choice(len(plate.index), 40, replace=False):
            rotation, translation = plate.poses.rotation[p], plate.poses.translation[p]
            frame = render_view(markers[k], PAPER_CAMERA, rotation, translation, Optics(), rng)
            ok = {marker.index for marker in detector(frame) if marker.ok}
            assert ok <= {k}
            assert ok or plate.poses.cos_tilt[p] < 0.5
