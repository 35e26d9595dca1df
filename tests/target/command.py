"""Calls the command line in a process of its own."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests import forked


def call(*arguments: str, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    return forked.call(*arguments, cwd=cwd, environment=more)
