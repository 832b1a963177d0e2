"""Files to read, and the one line that reading them ends with."""

from pathlib import Path

import pytest
from drawings import read_outline

from markergen.errors import InputError


@pytest.fixture
def refused(write):
    """Words of the one line that reading ends with."""

    def refused(content, **options):
        path = content if isinstance(content, Path) else write(content)
        with pytest.raises(InputError) as caught:
            read_outline(path, **options)
        message = str(caught.value)
        assert "\n" not in message
        assert len(message) < 700
        return message

    return refused
