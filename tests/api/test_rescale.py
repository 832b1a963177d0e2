import pytest
from sentences import sentence

from markergen.api.rescale import rescale
from markergen.errors import InputError
from markergen.model.marker import Marker


def test_rulers(pentagon, tmp_path):
    rescaled = rescale(pentagon, tmp_path / "m.json", measured_x="198mm", measured_y=0.199)
    assert rescaled.marker.print_scale == pytest.approx((0.99, 0.995))
    assert Marker.load(tmp_path / "m.json") == rescaled.marker
    assert str(rescaled).splitlines() == list(rescaled.notes)
    assert str(rescaled).startswith(sentence("print scale", 99) + " and 99.5 % along y: x 198 mm of 200 mm,")
    assert len(repr(rescaled)) < 300
    assert rescale(pentagon, measured_x="148.5mm", nominal_x="150mm").marker.print_scale == pytest.approx((0.99, 0.99))


def test_measured_dots(pentagon, tmp_path):
    table = "".join(f"{p.id},{1.001e3 * p.x},{1.001e3 * p.y}\n" for p in pentagon.control_points)
    (tmp_path / "dots.csv").write_text("id,x_mm,y_mm\n" + table)
    rescaled = rescale(pentagon, measured_points=str(tmp_path / "dots.csv"))
    assert rescaled.marker.xyz[1] == pytest.approx(1.001 * pentagon.xyz[1])


@pytest.mark.parametrize(
    ("output", "options", "phrase"),
    [
        (None, {}, "a measured length, found none"),
        ("m.pdf", {"measured_x": 0.2}, "an output that ends in .json"),
        (None, {"measured_x": "198mm", "measured_points": "dots.csv"}, "either rulers or dots"),
        (None, {"measured_x": "180mm"}, "force"),
        (None, {"mesured_x": "180mm"}, "did you mean 'measured_x'?"),
        (None, {"measured_x": "wide"}, "measured_x='wide' (a length"),
        (3, {"measured_x": 0.2}, "a path, found 3"),
    ],
)
def test_bad_wishes(pentagon, output, options, phrase, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        rescale(pentagon, output, **options)
    assert phrase in str(caught.value)
    assert not list(tmp_path.iterdir())
