"""Where the covariance of each state lives, asked of all that read or write it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from codegen.ir.covariance import CovarianceLayout
from model.drives.load import load_drive
from runtime.drive.scenario import scenarios
from runtime.drive.simulation import Simulator
from runtime.estimator.folder import find_folder
from tests.conftest import ALL_DRIVES, DRIVES, EVERY_DRIVE, thoroughly


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (3, 0, 4, 1, 2)])
def test_the_layout_packs_as_numpy_does(order: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    states = ("a", "b", "c", "d", "e")
    A = rng.normal(size=(5, 5))
    S = np.linalg.cholesky((A @ A.T)[np.ix_(order, order)])
    D = np.diag(S) ** 2
    packed = (S / np.diag(S) - np.eye(5) + np.diag(D))[np.tril_indices(5)]
    layout = CovarianceLayout("LD", states, order)
    assert layout.size == len(packed)
    assert layout.natural == (order == (0, 1, 2, 3, 4))
    for row, state in enumerate(order):
        assert layout.row(states[state]) == layout.rows[state] == row
        assert packed[layout.variance(states[state])] == packed[layout.variances[state]] == D[row]
        for column, other in enumerate(order[:row]):
            word = layout.word(states[state], states[other])
            assert packed[word] == S[row, column] / S[column, column]
            assert word == layout.word(states[other], states[state]) == layout.row_start(states[state]) + column
            assert layout.pairs()[word] == (state, other)


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_module_and_header_name_the_same_places(name: str) -> None:
    """The module's unpack is the judge: a word alone changed must show in the state that it is said to belong to."""
    folder = find_folder(name)
    module = folder.module
    kind = folder.chosen(None)
    header = folder.text(f"{name}_{kind}.h")
    places = {key: int(value) for key, value in re.findall(r"^    (\w+) = (\d+),?$", header, re.MULTILINE)}
    prefix, n = f"{name}_{kind}".upper(), len(module.STATES)
    assert len(places) == 2 * n
    for k, state in enumerate(module.STATES):
        assert places[f"{prefix}_{state.upper()}"] == k
        assert places[f"{prefix}_{module.COVARIANCE}_{state.upper()}"] == module.VARIANCES[k] == module.word(k, k)
        words = np.zeros(module.WORDS)
        words[module.VARIANCES[k]] = 1.0
        np.testing.assert_array_equal(module.unpack(words), np.diag(np.eye(n)[k]))
    P = np.diag(np.arange(1.0, n + 1))
    np.testing.assert_array_equal(module.diagonal(np.diag(P), 0.0), module.pack(P))


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_the_supervisor_begins_with_the_sigmas_it_says(name: str) -> None:
    """Its words read back by unpack, after a rotor that turns was read and after it was found."""
    folder = find_folder(name)
    module, drive = folder.module, load_drive(name)
    f, s, math, where = module.new_filter(np.float64), module.new_supervisor(np.float64), module.MATH["float64"], True
    phase = (np.float64(0.1), np.float64(-0.2))
    s.guess, s.reading, s.probe = (0.0, 0.0, 3.0, 0.4), (1.0, 0.0, 1.0, 0.5), (1.0, 2.0)
    module._guess_from_probe(s, f, phase, where, math)
    module._place(s, f, phase, where, math)
    module._start_filter(s, f, phase, where, math)
    P_0 = dict(zip(module.STATES, module.DEFAULTS["P_0"], strict=True))
    expected = P_0 | {"omega": (0.5 * drive.operating_box.speed) ** 2, "theta": 0.01}
    if module.UNITS[0] == "Wb":
        expected |= dict.fromkeys(module.STATES[:2], 0.01 * drive.motor.magnet_flux**2)
    held = expected | {state: 1e-3 * P_0[state] for state in drive.model.adaptive}

    def P() -> np.ndarray:
        return np.asarray(module.unpack(np.array(getattr(f, module.COVARIANCE), dtype=float)))

    np.testing.assert_allclose(P(), np.diag(list(held.values())), rtol=1e-6)
    assert [f.x[k] for k in (0, 1, 2, module.ANGLE)] == list(s.guess)
    module._learn(s, f, phase, where, math)
    np.testing.assert_allclose(P(), np.diag(list(expected.values())), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["no_load", *thoroughly("load_step")])
#: The others' controllers have the same bits in the chain, test_proof.py; here it is the loop that is closed in NumPy.
@pytest.mark.parametrize("name", [DRIVES[-1], *thoroughly(*(name for name in ALL_DRIVES if name != DRIVES[-1]))])
def test_the_numpy_controller_has_the_bits_of_the_c(name: str, scenario: str) -> None:
    """``simulate --controller numpy``, the whole run."""
    folder = find_folder(name)
    simulator, task = Simulator(folder, folder.chosen(None)), scenarios(load_drive(name))[scenario]
    c, twin = (simulator.run(task, controller=which) for which in ("c", "numpy"))
    for field in ("x", "duty", "status"):
        np.testing.assert_array_equal(getattr(c, field), getattr(twin, field))


@pytest.mark.parametrize("name", ALL_DRIVES)
@pytest.mark.parametrize("number", [np.float32, np.float64])
def test_a_new_filter_is_what_init_leaves(name: str, number: type) -> None:
    """x_0 and P_0 of the drive file, every tuning word in the arithmetic asked for, changes taken."""
    module, drive = find_folder(name).module, load_drive(name)
    f = module.new_filter(number, Q=tuple(2.0 * q for q in module.DEFAULTS["Q"]))
    P = module.unpack(np.array(getattr(f, module.COVARIANCE)))
    np.testing.assert_array_equal(P, np.diag(number(drive.filter.initial_covariance)))
    np.testing.assert_array_equal(f.Q, number(2.0 * np.array(drive.filter.process_noise)))
    assert {type(value) for value in (*f.x, *f.R, f.y_max, f.nis, *f.u_held)} == {number}
    assert (f.iterations, f.repairs, f.max_iterations) == (0, 0, drive.filter.max_iterations)
    c = module.new_controller(number, delay=1)
    assert c.gain == tuple(number(value) for value in module.GAIN)
    assert (c.delay, c.sensored, c.integrator) == (1, 0, (0, 0, 0, 0))
