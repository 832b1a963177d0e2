"""Uncertainty of a camera calibration: standard deviations or a covariance of its parameters."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.guard import read
from markergen.model.camera import Camera
from markergen.read.cameras.document import Document, Fields

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""Allowed asymmetry and negative eigenvalue of a covariance, as a correlation: files round to six digits."""


def read_camera_covariance(source: Path | str | Array, camera: Camera) -> Array:
    """Read the covariance (k, k) of `camera.parameter_names`: fx, fy, cx, cy in px, then the distortion coefficients.

    A file is text (numbers separated by blanks or commas, comments after #) or .npy. It holds one row of k standard
    deviations or k rows of a covariance; if k is 4, the distortion is taken as exact. An array holds the same.

    Raises
    ------
    InputError
        If the file cannot be read, has another number of parameters, or is not a covariance: not finite, not symmetric,
        or with a negative eigenvalue.
    """
    if isinstance(source, Path | str):
        name, data = read(source, "covariance")
        values = _npy(Path(source)) if data.startswith(b"\x93NUMPY") else _text(Document(name, data))
    else:
        name, values = "camera_covariance", _array(source)
    names = camera.parameter_names
    counts = sorted({4, len(names)})
    # A column of standard deviations is as unambiguous as a row.
    count = max(values.shape)
    if count not in counts or values.shape not in ((1, count), (count, 1), (count, count)):
        sizes = " or ".join(f"{k} standard deviations or {k}x{k} numbers" for k in counts)
        raise InputError(
            f"{sizes} in {name}",
            f"{values.shape[0]} rows of {values.shape[1]}",
            f"the parameters are {' '.join(names)}",
        )
    if not np.isfinite(values).all():
        raise InputError(f"finite numbers in {name}", "nan or inf", "correct it")
    result = np.zeros((len(names), len(names)))
    result[:count, :count] = _of_sigmas(values.ravel(), name) if 1 in values.shape else _checked(values, name, names)
    return result


def _of_sigmas(sigmas: Array, name: str) -> Array:
    if (sigmas < 0).any() or sigmas.max() > 1e100:
        raise InputError(f"standard deviations of 0 or more in {name}", brief(sigmas.tolist()), "correct it")
    return np.diag(sigmas**2)


def _checked(covariance: Array, name: str, names: tuple[str, ...]) -> Array:
    variances = np.diag(covariance)
    worst = int(np.argmin(variances))
    if variances[worst] < 0:
        raise InputError(f"variances of 0 or more in {name}", f"{variances[worst]} for {names[worst]}", "correct it")
    # Check correlations, since the parameters have units as different as px and 1.
    scale = np.sqrt(variances)
    inverse = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    correlation = covariance * inverse[:, None] * inverse
    uncertain = scale > 0
    if covariance[~uncertain].any() or covariance[:, ~uncertain].any() or np.abs(correlation).max() > 1 + TOLERANCE:
        raise InputError(
            f"a covariance in {name}", "one that exceeds its variances", "correct it; are these correlations?"
        )
    if np.abs(correlation - correlation.T).max() > TOLERANCE:
        raise InputError(f"a symmetric covariance in {name}", "an asymmetric one", "correct it")
    if np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -TOLERANCE:
        raise InputError(f"a positive semidefinite covariance in {name}", "a negative eigenvalue", "correct it")
    return (covariance + covariance.T) / 2


def _text(document: Document) -> Array:
    rows = []
    for index, line in enumerate(document.text.splitlines()):
        words = line.partition("#")[0].replace(",", " ")
        if words.strip():
            rows.append(Fields(document.name, {f"line {index + 1}": words}).numbers(f"line {index + 1}"))
    if not rows or len({len(row) for row in rows}) > 1:
        raise InputError(
            f"rows of equal length in {document.name}",
            f"rows of {brief(sorted({len(row) for row in rows}))} numbers",
            "correct the file",
        )
    return np.array(rows)


def _array(values: object) -> Array:
    found = ""
    try:
        array = np.atleast_2d(np.asarray(values, dtype=float))
        if array.ndim != 2 or not array.size:
            found = f"shape {array.shape}"
    except (TypeError, ValueError):
        found = " ".join(brief(values).split())
    if found:
        raise InputError(
            "a covariance of the camera's parameters: an array, or the path of a file",
            found,
            "give the (k, k) matrix or k standard deviations of fx, fy, cx, cy and the distortion coefficients",
        )
    return array


def _npy(path: Path) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Memory-mapped, since the header may claim a size that the file does not have.
            values = np.load(path, mmap_mode="r", allow_pickle=False, max_header_size=1000)
    except Exception as error:
        # The header is Python code, whose parsers raise a dozen kinds of errors and warnings on damaged text.
        raise InputError(f"a .npy of numbers at {path}", brief(str(error)), "write it with numpy.save") from None
    if values.dtype.kind not in "fiu" or values.ndim not in (1, 2) or values.size > 10_000:
        raise InputError(
            f"a .npy of numbers in one or two dimensions at {path}",
            f"{values.dtype} {brief(values.shape)}",
            "write it with numpy.save",
        )
    return np.atleast_2d(np.array(values, dtype=float))
