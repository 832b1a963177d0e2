import numpy as np
import pytest

from markergen.errors import InputError
from markergen.validation.figures import axes_of


def test_axes_are_those_given_or_of_a_new_figure():
    from matplotlib.figure import Figure

    own = axes_of(None, (3, 2))
    assert own.figure.get_size_inches().tolist() == [3, 2]
    first, second = Figure().subplots(2)
    assert axes_of(second) is second is not first


@pytest.mark.parametrize("several", [True, False])
def test_what_is_no_axes_is_one_line(several):
    from matplotlib.figure import Figure

    figure = Figure()
    for other in (figure.subplots(2), np.array(3)) if several else (figure, 3, "ax"):
        with pytest.raises(InputError, match=r"expected axes of matplotlib, found ax=.*; give one of those") as caught:
            axes_of(other)
        assert "\n" not in str(caught.value)
