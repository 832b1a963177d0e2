"""Designs are those of designs.json, up to what other versions of linear algebra change.

If they change on purpose, record them anew: ``python tests/golden/record.py designs``.
"""

import json

import numpy as np
import pytest

from tests.golden import record

RECORDED = json.loads(record.DESIGNS.read_text())

pytestmark = pytest.mark.long


@pytest.mark.parametrize("name", record.DESIGN_CASES)
def test_designs_are_the_recorded_ones(name):
    design, recorded = record.reference(record.designed(record.DESIGN_CASES[name])), RECORDED[name]
    # Searches stop within 1e-5 of their optimum, near which places matter by the root of that.
    assert design["value"] == pytest.approx(recorded["value"], rel=1e-4)
    assert design["criteria"] == pytest.approx(recorded["criteria"], rel=1e-3)
    points = np.array(recorded["points"])
    np.testing.assert_allclose(design["points"], points, atol=3e-3 * np.abs(points[:, :2]).max())
