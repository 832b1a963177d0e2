"""Option declarations, and validation of caller input.

The options themselves are declared in `markergen.options.declarations`, the kinds of their values in `kinds`.
"""

import os
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from inspect import Parameter, Signature, formatannotation
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from markergen.errors import InputError, brief
from markergen.options.kinds import KINDS, Kind

F = TypeVar("F", bound=Callable[..., Any])

Progress = Callable[[str, int, int], None]
"""Progress callback: name of the stage, amount done, total."""

STAGES = {
    "number of dots": "trying numbers of dots",
    "refinement": "settling the number of dots",
    "radius": "trying sizes of the marker",
    "dot size": "trying sizes of dots",
    "scales": "trying dots of several sizes",
    "regular": "trying regular layouts",
    "descent": "moving dots downhill",
    "exchange": "trying other places",
    "polish": "fine adjustment",
    "hops": "moving single dots away",
    "asymmetric": "telling dots apart",
    "relief": "raising dots",
    "together": "all sizes together",
    "plates": "one plate after the other",
    "lower bound": "what is possible at best",
    "settings": "tuning other detectors",
}
"""Words for the stages of a search or comparison, by the names that callers get; other names are words already."""

Watch = Callable[[str, Any, float], None]
"""Callback of a search: name of the stage, best layout so far as an array (n, 2 or 3) in m, value of the objective."""

LAYOUT, VIEW, DOTS = "Layout", "Camera and poses", "Dots and labels"
SHEET, SOLID, SEARCH = "Sheet", "Solid", "Search"
TRIALS, IMAGES, ERRORS, RUN, FILES = "Trials", "Synthetic views", "Print and calibration", "Run", "Files"
GROUPS = (LAYOUT, VIEW, DOTS, TRIALS, IMAGES, ERRORS, SHEET, SOLID, SEARCH, RUN, FILES)
"""Groups in the order of help."""


WITHOUT_EFFECT = frozenset({"refine"})
"""Options of the release before that are still accepted and ignored; they go with the next."""


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes
    ----------
    group : str
        One of `GROUPS`.
    help : str
        A sentence or two, without the default.
    default : int, float, str, bool or None
        As a user would write it; None if `otherwise` describes it, or there is none.
    otherwise : str
        The default in words.
    metavar : str
        Placeholder for the value in help.
    flags : str
        Spelling on the command line, if it does not follow from the name.
    aliases : tuple of str
        Additional names accepted in spec files.
    name, kind : str
        Filled in by `declared`: the keyword, and the name of the kind of its value, see `KINDS`.
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
        flags = self.flags.replace("/", " ").split() or ["--" + self.name.replace("_", "-")]
        return next(flag for flag in flags if flag.startswith("--"))


@cache
def declared(table: type) -> Mapping[str, Option]:
    """Return a table's options by name, in the order of `GROUPS` and, within each, of declaration.

    >>> from markergen.options.declarations import DesignKeywords
    >>> declared(DesignKeywords)["corner_radius"].flag
    '--corner-radius'
    """
    hints = get_type_hints(table, include_extras=True)
    options = [_named(name, hint) for name, hint in hints.items()]
    return {option.name: option for option in sorted(options, key=lambda option: GROUPS.index(option.group))}


def _named(name: str, hint: Any) -> Option:
    assert get_origin(hint) is Annotated
    kind, option = _kind_of(hint), get_args(hint)[-1]
    assert isinstance(option, Option)
    length = "LENGTH" if kind.name == "length" else ""
    return replace(option, name=name, kind=kind.name, metavar=option.metavar or length)


def _kind_of(hint: Any) -> Kind:
    """Kind of an annotation: that of an alias, or of a builtin type."""
    type_, *extras = get_args(hint)
    return extras[0] if isinstance(extras[0], Kind) else KINDS[type_.__name__]


class _Accepted:
    """Annotation that ``help()`` shows as the types that a kind accepts."""

    def __init__(self, types: str) -> None:
        self._types = types

    def __repr__(self) -> str:
        return self._types


def _accepted(hint: Any) -> Any:
    """Replace the kinds of values in an annotation with the types they accept."""
    if get_origin(hint) is Annotated:
        return _Accepted(_kind_of(hint).accepted) if get_args(hint)[0] is object else get_args(hint)[0]
    parts = [(part, _accepted(part)) for part in get_args(hint)]
    if all(accepted is part for part, accepted in parts):
        return hint
    names = [formatannotation(accepted) if accepted is not type(None) else "None" for _, accepted in parts]
    is_union = get_origin(hint) in (Union, UnionType)
    return _Accepted(" | ".join(names) if is_union else f"{get_origin(hint).__name__}[{', '.join(names)}]")


def signature_of(function: Any, table: type | None = None) -> Signature:
    """Return the signature of a function or class with its ``**options`` spelled out as declared in a table."""
    from inspect import signature

    parameters = [
        parameter
        for parameter in signature(function).parameters.values()
        if parameter.kind is not Parameter.VAR_KEYWORD
    ]
    parameters = [parameter.replace(annotation=_accepted(parameter.annotation)) for parameter in parameters]
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=declared(table)[name].default, annotation=_accepted(hint))
        for name, hint in (get_type_hints(table, include_extras=True) if table else {}).items()
    ]
    return Signature([*parameters, *options], return_annotation=signature(function).return_annotation)


def takes(table: type) -> Callable[[F], F]:
    """Decorate a function whose ``**options`` are those of a table with its `signature_of`."""

    def decorate(function: F) -> F:
        function.__signature__ = signature_of(function, table)  # type: ignore[attr-defined]
        return function

    return decorate


def settle(options: Mapping[str, Any], table: type, spec: str = "") -> dict[str, Any]:
    """Check a caller's options and return all options of the table, converted and with defaults filled in.

    As strict as a spec file: no ``"5"`` for a number, no True for 1. NumPy scalars count as numbers.

    Parameters
    ----------
    options : mapping
        Keyword arguments; None means that the option was not given.
    table : type
        One of the tables of `markergen.options.declarations`, named after its function, as in ``ValidateKeywords``.
    spec : str
        Name of the spec that the options are from; they are a caller's if empty.

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
    declarations = declared(table)
    settled: dict[str, Any] = {}
    findings = []
    for name, value in options.items():
        if name in WITHOUT_EFFECT:
            warnings.warn(f"{name}= has no effect any more", DeprecationWarning, stacklevel=3)
        elif name not in declarations:
            findings.append(f"{name}={brief(value)} (no such option: {_hint(name, declarations)})")
    for name, option in declarations.items():
        asked = options.get(name)
        value = option.default if asked is None else _plain(asked)
        try:
            settled[name] = None if value is None else KINDS[option.kind].read(value, name)
        except InputError as error:
            findings.append(f"{name}={brief(asked)} ({error.args[0]})")
    if findings:
        function = f"markergen.{table.__name__.removesuffix('Keywords').lower()}"
        expected, remedy = f"options of {function}", f"see help({function})"
        if spec:
            expected, remedy = f"a valid spec in {spec}", "correct these places"
        raise InputError(expected, ", ".join(findings), remedy)
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
        return None if value is None else KINDS[kind].read(_plain(value), name)
    except InputError as error:
        raise InputError(f"{error.args[0]} for {name}", brief(value), f"give {name} such a value") from None


def check_progress(progress: object, takes: str = "a stage, what is done, and a total") -> None:
    """Refuse a progress callback that is not callable, before any work is done; raises InputError."""
    if progress is not None and not callable(progress):
        raise InputError("a function for progress", brief(progress), f"give one that takes {takes}")


def given(options: Mapping[str, Any], table: type, spec: str = "") -> dict[str, Any]:
    """Return only the options that a caller or a spec gave, checked and converted as by `settle`."""
    settled = settle(options, table, spec)
    return {name: settled[name] for name, value in options.items() if value is not None}


def as_list(value: Any) -> list[Any]:
    """Return a value as a list; a string, path, mapping or open file counts as a single item.

    >>> as_list("marker.json"), as_list(("a.json", "b.json"))
    (['marker.json'], ['a.json', 'b.json'])
    """
    # An open file is iterable, but its lines are not separate values.
    is_single = isinstance(value, str | bytes | os.PathLike | Mapping) or hasattr(value, "read")
    is_single = is_single or getattr(value, "ndim", 1) == 0  # A zero-dimensional array is a single number.
    return list(value) if isinstance(value, Iterable) and not is_single else [value]


GUESSES = {
    **dict.fromkeys(("size", "width"), ("boundary", "the room is --radius 150mm or --boundary rect:200mmx100mm")),
    "diameter": ("dot", "--dot 20mm is the diameter of a dot, --radius 150mm half that of the room"),
    **dict.fromkeys(("dots", "count", "num", "number"), ("n", "write --n 8")),
    **dict.fromkeys(("out", "file", "format"), ("output", "write -o marker.pdf; its suffix is the format")),
    "units": ("radius", "lengths carry their unit: 150mm, 0.15, 6in"),
    **dict.fromkeys(("dictionary", "dict", "family"), ("tag", "write --tag aruco:DICT_4X4_50:7")),
    "calibration": ("camera", "write --camera camera.yaml"),
    "camera": ("protocol", "all are seen by the camera of the first marker's design: markergen design --camera"),
}
"""What users of other tools write: the option that has to exist for an answer, and the answer."""


_WRITTEN = re.compile(r"--?([a-z-]+) ([a-z0-9][^\s;,]*)")
"""An option with its value at the command line."""


def guess(name: str, names: Collection[str]) -> str:
    """Return the answer to an option of another tool where these options exist; else nothing."""
    option, answer = GUESSES.get(name, ("", ""))
    return answer if option in names and name not in names else ""


def _hint(name: str, names: Mapping[str, Option]) -> str:
    if answer := guess(name, names):
        return _WRITTEN.sub(_as_keyword, answer)
    matches = get_close_matches(name, names, n=1)
    return f"did you mean {matches[0]!r}?" if matches else f"known: {', '.join(names)}"


def _as_keyword(option: re.Match[str]) -> str:
    name, value = {"o": "output"}.get(option[1], option[1]).replace("-", "_"), option[2]
    return f"{name}={value if value.isdecimal() else repr(value)}"


def _plain(value: Any) -> Any:
    """Convert NumPy scalars to Python values, without importing NumPy."""
    is_scalar = getattr(value, "ndim", None) == 0 and hasattr(value, "item")
    return value.item() if is_scalar else value
