"""The gallery: a page for every script of docs/gallery, with its figure, and one that shows them all.

Run as a program it runs the scripts that are named, or all, and writes their figures beside them.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "gallery"
#: In the order in which they are shown.
SCRIPTS = (
    *("paper_no_load", "paper_load_step", "four_filters", "salient_against_surface", "start_from_anywhere"),
    *("fault_ridden_through", "dead_time", "where_it_holds", "batch_of_1000", "identify_motor"),
    *("recording_replayed", "own_machine", "board_on_a_terminal"),
)


def told(name: str) -> tuple[str, str, str]:
    """Title, text and code of a script."""
    source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    title, _, text = (ast.get_docstring(ast.parse(source)) or "").partition("\n")
    return title.rstrip("."), text.strip(), source.split('"""', 2)[2].strip()


def page(name: str) -> str:
    """A script's own page."""
    title, text, code = told(name)
    return f"# {title}\n\n{text}\n\n![{title}]({name}.svg)\n\n```python\n{code}\n```\n\n[{name}.py]({name}.py)\n"


def index() -> str:
    """All of them, each with its figure."""
    cards = "\n".join(f"[![]({name}.svg) {told(name)[0]}]({name}.md)\n" for name in SCRIPTS)
    return f"""# Gallery

Scripts of at most forty lines, each with the figure it makes. Each runs as it is, in some seconds, where
`pip install 'pmsm-ickf[report]'` was done:

    python docs/gallery/paper_no_load.py

<div class="gallery" markdown>

{cards}
</div>
"""


#: Path in the site -> text of the page.
PAGES = {"gallery/index.md": index, **{f"gallery/{name}.md": lambda name=name: page(name) for name in SCRIPTS}}


def run(name: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script in a folder, where it leaves its figure."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(FOLDER / f"{name}.py")]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    for asked in sys.argv[1:] or SCRIPTS:
        done = run(asked, FOLDER)
        if done.returncode == 0:
            figure = FOLDER / f"{asked}.svg"  # its last line says which matplotlib laid it out
            drawn = figure.read_text(encoding="utf-8")
            figure.write_text(f"{drawn}\n<!-- Matplotlib v{version('matplotlib')} -->\n", encoding="utf-8")
        print(asked, done.stdout if done.returncode == 0 else done.stderr, sep="\n")
