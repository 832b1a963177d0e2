"""Stored markers and rigs are exported to the same bytes as when exports.json was recorded.

If bytes change on purpose, record them anew (``python tests/golden/record.py exports``) and say in the commit what
changed; ``record.py results`` and ``record.py diff`` show it, see there.
"""

import json

import pytest

from markergen.exporters import EXPORTERS
from tests.golden import record

RECORDED = json.loads(record.EXPORTS.read_text())
SUFFIXES = {"sheets": (*record.POINTS, *record.SHEETS), "solids": record.KERNEL}


QUICK = ("disk", "pad", "relief", "disk through")
TABLE = [
    pytest.param(part, name, marks=[pytest.mark.long] * (part == "solids" and name not in QUICK))
    for name, *_, taken in record.CASES
    for part in SUFFIXES
    if not set(SUFFIXES[part]).isdisjoint(taken)
]


@pytest.mark.parametrize(("part", "case"), TABLE)
def test_exports_have_the_recorded_bytes(part, case):
    recorded, installed = RECORDED[part]["versions"], record.versions(part)
    others = [
        f"{name} {number}, here {installed[name]}" for name, number in recorded.items() if installed[name] != number
    ]
    if others:
        pytest.skip(f"recorded with {', '.join(others)}")
    assert record.table(SUFFIXES[part], [case])[case] == RECORDED[part]["exports"][case]


def test_every_format_is_recorded():
    assert set(record.EVERY) == set(EXPORTERS)
