"""The studio's first screen: what is in the printer, the camera, the distance; and answers at the field."""

import pytest

from tests.support.studio import Studio, link_of, type_in

pytestmark = pytest.mark.browser

TARGETS = """() => [...document.querySelectorAll("button, select, summary, input:not([type=checkbox], [type=file])")]
  .filter((each) => each.checkVisibility() && each.getBoundingClientRect().height < 44)
  .map((each) => each.id || each.textContent)"""


def allowed(address):
    return lambda url: url.startswith((address, "blob:"))


def test_it_begins_with_the_best_layout_for_the_page_in_the_printer(address, opened):
    with opened(address, allowed(address)) as page:
        studio = Studio(page)
        studio.settle()
        page.wait_for_selector("#undo:enabled", timeout=120_000)
        state = studio.state()
        assert state["boundary"] == "page"
        assert state["paper"] == page.input_value("#first-paper")
        assert state["points"]
        page.select_option("#first-camera", "phone")
        assert studio.state()["camera"] == "phone"
        page.fill("#first-far", "3")
        page.keyboard.press("Tab")
        assert studio.state()["poses"] == "cone:distance=1.2..3m,tilt=0..70"
        page.click("#sheet summary")
        page.wait_for_selector("#page[src]", timeout=120_000)
        studio.until(
            "() => document.getElementById('page').naturalHeight > document.getElementById('page').naturalWidth"
        )


def test_another_answer_moves_the_dots_and_keeps_their_number(address, opened):
    state = {"points": "0mm,60mm; -60mm,0mm; 0mm,-60mm; 60mm,0mm", "dot": "12mm", "radius": "90mm"}
    with opened(link_of(state, address), allowed(address)) as page:
        studio = Studio(page)
        studio.settle()
        page.fill("#first-far", "1")
        page.keyboard.press("Tab")
        after = studio.state()
        assert (after.get("points"), after["n"]) == (None, 4)


def test_it_answers_at_the_field(refusing):
    type_in(refusing, "n", "abc")
    fault = refusing.page.locator(".option:has(#option-n) .fault")
    fault.wait_for()
    assert "whole number" in fault.inner_text()
    type_in(refusing, "n", "6")
    fault.wait_for(state="hidden")


@pytest.mark.parametrize(
    ("name", "typed", "taken"),
    [
        ("radius", "80", "80mm"),
        ("radius", "0,08", "0,08"),
        ("keep_out", "circle:5@-10,.5 | rect:4 x 6", "circle:5mm@-10mm,.5mm | rect:4mm x 6mm"),
        ("mount", "4xM3@120/45 | M2.5:1,2; -3,4 | 4x3.4@110", "4xM3@120mm/45 | M2.5:1mm,2mm; -3mm,4mm | 4x3.4mm@110mm"),
    ],
)
def test_a_length_without_a_unit_is_in_mm(refusing, name, typed, taken):
    type_in(refusing, name, typed)
    refusing.settle()
    assert refusing.page.input_value(f"#option-{name}") == taken


def test_an_option_is_found_by_what_it_is_for(studio):
    for word, names in (("bore", {"mount", "dowel"}), ("screw", {"mount"}), ("hole", {"mount", "dowel", "keep_out"})):
        studio.page.fill("#find", word)
        visible = studio.page.eval_on_selector_all(
            ".option:not([hidden]) input", "(fields) => fields.map(({id}) => id)"
        )
        assert names <= {field.removeprefix("option-") for field in visible}
        assert "option-n" not in visible
        assert not studio.said()
    studio.page.fill("#find", "xyzzy")
    assert studio.said()


def test_one_menu_copies(studio):
    assert not studio.page.locator("#command").is_visible()
    studio.page.click("#copy")
    studio.page.click("#share")
    studio.until("() => document.getElementById('said').textContent.startsWith('Cop')")
    assert not studio.page.locator("#share").is_visible()


def test_on_a_phone_options_come_first_and_fingers_meet_them(address, opened):
    looks = {"viewport": {"width": 400, "height": 800}, "has_touch": True, "is_mobile": True}
    with opened(address, allowed(address), **looks) as page:
        Studio(page).settle()
        first, marker = (page.locator(name).bounding_box() for name in ("#first", "#marker"))
        assert first["y"] + first["height"] < min(800, marker["y"])
        assert page.evaluate(TARGETS) == []


def test_a_marker_that_is_opened_is_named(studio, tmp_path, pentagon):
    pentagon.save(tmp_path / "mine.json")
    studio.give(tmp_path / "mine.json")
    studio.until("() => document.getElementById('said').textContent.startsWith('mine.json: ')")
    assert studio.state()["radius"].endswith("mm")


@pytest.mark.parametrize("far", ["-1", "0"])
def test_a_distance_that_is_none_is_marked_and_nothing_is_downloaded(refusing, far):
    page = refusing.page
    page.fill("#first-far", far)
    page.keyboard.press("Tab")
    page.wait_for_selector("#first-far[aria-invalid=true]")
    assert f"distance={far}" in refusing.said()
    assert page.evaluate("() => getComputedStyle(document.getElementById('canvas')).opacity") == "0.55"
    loaded = []
    page.on("download", lambda download: loaded.append(download))
    page.click("#download")
    refusing.until("() => document.getElementById('said').classList.contains('fault')")
    page.fill("#first-far", "")
    page.keyboard.press("Tab")
    page.wait_for_selector("#first-far[aria-invalid=false]")
    refusing.settle()
    assert not loaded
    assert refusing.page.get_attribute("#first-far", "placeholder").endswith("the paper\u2019s")


def test_the_print_error_in_use_stands_in_its_field(refusing):
    planned = refusing.degrees()
    model = refusing.page.locator("#option-noise_model option").first
    assert refusing.page.get_attribute("#option-print_sigma", "placeholder") == "0.1mm"
    assert model.inner_text() == "point"
    type_in(refusing, "print_sigma", "0.1")
    assert refusing.degrees() == planned
    assert model.inner_text() == "image"
    type_in(refusing, "print_sigma", "0")
    refusing.page.wait_for_selector("#option-print_sigma[aria-invalid]")
    type_in(refusing, "print_sigma", "0.2")
    assert refusing.degrees() > planned


def test_a_size_that_a_search_has_found_is_no_choice_after_a_reload(address, opened):
    points = "0mm,60mm; -60mm,0mm; 0mm,-60mm; 60mm,0mm"
    state = {"points": points, "dot": "12mm", "sized": "12mm", "radius": "90mm"}
    with opened(link_of(state, address), allowed(address)) as page:
        studio = Studio(page)
        studio.settle()
        page.reload()
        studio.settle()
        page.select_option("#first-camera", "phone")
        assert not {"dot", "sized"} & studio.state().keys()


def test_an_emptied_room_is_the_page_again(studio):
    type_in(studio, "radius", "60mm")
    assert studio.state() == {"radius": "60mm"}
    type_in(studio, "radius", "")
    assert studio.state() == {"boundary": "page", "paper": studio.page.input_value("#first-paper")}


def test_a_double_click_begins_one_search(studio):
    type_in(studio, "n", "30")
    studio.settle()
    studio.page.dblclick("#optimize")
    studio.page.wait_for_selector("#optimize:text-is('Stop')")
    studio.page.wait_for_selector("#canvas .ghost", timeout=60_000, state="attached")
    studio.page.click("#optimize")


def test_dots_that_no_longer_fit_are_searched_for_anew_or_take_heights(address, opened):
    state = {"points": "0mm,60mm; -60mm,0mm; 0mm,-60mm; 60mm,0mm", "dot": "12mm", "sized": "12mm", "radius": "90mm"}
    with opened(link_of(state, address), allowed(address)) as page:
        studio = Studio(page)
        studio.settle()
        type_in(studio, "radius", "50mm")
        page.wait_for_selector("#problems li")
        assert "Optimize" in studio.said()
        assert "polygon." not in page.inner_text("#beside")
        type_in(studio, "relief", "10mm")
        studio.settle()
        page.wait_for_selector("#problems li", state="detached")
        assert studio.state() == {"radius": "50mm", "relief": "10mm", "n": 4}


def test_warnings_stand_below_the_marker(address, opened):
    points = "0mm,60mm; -60mm,0mm; 0mm,-60mm; 60mm,0mm"
    state = {"points": points, "dot": "12mm", "radius": "90mm", "dowel": "4mm:0mm,47mm", "poses": "cone:count=3"}
    with opened(link_of(state, address), allowed(address)) as page:
        page.wait_for_selector("#warnings li:has-text('quiet zones of dots')", timeout=60_000)
        assert "\u201cgap around dots\u201d" in page.inner_text("#warnings")


def test_options_in_a_refusal_are_fields(refusing):
    for name, value in (("radius", "300mm"), ("paper", "A4")):
        type_in(refusing, name, value)
    refusing.settle()
    refusing.page.select_option("#suffix", ".svg")
    refusing.page.click("#download")
    refusing.page.wait_for_selector("#said.fault")
    assert "markergen design" not in refusing.said()
    assert "use \u201cpaper\u201d A0" in refusing.said()
