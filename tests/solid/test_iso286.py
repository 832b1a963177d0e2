import pytest

from markergen.errors import InputError
from markergen.solid.iso286 import STEPS, disc_fit


def test_fits_are_tabulated_up_to_500_mm():
    for size in (0.5, *STEPS):
        slip, press = disc_fit("slip", size), disc_fit("press", size)
        assert slip.gap > 0 == press.gap
        assert slip.play > slip.gap
    assert disc_fit("slip", 3).pocket == "F8 (+0.020 / +0.006 mm)"
    assert disc_fit("slip", 3.01).pocket == "F8 (+0.028 / +0.010 mm)"
    with pytest.raises(InputError, match="at most 500 mm"):
        disc_fit("slip", 500.1)
