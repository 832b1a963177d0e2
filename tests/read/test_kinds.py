"""Each file is of the kind that its content shows, whatever its name."""

import pytest

from markergen.errors import InputError
from markergen.read.kinds import kinds_of

FILE = "file.bin"
FILES = {
    "camera": ["camera_matrix: [1,0,0,0,1,0,0,0,1]\n", "<opencv_storage><camera_matrix>1</camera_matrix>"
               "</opencv_storage>", "%YAML:1.0\n---\nCamera.fx: 9\n"],
    "poses": ["tx,ty,tz,qx,qy,qz,qw\n", "1 2 3 4 5 6 7 8\n", '[{"tx": 1}]', '{"poses": []}', "# a\n1,2,3,0,0,0,1,0\n"],
    "outline": ["<svg xmlns='http://www.w3.org/2000/svg'/>", "0\nSECTION\n", '{"type": "Polygon"}',
                "(kicad_pcb (version 1))"],
    "points": ["id,x,y\n", "id;x_mm;y_mm\n0;1;2\n"],
    "marker": ['{"control_points": []}'],
}  # fmt: skip


@pytest.mark.parametrize(("kind", "text"), [(kind, text) for kind, texts in FILES.items() for text in texts])
def test_kinds_by_content(write, kind, text):
    assert kinds_of(write(text)) == [kind]


@pytest.mark.parametrize("text", ["", "a secret line\n", "\0\1\2", "{}", "[1, 2]", "<html/>", "{" * 100_000])
def test_none_of_them_is_quoted(write, text):
    with pytest.raises(InputError) as caught:
        kinds_of(write(text))
    assert "secret" not in str(caught.value)


def test_a_program_that_is_not_read_is_named(write):
    with pytest.raises(InputError, match="NumPy"):
        kinds_of(write(b"\x93NUMPY\x01\x00"))
