import pytest

from markergen.errors import InputError
from markergen.workshop.iso286 import STEPS, core_fit, disc_fit, hole_class


def test_fits_are_tabulated_up_to_500_mm():
    for size in (0.5, *STEPS):
        slip, press = disc_fit("slip", size), disc_fit("press", size)
        assert slip.gap > 0 == press.gap
        assert slip.play > slip.gap
    assert disc_fit("slip", 3).pocket.words == "F8 (+0.020 / +0.006)"
    assert disc_fit("slip", 3.01).pocket.words == "F8 (+0.028 / +0.010)"
    with pytest.raises(InputError, match="at most 500 mm"):
        disc_fit("slip", 500.1)


def test_limits_are_those_of_iso_286_2():
    # From the tables of the standard: um above and below the nominal size.
    reference = {
        ("disc", "slip", 36): (0, -25), ("pocket", "slip", 36): (64, 25),
        ("disc", "press", 36): (0, -16), ("pocket", "press", 36): (-17, -42),
    }  # fmt: skip
    for (part, kind, size), (upper, lower) in reference.items():
        limits = getattr(disc_fit(kind, size), part)
        assert (limits.least, limits.most) == pytest.approx((size + lower / 1e3, size + upper / 1e3))
    # H8/f7 and H7/p6 of the core of a ring: 18 mm, 3 mm, and 2 mm, where p6 is an exception to the rule for P7.
    cores = {("slip", 18): ("f7", -16, -34, "H8", 27), ("press", 18): ("p6", 29, 18, "H7", 18),
             ("press", 2): ("p6", 12, 6, "H7", 10), ("slip", 6): ("f7", -10, -22, "H8", 18)}  # fmt: skip
    for (kind, size), (name, upper, lower, bore, wide) in cores.items():
        fit = core_fit(kind, size)
        assert (fit.disc.name, fit.pocket.name) == (name, bore)
        limits = fit.disc.upper, fit.disc.lower, fit.pocket.upper, fit.pocket.lower
        assert limits == pytest.approx((upper / 1e3, lower / 1e3, wide / 1e3, 0))
        # It fits as its disc in its pocket does.
        assert fit.gap == disc_fit(kind, size).gap == pytest.approx(max(-fit.disc.upper / 2, 0))
    assert hole_class("H7", 4).words == "H7 (+0.012 / 0)"
    assert hole_class("H13", 4.5).words == "H13 (+0.180 / 0)"
