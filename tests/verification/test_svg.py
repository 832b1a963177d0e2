"""Colors of an SVG are read as a browser reads them, in whichever form they are written."""

import re

import pytest
from PIL import ImageColor

from markergen.errors import InputError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.read.outlines.formats import OutlineFile
from markergen.verification import verify
from markergen.verification.svg import plain

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="9mm" height="9mm">{}</svg>'

# From the examples of CSS Color 4, or the same color by hand.
COLORS = {
    "#369": "#369",
    "rgb(20%, 40%, 60%)": "#336699",
    "RGB(51 102 153 / 1)": "#336699",
    "rgb(51 40% 153/100%)": "#336699",
    "rgba(51.2,101.8,153,1)": "#336699",
    "hsl(210, 50%, 40%)": "#336699",
    "hsla(210deg 50% 40% / 1)": "#336699",
    "hsl(-150 50 40)": "#336699",
    "hsl(233.33333grad 50% 40%)": "#336699",
    "hsl(0.5833333turn,50%,40%)": "#336699",
    "hsl(3.6651914rad 50% 40%)": "#336699",
    "hwb(210 20% 40%)": "#336699",
    "rgb(none 102 153)": "#006699",
    "rgb(510 -5 0)": "#ff0000",
    "rgb(51 102 153 / 50%)": "#33669980",
    "RebeccaPurple": "#663399",
    "currentcolor": "currentColor",
    "unset": "inherit",
    "transparent": "none",
    "rgb(0 0 0 / 0)": "none",
    "url(#a) red": "url(#a) #ff0000",
}
STRANGE = [
    "rgb(1 2, 3)", "rgb(1, 2%, 3)", "rgb(1 2 3 4)", "rgb(1, 2)", "rgb(none, 1, 2)", "hsl(1, 2, 3)", "hsl(1% 2% 3%)",
    "hwb(1, 2%, 3%)", "oklch(50% 0.1 250)", "color(srgb 0 0 0)", "Canvas", "nonsense", "var(--a)", "\\77hite",
]  # fmt: skip


def rewritten(content):
    return plain(OutlineFile("a.svg", SVG.format(content).encode())).data.decode()


@pytest.mark.parametrize("form", COLORS)
def test_a_color_is_the_same_in_every_form_and_place(form):
    text = f'<style>.a {{ fill: {form} }}</style><g fill="{form}" style="r:0;fill:{form} !important"/>'
    data = rewritten(text.replace("r:0;", "opacity:1;"))
    assert re.findall(r'fill(?:=|: ?)"?([^"}!]*?)\s*(?:["}!])', data) == [COLORS[form]] * 3


def test_names_are_those_of_css():
    for name in ImageColor.colormap:
        (color,) = re.findall('fill="([^"]*)"', rewritten(f'<g fill="{name.title()}"/>'))
        assert ImageColor.getrgb(color) == ImageColor.getrgb(name)


@pytest.mark.parametrize("form", STRANGE)
def test_forms_that_programs_draw_differently_are_refused(form):
    for text in (f'<g fill="{form}"/>', f'<g style="stroke:{form}"/>', f"<style>g {{ color: {form} }}</style>"):
        with pytest.raises(InputError, match="alike"):
            rewritten(text)


@pytest.mark.parametrize("value", ["difference", "multiply", "screen"])
def test_inks_that_only_browsers_blend_are_refused(value):
    for text in ("<g style='mix-blend-mode:{}'/>", "<style>g {{ mix-blend-mode: {} }}</style>"):
        with pytest.raises(InputError, match="alike"):
            rewritten(text.format(value))
        assert "normal" in rewritten(text.format("normal") + "<g style='isolation:auto'/>")


def test_variables_of_the_drawing_and_rules_for_all_media_are_followed():
    data = rewritten(
        "<style>:root { --ink: hsl(0 0% 0%); --unused: 1px } "
        "@media screen, print { .a { fill: var(--ink) } } .b { fill: var(--none, rgb(1 2 3)) }</style>"
        '<g stroke="var(--ink)"/>'
    )
    assert "--" not in data
    assert re.findall(r"fill: ([^ }]+)", data) == ["#000000", "#010203"]
    assert 'stroke="#000000"' in data


@pytest.mark.parametrize(
    "text",
    [
        "<style>:root { --a: red } g { --a: blue; fill: var(--a) }</style>",
        "<style>:root { --a: red } g { fill: var(--a) }</style><g style='--a: blue'/>",
        "<style>g { --a: red; fill: var(--a) }</style>",
        "<style>@media print { g { fill: red } }</style>",
        "<style>@media all { @media print { g { fill: red } } }</style>",
    ],
)
def test_variables_of_several_values_and_rules_for_some_media_are_refused(text):
    with pytest.raises(InputError, match="alike"):
        rewritten(text)


@pytest.fixture(scope="module")
def sheet(markers, tmp_path_factory):
    path = tmp_path_factory.mktemp("sheet") / "a.svg"
    save(markers["5 skew"], [path], ExportOptions())
    return path.read_text()


def with_dots(text, colors):
    """Give each dot a color of its own."""
    colors = iter(colors)
    return re.sub(r'(<circle id="dot-\d"[^>]*fill=")[^"]*', lambda match: match[1] + next(colors), text)


def test_a_sheet_passes_with_black_in_any_form_and_white_in_any_form_is_named(markers, sheet, tmp_path):
    black = ["hsl(120deg 100% 0%)", "rgb(0% 0 0 / 1)", "var(--ink)", "hwb(0 0% 100%)", "rgba(0,0,0,100%)"]
    white = ["rgb(255 255 255 / 1)", "hsl(0deg 0% 100%)", "var(--paper)", "hwb(0 100% 0%)", "rgb(100% 100% 100%)"]
    style = "<style>:root { --ink: black; --paper: white }</style><title"
    sheet = sheet.replace("<title", style, 1)
    path = tmp_path / "a.svg"
    path.write_text(with_dots(sheet, black))
    assert verify(markers["5 skew"], path).passed
    path.write_text(with_dots(sheet, [*black[:3], *white[3:]]))
    assert [finding.kind for finding in verify(markers["5 skew"], path).findings] == ["pale"]
    path.write_text(with_dots(sheet, white))
    assert not verify(markers["5 skew"], path).passed


@pytest.mark.parametrize(
    ("unit", "per_mm"),
    [("in", 1 / 25.4), *(pytest.param(*unit, marks=pytest.mark.long) for unit in [("pt", 72 / 25.4), ("cm", 0.1)])],
)
def test_the_size_of_a_page_may_have_any_unit_of_length(markers, sheet, tmp_path, unit, per_mm):
    def sized(match):
        return f'{match[1]}="{float(match[2]) * per_mm:.9g}{unit}"'

    text = re.sub(r'\b(width|height)="([\d.]+)mm"', sized, sheet)
    assert text != sheet
    (tmp_path / "a.svg").write_text(text)
    check = verify(markers["5 skew"], tmp_path / "a.svg")
    assert check.passed, check.findings
    assert check.pages[0] == pytest.approx(verify(markers["5 skew"], sheet_file(tmp_path, sheet)).pages[0], abs=1e-3)


def sheet_file(folder, text):
    (folder / "b.svg").write_text(text)
    return folder / "b.svg"
