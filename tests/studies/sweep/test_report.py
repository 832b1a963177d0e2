from xml.etree import ElementTree

import pytest
from html_pages import check

from markergen.studies.sweep.grid import sweep_from_mapping
from markergen.studies.sweep.run import plots, roles_of, sweep_page

ROW = {
    "polar_angle_deg": "all", "estimator": "lm", "rotation_rms_deg": 1.0, "rotation_low_deg": 0.9,
    "rotation_high_deg": 1.1, "rotation_bound_deg": 0.95, "translation_rms_pct": 0.5, "translation_low_pct": 0.4,
    "translation_high_pct": 0.6, "translation_bound_pct": 0.45,
}  # fmt: skip


def test_the_longest_axis_of_numbers_goes_along_layouts_are_lines_and_the_rest_panels():
    grid = {"objective": ["pose", "rotation"], "n": [4, 5, 6], "layout": ["designed", "ngon"], "seed": [0, 1]}
    roles = roles_of(sweep_from_mapping({"dot": "20mm", "grid": grid}))
    assert (roles.x, roles.lines, roles.panels, roles.held) == ("n", "layout", "objective", {"seed": "0"})


def test_lengths_are_numbers_in_whatever_unit():
    roles = roles_of(sweep_from_mapping({"dot": "20mm", "grid": {"n": [4, 5], "radius": ["150mm", 0.2, "4in"]}}))
    assert (roles.x, roles.lines) == ("radius", "n")


def test_words_alone_make_an_axis_of_words():
    roles = roles_of(sweep_from_mapping({"grid": {"layout": ["ngon", "random"]}}))
    assert (roles.x, roles.lines, roles.panels) == ("layout", "", "")


@pytest.mark.parametrize(
    "grid", [{"n": [4, 5]}, {"layout": ["ngon"]}, {"radius": ["80mm", "150mm"], "n": [4, 5], "seed": [0, 1]}]
)
def test_plots_and_page_are_well_formed_and_what_failed_leaves_a_gap(grid):
    sweep = sweep_from_mapping({"dot": "20mm", "study": {"name": "<b>&"}, "grid": grid})
    table = [
        {key: str(value) for key, value in point.axes.items()} | ({"error": "none <i>"} if not index else ROW)
        for index, point in enumerate(sweep.points)
    ]
    drawn = plots(sweep, table)
    assert [plot.name for plot in drawn] == ["rotation-error", "translation-error"]
    for plot in drawn:
        assert ElementTree.fromstring(plot.svg).tag.endswith("svg")
    made = sweep_page(sweep, table, drawn)
    result = check(made, {"table.csv"})
    assert not result.of("b") + result.of("i")
    assert len(result.of("svg")) == 2
    assert sweep_page(sweep, table, drawn) == made
