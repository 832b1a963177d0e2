"""``markergen.rescale``: the marker as printed."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Generic, TypeVar, Unpack, overload

from markergen.api.arguments import as_path, files_among
from markergen.drawing.sheet_layout import sheet_for
from markergen.errors import InputError, brief
from markergen.files import Written, check_outputs, write_all
from markergen.model.body import Body
from markergen.model.body_json import body_to_json, load_marker_or_rig
from markergen.model.marker import Marker
from markergen.model.rescale import Rulers, check_not_exchanged, exchanged, remeasure, rescale_body
from markergen.model.rig import Rig
from markergen.options import read_as, settle, takes
from markergen.options.declarations import RescaleKeywords
from markergen.options.kinds import File, MarkerLike, TargetLike
from markergen.presentation.results import Result, files_as_json, json_bytes, plain
from markergen.read.dot_tables import read_measured
from markergen.units import format_length, parse_length

T = TypeVar("T", bound=Body)


class Rescaled(Result, Generic[T]):
    """A marker or rig with its dots where they are in the print, and notes on the differences.

    Attributes
    ----------
    marker : Marker or Rig
    notes : tuple of str
        Sentences: the scale error of the print, and how far it moves the dots.
    written : tuple of Written
        Files written, if any.

    Examples
    --------
    >>> import markergen as mg
    >>> marker = mg.design(n=4, dot="20mm", restarts=2).marker
    >>> mg.rescale(marker, measured_x="198mm").marker.print_scale
    (0.99, 0.99)
    """

    def __init__(self, marker: T, notes: tuple[str, ...], written: tuple[Written, ...] = ()) -> None:
        self.marker: T = marker
        self.notes, self.written = notes, written

    def parts(self) -> list[str]:
        """See `Result.parts`."""
        return list(self.notes)

    def to_json(self) -> bytes:
        """Return the scale of the print along x and y, of a rig's markers by name, with notes and files."""
        scales = {plate.name: plate.marker.print_scale for plate in self.marker.plates}
        scale = scales if self.marker.frame == "rig" else scales["marker"]
        return json_bytes(plain({"print_scale": scale, "notes": self.notes, "files": files_as_json(self.written)}))

    def __repr__(self) -> str:
        return f"Rescaled({self.marker!r})"


@overload
def rescale(
    marker: MarkerLike, output: File | None = None, *, json: File | None = None, **options: Unpack[RescaleKeywords]
) -> Rescaled[Marker]: ...


@overload
def rescale(
    marker: Rig, output: File | None = None, *, json: File | None = None, **options: Unpack[RescaleKeywords]
) -> Rescaled[Rig]: ...


@takes(RescaleKeywords)
def rescale(
    marker: TargetLike, output: File | None = None, *, json: File | None = None, **options: Unpack[RescaleKeywords]
) -> Rescaled[Any]:
    """Correct a marker for a print that came out at another size, from measurements of its rulers or of its dots.

    Parameters
    ----------
    marker : Marker, Rig, path or dict
        As designed, or rescaled before. The markers of a rig are rescaled each about its own origin.
    output : str or path, optional
        The marker.json or rig.json for this print; may be the file that the marker was read from.
    json : path, optional
        File for the scale and the notes.
    **options
        As on the command line, ``markergen rescale --help``, with underscores: ``measured_x="198.6mm"``.

    Returns
    -------
    Rescaled

    Raises
    ------
    InputError
        If nothing was measured, both rulers and dots were, or a length is off by 5 % or more without ``force``.

    Examples
    --------
    >>> import markergen as mg
    >>> marker = mg.design(n=4, dot="20mm", restarts=4).marker
    >>> print(mg.rescale(marker, measured_x="198mm", measured_y="199mm"))
    The print is 99 % of the design along x and 99.5 % along y: x 198 mm of 200 mm, y 199 mm of 200 mm.
    This assumes --nominal-x 200mm and --nominal-y 200mm; if another length is printed beside a ruler, give that.
    Dots are up to 1.38 mm from where they were designed.
    """
    asked = settle(options, RescaleKeywords)
    if asked["measured_points"] is not None and (asked["measured_x"], asked["measured_y"]) != (None, None):
        raise InputError(
            "either rulers or dots, measured on the print", "both", "measured dots suffice: leave out the rulers"
        )
    target = None if output is None else as_path(output, "a path to write to")
    if target is not None and target.suffix.lower() != ".json":
        raise InputError("an output that ends in .json", str(target), "a sheet of it is made by markergen export")
    results, targets = list(read_as("files", json, "json") or ()), [target] if target else []
    check_outputs([*targets, *results])
    check_outputs(results, files_among(marker, asked["measured_points"]))
    body: Body = load_marker_or_rig(marker)
    before = body.plates[0].marker
    rulers = Rulers(*(asked[name] for name in ("measured_x", "measured_y", "nominal_x", "nominal_y")))
    rescaled: Rescaled[Any]
    if body.frame == "rig":
        if asked["measured_points"] is not None:
            raise InputError("rulers of a rig", "--measured-points", "measure its dots with markergen calibrate")
        rescaled = Rescaled(*rescale_body(body, rulers, asked["force"], _others(asked["also"] or (), rulers)))
    elif asked["also"]:
        raise InputError("rulers of one marker", "--also", "it is for the markers of a rig")
    elif asked["measured_points"] is None:
        rescaled = Rescaled(*rescale_body(before, rulers, asked["force"]))
        if before.rulers is None:
            rescaled.notes += _exchanged(before, rulers, asked["force"])
    else:
        rescaled = Rescaled(*remeasure(before, read_measured(asked["measured_points"]), asked["force"]))
    rescaled.written = tuple(Written(path, rescaled.notes) for path in targets)
    contents = {path: body_to_json(rescaled.marker) for path in targets}
    write_all(contents | {path: rescaled.to_json() for path in results})
    rescaled.written += tuple(map(Written, results))
    return rescaled


def _exchanged(marker: Marker, rulers: Rulers, force: bool) -> tuple[str, ...]:
    """Refuse lengths that are x for y on the sheets of usual papers; note it if the lengths beside them were given."""
    printed = []
    for paper in (None, "A4", "Letter"):
        with suppress(InputError):
            x, y = sheet_for(marker.as_designed, paper).rulers_mm
            printed.append((x / 1e3, y / 1e3))
    if not force and (rulers.nominal_x is None or rulers.nominal_y is None):
        check_not_exchanged(rulers, printed)
    swapped = exchanged(rulers, printed)
    if swapped is None:
        return ()
    x_words, y_words = map(format_length, swapped)
    return (f"On usual paper the rulers are x {x_words} and y {y_words}: see that x and y are not exchanged.",)


def _others(texts: Sequence[str], rulers: Rulers) -> dict[str, Rulers]:
    """Return rulers of single markers from texts such as ``+x=198.6mm,199.1mm``."""
    by_name = dict[str, Rulers]()
    for text in texts:
        name, equals, lengths = text.rpartition("=")
        measured = [parse_length(length, "also") for length in lengths.split(",")]
        if not (name and equals and len(measured) <= 2) or name in by_name:
            raise InputError("a marker once, with one or two lengths", brief(text), "write '+x=198.6mm,199.1mm'")
        by_name[name] = Rulers(measured[0], measured[1] if measured[1:] else None, rulers.nominal_x, rulers.nominal_y)
    return by_name
