"""Design fiducial markers: the layout of control points that gives the most accurate pose, proved.

>>> import markergen as mg
>>> marker = mg.design(n=5, radius="150mm").marker      # takes a second or two
>>> marker
Marker(5 control points in a disk of radius 150 mm, dots of 36 mm, spec 2b6ca07a)

Lengths are in meters, or text with a unit: ``0.15``, ``"150mm"``, ``"6in"``. The marker frame is x right, y up, z out
of the printed face; a pose is ``T_camera_marker``. The library does not print: progress is a callback, and the
logger ``markergen`` reports more when enabled.
"""

import logging
import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markergen.api.calibrate import calibrate
    from markergen.api.compare import compare
    from markergen.api.design import design, rig
    from markergen.api.export import export
    from markergen.api.handeye import handeye
    from markergen.api.inspect import Inspection, inspect
    from markergen.api.rescale import Rescaled, rescale
    from markergen.api.study import Study, study
    from markergen.api.validate import validate
    from markergen.api.verify import verify
    from markergen.calibration.calibration import Calibration
    from markergen.calibration.handeye import HandEye
    from markergen.comparison.result import Comparison
    from markergen.detect.detector import Detector
    from markergen.detect.results import Found
    from markergen.errors import InputError, MarkergenError, MissingLibraryError, OutputError
    from markergen.model.body import Plate
    from markergen.model.camera import Camera
    from markergen.model.marker import Marker
    from markergen.model.poses import Poses
    from markergen.model.rig import Rig
    from markergen.optimize.design import Design
    from markergen.validation.result import Validation
    from markergen.verification.result import Verification

__version__ = "0.2.0"

__all__ = [
    "Calibration",
    "Camera",
    "Comparison",
    "Design",
    "Detector",
    "Found",
    "HandEye",
    "InputError",
    "Inspection",
    "Marker",
    "MarkergenError",
    "MissingLibraryError",
    "OutputError",
    "Plate",
    "Poses",
    "Rescaled",
    "Rig",
    "Study",
    "Validation",
    "Verification",
    "calibrate",
    "compare",
    "design",
    "export",
    "handeye",
    "inspect",
    "rescale",
    "rig",
    "study",
    "validate",
    "verify",
]

_HOMES = {
    "model.marker": ("Marker",),
    "model.camera": ("Camera",),
    "model.body": ("Plate",),
    "model.poses": ("Poses",),
    "model.rig": ("Rig",),
    "errors": ("InputError", "MarkergenError", "MissingLibraryError", "OutputError"),
    "optimize.design": ("Design",),
    "detect.detector": ("Detector",),
    "detect.results": ("Found",),
    "validation.result": ("Validation",),
    "comparison.result": ("Comparison",),
    "verification.result": ("Verification",),
    "calibration.calibration": ("Calibration",),
    "calibration.handeye": ("HandEye",),
    "api.calibrate": ("calibrate",),
    "api.compare": ("compare",),
    "api.design": ("design", "rig"),
    "api.export": ("export",),
    "api.handeye": ("handeye",),
    "api.inspect": ("Inspection", "inspect"),
    "api.rescale": ("Rescaled", "rescale"),
    "api.study": ("Study", "study"),
    "api.validate": ("validate",),
    "api.verify": ("verify",),
}
"""Public names by module; a module is imported when one of its names is first used."""

_HOME = {name: f"{__name__}.{module}" for module, names in _HOMES.items() for name in names}

_RENAMED = {"RigDesign": "Design", "RigMarker": "Plate", "RigValidation": "Validation"}
"""Names of the release before, and what they are now; they go with the next."""

# Silent unless the application configures logging.
logging.getLogger(__name__).addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    if name in _RENAMED:
        warnings.warn(f"markergen.{name} is now markergen.{_RENAMED[name]}", DeprecationWarning, stacklevel=2)
        return getattr(import_module(__name__), _RENAMED[name])
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
