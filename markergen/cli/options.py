"""Declared options as those of a command: parsers, types, and help by group."""
# tests: tests/cli/test_help.py

import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, Signature, signature
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from markergen.api.names import names_of, takes_names
from markergen.cli import console
from markergen.errors import InputError
from markergen.options import VIEW, Option, as_list, declared, guess
from markergen.options.kinds import KINDS, Kind
from markergen.units import METERS

Rows = list[tuple[str, str]]
Json = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as JSON; - is standard output.")
]
Details = Annotated[bool, typer.Option("--details", help="Print all tables and notes, instead of a few lines.")]
Refine = Annotated[str | None, typer.Option(hidden=True, callback=console.ignored, metavar="NAME")]
MarkerFile = Annotated[
    Path, typer.Argument(metavar="MARKER.JSON", help="As written by markergen design; or a rig.json.")
]
Report = Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write everything as one HTML page.")]


def calibration_file(default: str) -> Any:
    """Return the option of a camera's file, with what it is without one."""
    help = f"Calibration: OpenCV, ROS camera_info, Kalibr or COLMAP. [default: {default}]"
    return typer.Option(metavar="FILE", help=help, rich_help_panel=VIEW)


def output_files(help: str) -> Any:
    """Return the option of files to write."""
    return typer.Option("-o", "--output", metavar="PATH", help=help)


def parser_of(kind: Kind) -> Callable[[str], Any] | None:
    """Return the parser of a kind that typer cannot read itself, whose errors name the option; else None."""
    if kind.parse is None:
        return None

    def parse(text: str) -> Any:
        try:
            return kind.parse(text) if kind.parse else text
        except InputError as error:
            raise typer.BadParameter(str(error)) from None

    parse.__name__ = kind.parse.__name__
    return parse


class Help:
    """Whether help lists every option, ``--help-all``, instead of those of a command that are needed most."""

    whole = False


def with_options(
    table: type, listed: Mapping[str, Callable[[], Rows]] | None = None, first: str = ""
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command so that its ``**options`` are those of a table; options not given are not passed on.

    Parameters
    ----------
    table : type
        One of `markergen.options.declarations`.
    listed : mapping of title to callable, optional
        Two-column rows to show in help under each title, created on demand.
    first : str
        Options that ``--help`` lists, separated by spaces; all by default.
    """

    def decorate(body: Callable[..., None]) -> Callable[..., None]:
        parameters = [
            parameter
            for parameter in signature(body).parameters.values()
            if parameter.kind is not Parameter.VAR_KEYWORD
        ]
        named = {parameter.name for parameter in parameters}
        more = [_parameter(option) for name, option in declared(table).items() if name not in named]

        @wraps(body)
        def command(**arguments: Any) -> None:
            # A repeatable option that is not given is None in some versions of typer and empty in others.
            body(**{name: value for name, value in arguments.items() if name in named or value not in (None, [])})

        command.__signature__ = Signature([*parameters, *more])  # type: ignore[attr-defined]
        command.__dict__.update(listed=listed, first=first.split())
        command.__annotations__ = {parameter.name: parameter.annotation for parameter in (*parameters, *more)}
        return command

    return decorate


def _parameter(option: Option) -> Parameter:
    kind = KINDS[option.kind]
    info = typer.Option(
        *(option.flags.split() or [option.flag]),
        parser=parser_of(kind),
        metavar=option.metavar or None,
        help=f"{option.help} [default: {option.shown}]" if option.shown else option.help,
        rich_help_panel=option.group,
        autocompletion=(lambda: names_of(option.name)) if takes_names(option) else None,
    )
    return Parameter(option.name, Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind.typed | None, info])


class GroupedCommand(TyperCommand):
    """A command whose help lists its options by their declared groups, then its own options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words; where one is the option of another tool, say what stands for it here."""
        arguments = tuple(args)  # click empties the list
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter.__base__ as error:  # type: ignore[misc]
            name = getattr(error, "option_name", "").lstrip("-")
            names = {str(param.name) for param in self.get_params(ctx)}
            lacking = getattr(getattr(error, "param", None), "name", None)
            spec = next((word for word in arguments if word.endswith(".toml") and f"({word})" in error.message), None)
            body = next((word for word in arguments if word.endswith(".json")), "marker.json")
            # The shell splits "50 mm".
            pairs = (pair for pair in pairwise(arguments) if pair[1] in METERS)
            length = next((pair for pair in pairs if f"({pair[1]})" in error.message), None)
            if spec and "template" in names:
                answer = f"a spec goes with --template {spec}"
            elif length:
                answer = f"write {''.join(length)}, without a space"
            elif lacking == "marker" and "images" in names:
                error.message, answer = f"Write --marker {body}", ""
            elif name == "marker" and name in names:
                answer = f"{body} comes first, without --marker"
            else:
                answer = guess(name, names)
            if answer:
                error.possibilities, error.message = None, f"{error.message.rstrip('.')}; {answer}"
            elif possibilities := getattr(error, "possibilities", None):
                # The dashes that all options share made short ones look alike.
                named = {flag.lstrip("-"): flag for flag in possibilities}
                error.possibilities = [
                    named[option] for option in get_close_matches(error.option_name.lstrip("-"), named, cutoff=0.7)
                ]
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run the command; where another file stands in the place of the marker, say that the marker comes first."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            expected, problem, _ = error.args
            names = [param.name for param in self.params if param.param_type_name == "argument"]
            others = (str(value) for name in names[1:] for value in as_list(ctx.params[name]))
            body = next((value for value in others if value.endswith(".json")), "")
            place = str(ctx.params.get("marker"))
            if names[:1] != ["marker"] or not body or place.endswith(".json") or not expected.endswith(f" {place}"):
                raise
            remedy = f"the marker comes first: {ctx.command_path} {body} {place}"
            raise InputError(expected, problem, remedy) from None

    def get_short_help_str(self, limit: int = 45) -> str:
        """Return the first clause of the help whole; at the limit, most would end in the middle of one."""
        del limit
        paragraph = " ".join((self.help or "").partition("\n\n")[0].split())
        return re.split(r"[:;.](?: |$)", paragraph)[0] + "."

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then each group of options."""
        groups: dict[str, Rows] = {}
        other_options = []
        first = () if Help.whole else getattr(self.callback, "first", ())
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if first and param.param_type_name != "argument" and param.name not in first:
                continue
            group = getattr(param, "rich_help_panel", None)
            if record is None:
                continue
            if param.param_type_name == "argument":
                groups.setdefault("Arguments", []).append(record)
            elif group:
                groups.setdefault(group, []).append(record)
            else:
                other_options.append(record)
        listed = getattr(self.callback, "listed", None) or {}
        groups = {**{title: rows() for title, rows in listed.items()}, **groups}
        if first:
            other_options.append(("--help-all", f"Show all {len(self.params)} options."))
        for title, records in {**groups, "Options": other_options}.items():
            with formatter.section(title):
                formatter.write_dl(records)


def rig_suffixes() -> Rows:
    """Rows of help: the suffixes that a rig is written to, and what for."""
    from markergen.exporters import catalog

    return [(" ".join(suffixes), purpose) for suffixes, purpose in catalog("rig")]
