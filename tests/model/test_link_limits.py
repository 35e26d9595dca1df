"""What the DC link allows: the generated block beside what docs/firmware.md states; its proof fails a wrong one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from model.drives.load import load_drive
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof.link_drive import by_hand
from runtime.proof.modes import Modes
from tests.conftest import EVERY_DRIVE

NAN, INF = math.nan, math.inf


def share(name: str, link: float, reference: float, omega: float, dtype: Any = np.float64) -> float:
    """Of the largest current; ``link`` in shares of the drive file's, speeds in shares of the operating box's."""
    module, drive = GeneratedFolder(GENERATED / name, checked=False).module, load_drive(name)
    volts, speed = link * drive.control.dc_link, drive.operating_box.speed
    given = (dtype(reference * speed), dtype(volts)), (dtype(omega * speed),)
    with np.errstate(all="ignore"):
        (found,) = module.allow(*given, module.MATH[np.dtype(dtype).name])
    return float(found)


@pytest.mark.parametrize("omega", [0.5, -0.5])
@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_either_end_takes_torque_away_in_a_straight_line(name: str, omega: float) -> None:
    """Half of it in the middle; a high link leaves torque that drives."""
    driving, braking = 1.1 * omega, 0.9 * omega
    for link, drives, brakes in (
        *((-1.0, 0, 0), (0.0, 0, 0), (0.49, 0, 0), (0.55, 0.25, 0.25), (0.6, 0.5, 0.5), (0.71, 1, 1)),
        *((1.0, 1, 1), (1.14, 1, 1), (1.175, 1, 0.75), (1.2, 1, 0.5), (1.26, 1, 0), (5.0, 1, 0)),
    ):
        assert share(name, link, driving, omega) == pytest.approx(drives, abs=1e-12)
        assert share(name, link, braking, omega) == pytest.approx(brakes, abs=1e-12)
        assert share(name, link, -omega, omega) == pytest.approx(brakes, abs=1e-12), "reversing brakes"
        assert share(name, link, 0.0, omega) == pytest.approx(brakes, abs=1e-12)


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_about_the_nominal_link_nothing_changes_by_a_bit(name: str) -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        assert share(name, rng.uniform(0.705, 1.145), *rng.uniform(-2, 2, 2), np.float32) == 1.0


def test_what_is_no_number() -> None:
    """A link that is none leaves no torque; a speed or a reference that is none counts as braking."""
    for reference, omega in ((0.5, 0.4), (0.4, 0.5), (NAN, 0.5), (0.5, NAN), (INF, -INF)):
        assert share("paper_spmsm", NAN, reference, omega) == 0.0
        assert share("paper_spmsm", -INF, reference, omega) == 0.0
    for reference, omega in ((NAN, 0.5), (0.5, NAN), (-INF, 0.5), (INF, INF)):
        assert share("paper_spmsm", 1.0, reference, omega) == 1.0
        assert share("paper_spmsm", 1.25, reference, omega) == pytest.approx(0.0, abs=1e-12)
    assert share("paper_spmsm", INF, 0.5, 0.4) == 1.0
    assert share("paper_spmsm", INF, 0.4, 0.5) == 0.0


def test_a_speed_about_its_reference_does_not_switch_torque() -> None:
    """At a fiftieth of the box's speed, and a thousandth beyond the reference, a high link takes a twentieth."""
    assert share("paper_spmsm", 1.3, 0.02, 0.021) == pytest.approx(1 - 0.021 * 0.001 / 0.02**2)
    assert share("paper_spmsm", 1.3, 0.5, 0.0) == 1.0


WRONG: dict[str, Callable[[float], float]] = {
    "all of it, always": lambda _: 1.0,
    "a thousandth too much": lambda found: 1.001 * found,
    "no number": lambda _: NAN,
}


@pytest.mark.parametrize("wrong", WRONG)
def test_the_link_fails_a_wrong_share(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, hand = (
        GeneratedFolder(GENERATED / "paper_spmsm").module,
        Modes(load_drive("paper_spmsm").model_dump(), False),
    )
    assert all(row.passed for row in by_hand(module, "ckf", hand, 60))
    own = module.allow
    monkeypatch.setattr(module, "allow", lambda *given: (WRONG[wrong](own(*given)[0]),))
    assert {row.stage for row in by_hand(module, "ckf", hand, 60) if not row.passed} >= {"drive, DC link", "drive"}
