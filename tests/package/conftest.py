"""Distributions as a user gets them, and environments that they are installed into, away from the source tree."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATIENCE = 15
"""Minutes that a download of two gigabytes may take."""


def call(*phrase: object, cwd: Path, check: bool = True, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a program that finds nothing of this source tree by chance, with further environment variables."""
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        list(map(str, phrase)), cwd=cwd, capture_output=True, text=True, timeout=60 * PATIENCE,
        env={**environment, "PYTHONNOUSERSITE": "1", "OPENBLAS_NUM_THREADS": "1", **variables},
    )  # fmt: skip
    assert not check or done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="session")
def distributions(tmp_path_factory) -> dict[str, Path]:
    """The sdist and the wheel that is built from it, by suffix; the detector's are in a folder beside theirs."""
    pytest.importorskip("build", reason="needs the dependency group package: make test-package")
    folder = tmp_path_factory.mktemp("dist")
    asked = call(
        sys.executable, "-m", "pip", "download", "--no-deps", "--dest", folder, "hatchling", cwd=folder, check=False
    )
    if asked.returncode:
        pytest.skip(f"the package index cannot be reached: {(asked.stderr.splitlines() or ['no answer'])[-1]}")
    call(sys.executable, "-m", "build", "--outdir", folder / "made", ROOT, cwd=folder)
    call(sys.executable, "-m", "build", "--outdir", folder / "detector", ROOT / "detector", cwd=folder)
    return {path.suffix: path for path in (folder / "made").iterdir()}


@pytest.fixture(scope="session")
def detector(distributions) -> dict[str, Path]:
    """The same of the detector."""
    return {path.suffix: path for path in distributions[".whl"].parents[1].joinpath("detector").iterdir()}


@pytest.fixture(scope="session")
def install(distributions, detector, tmp_path_factory) -> Callable[[str], Path]:
    """Install the wheel with extras such as ``[all]`` into an environment of its own; returns its folder of programs.

    The newest releases of everything, which is what a user gets, and not those of constraints.txt.
    """

    def installed(extras: str) -> Path:
        folder = tmp_path_factory.mktemp("environment")
        call(sys.executable, "-m", "venv", folder, cwd=folder)
        programs = folder / "bin"
        wheel = f"markergen{extras} @ {distributions['.whl'].as_uri()}"
        links = "--find-links", detector[".whl"].parent
        call(programs / "python", "-m", "pip", "install", "--quiet", *links, wheel, cwd=folder)
        return programs

    return installed


@pytest.fixture(scope="session")
def bare(install) -> Path:
    """Programs of an installation without extras."""
    return install("")


@pytest.fixture(scope="session")
def whole(install) -> Path:
    """Programs of an installation with every extra."""
    return install("[all]")
