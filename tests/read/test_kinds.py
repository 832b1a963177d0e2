"""Each file is of the kind that its content shows, whatever its name."""

import pytest

from markergen.errors import InputError
from markergen.read.dot_tables import read_measured
from markergen.read.kinds import kinds_of
from markergen.read.rig_plates import read_plates
from markergen.read.templates import read_template

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


@pytest.mark.parametrize("text", ['password = "hunter2"\n', "password,user\nhunter2,me\n", '{"password": "hunter2"}'])
def test_what_is_no_spec_list_or_table_is_not_quoted(tmp_path, text):
    for ending, read in ((".toml", read_template), (".toml", read_plates), (".json", read_plates),
                         (".csv", read_plates), (".csv", read_measured)):  # fmt: skip
        (tmp_path / f"a{ending}").write_text(text)
        path = tmp_path / f"a{ending}"
        with pytest.raises(InputError) as caught:
            read(str(path) if read is read_template else path)
        assert "hunter2" not in str(caught.value)
        assert "password" not in str(caught.value)
