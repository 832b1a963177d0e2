"""Options, the kinds of their values, and the tables that declare them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from inspect import Parameter, Signature
from os import PathLike
from typing import IO, TYPE_CHECKING, Annotated, Any, TypeAlias, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from markergen.model.boundary import Boundary
    from markergen.model.camera import Camera
    from markergen.model.marker import Marker
    from markergen.model.poses import PoseDistribution

    Length = float | str
    LengthOrAuto = float | str
    File = str | PathLike[str]
    Files = str | PathLike[str] | Sequence[str | PathLike[str]]
    Texts = str | Sequence[str]
    Shape = str | PathLike[str] | Boundary | Mapping[str, Any]
    Shapes = Shape | Sequence[Shape]
    MarkerLike: TypeAlias = str | PathLike[str] | IO[str] | IO[bytes] | Marker | Mapping[str, Any]
    CameraLike = str | PathLike[str] | IO[str] | IO[bytes] | Camera | Mapping[str, Any]
    Poses = str | PathLike[str] | PoseDistribution
else:
    # Type checkers see above what callers may give; at runtime the aliases carry the kind of the value.
    Length = Annotated[object, "length"]
    LengthOrAuto = Annotated[object, "length or auto"]
    File = Annotated[object, "file"]
    Files = Annotated[object, "files"]
    Texts = Annotated[object, "texts"]
    Shape = Annotated[object, "shape"]
    Shapes = Annotated[object, "shapes"]
    MarkerLike = Annotated[object, "marker"]
    CameraLike = Annotated[object, "camera"]
    Poses = Annotated[object, "poses"]

Progress = Callable[[str, int, int], None]
"""Called along the way with the name of the stage, what is done of it, and its total."""

REPEATABLE = ("files", "texts", "shapes")
"""Kinds of which several may be given."""

LAYOUT, VIEW, DOTS = "Layout", "Camera and poses", "Dots and labels"
SHEET, SOLID, SEARCH = "Sheet", "Solid", "Search"
TRIALS, IMAGES, ERRORS, RUN, FILES = "Trials", "Synthetic views", "Print and calibration", "Run", "Files"
GROUPS = (LAYOUT, VIEW, DOTS, TRIALS, IMAGES, ERRORS, SHEET, SOLID, SEARCH, RUN, FILES)
"""In the order of help."""


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes
    ----------
    group : str
        One of `GROUPS`.
    help : str
        A sentence or two, without the default.
    default : object
        Its default, as a user would write it; None if `otherwise` describes it, or there is none.
    otherwise : str
        The default in words.
    metavar : str
        Placeholder for the value in help.
    flags : str
        Its spelling on the command line, where that does not follow from the name.
    aliases : tuple of str
        Further names that spec files have for it.
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
        """Its long flag on the command line: ``--corner-radius``."""
        words = self.flags.replace("/", " ").split() or ["--" + self.name.replace("_", "-")]
        return next(word for word in words if word.startswith("--"))


@cache
def declared(table: type) -> Mapping[str, Option]:
    """Options of a table by name, in the order of `GROUPS` and, within each, of their declaration.

    >>> from markergen.options import DesignKeywords
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


def keywords(table: type) -> Iterator[Parameter]:
    """Keyword parameters of a table, for the signature that ``help()`` and editors show."""
    for name, hint in get_type_hints(table).items():
        yield Parameter(name, Parameter.KEYWORD_ONLY, default=declared(table)[name].default, annotation=hint)


def signature_of(function: Any, table: type) -> Signature:
    """Signature of a function with its ``**options`` spelled out, as a table declares them."""
    from inspect import signature

    own = [each for each in signature(function).parameters.values() if each.kind is not Parameter.VAR_KEYWORD]
    return Signature([*own, *keywords(table)], return_annotation=signature(function).return_annotation)
