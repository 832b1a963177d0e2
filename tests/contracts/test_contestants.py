"""What every kind of contestant in `compare` keeps to, with its own library where it has one."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from markergen.comparison.baselines import line_up
from markergen.comparison.contestants import KINDS, Absent, Arena, forms, listed
from markergen.maths.projection import project
from markergen.maths.rotation import rotation_z
from markergen.model.boundary import polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.poses import paper
from markergen.objectives import Setting
from markergen.render import Optics
from markergen.validation.metrics import rotation_error_deg

POSES = paper()
POSE = 138
"""A pose at 17.5 degrees, 0.9 m away, in which every detector finds its pattern."""
EXAMPLES = {
    "ngon": "ngon:6", "square": "square", "random": "random:5", "aruco": "aruco:DICT_4X4_50:3",
    "apriltag": "apriltag:36h11:7", "edges": "edges:apriltag:25h9:2", "charuco": "charuco:4x5:DICT_4X4_50:0.7",
    "circles": "circles:4x5", "acircles": "acircles:4x5", "checkerboard": "checkerboard:8x7",
    "pupil": "pupil:25h9:3", "stag": "stag:HD21:4", "ringgrid": "ringgrid:4x5",
}  # fmt: skip
MODULES = {"pupil": "pupil_apriltags", "stag": "stag", "ringgrid": "ringgrid"}
WORST_DEG = {"ringgrid": 1.0, "stag": 0.5, "charuco": 0.5}
"""Error of the best setting without noise, deg, where more than 0.2 is allowed: their corners' own error."""
WORST_PX = {"ringgrid": 2.0}
"""Error of the worst point of the best setting without noise, px, where more than 0.6 is allowed."""
OFFSET_PX = 0.2
"""Median offset of all points, px: 0.5 if a library counted its pixels from another corner than we say."""
SILENT = Optics(noise_grey=0)


@pytest.fixture(scope="module")
def made():
    texts = [text for name, text in EXAMPLES.items() if name not in MODULES or find_spec(MODULES[name])]
    contestants, _ = line_up(texts)
    return {contestant.name.partition(":")[0]: contestant for contestant in contestants}


@pytest.fixture
def contestant(name, made):
    if name not in made:
        pytest.skip(f"{MODULES[name]} is not installed")
    return made[name]


def exact(contestant):
    return contestant.print_error(0.0, np.random.default_rng(0))


def best_sighting(contestant, pose, camera=PAPER_CAMERA):
    image = contestant.render(camera, pose, SILENT, np.random.default_rng(0), exact(contestant))
    choices = [{"detector": row} for row in contestant.settings.get("detector", [])]
    choices += [{"refiner": row} for row in contestant.settings.get("refiner", [])]
    findings = [contestant.sight(image, camera, choice, 0.0) for choice in choices or [{}]]
    rotated = [
        (rotation_error_deg(item.rotation @ rotation.T, pose[0]), item, rotation)
        for item in findings
        if item.rotation is not None
        for rotation in (rotation_z(2 * np.pi * k / contestant.turns) for k in range(contestant.turns))
    ]
    assert rotated, {item.reason for item in findings}
    return min(rotated, key=lambda item: item[0])


def test_every_kind_has_an_example_here():
    assert sorted(EXAMPLES) == KINDS.names()
    assert {name for name in KINDS if KINDS[name].requires} == set(MODULES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_its_form_is_listed(name):
    kind = KINDS[name]
    assert kind.form.startswith(name)
    assert kind.form in forms()
    assert (kind.form, f"{kind.summary}, by {kind.detector}") in listed()
    # The help of `compare` shows both in two columns.
    assert max(len(kind.form), len(kind.summary)) <= 60


@pytest.mark.parametrize("name", EXAMPLES)
def test_it_is_found_where_it_is(name, contestant):
    pose = POSES.rotation[POSE], POSES.translation[POSE]
    error, result, rotation = best_sighting(contestant, pose)
    assert error < WORST_DEG.get(name, 0.2)
    assert len(set(result.ids.tolist())) == len(result.ids) == len(result.pixels)
    truth = project(contestant.points @ rotation.T, pose[0][None], pose[1][None], PAPER_CAMERA.matrix)[0, result.ids]
    assert np.linalg.norm(result.pixels - truth, axis=-1).max() < WORST_PX.get(name, 0.6)
    assert np.abs(np.median(result.pixels - truth, axis=0)).max() < OFFSET_PX


@pytest.mark.parametrize("name", EXAMPLES)
def test_it_fills_the_circle_and_has_ink_in_it(name, contestant):
    patches = contestant.patches(PAPER_CAMERA, (POSES.rotation[0], POSES.translation[0]), exact(contestant))
    ink = np.concatenate([outline for patch in patches if patch.reflectance == 0 for outline in patch.outlines])
    reach = np.linalg.norm(ink, axis=-1).max()
    # Tags and dots have white around them; 1e-3 is the lattice of ringgrid's drawing, which is rounded to 0.1 um.
    assert 0.1 < reach <= 0.15 * (1 + 1e-3)
    assert contestant.ink(0.15) > 1e-4
    # Ink by its outlines: areas inside of others are holes.
    if name not in ("ngon", "square", "random"):
        areas = [np.sum(o[:, 0] * np.roll(o[:, 1], -1) - o[:, 1] * np.roll(o[:, 0], -1)) for o in patches[-1].outlines]
        assert contestant.ink(0.15) == pytest.approx(abs(sum(areas)) / 2, rel=2e-3)


@pytest.mark.parametrize("name", EXAMPLES)
def test_it_fits_on_a_plate_that_is_no_disk(name):
    plate = polygon_from([np.array([[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]])])
    result = KINDS[name](EXAMPLES[name], Arena(Setting(plate, PAPER_CAMERA, POSES)))
    if result.absent:
        pytest.skip(result.absent)
    patches = result.patches(PAPER_CAMERA, (POSES.rotation[0], POSES.translation[0]), exact(result))
    ink = np.concatenate([outline for patch in patches if patch.reflectance == 0 for outline in patch.outlines])
    # It may lie across the plate, and somewhere else on it.
    sides = np.sort(np.ptp(ink[:, :2], axis=0))
    assert np.all(sides <= [0.1, 0.2])
    assert sides[0] > 0.05


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_print_error_displaces_its_ink(name, contestant):
    rng = np.random.default_rng(1)
    moved = contestant.print_error(1e-3, rng)
    assert moved.shape[1] == 2
    offset = np.broadcast_to([2e-3, -1e-3], moved.shape)
    pose = POSES.rotation[0], POSES.translation[0]
    ends = [
        np.concatenate(
            [o for p in contestant.patches(PAPER_CAMERA, pose, item) if p.reflectance == 0 for o in p.outlines]
        )
        for item in (exact(contestant), np.array(offset))
    ]
    assert ends[1] - ends[0] == pytest.approx(np.broadcast_to([2e-3, -1e-3, 0], ends[0].shape), abs=1e-9)


@pytest.mark.parametrize("name", EXAMPLES)
def test_nothing_is_found_in_nothing(name, contestant):
    nothing = np.full((480, 640), 225, dtype=np.uint8)
    result = contestant.sight(nothing, PAPER_CAMERA, {}, 0.0)
    assert result.rotation is None
    assert result.reason
    assert contestant.size
    assert contestant.describe({})


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_setting_has_words_of_its_own(name, contestant):
    tables = contestant.settings
    first = contestant.describe({})
    phrase = {contestant.describe({name: row}) for name, rows in tables.items() for row in rows}
    # Every row but the first of each table changes the description of the first setting.
    assert len(phrase - {first}) == sum(len(rows) - 1 for rows in tables.values())
    assert not contestant.absent
    assert contestant.turns in (1, 2, 4)


@pytest.mark.parametrize("name", MODULES)
def test_without_its_library_it_says_what_to_install(name, monkeypatch):
    monkeypatch.setitem(sys.modules, MODULES[name], None)
    from markergen.comparison.contestants import ringgrid

    ringgrid._drawn.cache_clear()
    from markergen.model.spec import Spec

    arena = Arena(Setting(Spec().boundary, PAPER_CAMERA, POSES))
    finding = KINDS[name](EXAMPLES[name], arena)
    assert isinstance(finding, Absent)
    assert finding.absent == f"needs {KINDS[name].requires}: pip install ./detector '.[peers]'"
    assert finding.sight(np.zeros((9, 9), np.uint8), PAPER_CAMERA, {}, 0.0).reason == finding.absent


@pytest.mark.long
@pytest.mark.parametrize("name", EXAMPLES)
def test_it_is_found_through_a_lens(name, contestant):
    camera = Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.1, 0.05, 0.001, 0.0)))
    error, _, _ = best_sighting(contestant, (POSES.rotation[POSE], POSES.translation[POSE]), camera)
    assert error < 2 * WORST_DEG.get(name, 0.2)
