"""A page that computes within a report: it runs alone, what else would run does not."""

import base64
import hashlib
import threading
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from pages import sample_page

from ident.report.page import Frame, Section, write_page

SCRIPT = 'document.querySelector("p").textContent = "1 < 2 & \\"3\\"";'
INTRUDER = "document.body.append('intruder');"
REACHING = """<p></p><script>{script}</script><script>{intruder}</script>
<img src="{image}" onerror="{intruder}">"""


def framed(image):
    html = REACHING.format(script=SCRIPT, intruder=INTRUDER, image=image)
    hashed = "sha256-" + base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
    page = sample_page()
    section = Section("To touch", ("By hand.",), frame=Frame(html, hashed, "A computing page", "It computes."))
    return replace(page, sections=(*page.sections, section))


@pytest.fixture
def listener():
    """A server and the paths that it was asked for."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}", asked
        server.shutdown()


def test_only_the_named_script_runs_and_nothing_is_asked_for(browser_page, tmp_path, listener):
    address, asked = listener
    write_page(framed(f"{address}/x.png"), tmp_path / "page.html")
    with browser_page(tmp_path / "page.html", 390, 800) as opened:
        opened.page.locator("iframe").scroll_into_view_if_needed()
        opened.page.frame_locator("iframe").get_by_text('1 < 2 & "3"').wait_for()
        inner = opened.page.frames[1]
        assert "intruder" not in inner.inner_text("body")
        assert inner.evaluate("self.origin") == "null"
        inner.wait_for_timeout(300)
        assert asked == []
        opened.page.evaluate("address => fetch(address, { mode: 'no-cors' }).catch(() => 0)", f"{address}/refused")
        assert asked == []
        opened.page.context.request.get(f"{address}/control")
        assert asked == ["/control"]
        assert opened.overhang <= 0
        assert opened.complaints
        assert all("Content Security Policy" in words for words in opened.complaints), opened.complaints
        opened.page.emulate_media(media="print")
        assert not opened.page.locator("iframe").is_visible()


def test_a_page_without_a_frame_admits_no_script(browser_page, tmp_path):
    write_page(sample_page(), tmp_path / "page.html")
    assert "script-src" not in (tmp_path / "page.html").read_text("utf-8")
