"""Written results of the study: tables of plain rows, the claims as text, and a page."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.presentation.pages import Section, page
from markergen.presentation.plots import inline
from markergen.presentation.tables import Table, csv_bytes
from markergen_paper.claims import Claim, verdict
from markergen_paper.measurements import MEASURES
from markergen_paper.options import COORDINATES, GROUPS, NOISE_PX, QUIET_PX
from markergen_paper.results import TYPICAL_GROUPS, PaperResults, PoseLayouts, histogram, typical_of
from markergen_paper.sentences import SENTENCES
from markergen_paper.statistics import NO_A, ClaimTest

Array = NDArray[np.float64]
Row = Mapping[str, Any]

_SETTING = ("A written in", "noise", "verdict", "measured")

Findings = Sequence[tuple[Claim, list[ClaimTest]]]


def rows_csv(rows: Sequence[Row]) -> bytes:
    """Return rows as CSV, empty for missing numbers; infinity, as c(A) of a degenerate layout, is a number."""
    return csv_bytes([{key: _infinite(value) for key, value in row.items()} for row in rows])


def _infinite(value: Any) -> Any:
    return str(value) if isinstance(value, float | np.floating) and np.isinf(value) else value


def tables_of(study: PaperResults) -> dict[str, list[Row]]:
    """All tables by their file names without suffix."""
    tables: dict[str, list[Row]] = {
        **{f"descent-{camera}": list(_descent(result)) for camera, result in study.descents.items()},
        "early": list(_early(study)),
        "conditioned": list(_conditioned(study)),
        "conditioned-by-angle": list(_by_angle(study)),
        "joint": list(_joint(study)),
        "joint-layouts": list(_joint_layouts(study)),
    }
    for n in TYPICAL_GROUPS:
        counts, edges = histogram(study, n)
        centers = (edges[1:] + edges[:-1]) / 2
        tables[f"final-{n}-histogram"] = [
            {"x_m": x, "y_m": y, "aligned": state, "points": count}
            for state, part in zip(("no", "yes"), counts, strict=True)
            for x, column in zip(centers, part, strict=True)
            for y, count in zip(centers, column.tolist(), strict=True)
            if count
        ]
        tables[f"final-{n}-typical"] = [
            {"group": group, "share": share, "point": i, "x_m": x, "y_m": y}
            for group, (layout, share) in enumerate(typical_of(study, n))
            for i, (x, y) in enumerate(layout)
        ]
    return tables


def sets_of(table: PoseLayouts) -> list[str]:
    """Names of the sets of layouts of a table: ``ill``, ``ngon``, and the optimized ones."""
    return [key.removesuffix(".dlt.failed") for key in table.arrays if key.endswith(".dlt.failed")]


def _descent(result: Mapping[str, NDArray[Any]]) -> Iterator[Row]:
    """Steps of a descent, followed by the square."""
    numbers = {key: value for key, value in result.items() if not key.startswith("square.") and key != "layouts"}
    for step, layout in enumerate(result["layouts"]):
        places = {f"{axis}{i}_m": layout[i, j] for i in range(len(layout)) for j, axis in enumerate("xy")}
        yield {"step": step, **places, **{key: value[step] for key, value in numbers.items()}}
    yield {"step": "square", **dict.fromkeys(places, np.nan), **{key: result[f"square.{key}"][0] for key in numbers}}


def _early(study: PaperResults) -> Iterator[Row]:
    for (coordinates, n), result in study.early.items():
        for measure in ("c", "homography_px", "rotation_deg"):
            values = result[measure][np.isfinite(result[measure])]
            quartiles = np.quantile(values, [0.25, 0.5, 0.75]) if len(values) else [np.nan] * 3
            yield {
                "coordinates": coordinates, "n": n, "measure": measure, "descents": len(values),
                **dict(zip(("share_q25", "share_median", "share_q75"), quartiles, strict=True)),
                "steps_mean": float(result["steps"].mean()),
            }  # fmt: skip


def _each(study: PaperResults) -> Iterator[tuple[str, float, int, PoseLayouts]]:
    """Extent, noise, n and table of every comparison of random with optimized layouts."""
    for n, table in study.full.items():
        yield "full", NOISE_PX, n, table
    for (noise_px, n), table in study.beside.items():
        yield "beside", noise_px, n, table


def _conditioned(study: PaperResults) -> Iterator[Row]:
    for extent, noise_px, n, table in _each(study):
        for name in sets_of(table):
            yield from _rows(table, name, {"extent": extent, "noise_px": noise_px, "n": n, "layouts": name}, study)


def _by_angle(study: PaperResults) -> Iterator[Row]:
    for extent, noise_px, n, table in _each(study):
        for angle in np.unique(table.polar_deg):
            part = table.of(table.poses[table.polar_deg == angle])
            head = {"extent": extent, "noise_px": noise_px, "n": n, "polar_deg": angle}
            for name in sets_of(table):
                yield from _rows(part, name, {**head, "layouts": name}, study)


def _rows(table: PoseLayouts, name: str, head: Row, study: PaperResults) -> Iterator[Row]:
    for coordinates in COORDINATES:
        values = table[f"{name}.c.{coordinates}"]
        yield {**head, **_spread(f"c({coordinates})", values, values.size)}
    for measure, estimators in MEASURES.items():
        for estimator in estimators:
            key = f"{name}.{estimator}"
            flips = table.arrays.get(f"{key}.flipped")
            mean = table[f"{key}.{measure}.mean"]
            trials = mean.size * study.options.runs
            yield {
                **head,
                **_spread(f"{estimator} {measure}", mean, trials),
                **{"std": _pooled_std(mean, table[f"{key}.{measure}.std"], 1 - table[f"{key}.failed"])},
                "failed": float(table[f"{key}.failed"].mean()),
                "flipped": np.nan if flips is None else float(flips.mean()),
            }


def _spread(measure: str, values: Array, count: int) -> dict[str, Any]:
    kept = np.asarray(values[np.isfinite(values)], dtype=float)
    if not len(kept):
        kept = np.array([np.nan])
    q25, median, q75 = np.quantile(kept, [0.25, 0.5, 0.75])
    with np.errstate(divide="ignore"):
        geometric = np.exp(np.mean(np.log(kept)))
    return {
        "measure": measure, "count": count, "mean": kept.mean(), "geometric_mean": geometric,
        "q25": q25, "median": median, "q75": q75, "std": np.nan, "failed": np.nan, "flipped": np.nan,
    }  # fmt: skip


def _pooled_std(mean: Array, std: Array, kept: Array) -> float:
    """Standard deviation of all trials together, from each layout's mean, deviation and share kept."""
    usable = np.isfinite(mean) & np.isfinite(std)
    if not usable.any():
        return np.nan
    m, s, w = (np.asarray(a[usable], dtype=float) for a in (mean, std, kept))
    center = np.average(m, weights=w)
    return float(np.sqrt(np.average(s**2 + (m - center) ** 2, weights=w)))


def _joint(study: PaperResults) -> Iterator[Row]:
    criteria = ("pose_m", "homography_px", "condition", "rotation_deg", "translation_pct")
    for (name, n), result in study.joint.items():
        bounds = {f"bound_{key}": np.median(result[key]) if key in result else np.nan for key in criteria}
        row = {"layout": name, "n": n, "layouts": len(result["layouts"]), **bounds}
        for estimator, measure in (("dlt", "he_px2"), *((e, m) for e in ("epnp", "ippe", "sqpnp", "lm")
                                   for m in ("rotation_deg", "translation_pct"))):  # fmt: skip
            row[f"{estimator}_{measure}_rms"] = rms_of(result, f"{estimator}.{measure}")
        yield row


def rms_of(result: Mapping[str, NDArray[Any]], key: str) -> float:
    """RMS over poses and trials of a measure for the median layout; nan if it was not measured."""
    if f"{key}.mean" not in result:
        return np.nan
    mean, std = (np.asarray(result[f"{key}.{statistic}"], dtype=float) for statistic in ("mean", "std"))
    with np.errstate(invalid="ignore"):
        square = np.where(np.isfinite(mean), mean**2 + std**2, np.nan)
    counts = np.isfinite(square).sum(axis=0)
    errors = np.sqrt(np.nansum(square, axis=0) / np.maximum(counts, 1))
    return float(np.median(errors[counts > 0])) if counts.any() else np.nan


def _joint_layouts(study: PaperResults) -> Iterator[Row]:
    for (name, n), result in study.joint.items():
        if name == "random":
            continue
        for i, point in enumerate(result["layouts"][0]):
            x, y, z = (*point, 0.0)[:3]
            yield {"layout": name, "n": n, "point": i, "x_m": x, "y_m": y, "z_m": z}


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


def claims_page(findings: Findings, study: PaperResults) -> str:
    """Table of the claims as Markdown."""
    lines = ["# The paper's claims, measured", "", _summary(study), ""]
    for claim, group in findings:
        lines += [f"## {claim.words}", "", claim.test, "", "| A written in | noise | verdict | measured |"]
        lines.append("|---|---|---|---|")
        for row in _verdicts(group):
            lines.append(f"| {row['coordinates']} | {row['noise']} | **{row['verdict']}** | {row['measured']} |")
        lines.append("")
    lines += ["Every single test, with its 99 % interval, is in claims.csv.", ""]
    lines += ["## All claims", "", *summary_table(findings), "", "## The paper's sentences", ""]
    return "\n".join([*lines, *sentence_table(findings), ""])


def summary_table(findings: Findings) -> list[str]:
    """Lines of a table of all claims: the verdict in the paper's own setting and in all, and the range measured."""
    lines = ["| claim | paper's setting | measured there | all settings |", "|---|---|---|---|"]
    for claim, group in findings:
        groups = _own(group)
        # Bars of absolute values would divide cells.
        text = claim.words.replace("|", "\\|")
        lines.append(f"| {text} | **{verdict(groups)}** | {_measured(groups)} | {verdict(group)} |")
    return lines


def sentence_table(findings: Findings) -> list[str]:
    """Lines of a table of the paper's sentences, with the verdicts on them in the paper's own setting."""
    verdicts_by_claim = {claim.name: verdict(_own(group)) for claim, group in findings}
    lines = ["| | section | the paper | here |", "|---|---|---|---|"]
    for number, sentence in enumerate(SENTENCES, start=1):
        here = (
            "; ".join(f"*{name}*: **{verdicts_by_claim[name]}**" for name in sentence.claims)
            or f"not tested, because {sentence.reason}"
        )
        lines.append(f'| {number} | {sentence.section} | "{sentence.words}" | {here} |')
    return lines


def _own(group: Sequence[ClaimTest]) -> list[ClaimTest]:
    """Tests with A as the paper writes it, or without A, and its noise, or none."""
    return [
        finding
        for finding in group
        if finding.coordinates in (COORDINATES[0], NO_A) and finding.noise_px in (None, NOISE_PX)
    ]


def index_page(
    findings: Findings, figures: Iterable[tuple[str, bytes, str]], tables: Iterable[str], study: PaperResults
) -> bytes:
    """The page, with the same bytes for the same results; of each figure its name, its file, and its caption."""
    verdicts = [verdict(_own(group)) for _, group in findings]
    held, refuted = verdicts.count("holds"), verdicts.count("does not hold")
    rows = [
        [claim.words, verdict_text, verdict(group)]
        for verdict_text, (claim, group) in zip(verdicts, findings, strict=True)
    ]
    each_of = [
        (
            claim.words,
            Section(
                [claim.test],
                tables=[Table(claim.words, _SETTING, [list(row.values()) for row in _verdicts(group)])],
            ),
        )
        for claim, group in findings
    ]
    return page(
        "The paper, reproduced",
        "claims and figures",
        [
            (
                "claims",
                "Its claims",
                Section(
                    [
                        f"Of {len(findings)} claims {held} hold in the paper's own setting and {refuted} do not; "
                        f"{len(findings) - held - refuted} hold in part, or are open."
                    ],
                    tables=[Table("Claims", ["claim", "in the paper's setting", "in all settings"], rows)],
                    folded=each_of,
                    files=["claims.csv"],
                    book=("what is computed", "paper.md#what-is-computed"),
                ),
            ),
            (
                "figures",
                "Its figures",
                Section(
                    plots=[inline(svg, name, caption, caption, "wide") for name, svg, caption in figures],
                    files=[f"{name}.csv" for name in tables],
                    book=("what stands out", "paper.md#what-stands-out"),
                ),
            ),
        ],
        _summary(study),
        "The same study gives the same page.",
    )


def _verdicts(group: Sequence[ClaimTest]) -> list[dict[str, str]]:
    """A row for each coordinates and noise: the verdict, and the median and the extremes of the measured values."""
    rows = []
    for key in dict.fromkeys((finding.coordinates, finding.noise_px) for finding in group):
        part = [finding for finding in group if (finding.coordinates, finding.noise_px) == key]
        rows.append(
            {
                "coordinates": key[0],
                "noise": "" if key[1] is None else f"{key[1]:g} px",
                "verdict": verdict(part),
                "measured": _measured(part),
            }
        )
    return rows


def _measured(part: Sequence[ClaimTest]) -> str:
    ordered = sorted((finding for finding in part if np.isfinite(finding.judged.value)), key=lambda f: f.judged.value)
    if not ordered:
        return "nothing"
    if len(ordered) == 1:
        return f"{_tell(ordered[0])} ({ordered[0].measure})"
    least, most = ordered[0], ordered[-1]
    return f"from {_tell(least)} ({least.measure}) to {_tell(most)} ({most.measure})"


def _tell(finding: ClaimTest) -> str:
    judged = finding.judged
    note = f", {finding.note}" if finding.note else ""
    return f"{judged.value:.3g} [{judged.low:.3g}, {judged.high:.3g}]{note}"


def _summary(study: PaperResults) -> str:
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
