import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.read.dot_tables import read_layout, read_measured


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("measured") / "dots.csv"


def read(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_measured(path)


@pytest.mark.parametrize(
    ("text", "sigma"),
    [
        ("id,x,y\n3,0.012,-0.034\n", None),
        ("id,x_mm,y_mm\n3,12,-34\n", None),
        ("# by microscope\nY (mm); X [cm]; ID; sigma_um\n-34; 1.2; 3; 20\n\n", (2e-5, 2e-5, 0)),
        ("id\tx_mm\ty_mm\tsx_um\tsy_um\n3\t12\t-34\t10\t20\n", (1e-5, 2e-5, 0)),
        ('"id" "x_mm" "y_mm" "sx_um" "sy_um" "rho"\n3 12 -34 10 20 0.5\n', (1e-5, 2e-5, 0.5)),
        ("\ufeffid,x_in,y_m,sigma\r\n3,0.4724409448818898,-0.034,1e-5\r\n", (1e-5, 1e-5, 0)),
    ],
)
def test_columns_and_units(path, text, sigma):
    (dot,) = read(path, text)
    assert dot.id == 3
    assert (dot.x, dot.y) == pytest.approx((0.012, -0.034), rel=1e-12)
    if sigma is None:
        assert dot.covariance is None
    else:
        sx, sy, rho = sigma
        assert dot.covariance == pytest.approx((sx**2, rho * sx * sy, sy**2), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("# nothing\n", "empty"),
        ("id,x,y\n", "only the names"),
        ("id,x\n1,2\n", "id, x"),
        ("id,x,y,sx\n1,2,3,4\n", "sx"),
        ("id,x,y,z\n1,2,3,4\n", "'z'"),
        ("id,x,x,y\n1,2,3,4\n", "x twice"),
        ("id_mm,x,y\n1,2,3\n", "no unit for id"),
        ("id,x,y\n1,2\n", "line 2"),
        ("id,x,y\n1,2,three\n", "'three'"),
        ("id,x,y\n1,2,nan\n", "nan"),
        ("id,x,y\n1,2,1e999\n", "1e999"),
        ("id,x,y\n1.5,2,3\n", "whole number"),
        ("id,x,y\n-1,2,3\n", "whole number"),
        ("id,x,y\n1_0,2,3\n", "1_0"),
        ("id,x,y,sigma\n1,2,3,-1\n", "0 or more"),
        ("id,x,y,sx,sy,rho\n1,2,3,1,1,1.5\n", "rho"),
        (b"id,x,y\n\xff,2,3\n", "UTF-8"),
        ("id,x,y\n" + "1,2,3\n" * 10_001, "10000 rows"),
    ],
)
def test_tables_that_are_none(path, text, message):
    with pytest.raises(InputError) as error:
        read(path, text)
    assert message in str(error.value)


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_measured(tmp_path / "none.csv")
    with pytest.raises(InputError, match="directory"):
        read_measured(tmp_path)


TOKENS = ["", "id", "x_mm", "nan", "1e400", ",", ";", "\n", '"', "\0", "é", "9" * 400, "#", "1_0", "\u0661", " ", "\t"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=200)
@given(st.lists(st.tuples(st.floats(0, 1), st.integers(0, 9), st.sampled_from(TOKENS)), max_size=4))
def test_whatever_stands_in_it(path, changes):
    text = "id,x_mm,y_mm,sx_um,sy_um,rho\n0,1,2,3,4,0.1\n1,-5.5,7,3,4,-1\n"
    for place, length, token in changes:
        start = int(place * len(text))
        text = text[:start] + token + text[start + length :]
    results, message = (), ""
    try:
        results = read(path, text)
    except InputError as error:
        message = str(error)
    assert len(message.splitlines()) <= 1
    assert len(message) < 1000
    assert all(np.isfinite([dot.x, dot.y]).all() for dot in results)


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        ("x_mm;y_mm\n10,5;20,1\n", "decimal points at line 2 of .*dots.csv, found '10,5', perhaps with a dec"),
        ('x_mm,y_mm\n"10,5","20,1"\n', "decimal comma"),
        ("x_mm,y_mm\n10,5,20,1\n", "2 values at line 2 of .*dots.csv, found 4; write decimal points, not commas"),
        ("x_mm,y_mm\n10.5,20.1\n", "a layout in .*dots.csv, found 1 rows"),
    ],
)
def test_decimal_commas_are_named(path, rows, reason):
    path.write_text(rows)
    with pytest.raises(InputError, match=reason):
        read_layout(path)
