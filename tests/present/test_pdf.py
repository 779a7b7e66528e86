"""Pages as PDF, by the browser of this machine."""

import shutil

import pytest

from ident.errors import InputError, ModelError
from ident.present.files.document import NAMES, find_browser, write_pdf

there = pytest.mark.skipif(not any(map(shutil.which, NAMES)), reason="no browser to print with")


@there
@pytest.mark.slow
def test_a_page_is_printed(tmp_path):
    page = tmp_path / "a page.html"
    page.write_text("<!DOCTYPE html><title>one</title><p>Some words.</p>")
    write_pdf(page, tmp_path / "a page.pdf")
    assert (tmp_path / "a page.pdf").read_bytes().startswith(b"%PDF-")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a page.html", "a page.pdf"]


def test_without_a_browser_it_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="pdf: got no browser that prints, expected chromium or"):
        find_browser()


def test_a_browser_that_fails_is_named_and_nothing_is_written(monkeypatch, tmp_path):
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    with pytest.raises(ModelError, match="could not be printed"):
        write_pdf(tmp_path / "page.html", tmp_path / "page.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["chromium"]
