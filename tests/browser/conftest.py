"""A browser for pages: Chromium, offline, that tells what goes wrong in a page; and pages of the studio."""

import os
import shutil
from contextlib import contextmanager

import pytest

from tests.support.studio import Studio, free_port, link_of, serving

ARGUMENTS = ("--no-sandbox", "--disable-background-networking", "--disable-component-update")


@pytest.fixture(scope="session")
def launched():
    """Start an installed Chromium with further arguments."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: make test-browser installs it")
    path = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    if not path:
        pytest.skip("no Chromium in the path")
    with playwright.sync_playwright() as started:

        @contextmanager
        def launched(*arguments):
            browser = started.chromium.launch(executable_path=path, args=[*ARGUMENTS, *arguments])
            yield browser
            browser.close()

        yield launched


@pytest.fixture(scope="session")
def chromium(launched):
    with launched("--enable-unsafe-swiftshader") as browser:
        yield browser


@pytest.fixture(scope="session")
def opened(chromium):
    """Open an address; when closed, the page must have thrown no error and asked for nothing but `allowed`."""

    @contextmanager
    def opened(address, allowed=lambda url: False, **looks):
        context = chromium.new_context(**looks)
        page, wrong = context.new_page(), []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on(
            "request",
            lambda asked: (
                None
                if asked.url == address or asked.url.startswith("data:") or allowed(asked.url)
                else wrong.append(asked.url)
            ),
        )
        page.goto(address)
        yield page
        context.close()
        assert not wrong

    return opened


@pytest.fixture(scope="session")
def address():
    pytest.importorskip("starlette", reason="no starlette: pip install 'markergen[studio]'")
    with serving(free_port()) as result:
        yield result


@pytest.fixture
def studio(address, opened):
    with opened(
        link_of({}, address), lambda url: url.startswith((address, "blob:" + address[: address.index("/", 8)]))
    ) as page:
        result = Studio(page)
        result.settle()
        yield result


@pytest.fixture
def refusing(address, chromium):
    """A page where requests may be refused, which browsers report as errors; nothing else may go wrong."""
    context = chromium.new_context()
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(link_of({}, address))
    result = Studio(page)
    result.settle()
    yield result
    context.close()
    assert not wrong
