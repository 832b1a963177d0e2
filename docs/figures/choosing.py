"""What number, room, dots, print and relief do to the pose: figures and tables of docs/choosing.md."""

import re
from functools import cache
from typing import Any, NamedTuple

import markergen as mg
from docs.figures import Save, drawing, lines, table
from markergen.model.picture import svg

NUMBERS = 4, 5, 6, 8, 12, 16, 24, 40
DIAMETERS_MM = 100, 150, 200, 300, 400
DOTS_MM = 10, 14, 20, 28, 36, 50, 70
PRINTS_MM = 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5
HEIGHTS_MM = 0, 10, 20, 30, 50

FORMS: dict[str, dict[str, Any]] = {
    "five dots": {"n": 5},
    "no ring": {"n": 6, "asymmetric": 3},
    "with a tag": {"n": 6, "tag": "aruco:DICT_4X4_50:7"},
    "many": {"n": 40},
    "near and far": {"template": "landing-pad"},
    "a plate": {"n": 8, "boundary": "rect:0.2x0.1", "keep_out": ["circle:30mm"]},
}
"""Designs that are shown, with what is asked for."""


class Case(NamedTuple):
    """RMS errors of a design over the paper's 400 poses, flips included, and where they come from."""

    rotation_deg: float
    translation_mm: float
    hardest_deg: float
    image_deg: float
    print_deg: float
    calibrated_deg: float
    """With the calibration that `validate` warns of: 2 px off in fx and fy, 1.5 px in the principal point."""
    least_px: float
    dot_mm: float


@cache
def case(print_mm: float = 0.1, **asked: Any) -> Case:
    """Errors of the design that is asked for."""
    marker = designed(**asked)
    validation = mg.validate(marker, runs=0, views=0, print_sigma=print_mm / 1000)
    over_all, budget = validation.headline["all"], validation.results["budget"]["rotation_deg"]
    return Case(
        over_all["rotation_deg"],
        over_all["translation_mm"],
        validation.headline["rotation_deg"],
        budget["image"],
        budget["print"],
        validation.headline["calibration"]["rotation_deg"],
        validation.results["dots"]["least_px"],
        1e3 * marker.dot_diameter,
    )


@cache
def designed(**asked: Any) -> mg.Marker:
    """Marker of a search from two random starts besides the regular ones."""
    return mg.design(restarts=2, **asked).marker


def make(save: Save) -> None:
    """Print the page's tables, and save its figures."""
    save("choosing-forms", forms())
    _number(save)
    _room(save)
    _dots(save)
    _print(save)
    _relief()


def forms() -> str:
    """Return a picture of the designs of `FORMS`, each in its own scale, on paper."""
    parts = []
    for k, (name, asked) in enumerate(FORMS.items()):
        picture = re.sub(r"(\.\d)\d+", r"\1", svg(mg.design(**asked).marker))
        picture = re.sub(r'd="([^"]*)Z"', _thinned, picture)
        x, y = 10 + 180 * (k % 3), 10 + 200 * (k // 3)
        place = f'x="{x}" y="{y + 20}" width="160" height="165"'
        picture = re.sub(r'width="[^"]*" height="[^"]*"', place, picture, count=1)
        parts.append(f'{picture}<text x="{x + 80}" y="{y + 10}">{name}</text>')
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 540 410" font-size="13" '
        'font-family="system-ui,sans-serif" text-anchor="middle" fill="#1a1a1a">'
        f'<rect width="540" height="410" fill="#fff"/>{"".join(parts)}</svg>\n'
    )


def _thinned(path: re.Match[str]) -> str:
    """Return an outline of many points with a fourth of them."""
    points = path[1].split("L")
    return f'd="{"L".join(points[::4] if len(points) > 100 and path[1].count("M") == 1 else points)}Z"'


def _number(save: Save) -> None:
    exact, good, usual = ([case(print_mm, n=n) for n in NUMBERS] for print_mm in (0.0, 0.02, 0.1))
    columns = {
        "exact print": [item.rotation_deg for item in exact],
        "print 0.02 mm": [item.rotation_deg for item in good],
        "print 0.1 mm": [item.rotation_deg for item in usual],
        "print 0.1 mm, calibration off by 2 px": [item.calibrated_deg for item in usual],
    }
    _table("Number of dots", {"dots": NUMBERS, **columns})
    named = [(name, NUMBERS, values) for name, values in reversed(columns.items())]
    save("choosing-number", drawing(lambda ax: lines(ax, named, ("dots", "rotation error, RMS, deg"))))


def _room(save: Save) -> None:
    cases = {n: [case(n=n, radius=d / 2000) for d in DIAMETERS_MM] for n in (5, 12)}
    columns: dict[str, Any] = {"marker, mm": DIAMETERS_MM}
    for n, row in cases.items():
        columns[f"{n} dots of, mm"] = [item.dot_mm for item in row]
        columns[f"{n} dots: rotation, deg"] = [item.rotation_deg for item in row]
        columns[f"{n} dots: position, mm"] = [item.translation_mm for item in row]
    _table("Room", columns)
    named = [(f"{n} dots", DIAMETERS_MM, columns[f"{n} dots: rotation, deg"]) for n in cases]
    labels = "diameter of the marker, mm", "rotation error, RMS, deg"
    save("choosing-room", drawing(lambda ax: lines(ax, named, labels)))


def _dots(save: Save) -> None:
    cases = [case(n=5, dot=d / 1000) for d in DOTS_MM]
    columns = {
        "image and print, deg": [item.rotation_deg for item in cases],
        "print alone, deg": [item.print_deg for item in cases],
        "image alone, deg": [item.image_deg for item in cases],
    }
    _table("Size of dots", {"dot, mm": DOTS_MM, "smallest image, px": [item.least_px for item in cases], **columns})
    named = [(name.removesuffix(", deg"), DOTS_MM, values) for name, values in columns.items()]
    labels = "diameter of a dot, mm", "rotation error, RMS, deg"
    save("choosing-dots", drawing(lambda ax: lines(ax, named, labels)))


def _print(save: Save) -> None:
    columns = {f"{n} dots": [case(p, n=n).rotation_deg for p in PRINTS_MM] for n in (5, 24)}
    _table("Print", {"print error, mm": PRINTS_MM, **{f"{name}, deg": values for name, values in columns.items()}})
    named = [(name, PRINTS_MM, values) for name, values in columns.items()]
    labels = "print error along each axis, mm", "rotation error, RMS, deg"
    save("choosing-print", drawing(lambda ax: lines(ax, named, labels)))


def _relief() -> None:
    cases = [case(0.02, n=6, dot=0.03, relief=h / 1000, objective="rotation") for h in HEIGHTS_MM]
    over_all, hardest = ([item[k] for item in cases] for k in (0, 2))
    _table("Relief", {"relief, mm": HEIGHTS_MM, "rotation, deg": over_all, "hardest case, deg": hardest})


def _table(title: str, columns: dict[str, Any]) -> None:
    rows = zip(*columns.values(), strict=True)
    table(title, list(columns), [[f"{value:.3g}" for value in row] for row in rows])
