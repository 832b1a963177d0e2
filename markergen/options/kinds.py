"""Kinds of option values: how each is annotated, read from Python, typed on a command line and stated in a file."""
# tests: tests/options/test_declared.py

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import FunctionType, MethodType
from typing import IO, TYPE_CHECKING, Annotated, Any, TypeAlias

from markergen.errors import InputError
from markergen.units import LARGEST_LENGTH, SMALLEST_LENGTH, parse_duration, parse_length, with_point

Reader = Callable[[Any, str], Any]
"""Returns a value of a name as converted, or raises an error with only the expected part filled in."""


@dataclass(frozen=True)
class Kind:
    """Kind of an option's value.

    Attributes
    ----------
    name : str
    accepted : str
        Accepted types, as ``help()`` and editors show them.
    read : callable
        `Reader`.
    typed : type
        Type that the command line gives to typer.
    parse : callable, optional
        Parser of text on the command line that typer cannot read itself; raises `InputError`.
    repeatable : bool
        Accepts several values.
    """

    name: str
    accepted: str
    read: Reader
    typed: Any = str
    parse: Callable[[str], Any] | None = None
    repeatable: bool = False


KINDS: dict[str, Kind] = {}
"""Kinds by name."""


def _kind(name: str, accepted: str, read: Reader, typed: Any = str, parse: Callable[[str], Any] | None = None) -> Any:
    """Annotation of a new kind."""
    KINDS[name] = Kind(name, accepted, read, typed, parse)
    return Annotated[object, KINDS[name]]


def _several(name: str, accepted: str, of: Kind, expected: str) -> Any:
    """Annotation of a new kind that accepts one or several values of another kind."""

    def read_all(value: Any, name: str) -> tuple[Any, ...]:
        is_single = isinstance(value, str | bytes | bytearray) or not isinstance(value, Sequence)
        try:
            return tuple(of.read(part, name) for part in ([value] if is_single else value))
        except InputError:
            raise _wrong(expected) from None

    KINDS[name] = replace(of, name=name, accepted=accepted, read=read_all, typed=list[of.typed], repeatable=True)  # type: ignore[name-defined]
    return Annotated[object, KINDS[name]]


def _wrong(expected: str) -> InputError:
    return InputError(expected, "", "")


def _int(value: Any, _: str) -> int:
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise _wrong("a whole number")
    return int(value)


def _int_or_auto(value: Any, name: str) -> int | str:
    if isinstance(value, str) and value == "auto":
        return value
    try:
        return _int(value, name)
    except InputError:
        raise _wrong("a whole number, or 'auto'") from None


def _typed_int_or_auto(text: str) -> int | str:
    """Parse a whole number so that an error names the word, too."""
    try:
        return text if text == "auto" else int(text)
    except ValueError:
        raise InputError("a whole number or auto", repr(text), "write 8, or auto") from None


def _typed_number(kind: type, expected: str, example: str) -> Callable[[str], Any]:
    """Parser of what is typed for an int or a float."""

    def parse(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            raise InputError(expected, repr(text), f"write a number such as {example}") from None

    parse.__name__ = kind.__name__  # Shown in the help as what to type.
    return parse


def _float(value: Any, _: str) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise _wrong("a number")
    try:
        return float(value)
    except OverflowError:
        raise _wrong("a number of at most 308 digits") from None


def _bool(value: Any, _: str) -> bool:
    if not isinstance(value, bool):
        raise _wrong("True or False")
    return value


def _str(value: Any, _: str) -> str:
    if not isinstance(value, str):
        raise _wrong("a text")
    return str(value)


def _length(value: Any, name: str) -> float:
    try:
        meters = parse_length(value, name) if isinstance(value, str) else _float(value, name)
    except InputError:
        meters = math.nan
    if not math.isfinite(meters):
        pointed = with_point(value)
        raise _wrong(f"write a point: {pointed}" if pointed else "a length such as 0.15 or '150mm'")
    # Standard deviations may be as small as they like.
    if abs(meters) > LARGEST_LENGTH or (0 < abs(meters) < SMALLEST_LENGTH and "sigma" not in name):
        raise _wrong("a length of 1 um to 1 km")
    return meters


def _length_or(word: str) -> Any:
    """Annotation of a new kind: a length or one word."""

    def read(value: Any, name: str) -> float | str:
        return word if isinstance(value, str) and value == word else _length(value, name)

    def parse(text: str) -> float | str:
        return text if text == word else parse_length(text)

    return _kind(f"length or {word}", "float | str", read, float, parse)


def _file(value: Any, _: str) -> Path:
    if isinstance(value, str | os.PathLike):
        path = os.fspath(value)
        if isinstance(path, str) and path and "\0" not in path:
            return Path(path)
    raise _wrong("a path")


def _covariance(value: Any, name: str) -> Any:
    rows = value.tolist() if hasattr(value, "tolist") else value
    try:
        return rows if isinstance(rows, list | tuple) and rows else _file(rows, name)
    except InputError:
        raise _wrong("a path, standard deviations, or rows of a covariance") from None


def _layout(value: Any, _: str) -> Any:
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, str | os.PathLike | list | tuple):
        return value
    raise _wrong("a layout: a text such as '0mm,50mm; -40mm,-30mm; ...', a CSV file, or rows of x, y")


def _settings(value: Any, _: str) -> Any:
    if isinstance(value, str | Mapping):
        return value
    raise _wrong("named numbers: a text such as 'blur_px=1.5,noise_grey=4', or a dictionary")


def _thing(expected: str, others: tuple[type, ...] = ()) -> Reader:
    """Pass on an object of a markergen class that this layer cannot import; builtins but for `others` are refused."""

    def read(value: Any, _: str) -> Any:
        if isinstance(value, (str, os.PathLike, Mapping, *others)) or type(value).__module__ != "builtins":
            return value
        raise _wrong(expected)

    return read


for builtin, reader, typed in (
    (int, _int, _typed_number(int, "a whole number", "8")),
    (float, _float, _typed_number(float, "a number", "0.5")),
    (bool, _bool, None),
    (str, _str, None),
):
    _kind(builtin.__name__, builtin.__name__, reader, builtin, typed)

_OUTLINE = "an outline: a text such as rect:0.2x0.1, a path, or a boundary"

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from markergen.model.boundary import Boundary
    from markergen.model.camera import Camera
    from markergen.model.marker import Marker
    from markergen.model.rig import Rig

    Length = float | str
    Duration = float | str
    LengthOrAuto = float | str
    IntOrAuto = int | str
    LengthOrFit = float | str
    File = str | PathLike[str]
    Files = str | PathLike[str] | Sequence[str | PathLike[str]]
    Texts = str | Sequence[str]
    Shape = str | PathLike[str] | Boundary | Mapping[str, Any]
    Shapes = Shape | Sequence[Shape]
    MarkerLike: TypeAlias = str | PathLike[str] | IO[str] | IO[bytes] | Marker | Mapping[str, Any]
    TargetLike: TypeAlias = MarkerLike | Rig
    CameraLike = str | PathLike[str] | IO[str] | IO[bytes] | Camera | Mapping[str, Any]
    Poses = Any
    ObjectiveLike = str | Callable[..., Any]
    Covariance = str | PathLike[str] | Sequence[Sequence[float]] | NDArray[Any]
    Settings = str | Mapping[str, float]
    Layout = str | PathLike[str] | Sequence[Sequence[float | str]] | NDArray[Any]
else:
    # Type checkers see the accepted types above; at runtime the aliases carry the kind.
    Length = _kind("length", "float | str", _length, float, parse_length)
    Duration = _kind("duration", "float | str", lambda value, _: parse_duration(value), str, parse_duration)
    LengthOrAuto, LengthOrFit = _length_or("auto"), _length_or("fit")
    IntOrAuto = _kind("int or auto", "int | str", _int_or_auto, str, _typed_int_or_auto)
    File = _kind("file", "str | Path", _file, Path)
    Files = _several("files", "str | Path | list[str | Path]", KINDS["file"], "a path, or a list of paths")
    Texts = _several("texts", "str | list[str]", KINDS["str"], "a text, or a list of texts")
    Shape = _kind("shape", "str | Path | Boundary | dict", _thing(_OUTLINE))
    Shapes = _several(
        "shapes", "str | Path | Boundary | dict | list[...]", KINDS["shape"], _OUTLINE + ", or a list of them"
    )
    _MARKER = "a marker, a path, or a dictionary"
    MarkerLike = _kind("marker", "Marker | str | Path | dict", _thing(_MARKER))
    TargetLike = _kind("marker or rig", "Marker | Rig | str | Path | dict", _thing(_MARKER))
    CameraLike = _kind("camera", "Camera | str | Path | dict", _thing("a camera, a path, or a dictionary"))
    Poses = _kind(
        "poses",
        "str | Path | Poses | array | pairs | DataFrame | callable",
        _thing(
            "poses: a text such as 'paper' or 'cone:tilt=0..60', a path, matrices (k, 4, 4), pairs of rvec and tvec, a "
            "DataFrame, or a function of a generator",
            (list, tuple, zip, FunctionType, MethodType),
        ),
    )
    ObjectiveLike = _kind(
        "objective",
        "str | callable | Objective subclass",
        _thing("an objective: a name, a function of points and view, or a subclass of Objective", (FunctionType, type)),
    )
    Covariance = _kind("covariance", "str | Path | array", _covariance, Path)
    Settings = _kind("settings", "str | dict", _settings)
    Layout = _kind("layout", "str | Path | array", _layout)
