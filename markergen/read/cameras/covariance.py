"""Uncertainty of a camera calibration: standard deviations or a covariance of its parameters."""

# tests: tests/read/test_camera_covariances.py

import os
import re
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief, reason_of
from markergen.guard import place_of, read
from markergen.model.camera import Camera, typical_camera
from markergen.read.cameras import CAMERA_FORMATS, COVARIANCE, NAMES, sized_document
from markergen.read.cameras.calibration import entries
from markergen.read.cameras.document import Document, Fields, document_of
from markergen.read.formats import recognized, split

TOLERANCE = 1e-6
"""Allowed asymmetry and negative eigenvalue of a covariance, as a correlation: files round to six digits."""


DEVIATIONS, LENS_DEVIATIONS = "camera_matrix_std_dev", "dist_coeffs_std_dev"
"""Keys of standard deviations of fx, fy, cx, cy, and of the coefficients."""

EXACT = "none"
"""Word that stands for the covariance of an exact calibration."""


def is_exact(value: object) -> bool:
    """Return whether a user asks for an exact calibration, by the word for it."""
    return isinstance(value, str | Path) and str(value) == EXACT


def camera_covariance(value: Path | str | Array | None, source: object, camera: Camera) -> Array | None:
    """Return the covariance to count: the one given, or the one in the camera's own file; None if there is neither.

    It is given as for `read_camera_covariance`; ``none`` takes the calibration as exact. The source is what the camera
    was made from: a path or a mapping of a file's values may have its covariance.
    """
    if is_exact(value):
        return None
    if value is not None:
        return read_camera_covariance(value, camera)
    if isinstance(source, Mapping):
        return _stored(document_of(source, "the dict"), None, camera)
    if isinstance(source, str | os.PathLike) and not typical_camera(source):
        return _stored(*sized_document(source), camera)
    return None


def counted(value: object, source: object, covariance: Array | None) -> str:
    """Return a sentence for people where a covariance comes from the camera's own file; empty elsewhere."""
    if value is not None or covariance is None:
        return ""
    name = place_of(source) if isinstance(source, str | os.PathLike) else "the camera"
    return f"{name}: its covariance is counted; --camera-covariance {EXACT} takes the calibration as exact"


def read_camera_covariance(source: Path | str | Array, camera: Camera) -> Array:
    """Read the covariance (k, k) of `camera.parameter_names`: fx, fy, cx, cy in px, then the distortion coefficients.

    A file is a camera file with its covariance (``path#NAME`` as for `read_camera`), text (numbers separated by blanks
    or commas, comments after #) or .npy. Text and .npy hold one row of k standard deviations or k rows of a covariance;
    if k is 4, the distortion is taken as exact. An array holds the same.

    Raises InputError if the file cannot be read, has another number of parameters, or is not a covariance: not finite,
    not symmetric, or with a negative eigenvalue; or if it is a camera file without one.
    """
    if isinstance(source, Path | str):
        name, choice = split(os.fspath(source))
        name, data = read(path := Path(name), "covariance")
        document = Document(name, data)
        if data.startswith(b"\x93NUMPY"):
            values = _npy(path)
        elif _is_camera(document):
            if (stored := _stored(document, choice, camera)) is None:
                expected = f"the key {COVARIANCE} in {name}"
                raise InputError(expected, "a camera without one", "give a file with its covariance")
            return stored
        else:
            values = _text(document)
    else:
        name, values = "camera_covariance", _array(source)
    names = camera.parameter_names
    counts = sorted({4, len(names)})
    # A column of standard deviations is as unambiguous as a row.
    count = max(values.shape)
    if count not in counts or values.shape not in ((1, count), (count, 1), (count, count)):
        sizes = " or ".join(f"{k} standard deviations or {k}x{k} numbers" for k in counts)
        problem = f"{values.shape[0]} rows of {values.shape[1]}"
        raise InputError(f"{sizes} in {name}", problem, f"the parameters are {' '.join(names)}")
    if not np.isfinite(values).all():
        raise InputError(f"finite numbers in {name}", "nan or inf", "correct it")
    result = np.zeros((len(names), len(names)))
    result[:count, :count] = _of_sigmas(values.ravel(), name) if 1 in values.shape else _checked(values, name, names)
    return result


def _is_camera(document: Document) -> bool:
    try:
        return recognized(CAMERA_FORMATS, document) is not None
    except InputError:
        # Not YAML, XML or TOML: damaged, unless it is a table of numbers.
        if document.lines and re.match(r"[-+.\d]", document.lines[0]):
            return False
        raise


def _stored(document: Document, choice: str | None, camera: Camera) -> Array | None:
    """Covariance (k, k) of the camera's parameters from its file; 0 for those that are not in it."""
    form = recognized(CAMERA_FORMATS, document)
    if form is None:
        return None
    table = CAMERA_FORMATS[form].table(document, choice)
    key = table.find(COVARIANCE)
    if key is None:
        return _of_deviations(table, camera)
    rows, names = table.words(NAMES), camera.parameter_names
    if len(set(rows)) < len(rows):
        raise InputError(f"every parameter once at {table.place(NAMES)}", brief(" ".join(rows)), "correct the file")
    values = entries(table, key, (len(rows), len(rows)))
    if len(values) != len(rows) ** 2:
        raise InputError(f"{len(rows)}x{len(rows)} numbers at {table.place(key)}", str(len(values)), "correct the file")
    covariance = _checked(np.array(values).reshape(len(rows), -1), table.place(key), tuple(rows))
    here = [row in names for row in rows]
    if covariance[np.logical_not(here)].any():
        expected = f"a covariance of {' '.join(names)} at {table.place(key)}"
        raise InputError(expected, brief(" ".join(rows)), "give that of the same lens model")
    result = np.zeros((len(names), len(names)))
    places = [names.index(row) for row in rows if row in names]
    result[np.ix_(places, places)] = covariance[np.ix_(here, here)]
    return result


def _of_deviations(table: Fields, camera: Camera) -> Array | None:
    """Covariance from the standard deviations that OpenCV's interactive-calibration writes; None without them."""
    if table.find(DEVIATIONS) is None:
        return None
    sigmas = np.zeros(len(camera.parameter_names))
    for key, part in ((DEVIATIONS, sigmas[:4]), (LENS_DEVIATIONS, sigmas[4:])):
        values = entries(table, table.key(key), None) if table.find(key) else []
        if any(values[len(part) :]):
            raise InputError(
                f"{len(part)} standard deviations at {table.place(key)}", str(len(values)), "correct the file"
            )
        part[: len(values)] = values[: len(part)]
    return _of_sigmas(sigmas, table.place(DEVIATIONS))


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
        remedy = "correct it; are these correlations?"
        raise InputError(f"a covariance in {name}", "one that exceeds its variances", remedy)
    if np.abs(correlation - correlation.T).max() > TOLERANCE:
        raise InputError(f"a symmetric covariance in {name}", "an asymmetric one", "correct it")
    if np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -TOLERANCE:
        raise InputError(f"a positive semidefinite covariance in {name}", "a negative eigenvalue", "correct it")
    return (covariance + covariance.T) / 2


def _text(document: Document) -> Array:
    rows: list[list[float]] = []
    for index, line in enumerate(document.text.splitlines()):
        numbers = line.partition("#")[0].replace(",", " ")
        if numbers.strip():
            # What is no covariance is not quoted.
            if not rows and numbers.strip()[0] not in "-+.0123456789ni":
                raise InputError(f"rows of numbers in {document.name}", "text", "check the path")
            rows.append(Fields(document.name, {f"line {index + 1}": numbers}).numbers(f"line {index + 1}"))
    if not rows or len({len(row) for row in rows}) > 1:
        problem = f"rows of {brief(sorted({len(row) for row in rows}))} numbers"
        raise InputError(f"rows of equal length in {document.name}", problem, "correct the file")
    return np.array(rows)


def _array(values: object) -> Array:
    try:
        array = np.atleast_2d(np.asarray(values, dtype=float))
        problem = f"shape {array.shape}" if array.ndim != 2 or not array.size else ""
    except (TypeError, ValueError):
        problem = " ".join(brief(values).split())
    if problem:
        expected = "a covariance of the camera's parameters: an array, or the path of a file"
        remedy = "give the (k, k) matrix or k standard deviations of fx, fy, cx, cy and the distortion coefficients"
        raise InputError(expected, problem, remedy)
    return array


def _npy(path: Path) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Memory-mapped, since the header may claim a size that the file does not have.
            values = np.load(path, mmap_mode="r", allow_pickle=False, max_header_size=1000)
    except Exception as error:
        # The header is Python code, whose parsers raise a dozen kinds of errors and warnings on damaged text.
        raise InputError(f"a .npy of numbers at {path}", reason_of(error), "write it with numpy.save") from None
    if values.dtype.kind not in "fiu" or values.ndim not in (1, 2) or values.size > 10_000:
        expected = f"a .npy of numbers in one or two dimensions at {path}"
        raise InputError(expected, f"{values.dtype} {brief(values.shape)}", "write it with numpy.save")
    return np.atleast_2d(np.array(values, dtype=float))
