"""How well a camera is calibrated: standard deviations or a covariance of its parameters."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.model.camera import Camera
from markergen.model.findings import brief
from markergen.read.cameras.document import Document, Table, read_bytes

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""How far a covariance may be from symmetric and from positive, as a correlation: files round to six digits."""


def read_camera_covariance(path: Path | str, camera: Camera) -> Array:
    """Covariance (k, k) of `camera.parameter_names`: fx, fy, cx, cy in px, then the distortion coefficients.

    The file is text, numbers separated by blanks or commas and comments after #, or a .npy. It holds one row of k
    standard deviations, or k rows of a covariance; k may be 4, then the distortion counts as known exactly.

    Raises
    ------
    InputError
        If the file cannot be read, has another number of parameters, or is no covariance: not finite, not symmetric,
        or with a negative variance in some direction.
    """
    path = Path(path)
    data = read_bytes(path, "camera covariance")
    values = _npy(path) if data.startswith(b"\x93NUMPY") else _text(Document(str(path), data))
    names = camera.parameter_names
    counts = sorted({4, len(names)})
    # A column of standard deviations is as clear as a row.
    count = max(values.shape)
    if count not in counts or values.shape not in ((1, count), (count, 1), (count, count)):
        sizes = " or ".join(f"{k} standard deviations or {k}x{k} numbers" for k in counts)
        raise InputError(
            f"{sizes} in {path}",
            f"{values.shape[0]} rows of {values.shape[1]}",
            f"the parameters are {' '.join(names)}",
        )
    if not np.isfinite(values).all():
        raise InputError(f"finite numbers in {path}", "nan or inf", "correct the file")
    result = np.zeros((len(names), len(names)))
    result[:count, :count] = _of_sigmas(values.ravel(), path) if 1 in values.shape else _checked(values, path, names)
    return result


def _of_sigmas(sigmas: Array, path: Path) -> Array:
    if (sigmas < 0).any() or sigmas.max() > 1e100:
        raise InputError(f"standard deviations from 0 in {path}", brief(sigmas.tolist()), "correct the file")
    return np.diag(sigmas**2)


def _checked(covariance: Array, path: Path, names: tuple[str, ...]) -> Array:
    variances = np.diag(covariance)
    worst = int(np.argmin(variances))
    if variances[worst] < 0:
        raise InputError(f"variances from 0 in {path}", f"{variances[worst]} for {names[worst]}", "correct the file")
    # As correlations: the parameters have units as different as px and 1.
    scale = np.sqrt(variances)
    inverse = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    correlation = covariance * inverse[:, None] * inverse
    uncertain = scale > 0
    if covariance[~uncertain].any() or covariance[:, ~uncertain].any() or np.abs(correlation).max() > 1 + TOLERANCE:
        raise InputError(
            f"a covariance in {path}", "one beyond its two variances", "correct the file; are these correlations?"
        )
    if np.abs(correlation - correlation.T).max() > TOLERANCE:
        raise InputError(f"a symmetric covariance in {path}", "another", "correct the file")
    if np.linalg.eigvalsh((correlation + correlation.T) / 2).min() < -TOLERANCE:
        raise InputError(f"a positive semidefinite covariance in {path}", "a negative eigenvalue", "correct the file")
    return (covariance + covariance.T) / 2


def _text(document: Document) -> Array:
    rows = []
    for index, line in enumerate(document.text.splitlines()):
        words = line.partition("#")[0].replace(",", " ")
        if words.strip():
            rows.append(Table(document.name, {f"line {index + 1}": words}).numbers(f"line {index + 1}"))
    if not rows or len({len(row) for row in rows}) > 1:
        raise InputError(
            f"rows of equally many numbers in {document.name}",
            f"rows of {brief(sorted({len(row) for row in rows}))}",
            "correct the file",
        )
    return np.array(rows)


def _npy(path: Path) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # Mapped: the header may claim a size that the file does not have.
            values = np.load(path, mmap_mode="r", allow_pickle=False, max_header_size=1000)
    except Exception as error:
        # The header is Python, and its parsers have errors and warnings of a dozen kinds for damaged text.
        raise InputError(f"a .npy of numbers at {path}", brief(str(error)), "write it with numpy.save") from None
    if values.dtype.kind not in "fiu" or values.ndim not in (1, 2) or values.size > 10_000:
        raise InputError(
            f"a .npy of numbers in one or two dimensions at {path}",
            f"{values.dtype} {brief(values.shape)}",
            "write it with numpy.save",
        )
    return np.atleast_2d(np.array(values, dtype=float))
