"""Check a built site: links within it lead somewhere, and nothing is loaded from the network.

    python docs/check_site.py site/html

Sphinx checks what it resolves itself; this sees the pages as a browser does, themes and notebooks'
outputs included. Links to other sites are not followed.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADS = {"audio", "embed", "iframe", "img", "link", "script", "source", "video"}
"""Elements that a browser fetches without being asked."""

NOT_FETCHED = {"alternate", "author", "canonical", "index", "next", "prev", "search"}
"""What a ``link`` only says."""


class Page(HTMLParser):
    """The anchors of a page, what it links to, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors = {""}
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element's anchor and link."""
        found = dict(attrs)
        self.anchors |= {found[name] or "" for name in ("id", "name") if name in found}
        link = found.get("href") or found.get("src")
        if link:
            self.links.append(link)
            if tag in LOADS and not set((found.get("rel") or "").split()) & NOT_FETCHED:
                self.loads.append(link)


def faults(folder: Path) -> list[str]:
    """Return a line for every link that leads nowhere, and for all that comes from the network."""
    paths = sorted(folder.resolve().rglob("*.html"))
    pages = {path: Page(path) for path in paths if "_static" not in path.parts}  # templates
    found = []
    for path, page in pages.items():
        where = path.relative_to(folder.resolve())
        found += [f"{where}: loads {link}" for link in page.loads if urlsplit(link).netloc]
        for link in sorted(set(page.links)):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            if not target.exists():
                found.append(f"{where}: {link} leads nowhere")
            elif target in pages and unquote(parts.fragment) not in pages[target].anchors:
                found.append(f"{where}: {link} leads to no place of the page")
    if not pages:
        found.append(f"{folder}: no pages")
    return found


if __name__ == "__main__":
    lines = faults(Path(sys.argv[1]))
    print(*lines, sep="\n", end="\n" if lines else "")
    sys.exit(bool(lines))
