"""A page as PDF, printed by a browser that is on this machine."""

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from ident.errors import InputError, ModelError, Problem
from ident.files import replace_file

NAMES = ("chromium", "chromium-browser", "google-chrome")
"""Programs that print pages, the first that is found."""
FLAGS = ("--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--no-pdf-header-footer")
LONGEST = 120.0
"""Seconds that printing may take."""


def find_browser() -> str:
    """Return the program that prints pages.

    Raises:
        InputError: there is none on the PATH.
    """
    if program := next(filter(None, map(shutil.which, NAMES)), None):
        return program
    remedy = "install Chromium, or print the page from another browser"
    raise InputError(Problem("pdf", "no browser that prints", f"{' or '.join(NAMES)} on the PATH", remedy))


def write_pdf(page: Path, path: Path) -> None:
    """Print a page as PDF, whole or not at all.

    Raises:
        InputError: no browser, or the file can't be written.
        ModelError: the browser fails.
    """
    program = find_browser()
    as_root = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()  # Chromium else refuses root

    with TemporaryDirectory() as profile:
        printed = Path(profile) / "printed.pdf"
        flags = [*FLAGS, *as_root, f"--user-data-dir={profile}", f"--print-to-pdf={printed}"]
        try:
            line = [program, *flags, page.absolute().as_uri()]
            subprocess.run(line, check=True, capture_output=True, timeout=LONGEST)
            content = printed.read_bytes()
        except (subprocess.SubprocessError, OSError) as error:
            raise ModelError(f"{page} could not be printed: {program} failed ({type(error).__name__})") from None
    replace_file(path, lambda file: file.write(content))
