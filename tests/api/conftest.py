"""Results to look at, made once: a few poses, a few trials, a few views."""

import sys
from types import SimpleNamespace

import pytest

from markergen.api.validate import validate


@pytest.fixture(scope="session")
def quick():
    """Options of a validation that takes seconds."""
    return {"poses": "cone:count=20", "runs": 20, "views": 4, "workers": 1}


@pytest.fixture(scope="module")
def proved(pentagon, quick):
    """A validation with trials and views, and the progress that was told."""
    calls = []
    validation = validate(pentagon, **quick, progress=lambda *call: calls.append(call))
    return SimpleNamespace(found=validation, calls=calls)


@pytest.fixture
def frames(monkeypatch):
    """A stand-in for pandas whose data frame is the list of rows that it is made of."""
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=list))
