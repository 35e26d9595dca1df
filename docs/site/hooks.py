"""What the site has beside the pages in docs/: the reference, written from the code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from reference_pages import PAGES


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are written from the code."""
    for path, write in PAGES.items():
        files.append(File.generated(config, path, content=write()))
    return files


def on_post_build(config: Any) -> None:
    """Take out what has a date: a site map without an address of the site lists nothing."""
    for path in Path(config.site_dir).glob("sitemap.xml*"):
        path.unlink()
