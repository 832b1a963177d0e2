"""Exceptions with one common root; every message says what was expected, what was found, and what to do."""

import reprlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


class MarkergenError(Exception):
    """Root of all errors that markergen raises on purpose; the command line prints it as one line.

    >>> import markergen as mg
    >>> try:
    ...     mg.design(n=3)
    ... except mg.MarkergenError as error:
    ...     print(error)
    expected at least 4 control points, found n=3; a homography needs four: use --n 4 or more
    """


class InputError(MarkergenError):
    """Unusable input (exit status 2).

    Parameters
    ----------
    expected, found, remedy : str
        Expected value, value found, and how to fix it.

    Examples
    --------
    >>> print(InputError("a radius above 0", "radius=-0.15 m", "give --radius a positive length"))
    expected a radius above 0, found radius=-0.15 m; give --radius a positive length
    """

    def __init__(self, expected: str, found: str, remedy: str) -> None:
        # The three parts are the arguments, so that the error survives pickling on its way back from a worker process.
        super().__init__(expected, found, remedy)

    def __str__(self) -> str:
        return "expected {}, found {}; {}".format(*self.args)


class OutputError(MarkergenError):
    """A result could not be written (exit status 2); the target is unchanged.

    >>> import markergen as mg
    >>> try:
    ...     mg.design(n=4, output="no/such/folder/marker.pdf")
    ... except mg.OutputError as error:
    ...     print(str(error).partition(";")[0])
    expected to write no/such/folder/marker.pdf, found: the folder no/such/folder does not exist
    """


class MissingLibraryError(MarkergenError):
    """A part of markergen needs a library that is not installed (exit status 2).

    >>> import markergen as mg
    >>> issubclass(mg.MissingLibraryError, mg.MarkergenError)
    True
    """


@contextmanager
def with_place(place: str) -> Iterator[None]:
    """Add a place, such as ``at K in camera.yaml``, to an error about a value that does not name it."""
    try:
        yield
    except InputError as error:
        expected, problem, remedy = error.args
        raise InputError(expected if place in expected else f"{expected} {place}", problem, remedy) from None


def brief(value: object) -> str:
    """Return one short line for any value, however long or deep.

    >>> brief("long " * 100)
    "'long long lo...ng long long '"
    """
    try:
        text = " ".join(reprlib.repr(value).split())
    except ValueError:  # Python refuses to format integers of thousands of digits.
        return "an endless number"
    return text if len(text) <= 60 else text[:57] + "..."


def reason_of(error: BaseException) -> str:
    """Return in a few words why a file could not be read.

    >>> reason_of(ValueError("line 1,\\n  column 2"))
    'line 1, column 2'
    """
    text = str((error.strerror if isinstance(error, OSError) else None) or error or type(error).__name__)
    text = " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())
    return text if len(text) <= 100 else text[:97] + "..."


def enumerated(names: Iterable[str], conjunction: str = "or") -> str:
    """Join names as ``a, b or c``."""
    *others, last = names
    return f"{', '.join(others)} {conjunction} {last}" if others else last


def among(name: object, names: Iterable[str], listed: Sequence[str] = (), cutoff: float = 0.6) -> str:
    """Return the remedy for an unknown name: the nearest known name, if any, and all of them, or those in `shown`.

    >>> among("aruko", ["aruco", "apriltag"])
    "did you mean 'aruco'? Known: aruco, apriltag"
    """
    from difflib import get_close_matches

    every = list(names)
    matches = get_close_matches(name, every, n=1, cutoff=cutoff) if isinstance(name, str) else []
    hint = f"did you mean {matches[0]!r}? Known" if matches else "known"
    return f"{hint}: {', '.join(listed or every)}"


def install(extra: str) -> str:
    """Return the command that installs an extra: in a checkout from there, else from the package index."""
    is_checkout = (Path(__file__).parents[1] / "detector" / "pyproject.toml").exists()
    return f"pip install ./detector '.[{extra}]'" if is_checkout else f"pip install 'markergen[{extra}]'"
