"""Sheets: markers at true size on paper, with what a person needs to check, mount and read them."""

from collections.abc import Sequence
from math import ceil, inf

from markergen.drawing.figure import Figure, drawn_box, size_words
from markergen.drawing.furniture import Frame
from markergen.drawing.grid import grid_pages
from markergen.drawing.options import SheetOptions
from markergen.drawing.page import Reach, Sheet, needs, origin_on, reach_of, single
from markergen.drawing.paper import ISO, PAPERS, Paper, find_paper, oriented
from markergen.drawing.scene import Point
from markergen.drawing.tiles import tiled
from markergen.errors import InputError
from markergen.model.boundary import Boundary
from markergen.model.marker import Marker

__all__ = ["Sheet", "SheetOptions", "check_paper", "pages_for", "sheet_for"]


def sheet_for(marker: Marker, paper: str | None = None) -> Sheet:
    """Lay a marker out on one page, at true size; see `pages_for`."""
    return pages_for([marker], SheetOptions(paper, tile=False))[0]


def pages_for(markers: Sequence[Marker], options: SheetOptions) -> tuple[Sheet, ...]:
    """Lay markers out on pages, at true size, never smaller.

    One marker gets one page, or, if it is larger than the paper, a plan of assembly and a page for every tile. Several
    share pages, as many on each as fit; without a paper named, on the smallest from A4 on that holds one of them.

    Parameters
    ----------
    markers : sequence of Marker
        At least one.
    options : SheetOptions

    Raises
    ------
    InputError
        If a control point has no dot or lies off the plane, the paper is unknown or its margins leave nothing, or a
        marker does not fit on it and may not be tiled.
    """
    figures = [_figure(marker, options) for marker in markers]
    if len(figures) > 1:
        pages = grid_pages(figures, options, _frames(options, ISO[1:]))
        if pages:
            return pages
    return tuple(page for figure in figures for page in _pages(figure, options))


def check_paper(boundary: Boundary, options: SheetOptions) -> None:
    """Refuse a boundary that the paper is too small for, whatever dots come to lie in it; see `pages_for`."""
    box = drawn_box(boundary)
    reach = reach_of(box, (inf, inf, -inf, -inf), options.colors)
    if not _whole(reach, _frames(options)) and not options.tile:
        raise _too_small(reach, size_words(boundary), options)


def _figure(marker: Marker, options: SheetOptions) -> Figure:
    """What is drawn: the marker as designed, whatever was measured on a print; larger where the printer shrinks."""
    sx, sy = marker.print_scale
    if not options.compensate:
        return Figure(marker.as_designed, ink=options.colors.ink)
    if sx == sy == 1:
        raise InputError(
            "a marker that was measured on a print, to compensate for its printer",
            "a print scale of 1",
            "run markergen rescale with --measured-x and --measured-y first",
        )
    return Figure(marker.as_designed, (1 / sx, 1 / sy), options.colors.ink)


def _pages(figure: Figure, options: SheetOptions) -> tuple[Sheet, ...]:
    reach = reach_of(figure.outline, figure.quiet, options.colors)
    found = _whole(reach, _frames(options))
    if found:
        return (single(figure, options, *found),)
    if not options.tile:
        raise _too_small(reach, size_words(figure.marker.boundary), options)
    return tiled(figure, options, _frames(options, ISO[-1:]))


def _frames(options: SheetOptions, sizes: Sequence[Paper] = ISO) -> list[Frame]:
    """Pages to try in this order: the named paper, both ways round if nothing says which, else each of the sizes so."""
    if options.paper is not None:
        paper = find_paper(options.paper, options.orientation)
        fixed = options.orientation or oriented(options.paper)
        return [options.frame(each) for each in ((paper,) if fixed else (paper, paper.turned))]
    if options.orientation:
        return options.frames([find_paper(size.name, options.orientation) for size in sizes])
    return options.frames(_both_ways(sizes))


def _whole(reach: Reach, frames: Sequence[Frame]) -> tuple[Frame, Point] | None:
    """The first page that holds a marker, and where on it the origin goes."""
    for frame in frames:
        origin = origin_on(frame, reach)
        if origin:
            return frame, origin
    return None


def _too_small(reach: Reach, size: str, options: SheetOptions) -> InputError:
    frame = _frames(options)[0] if options.paper else options.frame(ISO[-1])
    left, down, right, up = needs(frame, reach)
    room = f"{ceil(left + right)} x {ceil(down + up)} mm"
    fit = _whole(reach, options.frames([*_both_ways(ISO), *PAPERS.values()]))
    tile = ", or leave out --no-tile" if fit else "leave out --no-tile, design a smaller one, or export it as .step"
    if options.paper is None:
        found = f"a marker {size} that needs {room}"
        return InputError(
            "a marker that A0 paper holds", found, f"use --paper {fit[0].paper.name}{tile}" if fit else tile
        )
    return InputError(
        f"paper of at least {room} for a marker {size}",
        str(frame.paper),
        f"use --paper {fit[0].paper.name}{tile}" if fit else f"no known paper holds it: {tile}",
    )


def _both_ways(sizes: Sequence[Paper]) -> list[Paper]:
    return [each for size in sizes for each in (size, size.landscape)]
