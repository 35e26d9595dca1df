"""Commands as processes of their own, as a shell starts them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from model.drives.load import DRIVES
from tests import forked

ROOT = Path(__file__).parents[2]
#: One filter is enough to generate here.
PAPER = (DRIVES / "paper_spmsm.toml").read_text(encoding="utf-8").replace('["ckf", "ickf"]', '["ckf"]')


def start(*arguments: str, cwd: Path, **more: object) -> subprocess.Popen[str]:
    """A command in a process of its own, in a group of its own as a shell would start it."""
    extra: dict[str, str] = more.pop("environment", {})  # type: ignore[assignment]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    environment |= {"PMSM_ICKF_LOG_EVERY": "0", **extra}  # every line of progress: some tests wait for one
    return subprocess.Popen(
        [sys.executable, *arguments], cwd=cwd, env=environment, text=True, encoding="utf-8",
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, process_group=0, **more,  # type: ignore[call-overload]
    )  # fmt: skip


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=300)
    return process.returncode, out, err


def call(*arguments: str, cwd: Path, **more: Any) -> tuple[int, str, str]:
    done = forked.call(*arguments, cwd=cwd, **more)
    return done.returncode, done.stdout, done.stderr


def refused(result: tuple[int, str, str]) -> str:
    """Exit code 2 and one line, which is returned."""
    code, _, err = result
    assert code == 2, err
    (line,) = err.splitlines()
    assert line.startswith("pmsm-ickf: ")
    return line
