"""What the site has beside the pages in docs/: the reference written from code, the gallery, formulas as MathML."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import gallery_pages
import reference_pages
from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

PAGES = {**reference_pages.PAGES, **gallery_pages.PAGES}


def on_config(config: Any) -> Any:
    """The gallery in the navigation, as its scripts are listed."""
    config.nav.insert(2, {"Gallery": list(gallery_pages.PAGES)})
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are written from the code."""
    for path, write in PAGES.items():
        files.append(File.generated(config, path, content=write()))
    return files


def _formula(found: re.Match[str]) -> str:
    display = "block" if found[1] == "div" else "inline"
    return str(convert(html.unescape(found[2]), display=display))


def on_page_content(text: str, **_: Any) -> str:
    """Write formulas as MathML, which a browser draws by itself: no script, nothing from elsewhere."""
    return re.sub(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', _formula, text, flags=re.DOTALL)


def on_post_build(config: Any) -> None:
    """Take out what has a date: a site map without an address of the site lists nothing."""
    for path in Path(config.site_dir).glob("sitemap.xml*"):
        path.unlink()
