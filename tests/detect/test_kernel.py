import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plain_blobs import plain_blobs

from markergen.detect import candidates, kernel, kernel_build, kernel_pose
from markergen.detect.blobs import Ellipses
from markergen.detect.conic_projection import SCHEDULE
from markergen.detect.ellipse_fit import _constants
from markergen.detect.identification import REFUSED_PX, ROUGH_PX, View, _judged
from markergen.detect.labeling_hypotheses import Labelings
from markergen.detect.pose import estimate_pose, homography_of
from markergen.detect.pose_hypotheses import layout_of
from markergen.detect.seen_models import Poses
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper_roll

FRESH = kernel._loaded.__wrapped__


@pytest.fixture
def built(tmp_path, monkeypatch):
    # Optimizing takes most of the time.
    monkeypatch.setattr(kernel_build, "_FLAGS", [flag.replace("-O3", "-O0") for flag in kernel_build._FLAGS])
    try:
        return kernel_build.build(tmp_path)
    except OSError as error:
        pytest.skip(str(error))


def test_what_was_built_is_used_and_what_was_built_of_another_source_is_not(built, monkeypatch):
    monkeypatch.delenv(kernel.VARIABLE, raising=False)
    copies = [built.with_name(source.name) for source in kernel_build.SOURCES]
    for source, copy in zip(kernel_build.SOURCES, copies, strict=True):
        copy.write_bytes(source.read_bytes())
    monkeypatch.setattr(kernel_build, "SOURCE", copies[0])
    monkeypatch.setattr(kernel_build, "SOURCES", copies)
    library, reason = FRESH()
    assert library is not None
    assert reason is None
    with built.with_name("kernel.c").open("a") as source:
        source.write("/* changed */\n")
    library, reason = FRESH()
    assert library is None
    assert "another version" in reason
    assert {path.name for path in built.parent.iterdir()} == {built.name, *(copy.name for copy in copies)}


@pytest.mark.parametrize(
    ("content", "said"), [(None, "without its compiled part,"), (b"no library", "cannot be loaded")]
)
def test_what_is_not_there_or_no_library_is_told_in_one_line(tmp_path, monkeypatch, content, said):
    monkeypatch.delenv(kernel.VARIABLE, raising=False)
    monkeypatch.setattr(kernel_build, "SOURCE", tmp_path / "kernel.c")
    if content is not None:
        (tmp_path / kernel_build.LIBRARY).write_bytes(content)
    library, reason = FRESH()
    assert library is None
    assert said in reason
    assert "kernel_build" in reason
    assert len(reason.splitlines()) == 1


def test_it_can_be_switched_off(monkeypatch):
    monkeypatch.setenv(kernel.VARIABLE, "off")
    library, reason = FRESH()
    assert library is None
    assert kernel.VARIABLE in reason


@pytest.mark.parametrize(
    "compiler",
    [
        "false",
        "no-such-compiler",
        f"{sys.executable} -c 'raise SystemExit(3)'",
        # Its messages need not be in the encoding of the locale.
        f"""{sys.executable} -c 'import sys; sys.stderr.buffer.write(b"Fehler \\xfc"); sys.exit(1)'""",
        "cc 'unfinished",
    ],
)
def test_without_a_working_compiler_there_is_one_line_and_what_was_there_stays(tmp_path, monkeypatch, compiler):
    (tmp_path / kernel_build.LIBRARY).write_bytes(b"older")
    monkeypatch.setenv("CC", compiler)
    with pytest.raises(OSError) as caught:
        kernel_build.build(tmp_path)
    assert len(str(caught.value).splitlines()) == 1
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"older"]
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OSError, match="no C compiler"):
        kernel_build.build(tmp_path)


def test_by_hand_the_reason_is_one_line_and_status_1():
    done = subprocess.run(
        [sys.executable, "-m", "markergen.detect.kernel_build"], env={"CC": "false", "PYTHONPATH": ":".join(sys.path)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "was not built: false failed" in line


def test_building_needs_the_standard_library_alone():
    # The build hook runs before anything is installed.
    tree = ast.parse(Path(kernel_build.__file__).read_text())
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = [getattr(node, "module", None) or node.names[0].name for node in imported]
    assert {name.split(".")[0] for name in names} <= sys.stdlib_module_names


@pytest.fixture
def compiled():
    if kernel.library() is None:
        pytest.skip(kernel.missing())


def edges(rough, image=np.zeros((60, 80), np.uint8), limits=candidates._LIMITS):  # noqa: B008
    return kernel.even_edges(image, np.array(rough), candidates._CIRCLE, limits)


def fitted(center=(40.0, 30.0), semi=(8.0, 6.0), angle=0.0, band=2.0, kind=float, constants=None):
    unknowns = np.array([[*center, 1 / 8, 0, 1 / 6, 200, 20, 1, 0, 0, 0, 0, *center, 0.5]], dtype=kind)
    rough = np.array([semi]), np.array([angle]), np.array([band]), np.zeros(1, bool), np.zeros(1, bool)
    image = np.random.default_rng(0).integers(0, 255, (60, 80), dtype=np.uint8)
    return kernel.fit_dots(image, *rough, 5.0, np.inf, 0.0, *(constants or _constants()), unknowns)


def followed(start=0, labels=None, near=2, gates=7):
    layout = np.eye(3), np.ones(3), np.zeros(3, bool), np.full((3, 1), near), True
    ellipses = np.zeros((2, 2)), np.stack([np.eye(2)] * 2), np.zeros((2, 2), bool)
    given = (np.array([start]), None) if labels is None else (None, np.full((1, 3), labels))
    return kernel.follow_poses(layout, *given, ellipses, (1.0,) * gates, np.eye(3)[None], np.ones((1, 3)), SCHEDULE)


def guessed(first=0, pair=1, near=2, area=2):
    layout = np.eye(3), np.ones(3), np.zeros(3, bool), np.full((3, 1), near)
    center, shape, space = np.zeros((2, 2)), np.stack([np.eye(2)] * 2), np.ones((2, 2, 3))
    blobs = center, shape, np.ones(area), np.ones(2), space, space
    pairs = np.array([first]), np.array([1]), np.array([[0, pair]])
    return kernel.guess_poses(pairs, layout, blobs, np.zeros((2, 2), bool), (1.0,) * 5, 1)


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize(
    "call",
    [
        lambda: edges(np.ones((20, 4))),
        lambda: edges(np.ones((1, 5)), np.zeros((1, 80), np.uint8)),
        lambda: edges(np.ones((1, 5)), limits=np.ones(3)),
        lambda: fitted(semi=(8.0, 6.0, 4.0)),
        lambda: fitted(constants=(np.ones(3), _constants()[1])),
        lambda: fitted(constants=(_constants()[0], np.ones((3, 2)))),
        lambda: followed(start=3),
        lambda: followed(labels=2),
        lambda: followed(labels=-2),
        lambda: followed(near=-1),
        lambda: followed(gates=3),
        lambda: guessed(first=2),
        lambda: guessed(pair=3),
        lambda: guessed(near=3),
        lambda: guessed(area=3),
    ],
)
def test_what_would_reach_beyond_an_array_is_refused(call):
    with pytest.raises(ValueError):
        call()


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e19, 0.0])
def test_what_is_no_ellipse_has_neither_an_edge_nor_a_fit(value):
    for place in range(5):
        assert len(edges([[value if i == place else own for i, own in enumerate((40.0, 30.0, 9.0, 0.0, 9.0))]])) == 0
    # Below zero, and with an axis of no length.
    assert len(edges([[40.0, 30.0, 1.0, 50.0, 1.0], [40.0, 30.0, 9.0, 0.0, 0.0]])) == 0
    complete = [
        fitted(**wrong)[2][2]
        for wrong in ({"center": (value, 30.0)}, {"center": (40.0, value)}, {"semi": (value, value), "band": 0.0},
                      {"semi": (value, 6.0)}, {"angle": value}, {"band": value})
    ]  # fmt: skip
    assert not np.any(complete)


@pytest.mark.usefixtures("compiled")
def test_numbers_of_another_type_are_converted():
    for ours, plain in zip(fitted(kind=np.float32), fitted(), strict=True):
        np.testing.assert_allclose(ours, plain, rtol=1e-4)


@pytest.mark.usefixtures("compiled")
def test_arrays_that_do_not_fit_are_refused():
    image = np.zeros((4, 40), np.uint8)
    for wrong in (image.astype(np.uint16), image[0]):
        with pytest.raises(ValueError, match="8 bits"):
            kernel.dark_components(wrong, 6, 7)
    with pytest.raises(ValueError, match="out of range"):
        kernel.dark_components(image, 256, 7)
    with pytest.raises(ValueError, match="pieces of 32"):
        kernel.difference_squares(image)
    with pytest.raises(ValueError, match="11 numbers"):
        kernel.elliptic(np.zeros((3, 10), np.int64), np.zeros(6))
    assert kernel.dark_components(image[:0], 6, 7).shape == (0, 11)


@pytest.fixture
def both(monkeypatch):
    """Run a function with the compiled part, then without it."""
    if kernel.library() is None:
        pytest.skip(kernel.missing())

    def run(call):
        compiled = call()
        with monkeypatch.context() as patch:
            patch.setattr(kernel, "library", lambda: None)
            return compiled, call()

    return run


@pytest.mark.parametrize("heights", [None, [0, 0.02, 0.01, 0.02, 0]])
def test_pose_covariance_and_homography_are_those_of_numpy(both, ngon, heights):
    points, poses = ngon(5, heights=heights).xyz, paper_roll()
    for pose in range(0, 400, 23):
        rng = np.random.default_rng(pose)
        exact = PAPER_CAMERA.project(points, poses.rotation[[pose]], poses.translation[[pose]])[0]
        pixels = exact + rng.normal(0, 0.05, exact.shape)
        spread = 0.05**2 * rng.uniform(0.5, 2, (5, 1, 1)) * np.eye(2)
        ours, plain = both(lambda: estimate_pose(points, pixels, spread, PAPER_CAMERA))  # noqa: B023
        np.testing.assert_allclose(ours.translation, plain.translation, rtol=1e-7)
        np.testing.assert_allclose(ours.rotation, plain.rotation, atol=1e-7)
        np.testing.assert_allclose([ours.chi2, ours.scale], [plain.chi2, plain.scale], rtol=1e-6)
        np.testing.assert_allclose(ours.likelihood_ratio, plain.likelihood_ratio, rtol=1e-4, atol=1e-12)
        for part in ("image", "print", "total"):
            theirs = getattr(plain.budget, part)
            np.testing.assert_allclose(getattr(ours.budget, part), theirs, rtol=1e-4, atol=1e-6 * np.abs(theirs).max())
        normalized = PAPER_CAMERA.from_pixels(pixels)
        ours, plain = both(lambda: homography_of(points, normalized, PAPER_CAMERA, plain))  # noqa: B023
        np.testing.assert_allclose(ours, plain, rtol=1e-7, atol=1e-9)


def test_labelings_are_judged_as_by_numpy(both, ngon):
    layout, rng = layout_of(ngon(8)), np.random.default_rng(3)
    poses = paper_roll()
    model = Poses(poses.rotation[:40], poses.translation[:40])
    model.translation[::3, 0] += 0.25  # m, across the image's edge.
    drawn = model.outlines(layout)
    ellipses = Ellipses(drawn.center[5], drawn.shape[5], np.zeros(8), np.arange(8))
    labels = np.where(rng.random((40, 8)) < 0.75, rng.permuted(np.tile(np.arange(8), (40, 1)), axis=1), -1)
    labels[:, :2] = [0, 1]
    labelings = Labelings(labels, np.ones(40), model, layout)
    rough = rng.choice([0.0, REFUSED_PX, ROUGH_PX], 8, p=[0.6, 0.2, 0.2])
    view = View(layout, PAPER_CAMERA, True, 1e-4)
    for given in (None, rough):
        ours, plain = both(lambda: _judged(labelings, ellipses, view, given))  # noqa: B023
        np.testing.assert_array_equal(ours.missing, plain.missing)
        np.testing.assert_allclose(ours.bound, plain.bound, rtol=1e-12)
        np.testing.assert_array_equal(ours.candidates.blobs, plain.candidates.blobs)


def test_blobs_of_one_dot_are_those_of_numpy(both):
    rng = np.random.default_rng(4)
    semi = np.sort(rng.uniform(2, 30, (400, 2)))[:, ::-1]
    center, near = rng.uniform(0, 300, (400, 2)), rng.integers(0, 400, 200)
    center[200:], semi[200:] = center[near] + rng.normal(0, 1, (200, 2)), semi[near] * rng.uniform(0.9, 1.1, (200, 1))
    blobs = plain_blobs(center, semi, np.zeros(400), np.zeros(400, bool), rng.uniform(0.1, 1, (400, 1, 1)) * np.eye(2))
    scale = rng.choice([1.0, 2.0], 400)
    ours, plain = both(lambda: candidates._distinct(blobs, scale))
    assert len(plain) < 399
    np.testing.assert_array_equal(ours, plain)


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, 0.0])
def test_numbers_that_are_none_end(value):
    # Of what is no pose, no ellipse and no point, nothing is expected but an end.
    with np.errstate(all="ignore"):
        dots = np.full((5, 3), value), np.ones(5), np.full((5, 2), value), np.eye(2), np.eye(3)
        kernel_pose.estimate_pose(dots, True, np.eye(3)[None], np.ones((1, 3)), 20, (1e-8, 1e-3, 20.0, 5.0), SCHEDULE)
        kernel_pose.homography(np.full((4, 2), value), np.ones((4, 2)))
        many = np.full(20, value)
        outlines = many, many, many, np.arange(20) < 10, many, many
        kernel.solve_blurred(outlines, 3, np.ones(12), np.tile(np.arange(14.0), (4, 1)), (0.05, 0.954, 0.5, 1.0))
        kernel.distinct_blobs(np.full((20, 2), value), np.full((20, 2), value), many, many, (0.5, 0.3, 1.0, 8.0))
    with pytest.raises(ValueError):
        kernel_pose.judge_poses(
            np.full((2, 4), 7), (np.ones((5, 2)), None), (np.ones((2, 4, 2)), np.eye(2), np.ones((2, 4), bool)),
            np.zeros(2), (1.0,) * 11,
        )  # fmt: skip
