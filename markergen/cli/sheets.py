"""Options of sheets and pictures that ``design`` and ``export`` share."""

from typing import TYPE_CHECKING, Annotated

import typer

from markergen.cli.console import length

if TYPE_CHECKING:
    from markergen.export import ExportOptions

Paper = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|WxH",
        help="A0..A5, letter, legal, tabloid, or a size such as 300x400mm. [default: the smallest ISO size that "
        "holds it]",
    ),
]
Orientation = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="portrait or landscape. [default: portrait unless only landscape holds it]"),
]
Margin = Annotated[
    float | None,
    typer.Option(
        parser=length, metavar="LENGTH", help="Edge that the printer leaves white. [default: 10 to 24 mm, by the paper]"
    ),
]
Tile = Annotated[
    bool, typer.Option("--tile/--no-tile", help="Spread what is larger than the paper over several sheets.")
]
Overlap = Annotated[
    float | None,
    typer.Option(parser=length, metavar="LENGTH", help="What neighboring sheets both print. [default: 10mm]"),
]
Dpi = Annotated[int, typer.Option(metavar="N", help="Of a .png, pixels per inch.")]
ColorsText = Annotated[
    str | None,
    typer.Option(
        "--colors",
        metavar="NAME|INK,PAPER",
        help="black, inverted, or two as #rrggbb,#rrggbb; after it ,cut:NAME for a spot color of the lines to cut, "
        "such as black,cut:CutContour. [default: black]",
    ),
]
Compensate = Annotated[
    bool,
    typer.Option("--compensate", help="Draw a rescaled marker so that the printer that was measured makes it true."),
]


def export_options(
    paper: str | None,
    orientation: str | None,
    margin: float | None,
    tile: bool,
    overlap: float | None,
    dpi: int,
    colors: str | None,
    compensate: bool,
) -> "ExportOptions":
    """Collect what was asked for; raises `InputError` for what there is not."""
    from markergen.drawing.colors import BLACK_ON_WHITE, parse_colors
    from markergen.drawing.options import SheetOptions
    from markergen.export import ExportOptions

    sheet = SheetOptions(
        paper=paper,
        orientation=orientation or "",  # type: ignore[arg-type]  # refused there unless it is one of them
        margin=margin,
        tile=tile,
        overlap=0.010 if overlap is None else overlap,
        compensate=compensate,
        colors=BLACK_ON_WHITE if colors is None else parse_colors(colors),
    )
    return ExportOptions(sheet, dpi)
