"""Link D-E's starts are as hard as they say: each reaches what it was made for."""

from __future__ import annotations

import numpy as np
import pytest

from codegen.evidence.box import sample_box
from model.drives.load import load_drive
from model.machines.state_space import build
from model.machines.tolerance import half_widths
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.probe import numpy_entries
from runtime.proof.starts import TELLING, Start, from_box, pieces

DRIVES = ["paper_spmsm", "ipmsm_flux", "spmsm_adaptive"]


def _folder(drive: str) -> GeneratedFolder:
    return GeneratedFolder(GENERATED / drive)


def _singles(drive: str, draws: int = 40) -> dict[str, Start]:
    data = load_drive(drive)
    return {start.where: start for start in from_box(_folder(drive).module, sample_box(data, build(data), draws))}


def _status(drive: str, start: Start) -> np.ndarray:
    backend = NumpyBackend(_folder(drive).module, "ickf", "float32")
    start.load(backend)
    return backend.run(start.u, start.y)[3]


@pytest.mark.parametrize("drive", DRIVES)
def test_draws_of_the_box_are_healthy(drive: str) -> None:
    module, start = _folder(drive).module, _singles(drive)["box"]
    assert not (_status(drive, start) & ~module.NOT_CONVERGED & ~module.DIVERGED).any()


@pytest.mark.parametrize("drive", DRIVES)
def test_wide_turns_are_beyond_what_counts_as_small(drive: str) -> None:
    start = _singles(drive)["box, wide turns"]
    entries = numpy_entries(_folder(drive), "ickf", start)
    z = np.array([v for (block, name), v in entries.items() if block == "time_update_turns" and name.startswith("z_")])
    assert (z.sum(axis=0) > 0.125).any()


@pytest.mark.parametrize("drive", ["paper_spmsm", "ipmsm_flux"])
def test_an_absurd_factor_hides_behind_what_is_sound(drive: str) -> None:
    """One lane is restarted for its L alone: pivots, prediction and innovations are within what is sound."""
    module, start, lane = _folder(drive).module, _singles(drive)["box, one corner"], 7
    assert _status(drive, start)[0, lane] & module.RESTARTED
    entries = numpy_entries(_folder(drive), "ickf", start)
    made = {name: float(v[lane]) for (block, name), v in entries.items() if block == "time_update"}
    assert max(abs(v) for name, v in made.items() if name.startswith("D_pred") or name.endswith("_pred")) < 1e6
    assert max(abs(v) for name, v in made.items() if name.startswith("L_pred")) > module.SANE_LIMIT
    assert start.tuning["nis"][lane] < module.SANE_LIMIT


@pytest.mark.parametrize("drive", DRIVES)
def test_a_corner_is_alone_among_healthy_lanes(drive: str) -> None:
    """So that in lanes nobody beside it asks for what it needs."""
    module, start = _folder(drive).module, _singles(drive)["box, one corner"]
    status = _status(drive, start)[0] & ~(module.NOT_CONVERGED | module.DIVERGED)
    assert set(np.flatnonzero(status) % 16) == {7}
    absurd = len(module.STATES) - 1
    held = sum(map(bool, half_widths(stated_drive(_folder(drive)))))  # the last states: brought back, not restarted
    assert (status[7::16][1 : 1 + absurd - held] & module.RESTARTED).all()
    assert (status[7::16][1 + absurd :] & module.COVARIANCE_REPAIRED).sum() >= module.ORDER.index(module.ANGLE) + 1


def test_telling_angles_are_rested_at() -> None:
    start = _singles("paper_spmsm")["box, angle alone unknown"]
    assert start.x[3, : len(TELLING)].tolist() == [float(np.float32(angle)) for angle in TELLING]
    assert not start.x[2].any()


@pytest.mark.parametrize("drive", DRIVES)
def test_pieces_meet_every_bit_of_the_status(drive: str) -> None:
    folder = _folder(drive)
    data = trajectory_of(stated_drive(folder), 420)
    start = pieces(folder.module, data.u.astype(np.float32), data.y.astype(np.float32))
    seen = int(np.bitwise_or.reduce(_status(drive, start), axis=None))
    m = folder.module
    for bit in (m.INPUT_REJECTED, m.COVARIANCE_REPAIRED, m.DIVERGED, m.RESTARTED):
        assert seen & bit
