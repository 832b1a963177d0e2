"""The error from pixels to degrees: figures and tables of docs/error.md."""

from functools import cache
from typing import Any

import numpy as np

import markergen as mg
from docs.figures import Save, drawing, lines, table

POSES = "cone:distance=0.5..1m,tilt=20..60"
FAR_M = 0.4, 0.6, 0.8, 1.2, 1.6, 2.4
BLURS_PX = 0.7, 1.5
TILTS_DEG = 0, 5, 10, 20, 30, 45, 60, 70
NEAR_M = 0.5, 1, 2
DOTS_PX = 10, 20, 40, 80
FOCAL_PX = 800
OFF = np.diag(np.square([2, 2, 1.5, 1.5]))
"""Covariance of fx, fy, cx and cy, px^2."""


@cache
def _marker() -> mg.Marker:
    return mg.design(n=6, radius="80mm", poses=POSES).marker


def _validated(**asked: Any) -> mg.Validation:
    return mg.validate(_marker(), **{"runs": 0, "views": 0, **asked})


def make(save: Save) -> None:
    """Print the page's tables, and save its figures."""
    _dots(save)
    _bias(save)
    _tilt(save)
    _distance(save)
    _example()


def _dots(save: Save) -> None:
    rows, named = [], []
    for blur in BLURS_PX:
        findings = [
            _validated(poses=f"cone:distance={far},tilt=30,count=40", views=40, print_sigma=0, optics=f"blur_px={blur}")
            for far in FAR_M
        ]
        pixels = [item.results["dots"]["least_px"] for item in findings]
        bound = [item.views["image_bound_px"] or np.nan for item in findings]
        measured = [item.views["point_px"]["rms"] or np.nan for item in findings]
        rate = [item.views["rate"] for item in findings]
        rows += [
            [f"{blur:g}", f"{p:.3g}", f"{100 * r:.0f} %", *(f"{value:.2g}" if r else "-" for value in (b, m))]
            for p, r, b, m in zip(pixels, rate, bound, measured, strict=True)
        ]
        named += [(f"blur {blur:g} px: bound", pixels, bound), ("the same, detected", pixels, measured)]
    labels = "diameter of a dot's image, px", "error of its center, RMS, px"
    save("error-dots", drawing(lambda ax: lines(ax, named, labels)))
    table("Dots", ["blur, px", "dot, px", "found", "bound, px", "measured, px"], rows)


def _bias(save: Save) -> None:
    import cv2

    from markergen.maths.conics import outlines

    tilts = np.arange(0, 81, 2)
    rotation = np.stack([cv2.Rodrigues(np.array([np.deg2rad(t), 0, 0]))[0] @ np.diag([1.0, -1, -1]) for t in tilts])
    named = []
    ahead = np.tile([0.0, 0, 1], (len(tilts), 1))
    for pixels in DOTS_PX:
        seen = outlines(np.zeros((1, 3)), np.array([pixels / FOCAL_PX / 2]), rotation, ahead)
        off = FOCAL_PX * np.linalg.norm(seen.center - seen.point, axis=-1)[:, 0]
        named.append((f"dot of {pixels} px", tilts, off))
    at = [int(np.flatnonzero(tilts == t)[0]) for t in (20, 40, 60, 70)]
    table(
        "Center of the ellipse",
        ["dot, px", *(f"{tilts[k]} deg" for k in at)],
        [[name.split()[2], *(f"{off[k]:.2g}" for k in at)] for name, _, off in named],
    )
    labels = "tilt, deg", "center of the ellipse off, px"
    save("error-bias", drawing(lambda ax: lines(ax, named, labels, log="")))


def _tilt(save: Save) -> None:
    results = {
        (far, tilt): _validated(poses=f"cone:distance={far},tilt={tilt},count=24").headline["all"]
        for far in NEAR_M
        for tilt in TILTS_DEG
    }
    table(
        "Tilt",
        ["tilt, deg", *(f"{far:g} m: deg" for far in NEAR_M), "first order at 2 m", "flips at 2 m"],
        [
            [
                str(tilt),
                *(f"{results[far, tilt]['rotation_deg']:.2g}" for far in NEAR_M),
                f"{results[2, tilt]['first_order_deg']:.2g}",
                f"{100 * results[2, tilt]['flip_rate']:.1f} %",
            ]
            for tilt in TILTS_DEG
        ],
    )
    named = [(f"{far:g} m", TILTS_DEG, [results[far, tilt]["rotation_deg"] for tilt in TILTS_DEG]) for far in NEAR_M]
    save("error-tilt", drawing(lambda ax: lines(ax, named, ("tilt, deg", "rotation error, RMS, deg"), log="y")))


def _distance(save: Save) -> None:
    parts = [
        _validated(poses=f"cone:distance={far},tilt=45,count=24", camera_covariance=OFF).results["budget"][
            "rotation_deg"
        ]
        for far in FAR_M
    ]
    names = {"all": "total", "calibration off by 2 px": "camera", "print 0.1 mm": "print", "image": "image"}
    columns = {name: [part[key] for part in parts] for name, key in names.items()}
    table(
        "Distance",
        ["distance, m", *(f"{name}, deg" for name in reversed(columns))],
        [[f"{far:g}", *(f"{values[k]:.2g}" for values in reversed(columns.values()))] for k, far in enumerate(FAR_M)],
    )
    named = [(name, FAR_M, values) for name, values in columns.items()]
    save("error-distance", drawing(lambda ax: lines(ax, named, ("distance, m", "rotation error, RMS, deg"))))


def _example() -> None:
    seen, off = _validated(views=200), _validated(camera_covariance=OFF)
    views, budget, worst = seen.views, off.results["budget"]["rotation_deg"], off.headline
    all_seen = seen.headline["views"]["all"]["rotation_deg"]
    rows = [
        ["center of a dot, least possible", f"{views['image_bound_px']:.4f} px"],
        ["center of a dot, as detected", f"{views['point_px']['rms']:.4f} px"],
        ["the same without the correction for perspective", f"{views['uncorrected_px']['rms']:.3f} px"],
        ["homography, with the print", f"{views['homography_px']['rms']:.2f} px"],
        ["rotation, by the image alone", f"{budget['image']:.4f} deg"],
        ["by the print, 0.1 mm", f"{budget['print']:.3f} deg"],
        ["by the calibration, 2 px and 1.5 px off", f"{budget['camera']:.3f} deg"],
        ["all of it", f"{budget['total']:.3f} deg"],
        ["views: image and print, expected", f"{all_seen['expected']:.3f} deg"],
        ["views: image and print, as detected", f"{all_seen['rms']:.3f} deg"],
        ["NEES of the detections, 6 if their covariance is right", f"{views['nees']['mean']:.2f}"],
        ["hardest case: rotation", f"{worst['rotation_deg']:.2f} deg"],
        ["hardest case: position", f"{worst['translation_mm']:.1f} mm"],
    ]
    table("Example", ["step", "RMS"], rows)
