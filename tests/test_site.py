"""The check that `make docs` runs on the built site finds what it is for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

CHECK = Path(__file__).parents[1] / "docs" / "check_site.py"

GOOD = """
<link rel="stylesheet" href="site.css">
<link rel="canonical" href="https://example.org/">
<h1 id="top">A</h1> <a href="#top">1</a> <a href="other.html#there">2</a>
<a href="https://example.org/gone">3</a> <a href="folder/">4</a>
"""

FAULTS = {
    '<a href="gone.html">': "gone.html leads nowhere",
    '<img src="gone.png">': "gone.png leads nowhere",
    '<a href="#gone">': "#gone leads to no place of the page",
    '<a href="other.html#gone">': "other.html#gone leads to no place of the page",
    '<script src="https://example.org/x.js"></script>': "loads https://example.org/x.js",
    '<link rel="stylesheet" href="//example.org/x.css">': "loads //example.org/x.css",
}


def _check(folder, page):
    (folder / "index.html").write_text(page)
    done = subprocess.run(
        [sys.executable, CHECK, folder], capture_output=True, text=True, timeout=60
    )
    return done.returncode, done.stdout.splitlines()


def test_links_within_a_site_and_what_it_loads(tmp_path):
    (tmp_path / "site.css").write_text("")
    (tmp_path / "folder").mkdir()
    for page in ("other.html", "folder/index.html"):
        (tmp_path / page).write_text('<p id="there">')
    assert _check(tmp_path, GOOD) == (0, [])
    expected = sorted(f"index.html: {fault}" for fault in FAULTS.values())
    code, lines = _check(tmp_path, GOOD + "".join(FAULTS))
    assert (code, sorted(lines)) == (1, expected)


def test_a_site_without_pages_is_a_fault(tmp_path):
    done = subprocess.run([sys.executable, CHECK, tmp_path], capture_output=True, timeout=60)
    assert done.returncode == 1
