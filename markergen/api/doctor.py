"""Versions of what markergen stands on here, and what each command lacks."""

import platform
import shutil
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from markergen.errors import install
from markergen.files import Written
from markergen.presentation.results import SavableResult, json_bytes
from markergen.presentation.tables import Table

VERSIONS = ("markergen", "markergen-detect", "numpy", "scipy")
FLAVORS = ("opencv-contrib-python-headless", "opencv-contrib-python", "opencv-python-headless", "opencv-python")
EXTRAS = {
    "step": (("OCP",), "export to .step and .brep"),
    "studio": (("starlette", "uvicorn"), "studio"),
    "cluster": (("distributed",), "study --scheduler"),
    "peers": (("pupil_apriltags", "stag", "ringgrid"), "compare with other detectors"),
}
"""Modules of each extra, and what lacks without them."""


@dataclass(frozen=True)
class Diagnosis(SavableResult):
    """Rows of name, state and remark."""

    rows: tuple[tuple[str, str, str], ...] = ()
    written: tuple[Written, ...] = ()

    def parts(self) -> list[str | Table]:
        """Return one table."""
        return [Table("This installation", ["name", "state", "for"], [list(row) for row in self.rows])]

    def to_json(self) -> bytes:
        """Return a list of tables with ``name``, ``state`` and ``for``."""
        return json_bytes([dict(zip(("name", "state", "for"), row, strict=True)) for row in self.rows])


def diagnosis(json: object = None) -> Diagnosis:
    """Look at this installation, and write what there is as JSON.

    Raises
    ------
    InputError
        If the path cannot be written to.
    """
    targets = Diagnosis.targets(json=json)
    targets.check()
    return Diagnosis(rows=tuple(_rows())).saved(targets)


def _rows() -> list[tuple[str, str, str]]:
    import cv2

    windows = next(
        (line.split(":")[1].strip() for line in cv2.getBuildInformation().splitlines() if "GUI:" in line), ""
    )
    flavors = [f"{name} {number}" for name in FLAVORS if (number := _version(name))]
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    rows = [
        ("Python", platform.python_version(), platform.platform()),
        *((name, _version(name) or "not a package: from a checkout", "") for name in VERSIONS),
        ("cv2", cv2.__version__, f"windows: {windows or 'none'}; {', '.join(flavors) or 'from no package'}"),
        ("C compiler", compiler or "none", "the detector from a checkout"),
    ]
    for extra, (modules, purpose) in EXTRAS.items():
        missing = [module for module in modules if find_spec(module) is None]
        state = f"lacks {', '.join(missing)}: {install(extra)}" if missing else "installed"
        rows.append((extra, state, purpose))
    return rows


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
