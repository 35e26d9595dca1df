"""How the generated C is compiled in tests, and tools that may be missing."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from runtime.estimator.folder import GENERATED

STRICT = [
    "-std=c89",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wunsuffixed-float-constants",
    "-Wmissing-prototypes",
    "-Werror",
    "-ffp-contract=off",
]


def interrupt_files(drive: str) -> list[Path]:
    """The C that runs in the interrupt: filters and controllers, not what tests them or shows how to call them."""
    found = sorted((GENERATED / drive).glob(f"{drive}_*.c"))
    return [path for path in found if not path.stem.endswith("_selftest")]


def need(tool: str) -> str:
    """The tool's name. Where it is missing the test is skipped with the reason, in CI it fails."""
    if shutil.which(tool) is None:
        reason = f"not run: {tool} not found"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return tool
