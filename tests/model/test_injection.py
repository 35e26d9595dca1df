"""The square wave on the d axis: who has it, how large it is, and that its proof fails a wrong one."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.drives.load import load_drive
from model.loop.injection import FADED, RIPPLE, injected_voltage
from model.rating import rating
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof.link_injection import link_injection


def module_of(name: str) -> Any:
    return GeneratedFolder(GENERATED / name, checked=False).module


def test_a_round_rotor_has_none() -> None:
    assert injected_voltage(load_drive("paper_spmsm")) == 0.0
    assert not hasattr(module_of("paper_spmsm"), "inject")


@pytest.mark.parametrize("name", ["ipmsm", "ipmsm_flux", "traction_70kw"])
def test_the_ripple_is_a_share_of_rated_or_largest_current(name: str) -> None:
    """A step of V T / L_d from one end to the other, L_d as small and V as large as they may be: a leg adds V_d."""
    drive = load_drive(name)
    least = drive.motor.inductance_d * (0.9 if drive.tolerance else 1.0)
    added = 600.0 * 2e-6 * 1e4 * 2 / 3 if name == "traction_70kw" else 0.0
    swing = (injected_voltage(drive) + added) * drive.model.sample_time / least
    current = rating(drive).current if drive.rated else drive.control.max_current
    assert swing / 2 == pytest.approx(RIPPLE * current)
    assert pytest.approx(1 / (FADED * rating(drive).speed)) == module_of(name).PER_FADED_SPEED


def test_an_inverter_that_takes_more_than_the_wave_leaves_half_of_it() -> None:
    drive = load_drive("traction_70kw")
    assert drive.inverter is not None
    slow = drive.model_copy(update={"inverter": drive.inverter.model_copy(update={"dead_time": 3e-5})})
    none = drive.model_copy(update={"inverter": None})
    assert injected_voltage(slow) == pytest.approx(injected_voltage(none) / 2)
    assert injected_voltage(none) == pytest.approx(injected_voltage(drive) + 8.0)


def test_what_the_filter_is_told_is_what_the_duty_cycles_make() -> None:
    module, rng = module_of("ipmsm"), np.random.default_rng(2)
    for _ in range(200):
        duty, rotor = np.clip(rng.uniform(-0.1, 1.1, 3), 0, 1), (rng.uniform(-30, 30), rng.uniform(-3, 3))
        added, v, wave = module.inject(rotor, tuple(duty), (0.0, 0.0), (540.0,), (100.0, 1.0), module.MATH["float64"])
        made = 540.0 * 2 / 3 * np.sum((np.array(added) - duty) * np.exp(2j * np.pi / 3 * np.arange(3)))
        assert made == pytest.approx(complex(*v), abs=1e-9)
        assert wave == (100.0, -1.0)
        assert min(added) >= -1e-15
        assert max(added) <= 1 + 1e-15


def planted(change: Callable[[Any], Any]) -> SimpleNamespace:
    """The module with a wave that is wrong."""
    good = module_of("ipmsm")

    def inject(*given: Any) -> Any:
        return change(good.inject(*given))

    return SimpleNamespace(MATH=good.MATH, PER_FADED_SPEED=good.PER_FADED_SPEED, inject=inject)


FAULTS = {
    "the sign stays": lambda found: (found[0], found[1], (found[2][0], -found[2][1])),
    "the amplitude is lost": lambda found: (found[0], found[1], (0.0, found[2][1])),
    "the filter is not told": lambda found: (found[0], (0.0, 0.0), found[2]),
    "two legs are swapped": lambda found: ((found[0][1], found[0][0], found[0][2]), found[1], found[2]),
    "no number": lambda found: ((float("nan"),) * 3, found[1], found[2]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_link_fails_a_wrong_wave(fault: str) -> None:
    assert link_injection(module_of("ipmsm"), "ipmsm", "ckf", "cubature", 540.0).passed
    found = link_injection(planted(FAULTS[fault]), "ipmsm", "ckf", "cubature", 540.0)  # type: ignore[arg-type]
    assert not found.passed, fault
