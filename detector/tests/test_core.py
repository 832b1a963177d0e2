"""The header, read by the package, against what the compiler made of it."""

import numpy as np
import structures as written
from markergen_detect.core import constants, library, pointer, structures


def test_structures_are_as_large_as_the_compiler_makes_them():
    sizes = np.zeros(100, np.int64)
    count = library().detector_sizes(pointer(sizes), len(sizes))
    assert dict(zip(structures(), sizes.tolist(), strict=False)) == {k: v.itemsize for k, v in structures().items()}
    assert count == len(structures())


def test_structures_have_the_offsets_that_are_written_down_here():
    for name in ("BLOB", "POSE", "DOT", "MATCH", "ESTIMATE"):
        kind, again = structures()[name.title()], getattr(written, name)
        offsets = [[(field, dtype.fields[field][1]) for field in dtype.names] for dtype in (kind, again)]
        assert offsets[0] == offsets[1]
    for name in ("Image", "Camera", "Errors"):
        again = getattr(written, f"{name}Struct")
        for field, *_ in again._fields_:
            assert structures()[name].fields[field][1] == getattr(again, field).offset


def test_enumerations_count_from_their_last_number():
    assert [constants()[name] for name in ("NO_MEMORY", "ROUGH", "REFUSED", "SAMPLED", "COEFFICIENTS")] == [
        -1,
        0,
        2,
        3,
        14,
    ]


def test_functions_know_what_they_take():
    assert len(library().lens_ray.argtypes) == 4
    assert library().detector_source()
