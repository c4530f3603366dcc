"""Pictures of the site, as wide as a desk's and a phone's screen: `python -m tests.whole.site_pictures`.

It makes the site anew and writes docs/figures/site_*.png; look at them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from tensegrity_core.files import write_bytes
from tests.output.page_pictures import shrunk
from tests.support.browser import Browser
from tests.support.words import words
from tests.whole.test_site import served

ROOT = Path(__file__).resolve().parents[2]
FIGURES = ROOT / "docs" / "figures"
LIVE = "document.querySelector('iframe.live')"
#: Name -> page, width and height of the screen, pixels of it for one, width of the picture.
VIEWS = {
    "desktop": ("index.html", 1280, 1000, 1.0, 760),
    "theory": ("theory.html#a-beam-that-snaps-eq-11-to-14", 1280, 900, 1.0, 760),
    "phone": ("index.html", 390, 844, 2.0, 360),
}


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "sphinx", "-q", "-W", "-n", str(ROOT / "docs"), folder], check=True)
        with served(Path(folder)) as address:
            for name, (page, width, height, scale, wide) in VIEWS.items():
                with Browser(width, height, scale, touch=width < 500) as browser:
                    browser.go(f"{address}/{page}", "document.readyState == 'complete'")
                    browser.wait(f"!{LIVE} || {LIVE}.contentWindow.document.documentElement.dataset.ready")
                    browser.run(f"document.getElementById({page.partition('#')[2]!r})?.scrollIntoView({{behavior: 'instant'}})")
                    picture = shrunk(browser.picture(), wide)
                    write_bytes(FIGURES / f"site_{name}.png", picture)
                    print(f"site_{name}.png: {len(picture) / 1e3:.0f} kB; {browser.problems or 'no complaint'}")


if __name__ == "__main__":
    words(__doc__)
    main()
