"""The documentation as a site: built from docs/ without a warning, without a dead link, and without anybody else."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.test_docs import site_module

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "docs" / "site" / "mkdocs.yml"


class Page(HTMLParser):
    """What a page is made of: the places in it that have a name, its links, and what a browser fetches with it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path, self.names = path, {""}
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        own = {name: value for name, value in attrs if value}
        self.names |= {own[name] for name in ("id", "name") if name in own}
        if tag == "a" and "href" in own:
            self.links.append(own["href"])
        elif tag == "link" and own.get("rel") in {"stylesheet", "icon", "preload", "preconnect"}:
            self.fetched.append(own["href"])
        elif "src" in own:
            self.fetched.append(own["src"])


def build(config: Path, site: Path) -> subprocess.CompletedProcess[str]:
    if find_spec("mkdocs") is None:
        if os.environ.get("CI"):
            pytest.fail("mkdocs is missing: pip install '.[docs]'")
        pytest.skip("mkdocs is missing: pip install '.[docs]'")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(config), "-d", str(site)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "site"
    done = build(CONFIG, folder)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return folder


def dead(pages: dict[Path, Page]) -> Iterator[str]:
    """Links within the site that lead to no file, or to no place in a page."""
    for page in pages.values():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (page.path.parent / unquote(parts.path)).resolve() if parts.path else page.path
            if not target.is_file() or (target in pages and unquote(parts.fragment) not in pages[target].names):
                yield f"{page.path.name}: {link}"


def fetched_from_elsewhere(site: Path) -> list[str]:
    """What a browser would ask other machines for."""
    pages = [Page(path) for path in site.rglob("*.html")]
    sources = [f"{page.path.name}: {source}" for page in pages for source in page.fetched if urlsplit(source).netloc]
    styles = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.css"))
    return sources + re.findall(r"url\(['\"]?(?:https?:)?//[^)]*", styles)


def dates(site: Path) -> list[str]:
    """What would differ on another day."""
    pages = "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.html"))
    return [path.name for path in site.glob("sitemap*")] + re.findall(r"\b20[2-9]\d-[01]\d-[0-3]\d\b", pages)


def test_the_site_is_whole_and_stands_alone(site: Path) -> None:
    pages = {path: Page(path) for path in site.rglob("*.html") if path.name != "404.html"}
    documents = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    assert documents <= {path.relative_to(site) for path in pages}
    assert sum(len(page.links) for page in pages.values()) > 1000
    assert list(dead(pages)) == []
    front = {unquote(urlsplit(link).path) for link in pages[site / "index.html"].links}
    assert {path.relative_to(site).as_posix() for path in pages} - front == {"index.html"} - front
    assert fetched_from_elsewhere(site) == []
    assert dates(site) == []


def test_what_leads_nowhere_ends_the_build(tmp_path: Path) -> None:
    """The site's own rules, on a page with three faults."""
    faults = ("[away](nowhere.md)", "[within](index.md#no-such-place)", "![picture](no_such.svg)")
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("# Start\n\n" + "\n\n".join(faults))
    validation = re.search(r"^validation:\n(?:  .*\n)+", CONFIG.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert validation
    (tmp_path / "mkdocs.yml").write_text(f"site_name: x\nplugins: []\n{validation[0]}")
    done = build(tmp_path / "mkdocs.yml", tmp_path / "site")
    assert done.returncode == 1
    assert done.stderr.count("WARNING") == len(faults)


def test_every_key_of_a_file_says_what_it_is() -> None:
    pages = site_module("reference_pages").PAGES
    for page in ("reference/drive_file.md", "reference/facts_file.md"):
        rows = [row.split(" | ") for row in pages[page]().splitlines() if row.startswith("| `")]
        assert len(rows) > 20
        assert [row[0] for row in rows if not row[1]] == []


def test_a_site_that_is_not_whole_is_seen(tmp_path: Path) -> None:
    link = '<h1 id="top">x</h1><a href="#top"></a><a href="other.html"></a><a href="page.html#no"></a>'
    (tmp_path / "page.html").write_text(f'{link}<script src="//cdn.test/x.js"></script><p>2026-11-29</p>')
    (tmp_path / "a.css").write_text("@font-face { src: url('https://fonts.test/x') }")
    page = Page(tmp_path / "page.html")
    assert list(dead({page.path: page})) == ["page.html: other.html", "page.html: page.html#no"]
    assert len(fetched_from_elsewhere(tmp_path)) == 2
    assert dates(tmp_path) == ["2026-11-29"]
