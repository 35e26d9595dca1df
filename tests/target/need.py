"""Tests that need programs which are not Python's: skipped without them, but not in CI."""

from __future__ import annotations

import os

import pytest

from runtime.firmware.tools import MissingTool, find_tool


def need(*programs: str) -> None:
    """Skip the test, with the package to install, where a program is missing; in CI fail."""
    for program in programs:
        try:
            find_tool(program)
        except MissingTool as error:
            if os.environ.get("CI"):
                pytest.fail(str(error))
            pytest.skip(str(error))
