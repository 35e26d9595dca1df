"""Shared pieces: the drives under test, variants of them, and a cache that does not touch the user's."""

from __future__ import annotations

import os
import tempfile
from typing import Any

import pytest

from model.drive import Drive, load_drive

os.environ.setdefault("PMSM_ICKF_CACHE", os.path.join(tempfile.gettempdir(), "pmsm-ickf-tests"))

DRIVES = ("paper_spmsm", "ipmsm_flux", "spmsm_load_torque")


def variant(drive: Drive, **changes: dict[str, Any]) -> Drive:
    """A drive with some keys of some sections replaced: ``variant(d, filter={"gain": "cubature"})``."""
    return drive.model_copy(
        update={name: getattr(drive, name).model_copy(update=keys) for name, keys in changes.items()}
    )


@pytest.fixture(params=DRIVES)
def drive(request: pytest.FixtureRequest) -> Drive:
    return load_drive(request.param)
