import re
from pathlib import Path

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.presentation import plots
from markergen.presentation.plots import axes_of


def test_axes_are_those_given_or_of_a_new_figure():
    from matplotlib.figure import Figure

    ours = axes_of(None, (3, 2))
    assert ours.figure.get_size_inches().tolist() == [3, 2]
    first, second = Figure().subplots(2)
    assert axes_of(second) is second is not first


@pytest.mark.parametrize("several", [True, False])
def test_what_is_no_axes_is_one_line(several):
    from matplotlib.figure import Figure

    figure = Figure()
    for other in (figure.subplots(2), np.array(3)) if several else (figure, 3, "ax"):
        with pytest.raises(InputError, match=r"axes of matplotlib, found ax=.*") as caught:
            axes_of(other)
        assert "\n" not in str(caught.value)


def drawn(ax):
    ax.plot([1, 10, 100], [3, 1, 2], label="<a & b> $x")
    plots.log_axis(ax, "x")
    plots.legend_below(ax)


def test_the_same_drawing_gives_the_same_bytes_whatever_the_settings_of_matplotlib(tmp_path):
    import matplotlib

    def pictures():
        def figure():
            made = plots.new_figure()
            drawn(made.add_subplot())
            return made

        yield plots.svg_bytes(lambda made: drawn(made.subplots()), (4, 3))
        yield plots.plot(drawn, "name", 'alt "text"', "caption").markup
        yield plots.figure_bytes(figure, tmp_path / "plot.svg")
        yield plots.figure_bytes(figure, tmp_path / "plot.PNG")

    ours = list(pictures())
    with matplotlib.rc_context({"font.size": 20, "svg.hashsalt": "other", "axes.grid": False, "text.parse_math": True}):
        before = dict(matplotlib.rcParams)
        assert list(pictures()) == ours
        assert dict(matplotlib.rcParams) == before
    assert b"<dc:date>" not in ours[0] + ours[2]
    assert ours[3].startswith(b"\x89PNG")


def test_a_plot_in_a_page_shares_no_ids_and_keeps_its_text():
    first, second = (plots.plot(drawn, name, 'alt "<text>"', "caption", (5.0, 2.0)) for name in ("a", "b"))
    assert first.kind == "wide"
    ids = [set(re.findall(r'\bid="([^"]*)"', item.markup)) for item in (first, second)]
    assert ids[0]
    assert not ids[0] & ids[1]
    assert 'aria-label="alt &#34;&lt;text&gt;&#34;"' in first.markup
    assert "&lt;a &amp; b&gt; $x" in first.markup
    assert "<style" not in first.markup


def test_a_picture_is_named_by_its_format():
    for name in ("a.svg", "A.PNG"):
        plots.check_figure(Path(name))
    with pytest.raises(InputError, match=r"\.svg or \.png, found 'a\.pdf'"):
        plots.check_figure(Path("a.pdf"))


def test_only_what_a_logarithmic_axis_can_show_is_drawn():
    assert plots.positive(2) == 2
    assert np.isnan([plots.positive(item) for item in (None, 0.0, -1.0, np.inf, np.nan)]).all()
    assert plots.ticks(1, 2)[:2] == (1, 1.2)
    assert plots.ticks(1, 1e9) == (1,)


def test_colors_keep_their_contrast_and_hue_in_the_dark():
    def luminance(color):
        srgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
        return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]

    def contrast(color, page):
        light, deep = sorted([luminance(color) + 0.05, luminance(page) + 0.05], reverse=True)
        return light / deep

    page = plots.dark("#ffffff")
    for ink in (plots.INK, plots.MUTED):
        assert contrast(plots.dark(ink), page) > 4.5
    for look in plots.SERIES:
        assert contrast(plots.dark(look["color"]), page) > 3
        assert np.argmax([plots.dark(look["color"])[k : k + 2] for k in (1, 3, 5)]) == np.argmax(
            [look["color"][k : k + 2] for k in (1, 3, 5)]
        )
    grays = [luminance(plots.dark(f"#{2 * f'{item:02x}'}{item:02x}")) for item in range(0, 256, 5)]
    assert np.all(np.diff(grays) < 0)


def test_a_plot_in_a_page_has_colors_for_light_and_dark_unless_it_shows_paper():
    page, paper = (plots.plot(drawn, "a", "alt", "caption", kind=kind).markup for kind in ("", "paper"))
    ink = plots.SERIES[0]["color"].replace("0b5394", "1f77b4")
    assert f"light-dark({ink},{plots.dark(ink)})" in page
    assert f"stroke: var(--{ink[1:]})" in page
    assert not re.findall(r'(?:fill|stroke)(?:: |=")#', page)
    assert "light-dark" not in paper
    assert f"stroke: {ink}" in paper
