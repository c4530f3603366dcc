"""The site of docs/, with the pages in which a model moves: it is made without a warning, and asks nobody for anything.

Links, anchors and pages that no menu has are warnings; .ci/site shows that they are.
"""

import contextlib
import functools
import http.server
import re
import subprocess
import sys
import threading
import urllib.parse
from collections.abc import Iterator
from pathlib import Path

import pytest

from tensegrity_core.output.page import bundle
from tests.conftest import once
from tests.support.browser import CHROMIUM, Browser

pytest.importorskip("sphinx", reason="needs the extra docs")

ROOT = Path(__file__).resolve().parents[2]
MADE = pytest.mark.skipif(bool(bundle.missing()), reason="needs what builds the page of `tensegrity view`")

#: Attributes by which a page of the site fetches something on its own.
FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|video)\b[^>]*?\bsrc="([^"]+)"|<link rel="(?:stylesheet|icon)"[^>]*?\bhref="([^"]+)\""""
)

pytestmark = [MADE, pytest.mark.usefixtures("made_page")]


@pytest.fixture(scope="module")
def site(made_page, tmp_path_factory) -> Path:
    """The site, made once."""

    def make(folder: Path) -> None:
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-n", str(ROOT / "docs"), str(folder)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")

    return once(tmp_path_factory, "site ü #1", make)


def pages(site: Path) -> list[Path]:
    return sorted(site.glob("*.html"))


def test_every_page_is_there(site):
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} <= {page.stem for page in pages(site)}


def test_what_pages_fetch_lies_in_the_site(site):
    found = 0
    for page in pages(site):
        for match in FETCHED.finditer(page.read_text(encoding="utf-8")):
            address = urllib.parse.unquote((match[1] or match[2]).partition("?")[0].partition("#")[0])
            assert (page.parent / address).resolve().is_relative_to(site.resolve()), f"{page.name}: {address}"
            assert (page.parent / address).is_file(), f"{page.name}: {address}"
            found += 1
    assert found > 10 * len(pages(site)), "else the pattern finds no longer what pages fetch"


@contextlib.contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address under which this machine serves a folder."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@CHROMIUM
def test_pages_in_a_browser(site):
    """Every page, as wide as a phone: it is no wider than that, its console has no complaint, and each request goes into the
    site's folder."""
    with Browser(390, 844) as browser:
        browser.call("Network.enable")
        for page in pages(site):
            browser.open(page, "document.readyState == 'complete'")
            width = browser.run("document.documentElement.scrollWidth")
            assert width <= 390, f"{page.name} is {width} wide"
        assert not browser.problems
        asked = {address for address in browser.requests if not address.startswith(("data:", "blob:"))}
    outside = {address for address in asked if not address.startswith(site.as_uri())}
    assert asked and not outside


@CHROMIUM
def test_the_model_on_the_first_page_runs(site):
    """Over HTTP, as sites are: a page that is a file may not look into another."""
    with served(site) as address, Browser(1280, 800) as browser:
        browser.go(f"{address}/index.html", "document.readyState == 'complete'")
        inside = "document.querySelector('iframe.live').contentWindow"
        browser.wait(f"{inside}.document.documentElement.dataset.ready")
        assert not browser.problems
