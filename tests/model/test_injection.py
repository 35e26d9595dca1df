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


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("name", ["ipmsm", "ipmsm_flux", "traction_70kw"])
def test_the_ripple_is_a_share_of_rated_or_largest_current(name: str, delay: int) -> None:
    """Sample by sample, d inductance as small and V as large as they may be: the compensation of the legs adds V_d."""
    drive = load_drive(name)
    m, T = drive.motor, drive.model.sample_time
    least, answer = 0.9 * m.inductance_d, drive.control.current_bandwidth * m.inductance_d
    wave = injected_voltage(drive, delay) + (600.0 * 2e-6 * 1e4 if name == "traction_70kw" else 0.0)
    i = [0.0, 0.0]
    for k in range(2000):
        i.append(i[-1] + T / least * (wave * (-1.0) ** k - answer * i[-1 - delay]))
    current = rating(drive).current if drive.rated else drive.control.max_current
    assert abs(i[-1] - i[-2]) / 2 == pytest.approx(RIPPLE * current)
    assert pytest.approx(1 / (FADED * rating(drive).speed)) == module_of(name).PER_FADED_SPEED
    assert module_of(name).INJECTED_VOLTAGE[delay] == injected_voltage(drive, delay)


def test_an_inverter_that_takes_more_than_the_wave_leaves_half_of_it() -> None:
    drive = load_drive("traction_70kw")
    assert drive.inverter is not None
    slow = drive.model_copy(update={"inverter": drive.inverter.model_copy(update={"dead_time": 3e-5})})
    none = drive.model_copy(update={"inverter": None})
    assert injected_voltage(slow) == pytest.approx(injected_voltage(none) / 2)
    assert injected_voltage(none) == pytest.approx(injected_voltage(drive) + 12.0)


def test_what_the_filter_is_told_is_what_the_duty_cycles_make() -> None:
    module, rng, cut = module_of("ipmsm"), np.random.default_rng(2), 0
    for _ in range(200):
        duty, rotor = np.clip(rng.uniform(-0.1, 1.1, 3), 0, 1), (rng.uniform(-30, 30), rng.uniform(-3, 3))
        added, v, wave = module.inject(rotor, tuple(duty), (0.0, 0.0), (540.0,), (100.0, 1.0), module.MATH["float64"])
        made = 540.0 * 2 / 3 * np.sum((np.array(added) - duty) * np.exp(2j * np.pi / 3 * np.arange(3)))
        assert made == pytest.approx(complex(*v), abs=1e-9)
        assert wave == (100.0, -1.0)
        assert min(added) >= -1e-15
        assert max(added) <= 1 + 1e-15
        full = np.ptp(added) == pytest.approx(1.0)
        assert full or abs(made) == pytest.approx(100.0 * max(0.0, 1 - abs(rotor[0]) * module.PER_FADED_SPEED))
        cut += full
    assert 0 < cut < 200


@pytest.mark.parametrize(("theta", "room"), [(0.0, 2 / 3), (np.pi / 6, 3**-0.5), (np.pi / 2, 3**-0.5)])
def test_a_pulse_at_rest_reaches_the_edge_of_the_hexagon(theta: float, room: float) -> None:
    """Two thirds of the link at a corner, over sqrt(3) at the middle of an edge."""
    module = module_of("ipmsm")
    for sign in (1.0, -1.0):
        _, v, _ = module.inject((0.0, theta), (0.5,) * 3, (0.0, 0.0), (540.0,), (900.0, sign), module.MATH["float64"])
        assert complex(*v) == pytest.approx(sign * 540.0 * room * np.exp(1j * theta), abs=1e-9)


def planted(change: Callable[[Any], Any]) -> SimpleNamespace:
    """The module with a wave that is wrong."""
    good = module_of("ipmsm")

    def inject(*given: Any) -> Any:
        return change(good.inject(*given))

    return SimpleNamespace(**{**vars(good), "inject": inject})


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


def learning(change: Callable[[Any, Any], Any]) -> SimpleNamespace:
    """The module with a resistance that is learnt wrongly; told what is given, and what is found."""
    good = module_of("ipmsm_flux")

    def learn_resistance(*given: Any) -> Any:
        return change(given, good.learn_resistance(*given))

    return SimpleNamespace(**{**vars(good), "learn_resistance": learn_resistance})


WRONG = {
    "the other way": lambda given, found: ((2 * given[3][0] - found[0][0],), found[1]),
    "forgotten": lambda given, found: (given[3], found[1]),
    "without a limit": lambda given, found: ((found[0][0] * (1 + 1e-9),), found[1]),
    "not taken from the voltage": lambda given, found: (found[0], given[4]),
    "added to it": lambda given, found: (found[0], tuple(2 * v - u for v, u in zip(given[4], found[1], strict=True))),
    "no number": lambda given, found: ((float("nan"),), found[1]),
}


@pytest.mark.parametrize("fault", WRONG)
def test_the_link_fails_a_resistance_learnt_wrongly(fault: str) -> None:
    assert link_injection(module_of("ipmsm_flux"), "ipmsm_flux", "ckf", "cubature", 540.0).passed
    found = link_injection(learning(WRONG[fault]), "ipmsm_flux", "ckf", "cubature", 540.0)  # type: ignore[arg-type]
    assert not found.passed, fault
