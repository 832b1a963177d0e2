import pytest

from markergen.cli import main
from markergen.model.body_json import read_marker, to_json


@pytest.fixture
def here(make_ngon, tmp_path, monkeypatch):
    marker = make_ngon(5, 0.05, 0.012)
    (tmp_path / "marker.json").write_bytes(to_json(marker))
    rows = [f"{p.id},{1e3 * p.x + 10},{1e3 * p.y - 5},20" for p in marker.control_points]
    (tmp_path / "dots.csv").write_text("\n".join(["id,x_mm,y_mm,sigma_um", *rows[:4]]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_by_rulers(here, capsys):
    assert (
        main(["rescale", "marker.json", "--measured-x", "198.6mm", "--measured-y", "199.1mm", "-o", "printed.json"])
        == 0
    )
    output = capsys.readouterr().out
    assert output.startswith("wrote printed.json")
    assert "99.3 %" in output
    assert "This assumes --nominal-x 200mm and --nominal-y 200mm" in output
    assert read_marker(here / "printed.json").print_scale == pytest.approx((0.993, 0.9955))
    # The same file may be the output.
    assert (
        main(["rescale", "printed.json", "--measured-y", "99.5mm", "--nominal-y", "100mm", "-o", "printed.json"]) == 0
    )
    assert "takes the place" in capsys.readouterr().out
    assert read_marker(here / "printed.json").print_scale == pytest.approx((0.995, 0.995))


def test_by_dots(here, capsys):
    assert main(["rescale", "marker.json", "--measured-points", "dots.csv", "-o", "printed.json"]) == 0
    output = capsys.readouterr().out
    assert "Dot 4 was not" in output
    result = read_marker(here / "printed.json")
    assert result.control_points[0].covariance == pytest.approx((4e-10, 0, 4e-10), abs=1e-20)
    assert result.control_points[4].covariance is None
    assert result.provenance["print"]["points"]["ids"] == [0, 1, 2, 3]


def test_exchanged_rulers_are_asked_about(here, capsys, make_ngon):
    # Its sheets of A4 and A5 have rulers of other lengths along x than along y.
    (here / "large.json").write_bytes(to_json(make_ngon(5, 0.089, 0.036)))
    arguments = ["rescale", "large.json", "-o", "out.json"]
    exchanged = ["--measured-x", "100.0mm", "--measured-y", "150.4mm"]
    assert main([*arguments, "--measured-x", "150.4mm", "--measured-y", "100.0mm"]) == 0
    for nominal in ([], ["--nominal-x", "150mm", "--nominal-y", "100mm"]):
        capsys.readouterr()
        assert main([*arguments, *exchanged, *nominal]) == 2
        message = capsys.readouterr().err
        assert "y 100 mm, found x 100 mm and y 150.4 mm" in message
        assert "are x and y exchanged?" in message
    # A sheet of another paper may have them so.
    assert main([*arguments, *exchanged, "--nominal-x", "100mm", "--nominal-y", "150mm"]) == 0
    output = "On usual paper the rulers are x 150 mm and y 100 mm: see that x and y are not exchanged."
    assert output in capsys.readouterr().out
    assert read_marker(here / "out.json").print_scale == pytest.approx((1.0, 150.4 / 150))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("marker.json -o out.json", "--measured-x"),
        ("marker.json --measured-x 190mm -o out.json", "--force"),
        ("marker.json --measured-x -2mm -o out.json", "above 0"),
        ("marker.json --measured-x 199mm --nominal-x 0 -o out.json", "above 0"),
        ("marker.json --measured-x much -o out.json", "length"),
        ("marker.json --measured-x 199mm -o out.pdf", ".json"),
        ("marker.json --measured-x 199mm -o no/folder/out.json", "no/folder"),
        ("none.json --measured-x 199mm -o out.json", "none.json"),
        ("marker.json --measured-x 199mm --measured-points dots.csv -o out.json", "either"),
        ("marker.json --measured-points none.csv -o out.json", "none.csv"),
        ("marker.json --measured-points marker.json -o out.json", "columns"),
        ("marker.json --measured-x 199mm", "--output"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(here, capsys, arguments, message):
    assert main(["rescale", *arguments.split()]) == 2
    error = capsys.readouterr().err
    assert error.startswith("markergen: error: ")
    assert len(error.strip().splitlines()) == 1
    assert message in error
    assert sorted(path.name for path in here.iterdir()) == ["dots.csv", "marker.json"]
