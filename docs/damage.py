"""The table of damage that verify names: how many kinds of damage the tests try, by what is wrong and by format.

Each entry of the tables in `tests/verification` and `tests/support/damaged_sheets.py` is damage to a good file. Its
test fails unless the file is refused, and for that.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

FORMATS = (
    ("SVG", (".svg",)),
    ("PDF", (".pdf",)),
    ("PNG", (".png",)),
    ("DXF", (".dxf",)),
    ("STEP", (".step",)),
    ("STL", (".stl",)),
    ("3MF", (".3mf",)),
    ("GLB", (".glb",)),
    ("lists", (".csv", ".json", ".detector.json", ".opencv.yaml", ".ros2.yaml", ".kalibr.yaml", ".apriltag.yaml")),
    ("models", (".urdf", ".sdf", ".mjcf.xml")),
)

WRONG = {
    "dots displaced, missing, or of another size, kind or height": "shifted missing diameter kind height thickness",
    "dots that do not show, or with ink around them": "pale covered quiet hidden",
    "light and dark, colors, materials": "inverted color looks",
    "outline, holes, layers": "outline hole layer",
    "the tag": "tag",
    "rulers, axes, numbers": "marks",
    "things that are not the marker's, or there twice": "extra twice",
    "scaled, sheared, mirrored, turned": "scaled sheared mirrored turned",
    "parts, names, surfaces": "part solid",
    "values of a list or a model": "value",
}
"""Kinds of findings by what is wrong; `looks` stands for other colors and materials of a GLB or 3MF."""

ON_EVERY_SHEET = ["mirrored", "missing", "shifted", "diameter", "kind", "extra", "tag", "tag", "tag"]
"""What `tests/verification/test_check.py` does to the sheets of all formats, beside scaling them."""

TEXT = """# Damage that is named

Each number is that of different kinds of damage to a good file of which [`verify`](print.md#is-the-file-right) reports
what is wrong; none of these passes. `make docs` counts them in the tests, which try each one: a test fails if a file
passes or, but for materials of a GLB or 3MF, if something else is reported.

"""


def damages() -> Iterator[tuple[str, str]]:
    """Format and kind of finding of each damage that the tests try."""
    from damaged_sheets import DAMAGE

    from tests.verification import test_check, test_claims, test_made, test_printed, test_remade

    everywhere = ["scaled"] * len(test_check.SCALES) + ON_EVERY_SHEET
    yield from ((suffix, kind) for suffix in test_check.SUFFIXES for kind in everywhere)
    yield from ((suffix, kind) for suffix, table in DAMAGE.items() for _, kind, _ in table.values())
    yield from ((suffix, test_made.DAMAGES[name].kind) for name, suffix in test_made.CASES)
    yield from ((".dxf", kind) for _, kind in test_claims.ENTITIES.values())
    yield from ((".stl", "extra") for _ in test_claims.BODIES)
    yield from ((".svg", "twice") for _ in test_claims.AGAIN)
    yield from ((".glb", "looks") for _ in test_claims.GLTF)
    yield from ((".3mf", "looks") for _ in test_claims.PRINTED)
    yield from ((".svg", "marks") for _ in test_printed.CHANGES)
    yield from ((".svg", "extra") for _ in test_printed.INSIDE)
    yield from ((suffix, (kinds or "value").split()[0]) for suffix, _, _, kinds in test_remade.DAMAGES)


def page_of_damage() -> str:
    """Return the page with the table."""
    column = {suffix: name for name, suffixes in FORMATS for suffix in suffixes}
    row = {kind: what for what, kinds in WRONG.items() for kind in kinds.split()}
    count = Counter((row[kind], column[suffix]) for suffix, kind in damages())
    names = [name for name, _ in FORMATS]
    lines = [["what is wrong", *names], ["---"] * (len(names) + 1)]
    lines += [[what, *(str(count[what, name] or "") for name in names)] for what in WRONG]
    lines.append(["tried and named", *(str(sum(count[what, name] for what in WRONG)) for name in names)])
    total = sum(count.values())
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return f"{TEXT}{table}\n\nTogether {total} kinds of damage, all of them named.\n"
