"""Option declarations, the kinds of their values, and validation of caller input.

The options themselves are declared in `markergen.options.declarations`.
"""

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from inspect import Parameter, Signature
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any, TypeAlias, get_args, get_origin, get_type_hints

from markergen.errors import InputError, brief
from markergen.units import parse_length

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from markergen.model.boundary import Boundary
    from markergen.model.camera import Camera
    from markergen.model.marker import Marker
    from markergen.model.poses import PoseDistribution
    from markergen.model.rig import Rig

    Length = float | str
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
    Poses = str | PathLike[str] | PoseDistribution
    Covariance = str | PathLike[str] | Sequence[Sequence[float]] | NDArray[Any]
    Settings = str | Mapping[str, float]
    Layout = str | PathLike[str] | Sequence[Sequence[float | str]] | NDArray[Any]
else:
    # Type checkers see the accepted types above; at runtime the aliases carry the kind, one of `ACCEPTED`.
    Length = Annotated[object, "length"]
    LengthOrAuto = Annotated[object, "length or auto"]
    IntOrAuto = Annotated[object, "int or auto"]
    LengthOrFit = Annotated[object, "length or fit"]
    File = Annotated[object, "file"]
    Files = Annotated[object, "files"]
    Texts = Annotated[object, "texts"]
    Shape = Annotated[object, "shape"]
    Shapes = Annotated[object, "shapes"]
    MarkerLike = Annotated[object, "marker"]
    TargetLike = Annotated[object, "marker or rig"]
    CameraLike = Annotated[object, "camera"]
    Poses = Annotated[object, "poses"]
    Covariance = Annotated[object, "covariance"]
    Settings = Annotated[object, "settings"]
    Layout = Annotated[object, "layout"]

Progress = Callable[[str, int, int], None]
"""Progress callback: name of the stage, amount done, total."""

Watch = Callable[[str, Any, float], None]
"""Callback of a search: name of the stage, best layout so far as an array (n, 2 or 3) in m, value of the objective."""

ACCEPTED = {
    "length": "float | str",
    "length or auto": "float | str",
    "int or auto": "int | str",
    "length or fit": "float | str",
    "file": "str | Path",
    "files": "str | Path | list[str | Path]",
    "texts": "str | list[str]",
    "shape": "str | Path | Boundary | dict",
    "shapes": "str | Path | Boundary | dict | list[...]",
    "marker": "Marker | str | Path | dict",
    "marker or rig": "Marker | Rig | str | Path | dict",
    "camera": "Camera | str | Path | dict",
    "poses": "str | Path | PoseDistribution",
    "covariance": "str | Path | array",
    "settings": "str | dict",
    "layout": "str | Path | array",
}
"""Accepted types for each kind of value, as ``help()`` and editors show them."""

REPEATABLE = ("files", "texts", "shapes")
"""Kinds that accept several values."""

LAYOUT, VIEW, DOTS = "Layout", "Camera and poses", "Dots and labels"
SHEET, SOLID, SEARCH = "Sheet", "Solid", "Search"
TRIALS, IMAGES, ERRORS, RUN, FILES = "Trials", "Synthetic views", "Print and calibration", "Run", "Files"
GROUPS = (LAYOUT, VIEW, DOTS, TRIALS, IMAGES, ERRORS, SHEET, SOLID, SEARCH, RUN, FILES)
"""Groups in the order of help."""


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes
    ----------
    group : str
        One of `GROUPS`.
    help : str
        A sentence or two, without the default.
        Default, as a user would write it; None if `otherwise` describes it, or there is none.
        Its default, as a user would write it; None if `otherwise` describes it, or there is none.
    otherwise : str
        The default in words.
    metavar : str
        Placeholder for the value in help.
    flags : str
        Spelling on the command line, if it does not follow from the name.
    aliases : tuple of str
        Additional names accepted in spec files.
    name, kind : str
        Filled in by `declared`: the keyword, and the kind of its value: ``int``, ``float``, ``str``, ``bool``, or one
        of the kinds above.
    """

    group: str
    help: str
    default: Any = None
    otherwise: str = ""
    metavar: str = ""
    flags: str = ""
    aliases: tuple[str, ...] = ()
    name: str = ""
    kind: str = ""

    @property
    def shown(self) -> str:
        """Default as help shows it; empty if there is none."""
        if self.otherwise or self.default is None:
            return self.otherwise
        if isinstance(self.default, bool):
            return "yes" if self.default else "no"
        return str(self.default)

    @property
    def flag(self) -> str:
        """Long flag on the command line: ``--corner-radius``."""
        words = self.flags.replace("/", " ").split() or ["--" + self.name.replace("_", "-")]
        return next(word for word in words if word.startswith("--"))


@cache
def declared(table: type) -> Mapping[str, Option]:
    """Return a table's options by name, in the order of `GROUPS` and, within each, of declaration.

    >>> from markergen.options.declarations import DesignKeywords
    >>> declared(DesignKeywords)["corner_radius"].flag
    '--corner-radius'
    """
    hints = get_type_hints(table, include_extras=True)
    found = [_named(name, hint) for name, hint in hints.items()]
    return {each.name: each for each in sorted(found, key=lambda each: GROUPS.index(each.group))}


def _named(name: str, hint: Any) -> Option:
    kind, *extras = get_args(hint)
    option = extras[-1]
    assert get_origin(hint) is Annotated
    assert isinstance(option, Option)
    length = "LENGTH" if extras[0] == "length" else ""
    return replace(
        option, name=name, kind=extras[0] if kind is object else kind.__name__, metavar=option.metavar or length
    )


class _Accepted:
    """Annotation that ``help()`` shows as written in `ACCEPTED`."""

    def __init__(self, words: str) -> None:
        self._words = words

    def __repr__(self) -> str:
        return self._words


def _accepted(hint: Any) -> Any:
    """Replace the kinds of values in an annotation with the types they accept."""
    if get_origin(hint) is Annotated:
        kind, first, *_ = get_args(hint)
        return _Accepted(ACCEPTED[first]) if kind is object else kind
    if type(None) in get_args(hint) and any(get_origin(each) is Annotated for each in get_args(hint)):
        return _Accepted(" | ".join("None" if each is type(None) else repr(_accepted(each)) for each in get_args(hint)))
    return hint


def signature_of(function: Any, table: type) -> Signature:
    """Return the signature of a function with its ``**options`` spelled out as declared in a table."""
    from inspect import signature

    own = [each for each in signature(function).parameters.values() if each.kind is not Parameter.VAR_KEYWORD]
    own = [each.replace(annotation=_accepted(each.annotation)) for each in own]
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=declared(table)[name].default, annotation=_accepted(hint))
        for name, hint in get_type_hints(table, include_extras=True).items()
    ]
    return Signature([*own, *options], return_annotation=signature(function).return_annotation)


def settle(options: Mapping[str, Any], table: type) -> dict[str, Any]:
    """Check a caller's options and return all options of the table, converted and with defaults filled in.

    As strict as a spec file: no ``"5"`` for a number, no True for 1. NumPy scalars count as numbers.

    Parameters
    ----------
    options : mapping
        Keyword arguments; None means that the option was not given.
    table : type
        One of the tables of `markergen.options.declarations`, named after its function, as in ``ValidateKeywords``.

    Returns
    -------
    dict
        Every name of the table: lengths in m, files as `Path`, repeatable options as tuples; None where nothing was
        given and the table has no default. Shapes, cameras and poses are passed on unchanged.

    Raises
    ------
    InputError
        Listing all errors: unknown names, each with the nearest known one, and values of the wrong type.

    Examples
    --------
    >>> from markergen.options.declarations import ValidateKeywords
    >>> settled = settle({"runs": 20, "print_sigma": "50um"}, ValidateKeywords)
    >>> settled["runs"], settled["print_sigma"], settled["noise"], settled["views"]
    (20, 5e-05, 0.2, None)
    >>> settle({"rnus": 20}, ValidateKeywords)
    Traceback (most recent call last):
    markergen.errors.InputError: expected options of markergen.validate, found rnus=20 (no such option: did you mean \
'runs'?); see help(markergen.validate)
    """
    known = declared(table)
    settled: dict[str, Any] = {}
    findings = []
    for name, value in options.items():
        if name not in known:
            findings.append(f"{name}={brief(value)} (no such option: {_hint(name, known)})")
    for name, option in known.items():
        given = options.get(name)
        value = option.default if given is None else _plain(given)
        try:
            settled[name] = None if value is None else _READERS[option.kind](value, name)
        except InputError as error:
            findings.append(f"{name}={brief(given)} ({error.args[0]})")
    if findings:
        function = f"markergen.{table.__name__.removesuffix('Keywords').lower()}"
        raise InputError(f"options of {function}", ", ".join(findings), f"see help({function})")
    return settled


def read_as(kind: str, value: Any, name: str) -> Any:
    """Check and convert one argument as an option of that kind; None stays None.

    Raises
    ------
    InputError
        If the value is of the wrong type.

    Examples
    --------
    >>> read_as("length", "0.1mm", "tolerance")
    0.0001
    """
    try:
        return None if value is None else _READERS[kind](_plain(value), name)
    except InputError as error:
        raise InputError(f"{error.args[0]} for {name}", brief(value), f"give {name} such a value") from None


def check_progress(progress: object, takes: str = "a stage, what is done, and a total") -> None:
    """Refuse a progress callback that is not callable, before any work is done; raises InputError."""
    if progress is not None and not callable(progress):
        raise InputError("a function for progress", brief(progress), f"give one that takes {takes}")


def given(options: Mapping[str, Any], table: type) -> dict[str, Any]:
    """Return only the options that a caller gave, checked and converted as by `settle`."""
    settled = settle(options, table)
    return {name: settled[name] for name, value in options.items() if value is not None}


def as_list(value: Any) -> list[Any]:
    """Return a value as a list; a string, path, mapping or open file counts as a single item.

    >>> as_list("marker.json"), as_list(("a.json", "b.json"))
    (['marker.json'], ['a.json', 'b.json'])
    """
    # An open file is iterable, but its lines are not separate values.
    one = isinstance(value, str | bytes | os.PathLike | Mapping) or hasattr(value, "read")
    one = one or getattr(value, "ndim", 1) == 0  # A zero-dimensional array is a single number.
    return list(value) if isinstance(value, Iterable) and not one else [value]


def _hint(name: str, known: Mapping[str, Option]) -> str:
    near = get_close_matches(name, known, n=1)
    return f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"


def _plain(value: Any) -> Any:
    """Convert NumPy scalars to Python values, without importing NumPy."""
    is_scalar = getattr(value, "ndim", None) == 0 and hasattr(value, "item")
    return value.item() if is_scalar else value


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
        raise _wrong("a length such as 0.15 or '150mm'")
    return meters


def _length_or(word: str) -> Callable[[Any, str], float | str]:
    def read(value: Any, name: str) -> float | str:
        return word if isinstance(value, str) and value == word else _length(value, name)

    return read


def _file(value: Any, _: str) -> Path:
    if isinstance(value, str | os.PathLike):
        path = os.fspath(value)
        if isinstance(path, str) and path and "\0" not in path:
            return Path(path)
    raise _wrong("a path")


def _several(read: Callable[[Any, str], Any], expected: str) -> Callable[[Any, str], tuple[Any, ...]]:
    def read_all(value: Any, name: str) -> tuple[Any, ...]:
        alone = isinstance(value, bytes | bytearray) or not isinstance(value, Sequence) or isinstance(value, str)
        try:
            return tuple(read(each, name) for each in ([value] if alone else value))
        except InputError:
            raise _wrong(expected) from None

    return read_all


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


def _thing(expected: str) -> Callable[[Any, str], Any]:
    """Pass on an object of a markergen class that this layer cannot import; builtins are refused."""

    def read(value: Any, _: str) -> Any:
        if isinstance(value, str | os.PathLike | Mapping) or type(value).__module__ != "builtins":
            return value
        raise _wrong(expected)

    return read


_SHAPE = "an outline: a text such as rect:0.2x0.1, a path, or a boundary"
_READERS: dict[str, Callable[[Any, str], Any]] = {
    "int": _int,
    "float": _float,
    "bool": _bool,
    "str": _str,
    "length": _length,
    "length or auto": _length_or("auto"),
    "int or auto": _int_or_auto,
    "length or fit": _length_or("fit"),
    "file": _file,
    "files": _several(_file, "a path, or a list of paths"),
    "texts": _several(_str, "a text, or a list of texts"),
    "shape": _thing(_SHAPE),
    "shapes": _several(_thing(_SHAPE), _SHAPE + ", or a list of them"),
    "camera": _thing("a camera, a path, or a dictionary"),
    "settings": _settings,
    "covariance": _covariance,
    "layout": _layout,
    "poses": _thing("poses: a text such as 'paper' or 'cone:tilt=0..60', a path, or a PoseDistribution"),
}
"""Readers by kind; each returns the converted value, or raises an error with only the expected part filled in."""
