import csv
import io

import numpy as np
import pytest

import markergen as mg
from markergen.errors import InputError, OutputError
from markergen.objectives import OBJECTIVES
from markergen.objectives.criteria import criteria, regular_polygon
from markergen.optimize.problem import FeasibleRegion
from markergen.optimize.trace import Recorder, Step, Watcher, check_trace_path, plot_trace, trace_bytes, trace_of


def shrinking(count=5, n=5):
    """Layouts (count, n, 2), each nearer to the rim."""
    return np.stack([regular_polygon(n, radius) for radius in np.linspace(0.05, 0.14, count)])


def steps(objective):
    record = Recorder()
    layouts = shrinking()
    record("descent", layouts[:2], layouts[1:3])
    record("polish", layouts[2:4], layouts[3:5])
    return trace_of(record.way(layouts[4]), objective)


def test_the_way_to_a_layout_is_that_of_its_own_start():
    record = Recorder()
    rng = np.random.default_rng(0)
    starts, middles, ends = rng.normal(size=(3, 4, 5, 2))
    record("descent", starts, middles)
    # The search may drop layouts and change their order.
    record("polish", middles[[2, 0]], ends[[2, 0]])
    way = record.way(ends[2])
    assert [stage for stage, _ in way] == ["start", "descent", "polish"]
    for (_, layout), expected in zip(way, (starts[2], middles[2], ends[2]), strict=True):
        np.testing.assert_array_equal(layout, expected)
    assert [stage for stage, _ in record.way(middles[1])] == ["start", "descent"]
    assert [stage for stage, _ in record.way(starts[3])] == ["start"]


def test_standing_still_and_going_in_circles_end():
    record = Recorder()
    one, other = np.random.default_rng(1).normal(size=(2, 1, 5, 2))
    record("descent", one, one)
    record("descent", one, other)
    record("descent", other, one)
    assert len(record.way(one[0])) == 3
    assert len(record.way(other[0])) <= 3
    record("descent", other, other)
    assert len(record.way(other[0])) <= 3


def test_steps_say_what_each_layout_is_worth(setting):
    objective = OBJECTIVES["pose"](setting, "max")
    trace = steps(objective)
    assert [item.stage for item in trace] == ["start", "descent", "descent", "polish", "polish"]
    assert [item.step for item in trace] == [0, 1, 2, 3, 4]
    for item, layout, row in zip(trace, shrinking(), criteria(shrinking(), setting), strict=True):
        assert item.objective == pytest.approx(objective(layout[None])[0], rel=1e-12)
        for key in ("condition", "rotation_deg", "translation_pct"):
            assert getattr(item, key) == pytest.approx(row[key], rel=1e-12)


def test_a_relief_has_no_condition_number(setting):
    layouts = np.pad(shrinking(2), ((0, 0), (0, 0), (0, 1))) + [0, 0, 0.01] * np.arange(5)[:, None]
    trace = trace_of([("start", layouts[0]), ("descent", layouts[1])], OBJECTIVES["pose"](setting))
    assert np.isnan([item.condition for item in trace]).all()
    assert trace[1].objective < trace[0].objective


def test_csv(setting):
    trace = steps(OBJECTIVES["pose"](setting))
    rows = list(csv.DictReader(io.StringIO(trace_bytes(trace, ".csv").decode())))
    assert list(rows[0]) == ["step", "stage", "objective", "condition", "rotation_deg", "translation_pct"]
    for row, item in zip(rows, trace, strict=True):
        assert (int(row["step"]), row["stage"]) == (item.step, item.stage)
        # Nine digits are written.
        assert float(row["objective"]) == pytest.approx(item.objective, rel=1e-8)
        assert float(row["rotation_deg"]) == pytest.approx(item.rotation_deg, rel=1e-8)


@pytest.mark.parametrize("suffix", [".PNG", ".csv"])
def test_the_same_trace_gives_the_same_bytes(setting, suffix):
    trace = steps(OBJECTIVES["pose"](setting))
    data = trace_bytes(trace, suffix, "pose, m")
    assert data == trace_bytes(trace, suffix, "pose, m")
    if suffix == ".PNG":
        assert data.startswith(b"\x89PNG")


def test_the_plot_shows_everything_and_leaves_gaps(setting):
    from matplotlib.figure import Figure

    trace = [Step(0, "start", np.inf, np.inf, np.inf, np.inf), *steps(OBJECTIVES["pose"](setting))]
    trace = [Step(i, *list(vars(item).values())[1:]) for i, item in enumerate(trace)]
    ax = Figure().add_subplot()
    assert plot_trace(trace, ax, "pose, m") is ax
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert [label.split(":")[0] for label in labels] == ["pose, m", "c(A)", "rotation", "translation"]
    assert f"{trace[-1].rotation_deg:.4g} deg" in labels[2]
    for line in ax.get_lines()[:4]:
        assert np.isnan(line.get_ydata()[0])
        assert line.get_ydata()[-1] == 1


def test_paths(tmp_path):
    check_trace_path(tmp_path / "trace.SVG")
    with pytest.raises(InputError, match=r"in one of .csv, .svg, .mp4, .png"):
        check_trace_path(tmp_path / "trace.pdf")
    with pytest.raises(OutputError):
        check_trace_path(tmp_path / "missing" / "trace.csv")


def test_a_watcher_tells_of_the_best_layout_that_fits(setting, monkeypatch):
    monkeypatch.setattr("markergen.optimize.trace.PAUSE", 0.0)
    objective, output, every = OBJECTIVES["pose"](setting), [], []
    region = FeasibleRegion(setting.boundary, 0.01, 0.001)
    watcher = Watcher(
        objective, region, lambda *phrase: output.append(phrase), lambda stage, before, after: every.append(stage)
    )
    good, better = regular_polygon(5, 0.08), regular_polygon(5, 0.12)
    outside = regular_polygon(5, setting.boundary.radius)
    watcher("descent", np.stack([outside]), np.stack([outside]))
    assert output == []  # Nothing fits yet.
    for stage, layouts in (("descent", [outside, good]), ("polish", [better]), ("polish", [good])):
        watcher(stage, np.stack(layouts), np.stack(layouts))
    assert every == ["descent", "descent", "polish", "polish"]
    assert [stage for stage, _, _ in output] == ["descent", "polish", "polish"]
    for (_, points, value), layout in zip(output, (good, better, better), strict=True):
        np.testing.assert_array_equal(points, layout)
        assert value == pytest.approx(objective(layout[None])[0], rel=1e-12)


def test_a_search_that_is_watched_is_the_same_and_ends_when_it_is_told_to():
    options = {"n": 4, "radius": "100mm", "dot": "0mm", "restarts": 2, "poses": "cone:count=3"}
    output = []
    watched = mg.design(**options, watch=lambda stage, points, value: output.append((points.shape, value)))
    assert watched.marker == mg.design(**options).marker
    assert output
    assert all(shape == (4, 2) for shape, _ in output)
    assert min(value for _, value in output) >= watched.value * (1 - 1e-9)

    def enough(stage, points, value):
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        mg.design(**options, watch=enough)
    with pytest.raises(InputError, match="a stage, a layout"):
        mg.design(**options, watch="often")
