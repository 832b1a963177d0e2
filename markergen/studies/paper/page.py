"""The claims as text, and the page that shows all of the study."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from markergen.studies.paper.claims import Claim, Finding, verdict
from markergen.studies.paper.figures import Draw
from markergen.studies.paper.gather import Study
from markergen.studies.paper.options import GROUPS, NOISE_PX, QUIET_PX
from markergen.studies.paper.tables import Row

Findings = Sequence[tuple[Claim, list[Finding]]]

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>The paper, reproduced</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 64em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; font-size: 13px; }
th, td { padding: .3em .8em; text-align: left; border-bottom: 1px solid #e4e4e4; vertical-align: top; }
figure { margin: 2em 0; } figcaption { color: #5a5a5a; }
img { max-width: 100%; height: auto; }
.holds { color: #2c6e12; } .fails { color: #a02c12; } .part { color: #8a6100; }
div { overflow-x: auto; }
</style>
</head>
<body>
<h1>The paper, reproduced</h1>
<p>{{ summary }}</p>
<h2>Its claims</h2>
{% for claim in claims %}
<h3>{{ claim.words }}</h3>
<p>{{ claim.test }}</p>
<div><table>
<thead><tr><th>A written in</th><th>noise</th><th>verdict</th><th>measured</th></tr></thead>
<tbody>
{% for row in claim.rows %}<tr><td>{{ row.coordinates }}</td><td>{{ row.noise }}</td>
<td class="{{ row.look }}">{{ row.verdict }}</td><td>{{ row.measured }}</td></tr>
{% endfor %}</tbody>
</table></div>
{% endfor %}
<p>Every single test is in <a href="claims.csv">claims.csv</a>.</p>
<h2>Its figures</h2>
{% for name, caption in figures %}
<figure><img src="{{ name }}.svg" alt="{{ caption }}"><figcaption>{{ caption }}</figcaption></figure>
{% endfor %}
<p>The data: {% for name in tables %}<a href="{{ name }}.csv">{{ name }}.csv</a> {% endfor %}</p>
</body>
</html>
"""


def claim_rows(findings: Findings) -> list[Row]:
    """Every test of every claim, one row each."""
    return [
        {
            "claim": claim.name,
            "coordinates": finding.coordinates,
            "noise_px": np.nan if finding.noise_px is None else finding.noise_px,
            "measure": finding.measure,
            "value": finding.judged.value,
            "low": finding.judged.low,
            "high": finding.judged.high,
            "p": finding.judged.p,
            "p_against": finding.judged.p_against,
            "count": finding.judged.count,
            "note": finding.note,
            "verdict": verdict([finding]),
        }
        for claim, group in findings
        for finding in group
    ]


def claims_page(findings: Findings, study: Study) -> str:
    """The table of the claims as Markdown."""
    lines = ["# The paper's claims, measured", "", _summary(study), ""]
    for claim, group in findings:
        lines += [f"## {claim.words}", "", claim.test, "", "| A written in | noise | verdict | measured |"]
        lines.append("|---|---|---|---|")
        for row in _rows(group):
            lines.append(f"| {row['coordinates']} | {row['noise']} | **{row['verdict']}** | {row['measured']} |")
        lines.append("")
    return "\n".join([*lines, "Every single test, with its 99 % interval, is in claims.csv.", ""])


def index_page(
    findings: Findings, figures: Mapping[str, tuple[Draw, Any, str]], tables: Iterable[str], study: Study
) -> bytes:
    """The page, the same bytes for the same results."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    values = {
        "summary": _summary(study),
        "claims": [{"words": claim.words, "test": claim.test, "rows": _rows(group)} for claim, group in findings],
        "figures": [(name, caption) for name, (_, _, caption) in figures.items()],
        "tables": [*tables, "claims"],
    }
    return environment.from_string(_PAGE).render(values).encode()


def _rows(group: Sequence[Finding]) -> list[dict[str, str]]:
    """A row for each coordinates and noise: the verdict, and the middle and the ends of what was measured."""
    rows = []
    for key in dict.fromkeys((finding.coordinates, finding.noise_px) for finding in group):
        part = [finding for finding in group if (finding.coordinates, finding.noise_px) == key]
        words = verdict(part)
        look = "holds" if words == "holds" else "fails" if words == "does not hold" else "part"
        rows.append(
            {
                "coordinates": key[0],
                "noise": "" if key[1] is None else f"{key[1]:g} px",
                "verdict": words,
                "look": look,
                "measured": _measured(part),
            }
        )
    return rows


def _measured(part: Sequence[Finding]) -> str:
    ordered = sorted((finding for finding in part if np.isfinite(finding.judged.value)), key=lambda f: f.judged.value)
    if not ordered:
        return "nothing"
    if len(ordered) == 1:
        return f"{_tell(ordered[0])} ({ordered[0].measure})"
    least, most = ordered[0], ordered[-1]
    return f"from {_tell(least)} ({least.measure}) to {_tell(most)} ({most.measure})"


def _tell(finding: Finding) -> str:
    judged = finding.judged
    note = f", {finding.note}" if finding.note else ""
    return f"{judged.value:.3g} [{judged.low:.3g}, {judged.high:.3g}]{note}"


def _summary(study: Study) -> str:
    options = study.options
    poses, layouts = len(options.poses), len(options.poses) * options.starts
    return (
        f"{poses} poses (4 distances, 5 polar angles, azimuths: {poses // GROUPS}), {options.starts} random starts "
        f"for each pose and n = 4..8, {options.runs} noisy runs of each layout, which pools "
        f"{layouts * options.runs:,} for each n; noise of {NOISE_PX:g} px. Other coordinates of A, other objectives, "
        f"and noise of {QUIET_PX:g} px: {len(options.fewer_poses)} poses and {options.fewer} starts. Values are "
        "medians with their 99 % intervals. Failed trials are left out and counted. EPnP is the better of two calls, "
        "because a single one measures the roll of the camera; LM starts from IPPE."
    )
