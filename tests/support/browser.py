"""A page as a reader's browser shows it: headless Chromium, and what it had to say."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@dataclass
class Opened:
    """A page in the browser.

    Attributes:
        page: playwright's page.
        address: where it was opened from.
        complaints: errors and warnings of the console, uncaught errors and dialogs.
        requests: addresses of all that was asked for, but for data: addresses.
    """

    page: Any
    address: str
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def listen(self) -> None:
        self.page.on("console", lambda m: self.complaints.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.complaints.append(dialog.message), dialog.dismiss()))
        self.page.on("request", lambda r: None if r.url.startswith("data:") else self.requests.append(r.url))

    @property
    def alone(self) -> bool:
        """Whether the file was all that was asked for."""
        return self.requests == [self.address]

    @property
    def overhang(self) -> int:
        """Pixels by which the page is wider than the window."""
        return self.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")

    @property
    def broken_images(self) -> list[str]:
        """Alternative texts of the images that did not load."""
        return self.page.evaluate(
            "[...document.images].filter(i => !i.complete || i.naturalWidth === 0).map(i => i.alt || '(no alt)')"
        )


@pytest.fixture(scope="module")
def browser():
    """Chromium; the test is skipped where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason='no playwright: pip install -e ".[dev]"')
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("no browser: apt-get install chromium, or put one of " + ", ".join(NAMES) + " on the PATH")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture
def browser_page(browser):
    """Open a file: `with browser_page(path, width, height) as opened`; `dark=True` for a reader who likes it so."""

    @contextmanager
    def open_page(path, width, height, *, dark=False) -> Iterator[Opened]:
        scheme = "dark" if dark else "light"
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        opened = Opened(page, path.resolve().as_uri())
        opened.listen()
        page.goto(opened.address)
        try:
            yield opened
        finally:
            page.close()

    return open_page
