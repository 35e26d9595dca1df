"""The generated C computes the numbers it always did: names, rooms and tools may change, no bit of a filter may.

``tests/data/recorded_bits.json`` holds digests of what each shipped filter made of a recorded run, with an input that
is missing, one that is too large, and a start from an unknown angle on the way. A change of a filter's numbers is a
decision: ``python -m tests.runtime.test_same_numbers`` writes the digests anew.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model.drives.load import load_drive, shipped_drives
from runtime import load

DATA = Path(__file__).parents[1] / "data"
DIGESTS = DATA / "recorded_bits.json"
FILTERS = [(name, kind) for name in shipped_drives() for kind in dict.fromkeys(load_drive(name).filter.kinds)]


def recorded_inputs(drive: str) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """600 samples of another simulator's run, some of them spoilt."""
    with np.load(DATA / ("ipmsm_step.npz" if drive.startswith("ipmsm") else "spmsm_step.npz")) as run:
        u = np.stack([run["u_alpha"], run["u_beta"]], axis=-1)[:600]
        y = np.stack([run["i_alpha"], run["i_beta"]], axis=-1)[:600]
    u, y = u.astype(np.float32).copy(), y.astype(np.float32).copy()
    y[100] = np.nan
    y[200:210, 0] = 1e6
    u[300, 1] = np.inf
    return u, y


def digest(drive: str, kind: str) -> str:
    """SHA-256 over every bit of the estimates, the covariance words, the iterations and the status."""
    u, y = recorded_inputs(drive)
    total = hashlib.sha256()
    for angle in (0.0, 2.5):
        f = load(drive, filter=kind, backend="c", dtype="float32")
        start = np.array(f.x)
        start[3] = angle
        f.reset(x0=start)
        trace = f.run(u, y)
        for values, dtype in ((trace.x, "<f4"), (trace.words, "<f4"), (trace.iterations, "<i4"), (trace.status, "<i4")):
            total.update(np.ascontiguousarray(values).astype(dtype).tobytes())
    return total.hexdigest()


@pytest.mark.parametrize(("drive", "kind"), FILTERS)
def test_every_bit_is_as_recorded(drive: str, kind: str) -> None:
    assert digest(drive, kind) == json.loads(DIGESTS.read_text())[f"{drive}/{kind}"]


if __name__ == "__main__":
    DIGESTS.write_text(json.dumps({f"{d}/{k}": digest(d, k) for d, k in FILTERS}, indent=2) + "\n")
