"""The detector by itself, as a robot gets it: a wheel, NumPy, and the file of a marker."""

import shutil
import subprocess
import sys
import sysconfig
import zipfile

import numpy as np
import pytest

from markergen.exporters import EXPORTERS, ExportOptions
from markergen.model.boundary import Circle
from markergen.model.camera import Camera
from markergen.model.marker import build_marker
from markergen.render import DEFAULT_OPTICS, render_view

from .conftest import ROOT, call

pytestmark = pytest.mark.package

OLDEST = "3.10"
SQUARE = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]])
MARKER = build_marker(SQUARE, Circle(0.06), diameter=0.02, clearance=0.002)
CAMERA = Camera(320, 240, 400, 400, 159.5, 119.5)
CODE = """
import sys, numpy as np
from markergen_detect import Detector
camera = {"width": 320, "height": 240, "fx": 400, "fy": 400, "cx": 159.5, "cy": 119.5}
finding, = Detector("board.detector.json", camera)(np.load("frame.npy"))
assert finding.ok and finding.ids.tolist() == [0, 1, 2, 3], finding.reason
assert np.allclose(finding.translation, [0.01, 0, 0.4], atol=1e-3), finding.translation
assert not {"cv2", "scipy", "markergen"} & set(sys.modules)
print(np.__version__)
"""


def oldest_python():
    """The oldest supported Python that is there, else this one."""
    for python in filter(None, (shutil.which(f"python{OLDEST}"), sys.executable)):
        if subprocess.run([python, "-c", "import venv, ensurepip"], capture_output=True).returncode == 0:
            return python
    raise AssertionError


def environment(folder):
    call(oldest_python(), "-m", "venv", folder, cwd=folder.parent)
    return folder / "bin" / "python"


def test_the_wheel_is_small_and_for_this_platform(detector):
    wheel = detector[".whl"]
    assert wheel.stat().st_size < 2_000_000
    assert wheel.stem.endswith(f"-py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}")
    names = zipfile.ZipFile(wheel).namelist()
    assert {"markergen_detect/detector.h", "markergen_detect/py.typed"} <= set(names)
    assert len([name for name in names if name.endswith((".so", ".dll"))]) == 1


@pytest.mark.parametrize("numpy", ["numpy", "numpy==1.21.6"])
def test_a_marker_is_found_with_numpy_alone(detector, tmp_path, numpy):
    if numpy != "numpy" and f"python{OLDEST}" not in oldest_python():
        pytest.skip(f"Python {OLDEST} is not there, for which this release of NumPy was made")
    rotation, translation = np.diag([1.0, -1.0, -1.0]), np.array([0.01, 0, 0.4])
    frame = render_view(MARKER, CAMERA, rotation, translation, DEFAULT_OPTICS, np.random.default_rng(0))
    np.save(tmp_path / "frame.npy", frame)
    written = EXPORTERS[".detector.json"](MARKER, ExportOptions(stem="board")).data
    (tmp_path / "board.detector.json").write_bytes(written)
    python = environment(tmp_path / "environment")
    call(python, "-m", "pip", "install", "--quiet", numpy, detector[".whl"], cwd=tmp_path)
    assert call(python, "-c", CODE, cwd=tmp_path).stdout


def test_a_machine_with_python_alone_builds_it(tmp_path):
    python = environment(tmp_path / "environment")
    # With no other folder of programs, there is no compiler.
    done = call(
        python, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", tmp_path, ROOT / "detector",
        cwd=tmp_path, PATH=str(python.parent), CC="",
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < 2_000_000, done.stdout


def test_a_compiler_that_fails_ends_the_build_in_one_line(tmp_path):
    python = environment(tmp_path / "environment")
    done = call(
        python, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", tmp_path, ROOT / "detector",
        cwd=tmp_path, CC="false", check=False,
    )  # fmt: skip
    assert done.returncode
    assert "markergen-detect cannot be built: false failed with status 1" in done.stdout + done.stderr
