"""A program of a user who checks it with mypy --strict; `make lint` does, and nothing runs it."""

from pathlib import Path

import numpy as np

import markergen as mg

version: str = mg.__version__
camera = mg.Camera(width=640, height=480, fx=800.0, fy=800.0, cx=320.0, cy=240.0)
design: mg.Design = mg.design(n=8, radius="150mm", camera=camera, poses="paper", output=[Path("m.pdf")], seed=1)
marker: mg.Marker = design.marker
marker.save("marker.step", Path("marker.fab.pdf"), process="cnc", thickness="4mm")
written: list[Path] = [file.path for file in mg.export([marker, "other.json"], "both.pdf", paper="A3")]
detector = mg.Detector([marker, "other.json"], camera)
for found in detector(np.zeros((480, 640), np.uint8)):
    if found.ok and found.tvec is not None:
        distance: float = float(np.linalg.norm(found.tvec))
validation: mg.Validation = mg.validate(marker, camera, poses="cone:tilt=0..60", runs=100, views=10)
validation.save("report.html")
passed: bool = mg.verify(marker, "marker.step").passed
comparison: mg.Comparison = mg.compare(marker, "aruco:DICT_4X4_50", views=100)
corrected: mg.Marker = mg.rescale("marker.json", measured_x="198mm").marker
study: mg.Study = mg.study({"grid": {"n": [4, 5]}}, "out", workers=2)
try:
    mg.design(n=3)
except mg.InputError as error:
    expected, found_instead, remedy = error.args
