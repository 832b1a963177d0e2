"""The data behind the figures, as tables of plain rows."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.studies.paper.gather import Study, Table
from markergen.studies.paper.options import COORDINATES, NOISE_PX
from markergen.studies.paper.shapes import aligned, typical
from markergen.studies.paper.trials import MEASURES

Array = NDArray[np.float64]
Row = Mapping[str, Any]

STATISTICS = ("mean", "std", "flipped", "failed")
BINS = 60
"""Cells of a histogram of final layouts along each axis."""

TYPICAL_GROUPS = {4: 1, 5: 2}
"""Numbers of points whose final layouts are shown, and how many typical ones, as in the paper."""


def csv_bytes(rows: Sequence[Row]) -> bytes:
    """Rows as CSV, the first row's keys as its header; numbers with nine digits, nothing for nan."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _plain(value) for key, value in row.items()} for row in rows)
    return text.getvalue().encode()


def tables_of(study: Study) -> dict[str, list[Row]]:
    """All tables by the names of their files, without suffix."""
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


def finals(study: Study, n: int) -> Array:
    """Final layouts (k, n, 2) of all descents in the paper's coordinates, m."""
    return np.asarray(study.full[n][f"{COORDINATES[0]}.layouts"], dtype=float).reshape(-1, n, 2)


def histogram(study: Study, n: int) -> tuple[list[NDArray[np.intp]], Array]:
    """Counts (BINS, BINS) of final points by x and y, as they are and aligned, and the edges (BINS + 1,) in m."""
    layouts = finals(study, n)
    edges = np.linspace(-0.16, 0.16, BINS + 1)
    counts = []
    for batch in (layouts, aligned(layouts)):
        points = batch.reshape(-1, 2)
        counts.append(np.histogram2d(points[:, 0], points[:, 1], (edges, edges))[0].astype(np.intp))
    return counts, edges


def typical_of(study: Study, n: int) -> list[tuple[Array, float]]:
    """Typical final layouts (n, 2) in m, aligned, and the shares of all that are of their kind."""
    return typical(aligned(finals(study, n)), TYPICAL_GROUPS[n])


def sets_of(table: Table) -> list[str]:
    """Names of the sets of layouts of a table: ``ill``, ``ngon``, and what was optimized."""
    return [key.removesuffix(".dlt.failed") for key in table.arrays if key.endswith(".dlt.failed")]


def _descent(result: Mapping[str, NDArray[Any]]) -> Iterator[Row]:
    """Steps of a descent, and the square at the end."""
    numbers = {key: value for key, value in result.items() if not key.startswith("square.") and key != "layouts"}
    for step, layout in enumerate(result["layouts"]):
        places = {f"{axis}{i}_m": layout[i, j] for i in range(len(layout)) for j, axis in enumerate("xy")}
        yield {"step": step, **places, **{key: value[step] for key, value in numbers.items()}}
    yield {"step": "square", **dict.fromkeys(places, np.nan), **{key: result[f"square.{key}"][0] for key in numbers}}


def _early(study: Study) -> Iterator[Row]:
    for (coordinates, n), result in study.early.items():
        for measure in ("c", "homography_px", "rotation_deg"):
            values = result[measure][np.isfinite(result[measure])]
            quartiles = np.quantile(values, [0.25, 0.5, 0.75]) if len(values) else [np.nan] * 3
            yield {
                "coordinates": coordinates, "n": n, "measure": measure, "descents": len(values),
                **dict(zip(("share_q25", "share_median", "share_q75"), quartiles, strict=True)),
                "steps_mean": float(result["steps"].mean()),
            }  # fmt: skip


def _each(study: Study) -> Iterator[tuple[str, float, int, Table]]:
    """Extent, noise, n and table of every comparison of random with optimized layouts."""
    for n, table in study.full.items():
        yield "full", NOISE_PX, n, table
    for (noise_px, n), table in study.beside.items():
        yield "beside", noise_px, n, table


def _conditioned(study: Study) -> Iterator[Row]:
    for extent, noise_px, n, table in _each(study):
        for name in sets_of(table):
            yield from _rows(table, name, {"extent": extent, "noise_px": noise_px, "n": n, "layouts": name}, study)


def _by_angle(study: Study) -> Iterator[Row]:
    for extent, noise_px, n, table in _each(study):
        for angle in np.unique(table.polar_deg):
            part = table.of(table.poses[table.polar_deg == angle])
            head = {"extent": extent, "noise_px": noise_px, "n": n, "polar_deg": angle}
            for name in sets_of(table):
                yield from _rows(part, name, {**head, "layouts": name}, study)


def _rows(table: Table, name: str, head: Row, study: Study) -> Iterator[Row]:
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
    """Standard deviation of all trials together, of means, deviations and shares kept of each layout's."""
    usable = np.isfinite(mean) & np.isfinite(std)
    if not usable.any():
        return np.nan
    m, s, w = (np.asarray(a[usable], dtype=float) for a in (mean, std, kept))
    center = np.average(m, weights=w)
    return float(np.sqrt(np.average(s**2 + (m - center) ** 2, weights=w)))


def _joint(study: Study) -> Iterator[Row]:
    criteria = ("pose_m", "homography_px", "condition", "rotation_deg", "translation_pct")
    for (name, n), result in study.joint.items():
        bounds = {f"bound_{key}": np.median(result[key]) if key in result else np.nan for key in criteria}
        row = {"layout": name, "n": n, "layouts": len(result["layouts"]), **bounds}
        for estimator, measure in (("dlt", "he_px2"), *((e, m) for e in ("epnp", "ippe", "sqpnp", "lm")
                                   for m in ("rotation_deg", "translation_pct"))):  # fmt: skip
            row[f"{estimator}_{measure}_rms"] = rms_of(result, f"{estimator}.{measure}")
        yield row


def rms_of(result: Mapping[str, NDArray[Any]], key: str) -> float:
    """RMS over poses and trials, of the median layout, of what was measured; nan if it was not."""
    if f"{key}.mean" not in result:
        return np.nan
    mean, std = (np.asarray(result[f"{key}.{each}"], dtype=float) for each in ("mean", "std"))
    with np.errstate(invalid="ignore"):
        square = np.where(np.isfinite(mean), mean**2 + std**2, np.nan)
    counts = np.isfinite(square).sum(axis=0)
    each = np.sqrt(np.nansum(square, axis=0) / np.maximum(counts, 1))
    return float(np.median(each[counts > 0])) if counts.any() else np.nan


def _joint_layouts(study: Study) -> Iterator[Row]:
    for (name, n), result in study.joint.items():
        if name == "random":
            continue
        for i, point in enumerate(result["layouts"][0]):
            x, y, z = (*point, 0.0)[:3]
            yield {"layout": name, "n": n, "point": i, "x_m": x, "y_m": y, "z_m": z}


def _plain(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else f"{value:.9g}"
    return value
