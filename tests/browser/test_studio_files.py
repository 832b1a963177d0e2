"""Files that the studio opens: markers, specs, drawings, cameras, photographs."""

import json
from io import StringIO

import numpy as np
import pytest

import markergen as mg
from tests.support.studio import PLATE, SHEET, Studio, free_port, link_of, serving, type_in, uploads

pytestmark = pytest.mark.browser


def test_files_are_opened(studio, tmp_path):
    mg.design(n=7, radius="80mm", restarts=2).marker.save(tmp_path / "seven.json")
    studio.give(tmp_path / "seven.json")
    studio.page.wait_for_selector("#canvas .dot:nth-child(7)")
    assert studio.dots() == 7
    (tmp_path / "spec.toml").write_text('n = 6\nradius = "90mm"\n')
    studio.give(tmp_path / "spec.toml")
    studio.page.wait_for_selector("#canvas .dot:nth-child(7)", state="detached")
    assert studio.dots() == 6
    drawing = '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">'
    (tmp_path / "plate.svg").write_text(drawing + '<path d="M20,20 h200 v160 h-200 z"/></svg>')
    studio.give(tmp_path / "plate.svg")
    studio.page.click("#drop button[value=boundary]")
    studio.page.wait_for_selector("#clear:not([hidden])")
    assert studio.state()["boundary"]["kind"] == "polygon"


def drawings():
    import ezdxf

    svg = '<svg xmlns="http://www.w3.org/2000/svg" width="{0}mm" height="{0}mm" viewBox="0 0 {0} {0}">{1}</svg>'
    yield "boundary", "plate.svg", svg.format(200, '<path d="M0,0 h200 v200 h-200 z"/>').encode()
    yield "keep_out", "hole.svg", svg.format(20, '<path d="M0,0 h20 v20 h-20 z"/>').encode()
    drawing = ezdxf.new(units=ezdxf.units.MM)
    drawing.modelspace().add_lwpolyline([(0, 0), (200, 0), (200, 160), (0, 160)], close=True)
    text = StringIO()
    drawing.write(text)
    yield "boundary", "plate.dxf", text.getvalue().encode()


def dropped(studio, name, data):
    studio.page.evaluate(
        """([name, bytes]) => {
          const held = new DataTransfer();
          held.items.add(new File([new Uint8Array(bytes)], name));
          for (const name of ["dragenter", "drop"]) {
            const looks = {dataTransfer: held, bubbles: true, cancelable: true};
            document.body.dispatchEvent(new DragEvent(name, looks));
          }
        }""",
        [name, list(data)],
    )


@pytest.mark.parametrize(("use", "name", "data"), [*drawings()], ids=lambda each: each if isinstance(each, str) else "")
def test_drawings_are_dropped(studio, use, name, data):
    dropped(studio, name, data)
    studio.page.click(f"#drop button[value={use}]")
    studio.until(f"() => document.getElementById('said').textContent.startsWith({name!r})")
    shape = studio.state()[use]
    assert (shape if use == "boundary" else shape[0])["kind"] == "polygon"


def test_a_drawing_whose_use_is_not_chosen_changes_nothing(studio, tmp_path):
    drawing = '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">'
    (tmp_path / "plate.svg").write_text(drawing + '<path d="M20,20 h200 v160 h-200 z"/></svg>')
    studio.give(tmp_path / "plate.svg")
    studio.page.click("#drop button[value=boundary]")
    studio.page.wait_for_selector("#clear:not([hidden])")
    studio.page.click("#undo")
    before = studio.state()
    studio.give(tmp_path / "plate.svg")
    studio.page.wait_for_selector("#drop[open]")
    studio.page.keyboard.press("Escape")
    studio.page.wait_for_selector("#drop", state="hidden")
    assert studio.state() == before


def test_a_photograph_is_searched(studio, tmp_path):
    from PIL import Image

    studio.page.wait_for_selector("body[data-rested]", timeout=60_000)
    marker = mg.design(n=5).marker
    setting = mg.Camera(640, 480, 800, 800, 320, 240)
    from markergen.render import Optics, render_view

    image = render_view(
        marker, setting, np.diag([1.0, -1, -1]), np.array([0, 0, 0.8]), Optics(), np.random.default_rng(1)
    )
    Image.fromarray(image).save(tmp_path / "seen.png")
    Image.fromarray(np.full_like(image, 200)).save(tmp_path / "empty.png")
    studio.give(tmp_path / "seen.png", tmp_path / "empty.png")
    studio.until("() => document.querySelectorAll('#photos figcaption').length === 2")
    studio.until("() => !document.getElementById('photos').textContent.includes('looking')")
    message = studio.page.locator("#photos").inner_text()
    assert "seen.png: found, 5 dots" in message
    assert "empty.png: not found" in message


def test_a_camera_file_gives_photographs_their_pose_and_the_calibration_its_share(studio, tmp_path):
    from PIL import Image

    from markergen.render import Optics, render_view

    setting = mg.Camera(640, 480, 800, 800, 320, 240)
    assert "calibration 0 %" in studio.page.locator("#limits").inner_text()
    (tmp_path / "camera.yaml").write_text(
        "width: 640\nheight: 480\nfx: 800\nfy: 800\ncx: 320\ncy: 240\n"
        "camera_parameters: [fx, fy, cx, cy]\n"
        "camera_covariance: [[4, 0, 0, 0], [0, 4, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]]\n"
    )
    rotated, place = np.diag([1.0, -1, -1]), np.array([0, 0, 0.8])
    image = render_view(mg.design(n=5).marker, setting, rotated, place, Optics(), np.random.default_rng(1))
    Image.fromarray(image).save(tmp_path / "seen.png")
    studio.give(tmp_path / "camera.yaml", tmp_path / "seen.png")
    studio.until("() => /found, 5 dots. 0.8\\d* m away/.test(document.getElementById('photos').textContent)")
    assert studio.state()["camera_covariance"][2] == [0, 0, 2, 0]
    assert "calibration 0 %" not in studio.page.locator("#limits").inner_text()
    studio.page.reload()
    assert "calibration 0 %" not in studio.page.locator("#limits").inner_text()


def test_photographs_calibrate_and_what_they_measure_is_downloaded(studio, tmp_path):
    from PIL import Image

    from markergen.render import Optics, render_view

    setting, poses = (
        mg.Camera(640, 480, 800, 800, 320, 240),
        mg.Poses.load("cone:distance=0.6..0.9,tilt=20..50,count=8"),
    )
    marker, rng = mg.design(n=5).marker, np.random.default_rng(1)
    for k, (rotated, place) in enumerate(zip(poses.rotation, poses.translation, strict=True)):
        image = render_view(marker, setting, rotated, place, Optics(), rng)
        Image.fromarray(image).save(tmp_path / f"{k}.png")
    assert studio.page.is_hidden("#calibrate")
    studio.give(*(tmp_path / f"{k}.png" for k in range(8)))
    studio.until("() => document.querySelectorAll('#photos figcaption').length === 8")
    studio.until("() => !document.getElementById('photos').textContent.includes('looking')")
    studio.page.click("#calibrate")
    studio.page.wait_for_selector("#calibration button", timeout=120_000)
    assert "a pose error of" in studio.page.locator("#calibration").inner_text()
    for name, load in (("measured.json", mg.Marker.load), ("camera.yaml", mg.Camera.load)):
        with studio.page.expect_download() as download:
            studio.page.click(f"#calibration button:has-text('{name}')")
        assert download.value.suggested_filename == name
        download.value.save_as(tmp_path / name)
        load(tmp_path / name)
    studio.page.click("#photos-away")
    assert studio.page.is_hidden("#calibrate")
    assert not studio.page.locator("#calibration").inner_text()


def test_bad_files_and_values_are_refused_in_a_line_and_change_nothing(refusing, tmp_path):
    before = refusing.state()
    for name, data, message in (
        ("bad.json", b'{"a": 1}', "bad.json"),
        ("bad.toml", b"n = [", "bad.toml"),
        ("bad.svg", b"<svg", "bad.svg"),
        ("cut.json", json.dumps({"schema": "markergen/2"}).encode()[:-3], "cut.json"),
    ):
        (tmp_path / name).write_bytes(data)
        refusing.give(tmp_path / name)
        refusing.page.wait_for_selector(f"#said.fault:has-text('{message}')")
        assert refusing.state() == before
    refusing.page.locator("#option-radius").fill("wide")
    refusing.page.keyboard.press("Tab")
    refusing.page.wait_for_selector("#option-radius[aria-invalid]")
    refusing.page.click("#undo")
    assert refusing.dots() == 5


def test_photographs_are_told_and_taken_away(studio, tmp_path):
    from PIL import Image

    Image.new("L", (320, 240), 200).save(tmp_path / "empty.png")
    # It stands above the photographs, and moves them down when it comes.
    studio.page.wait_for_selector("#view", state="visible")
    studio.give(tmp_path / "empty.png")
    studio.until("() => document.getElementById('said').textContent.startsWith('empty.png: not found')")
    studio.page.wait_for_selector("#photos img", state="visible")
    at = "document.querySelector('#photos figcaption').getBoundingClientRect()"
    studio.until(f"() => {at}.top > 0 && {at}.bottom < innerHeight")
    studio.page.get_by_role("button", name="Remove photographs").click()
    assert studio.page.locator("#photos figure").count() == 0
    assert studio.page.locator("#photos-away").is_hidden()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("plate.svg", '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="200mm" viewBox="0 0 240 200">'
         '<path d="M20,20 h200 v160 h-200 z"/><text x="30" y="30">plate</text></svg>'),
        ("cam.yaml", "width: 1080\nheight: 1920\nfx: 1000\nfy: 1000\ncx: 960\ncy: 540\nmodel: fisheye\nscale: 2\n"
         "D: [-0.01, 0, 0, 0]\n"),
        ("poses.csv", "tx_mm,ty_mm,tz_mm,rx,ry,rz,scale\n0,0,1000,3.14159,0,0,1\n0,0,1200,3.14159,0.3,0,1\n"),
    ],
)  # fmt: skip
def test_what_is_dropped_is_inspected(studio, tmp_path, name, text):
    (tmp_path / name).write_text(text)
    inspection = mg.inspect(tmp_path / name)
    dropped(studio, name, text.encode())
    if name.endswith(".svg"):
        studio.page.wait_for_selector("#drop-said:has-text('area')")
        studio.page.click("#drop button[value=boundary]")
    studio.until(f"() => document.getElementById('said').textContent.startsWith({name + ': '!r})")
    note = studio.page.locator("#said").inner_text()
    for row, value in inspection.facts[0].rows.items():
        assert f"{row} {value}" in note
    assert inspection.remarks
    for line in inspection.remarks:
        assert line.replace(f"{tmp_path}/", "") in note


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("mei.yaml", "model_type: MEI\nprojection_parameters:\n   gamma1: 700\n"),
        ("body.csv", "#time, p_RS_x [m], p_RS_y [m], p_RS_z [m], q_RS_w, q_RS_x, q_RS_y, q_RS_z\n0,0,0,1,0,1,0,0\n"),
        ("board.kicad_pcb", '(kicad_pcb (gr_line (start 0 0) (end 9 0'),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_and_never_500(refusing, tmp_path, name, text):
    before = refusing.state()
    statuses = []
    refusing.page.on("response", lambda response: statuses.append(response.status))
    dropped(refusing, name, text.encode())
    refusing.page.wait_for_selector(".fault:has-text('xpected')")
    assert refusing.state() == before
    assert statuses
    assert all(status < 300 or 400 <= status < 500 for status in statuses)


def test_a_dxf_is_a_drawing_whatever_type_the_browser_gives_it(studio, tmp_path):
    [_, _, (_, name, data)] = drawings()
    (tmp_path / name).write_bytes(data)
    studio.give(tmp_path / name)
    studio.page.click("#drop-room")
    studio.until(
        "() => document.getElementById('said').textContent.startsWith('plate.dxf: rectangle of 200 mm x 160 mm')"
    )
    assert studio.state()["boundary"]["kind"] == "polygon"
    assert studio.page.locator("#photos figure").count() == 0


@pytest.mark.parametrize(
    ("name", "text", "option"),
    [
        ("plate.svg", PLATE, "boundary"),
        ("camera.yaml", "width: 640\nheight: 480\nfx: 700\nfy: 700\ncx: 320\ncy: 240\n", "camera"),
        ("poses.csv", "tx,ty,tz,rx,ry,rz\n0,0,1,3.14159,0,0\n0,0,1.2,3.14159,0.3,0\n", "poses"),
        ("dots.csv", "x_mm,y_mm\n0,90\n80,0\n-80,0\n0,-85\n", "points"),
    ],
)
def test_it_begins_with_any_file_that_can_be_opened(opened, tmp_path, name, text, option):
    with (
        serving(free_port(), uploads(tmp_path, name, text)) as address,
        opened(address, lambda url: url.startswith((address, "blob:"))) as page,
    ):
        studio = Studio(page)
        if option == "boundary":
            page.click("#drop-room")
        studio.until(f"() => document.getElementById('said').textContent.startsWith('{name}: ')")
        assert studio.state()[option]


def test_keep_outs_of_the_sheet_of_the_room_lie_where_they_are_drawn(studio, tmp_path):
    holes = uploads(tmp_path, "holes.svg", SHEET.format('<circle cx="50" cy="50" r="10"/>'))
    plate = uploads(tmp_path, "plate.svg", PLATE)
    studio.give(plate)
    studio.page.click("#drop-room")
    studio.page.wait_for_selector("#clear:not([hidden])")
    studio.settle()
    studio.page.reload()
    studio.settle()
    studio.give(holes)
    studio.page.click("#drop-keep")
    studio.page.wait_for_selector("#canvas .out")
    [ours] = mg.design(
        **{name: item for name, item in studio.state().items() if name != "drawing_center"}
    ).spec.keep_outs
    [same] = mg.design(n=5, boundary=plate, keep_out=[holes]).spec.keep_outs
    assert ours == same
    assert ours.center == pytest.approx((-0.07, 0.05))


def test_a_drawing_that_is_no_room_does_not_look_like_one(refusing, tmp_path):
    type_in(refusing, "dot", "30mm")
    refusing.give(uploads(tmp_path, "tiny.svg", PLATE.replace("300mm", "3mm")))
    refusing.page.click("#drop-room")
    refusing.page.wait_for_selector("#said.fault")
    assert not refusing.said().startswith("tiny.svg: ")


def test_photographs_are_taken_with_the_camera_of_the_state(studio, tmp_path):
    from PIL import Image

    from markergen.render import Optics, render_view

    setting = mg.Camera(640, 480, 800, 800, 320, 240)
    rotated, place = np.diag([1.0, -1, -1]), np.array([0, 0, 0.8])
    image = render_view(mg.design(n=5).marker, setting, rotated, place, Optics(), np.random.default_rng(1))
    Image.fromarray(image).save(tmp_path / "seen.png")
    studio.give(uploads(tmp_path, "camera.yaml", "width: 640\nheight: 480\nfx: 800\nfy: 800\ncx: 320\ncy: 240\n"))
    studio.until("() => document.getElementById('said').textContent.startsWith('camera.yaml')")
    studio.page.reload()
    studio.settle()
    assert studio.state()["camera"]["fx"] == 800
    studio.give(tmp_path / "seen.png")
    studio.until("() => /found, 5 dots. 0.8\\d* m away/.test(document.getElementById('photos').textContent)")
    type_in(studio, "n", "5")
    studio.paste(link_of({"n": 5}))
    studio.until("() => document.getElementById('said').textContent === 'The design of the link.'")
    studio.give(tmp_path / "seen.png")
    studio.until("() => /Give a camera file/.test(document.querySelector('#photos').textContent)")


def test_a_drawing_is_asked_for_its_unit_and_layer(studio, tmp_path):
    import ezdxf

    bare = PLATE.replace('width="300mm" height="300mm" ', "")
    studio.give(uploads(tmp_path, "bare.svg", bare))
    studio.page.wait_for_selector("#drop-said.fault:has-text('a unit of length')")
    assert studio.page.locator("#drop-room").is_disabled()
    studio.page.select_option("#drop-unit", "cm")
    studio.page.wait_for_selector("#drop-said:has-text('rectangle of 2 m x 1.6 m')")
    studio.page.select_option("#drop-unit", "mm")
    studio.page.wait_for_selector("#drop-said:has-text('rectangle of 200 mm x 160 mm')")
    studio.page.click("#drop-room")
    studio.until("() => document.getElementById('said').textContent.startsWith('bare.svg: rectangle of 200 mm')")
    drawing = ezdxf.new(units=ezdxf.units.MM)
    for name, size in (("PLATE", 120), ("FRAME", 300)):
        points = [(0, 0), (size, 0), (size, size), (0, size)]
        drawing.modelspace().add_lwpolyline(points, close=True, dxfattribs={"layer": name})
    drawing.saveas(tmp_path / "layers.dxf")
    studio.give(tmp_path / "layers.dxf")
    studio.page.fill("#drop-layer", "PLAT")
    studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("#drop-said.fault:has-text(\"'PLATE'\")")
    studio.page.fill("#drop-layer", "FRAME")
    studio.page.keyboard.press("Enter")
    studio.page.wait_for_selector("#drop-said:has-text('rectangle of 300 mm x 300 mm')")
    studio.page.fill("#drop-layer", "PLATE")
    studio.page.click("#drop-room")
    studio.until("() => document.getElementById('said').textContent.startsWith('layers.dxf')")
    assert studio.state()["boundary"]["outlines"] == [[[-0.06, -0.06], [0.06, -0.06], [0.06, 0.06], [-0.06, 0.06]]]
    # Fields that the page has no drawing for are not there.
    for name in ("boundary_unit", "layer", "origin"):
        assert studio.page.locator(f"#option-{name}").count() == 0
