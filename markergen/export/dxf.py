"""DXF R2010 in millimeters: the marker itself, without paper, for cutters, engravers and CAD."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import StringIO
from typing import Any

import numpy as np

import markergen
from markergen.drawing.scene import Disk, marker_dots, marker_name
from markergen.export import EXPORTERS, ExportOptions, Output, only, without_paper
from markergen.model.marker import Marker

CUT, ENGRAVE, INFO = "CUT", "ENGRAVE", "INFO"
LAYERS = {
    CUT: (1, "the outline and the keep-outs, to be cut"),
    ENGRAVE: (7, "outlines of the dots and the tag, to be filled black"),
    INFO: (5, "axes, numbers of the dots and words, not to be made"),
}
"""Color index (red, black, blue) and meaning of each layer."""

NUMBER = 0.4
"""Height of a dot's number in radii: it stands inside the dot."""


@EXPORTERS.register(".dxf")
def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Outlines of the marker as DXF (R2010, mm), to cut and engrave."""
    marker = only(markers, ".dxf")
    notes = (
        "DXF units are mm; the origin is the marker's, x right and y up.",
        *(f"Layer {name} has {meaning}." for name, (_, meaning) in LAYERS.items()),
        *without_paper(options),
    )
    return Output(write_dxf(marker), notes)


def write_dxf(marker: Marker) -> bytes:
    """Write a marker as DXF: every circle exact, every other outline a closed polyline; the same bytes every time."""
    from ezdxf import units
    from ezdxf.filemanagement import new

    # The scene knows what a dot is; a marker that was measured is made again as it was designed.
    designed = marker.as_designed
    dots = marker_dots(designed)
    with _without_time():
        document = new("R2010", units=units.MM)
        for name, (color, meaning) in LAYERS.items():
            document.layers.add(name, color=color).description = meaning
        space = document.modelspace()
        for outline in (designed.boundary, *designed.keep_outs):
            rings, circles = outline.curves()
            for ring in rings:
                space.add_lwpolyline(_mm(ring), close=True, dxfattribs={"layer": CUT})
            for x, y, radius, _ in _mm(circles[:, :4]):
                space.add_circle((x, y), radius, dxfattribs={"layer": CUT})
        for dot in dots:
            for radius in filter(None, (dot.radius, dot.inner_radius)):
                space.add_circle((dot.x, dot.y), radius, dxfattribs={"layer": ENGRAVE})
        for ring in designed.tag.outlines if designed.tag else ():
            space.add_lwpolyline(_mm(ring), close=True, dxfattribs={"layer": ENGRAVE})
        _inform(space, designed, dots)
        # ezdxf would add these in the order of a set, which is another in every process.
        for kind in sorted(document.entitydb.dxf_types_in_use()):
            document.classes.add_class(kind)
        stream = StringIO()
        document.write(stream)
        return document.encode(stream.getvalue())


def _inform(space: Any, marker: Marker, dots: Sequence[Disk]) -> None:
    """Add the axes, each dot's number inside of it, and below the outline which marker this is."""
    from ezdxf.enums import TextEntityAlignment

    def write(words: str, x: float, y: float, height: float, align: Any) -> None:
        space.add_text(words, height=height, dxfattribs={"layer": INFO}).set_placement((x, y), align=align)

    box = _mm(np.concatenate(marker.boundary.outlines()))
    (left, bottom), (right, _) = box.min(axis=0).tolist(), box.max(axis=0).tolist()
    size = max(right - left, 1.0) / 50
    arm = 4 * size
    for name, tip, at in (("x", (arm, 0.0), (1.2 * arm, 0.0)), ("y", (0.0, arm), (0.0, 1.2 * arm))):
        space.add_line((0, 0), tip, dxfattribs={"layer": INFO})
        write(name, at[0], at[1], size, TextEntityAlignment.MIDDLE_CENTER)
    for dot in dots:
        number = dot.name.removeprefix("dot-")
        write(number, dot.x, dot.y, NUMBER * dot.radius, TextEntityAlignment.MIDDLE_CENTER)
    words = f"{marker_name(marker)}, {len(marker)} dots, millimeters, made with markergen {markergen.__version__}"
    write(words, left, bottom - 2 * size, size * min(1.0, 60 / len(words)), TextEntityAlignment.LEFT)


def _mm(meters: Any) -> Any:
    # Whole picometers, so that 0.0036 m reads 3.6 and not 3.5999999999999996.
    return np.round(np.asarray(meters) * 1e3, 9)


@contextmanager
def _without_time() -> Iterator[None]:
    """Let ezdxf write fixed dates and identifiers instead of the present time and random ones."""
    import ezdxf

    options = vars(ezdxf)["options"]
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before
