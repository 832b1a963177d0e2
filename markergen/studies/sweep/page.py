"""The page of a sweep: its plots, and its table over all poses."""

from collections.abc import Sequence

from markergen.studies.sweep.grid import Sweep, axis_text
from markergen.studies.sweep.plots import SweepPlot
from markergen.studies.sweep.table import ALL, Row, columns

SHOWN = (
    "layout", "control_points", "noise_px", "estimator", "rotation_rms_deg", "rotation_bound_deg",
    "translation_rms_pct", "translation_bound_pct", "homography_rms_px", "flip_rate", "failure_rate",
    "criterion_condition",
)  # fmt: skip
"""Columns of the page, after the axes; the file has all."""

MOST_ROWS = 2000

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{{ name }}</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 75em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; font-size: 13px; }
th, td { padding: .2em .7em; text-align: right; border-bottom: 1px solid #e4e4e4; white-space: nowrap; }
th { position: sticky; top: 0; background: #fff; }
td:first-child, th:first-child { text-align: left; }
section { display: flex; flex-wrap: wrap; gap: 1em 2em; align-items: flex-start; }
figure { margin: 1em 0; max-width: 100%; } figcaption { color: #5a5a5a; contain: inline-size; }
img { max-width: 100%; height: auto; }
div { overflow-x: auto; } li { margin: .3em 0; }
</style>
</head>
<body>
<h1>{{ name }}</h1>
<p>{{ summary }}</p>
<section>
{% for plot in plots %}
<figure><img src="{{ plot.name }}.svg" alt="{{ plot.caption }}"><figcaption>{{ plot.caption }}</figcaption></figure>
{% endfor %}
</section>
{% if errors %}
<h2>What could not be computed</h2>
<ul>{% for place, words in errors %}<li>{{ place }}: {{ words }}</li>{% endfor %}</ul>
{% endif %}
<h2>Over all poses</h2>
<p>{{ more }}<a href="table.csv">table.csv</a> has these rows for every polar angle too, with 95 % intervals.</p>
<div><table>
<thead><tr>{% for name in head %}<th>{{ name.replace("_", " ") }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows %}<tr>{% for value in row %}<td>{{ value }}</td>{% endfor %}</tr>
{% endfor %}</tbody>
</table></div>
</body>
</html>
"""


def page(sweep: Sweep, table: Sequence[Row], plots: Sequence[SweepPlot]) -> bytes:
    """Make the HTML page, the same bytes for the same table; what comes from the file is escaped."""
    from jinja2 import Environment, StrictUndefined

    rows = [row for row in table if row.get("polar_angle_deg") == ALL]
    present = {key for row in rows for key in row}
    axes = [name for name in sweep.axes if name in columns(sweep) and name not in SHOWN]
    known = {
        "noise": "noise_px",
        "n": "" if any(point.layout == "square" for point in sweep.points) else "control_points",
    }
    told = {known[name] for name in axes if name in known}
    head = [*axes, *(name for name in SHOWN if name in present - told)]
    errors = [
        (" ".join(f"{name}={row[name]}" for name in sweep.axes), row["error"]) for row in table if row.get("error")
    ]
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    values = {
        "name": sweep.name,
        "summary": _summary(sweep),
        "plots": plots,
        "errors": errors,
        "more": f"The first {MOST_ROWS} rows of {len(rows)}; " if len(rows) > MOST_ROWS else "",
        "head": head,
        "rows": [[_text(row.get(name, "")) for name in head] for row in rows[:MOST_ROWS]],
    }
    return environment.from_string(_PAGE).render(values).encode("utf-8", "replace")


def _summary(sweep: Sweep) -> str:
    grid = "; ".join(f"{name}: {', '.join(map(axis_text, values))}" for name, values in sweep.axes.items())
    fixed = "; ".join(f"{name}: {axis_text(value)}" for name, value in sweep.fixed.items())
    words = f"{len(sweep.points)} points of a grid ({grid}), {sweep.runs} noisy trials for each pose."
    return words + (f" The same everywhere: {fixed}." if fixed else "")


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
