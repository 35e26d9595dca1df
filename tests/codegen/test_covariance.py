"""Where the covariance of each state lives, asked of all that read or write it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

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


#: Prints the words that the supervisor leaves where neither speed nor angle is known, and once they are.
MAIN = """
#include <stdio.h>
#include "PREFIX_supervisor.c"

int main(void)
{
    static PREFIX_t f;
    static PREFIX_supervisor_t s;
    int k;
    PREFIX_init(&f);
    PREFIX_supervisor_init(&s);
    for (k = 0; k < WORDS; k++) { f.FIELD[k] = 7.0f; }
    s.guess[0] = 0.1f; s.guess[1] = 0.2f; s.guess[2] = 3.0f; s.guess[3] = 0.4f;
    s.spread[0] = UNKNOWN_SPEED; s.spread[1] = UNKNOWN_ANGLE;
    start_filter(&s, &f);
    for (k = 0; k < WORDS; k++) { printf("%a\\n", (double)f.FIELD[k]); }
    for (k = 0; k < STATES; k++) { printf("%a\\n", (double)f.x[k]); }
    learn(LEARNS);
    for (k = 0; k < WORDS; k++) { printf("%a\\n", (double)f.FIELD[k]); }
    return 0;
}
"""


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_the_supervisor_begins_with_the_sigmas_it_says(name: str, tmp_path: Path) -> None:
    """Compiled and run; its words read back by unpack. The expected ones are the drive's, not the text's."""
    folder = find_folder(name)
    module, drive = folder.module, load_drive(name)
    n, prefix = len(module.STATES), f"{name}_{folder.chosen(None)}"
    main = MAIN.replace("PREFIX", prefix).replace("FIELD", module.COVARIANCE)
    main = main.replace("WORDS", str(module.WORDS)).replace("STATES", str(n))
    (tmp_path / "main.c").write_text(main.replace("LEARNS", "&s, &f" if drive.model.adaptive else "&s"))
    command = ["gcc", "-std=c99", "-O1", f"-I{folder.path}", "main.c", str(folder.path / f"{prefix}.c")]
    subprocess.run([*command, "-lm", "-o", "example"], cwd=tmp_path, check=True)
    printed = subprocess.run([tmp_path / "example"], check=True, capture_output=True, text=True).stdout
    numbers = np.array([float.fromhex(line) for line in printed.split()])
    started, x, running = np.split(numbers, (module.WORDS, module.WORDS + n))
    P_0 = dict(zip(module.STATES, module.DEFAULTS["P_0"], strict=True))
    expected = P_0 | {"omega": (0.5 * drive.operating_box.speed) ** 2, "theta": 0.01}
    if module.UNITS[0] == "Wb":
        expected |= dict.fromkeys(module.STATES[:2], 0.01 * drive.motor.magnet_flux**2)
    held = expected | {state: 1e-3 * P_0[state] for state in drive.model.adaptive}
    np.testing.assert_allclose(module.unpack(started), np.diag(list(held.values())), rtol=1e-6)
    np.testing.assert_allclose(module.unpack(running), np.diag(list(expected.values())), rtol=1e-6)
    np.testing.assert_allclose(x[[0, 1, 2, module.ANGLE]], [0.1, 0.2, 3.0, 0.4], rtol=1e-6)


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
