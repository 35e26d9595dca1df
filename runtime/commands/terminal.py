"""The terminal that every command writes to."""

from __future__ import annotations

import sys

from rich.console import Console

# Into a file or a pipe the tables keep their width, whatever the terminal behind it.
console = Console() if sys.stdout.isatty() else Console(width=140)
