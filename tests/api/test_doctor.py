"""What an installation has and lacks."""

import cv2

from markergen.api import doctor


def test_versions_and_what_is_missing(monkeypatch):
    monkeypatch.setattr(doctor, "EXTRAS", {"none": (("no_such_module",), "nothing"), "some": (("numpy",), "arrays")})
    rows = {name: (state, purpose) for name, state, purpose in doctor.diagnosis().rows}
    assert rows["cv2"][0] == cv2.__version__
    assert "windows: " in rows["cv2"][1]
    assert rows["none"] == ("lacks no_such_module: pip install ./detector '.[none]'", "nothing")
    assert rows["some"] == ("installed", "arrays")


def test_packages_of_opencv_are_listed(monkeypatch):
    monkeypatch.setattr(doctor, "_version", lambda name: "4.10" if name == "opencv-python" else None)
    rows = {name: purpose for name, _, purpose in doctor.diagnosis().rows}
    assert rows["cv2"].endswith("; opencv-python 4.10")
