"""The design in the address of the page: links, tabs, servers that go and come."""

import re

import pytest
from sentences import sentence

from tests.support.studio import Studio, free_port, link_of, serving, type_in

pytestmark = pytest.mark.browser


def test_a_link_of_a_server_that_is_gone_is_pasted(studio):
    studio.drag(2, -30, -20)
    moved, link = studio.state(), studio.page.evaluate("() => location.href")
    studio.page.click("#undo")
    studio.settle()
    studio.paste(re.sub("//[^#]*", "//127.0.0.1:1/gone/", link))
    studio.until("() => document.getElementById('said').textContent === 'The design of the link.'")
    assert studio.state() == moved


def test_two_tabs_are_independent_and_the_address_holds_the_design(studio, address, opened):
    studio.drag(2, -30, -20)
    link, moved = studio.page.evaluate("() => location.href"), studio.degrees()
    with opened(link, lambda url: url.startswith((address, "blob:"))) as page:
        other = Studio(page)
        assert other.degrees() == moved
        other.drag(2, 10, -30)
        assert other.degrees() != moved
    studio.page.reload()
    assert studio.degrees() == moved


def test_a_server_that_goes_leaves_the_design(chromium):
    port = free_port()
    context = chromium.new_context()
    page = context.new_page()
    studio = Studio(page)
    with serving(port) as address:
        page.goto(address)
        studio.settle()
    page.locator("#canvas .dot").nth(1).focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#gone:not([hidden])")
    assert studio.state()["points"]
    context.close()


def test_the_design_is_taken_from_one_server_to_the_next(opened):
    """A server that starts anew has another token: its page takes the address of the old one."""
    port = free_port()
    with serving(port) as address, opened(address, lambda url: url.startswith((address, "blob:"))) as page:
        studio = Studio(page)
        studio.drag(2, -30, -20)
        moved, link, error = studio.state(), page.evaluate("() => location.href"), studio.degrees()
    with serving(port) as again, opened(again, lambda url: url.startswith((again, "blob:"))) as page:
        assert again != address
        studio = Studio(page)
        studio.settle()
        studio.paste(link)
        studio.until("() => document.getElementById('said').textContent === 'The design of the link.'")
        assert (studio.state(), studio.degrees()) == (moved, error)


def test_a_server_that_is_out_of_reach_for_a_while_is_found_again(refusing):
    before = refusing.degrees()
    refusing.page.context.set_offline(True)
    refusing.page.locator("#canvas .dot").nth(1).focus()
    refusing.page.keyboard.press("Shift+ArrowDown")
    refusing.page.wait_for_selector("#gone:not([hidden])")
    assert refusing.degrees() == before
    refusing.page.context.set_offline(False)
    refusing.page.wait_for_selector("#gone", state="hidden")
    refusing.until("() => document.getElementById('plan') && document.querySelector('main').ariaBusy === 'false'")
    assert refusing.degrees() != before
    assert "points" in refusing.state()


def test_whoever_waits_for_a_server_that_is_gone_is_told(refusing, tmp_path):
    from PIL import Image

    Image.new("L", (320, 240), 200).save(tmp_path / "empty.png")
    refusing.page.context.set_offline(True)
    refusing.page.click("#download")
    refusing.page.wait_for_selector("#gone:not([hidden])")
    assert refusing.said() == sentence("no answer")
    refusing.give(tmp_path / "empty.png")
    refusing.page.wait_for_selector("figcaption:has-text('empty.png: not looked at')")
    refusing.page.evaluate("() => window.scrollTo(0, document.body.scrollHeight)")
    banner = refusing.page.locator("#gone").bounding_box()
    assert 0 <= banner["y"] <= 720 - banner["height"]
    refusing.page.context.set_offline(False)


def test_the_skip_link_keeps_the_design(studio):
    type_in(studio, "n", "7")
    before = studio.state()
    studio.page.locator("#skip").focus()
    studio.page.keyboard.press("Enter")
    assert studio.page.evaluate("() => document.activeElement.id") == "marker"
    assert studio.state() == before
    studio.page.reload()
    assert studio.dots() == 7


def test_a_link_that_is_no_design_is_told_and_shown_in_the_form(refusing):
    refusing.paste(link_of({"n": 3}))
    refusing.page.wait_for_selector("#option-n[aria-invalid]")
    assert "found n=3" in refusing.said()
    assert refusing.page.locator("#option-n").input_value() == "3"
    refusing.page.click("#undo")
    assert refusing.dots() == 5
    assert refusing.page.locator("#option-n").input_value() == ""
    refusing.page.click("#redo")
    refusing.page.wait_for_selector("#option-n[aria-invalid]")
    assert refusing.page.locator("#option-n").input_value() == "3"
    # A page that begins with it has nothing to copy.
    refusing.page.reload()
    refusing.page.wait_for_selector("#option-n[aria-invalid]")
    assert refusing.page.locator("#option-n").input_value() == "3"
    refusing.copy("command")
    refusing.until("() => document.getElementById('said').textContent.includes('found n=3')")
