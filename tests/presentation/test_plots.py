import re
from pathlib import Path

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.presentation import plots
from markergen.presentation.plots import axes_of


def test_axes_are_those_given_or_of_a_new_figure():
    from matplotlib.figure import Figure

    own = axes_of(None, (3, 2))
    assert own.figure.get_size_inches().tolist() == [3, 2]
    first, second = Figure().subplots(2)
    assert axes_of(second) is second is not first


@pytest.mark.parametrize("several", [True, False])
def test_what_is_no_axes_is_one_line(several):
    from matplotlib.figure import Figure

    figure = Figure()
    for other in (figure.subplots(2), np.array(3)) if several else (figure, 3, "ax"):
        with pytest.raises(InputError, match=r"expected axes of matplotlib, found ax=.*; give axes from") as caught:
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
        yield plots.plot(drawn, "name", 'alt "text"', "caption").svg
        yield plots.figure_bytes(figure, tmp_path / "plot.svg")
        yield plots.figure_bytes(figure, tmp_path / "plot.PNG")

    own = list(pictures())
    with matplotlib.rc_context({"font.size": 20, "svg.hashsalt": "other", "axes.grid": False, "text.parse_math": True}):
        before = dict(matplotlib.rcParams)
        assert list(pictures()) == own
        assert dict(matplotlib.rcParams) == before
    assert b"<dc:date>" not in own[0] + own[2]
    assert own[3].startswith(b"\x89PNG")


def test_a_plot_in_a_page_shares_no_ids_and_keeps_its_text():
    first, second = (plots.plot(drawn, name, 'alt "<text>"', "caption", (5.0, 2.0)) for name in ("a", "b"))
    assert first.wide
    ids = [set(re.findall(r'\bid="([^"]*)"', each.svg)) for each in (first, second)]
    assert ids[0]
    assert not ids[0] & ids[1]
    assert 'aria-label="alt &#34;&lt;text&gt;&#34;"' in first.svg
    assert "&lt;a &amp; b&gt; $x" in first.svg
    assert "<style" not in first.svg


def test_a_picture_is_named_by_its_format():
    for name in ("a.svg", "A.PNG"):
        plots.check_figure(Path(name))
    with pytest.raises(InputError, match=r"expected a picture \.svg or \.png, found a\.pdf"):
        plots.check_figure(Path("a.pdf"))


def test_only_what_a_logarithmic_axis_can_show_is_drawn():
    assert plots.positive(2) == 2
    assert np.isnan([plots.positive(each) for each in (None, 0.0, -1.0, np.inf, np.nan)]).all()
    assert plots.ticks(1, 2)[:2] == (1, 1.2)
    assert plots.ticks(1, 1e9) == (1,)
