"""Motor data from recordings: the compiled likelihood, the search on other simulators' motors, what is not shown."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy import stats

from benchmarks.identify import DATA, facts_of, guessed, other_pwm, subject
from benchmarks.other_motor import MOTORS, recordings
from model.drives.load import load_drive
from runtime.design.facts import Facts
from runtime.identify import search as search_module
from runtime.identify.equations import STATES, TOLD, Equations
from runtime.identify.figures import along, write_figures
from runtime.identify.identify import Identified, identify
from runtime.identify.intervals import student
from runtime.identify.kernel import Kernel
from runtime.identify.likelihood import STEP, slope, values
from runtime.identify.problem import Problem, Stage
from runtime.identify.rows import ripple, rows_of
from runtime.identify.search import search
from runtime.identify.subject import read_subject
from runtime.proof.own_trajectory import trajectory_of
from runtime.recorded.data import Recorded
from tests.model.test_own_machine import EXAMPLE

FREE = "R,L_d,L_q,psi_m,J"
#: What is asked of 0.4 s of a recording, 0.05 A of noise.
WITHIN = {"R": 0.005, "L_d": 0.02, "L_q": 0.02, "psi_m": 0.001, "J": 0.05}


@cache
def pump() -> tuple[Facts, Recorded]:
    return facts_of(MOTORS["pump"]), recordings(MOTORS["pump"], 1)[0]


def cut(recording: Recorded, rows: slice) -> Recorded:
    truth = {name: column[rows] for name, column in recording.truth.items()}
    return replace(recording, t=recording.t[rows], u=recording.u[rows], y=recording.y[rows], truth=truth)


def problem(rows: slice = slice(0, 600), free: str = FREE) -> Problem:
    truth, recording = pump()
    guess = replace(truth, R=1.2 * truth.R)
    short = cut(recording, rows)
    return Problem(subject(truth, guess, False, free), (rows_of(short, truth.T, truth.dc_link, "pump"),))


def off(found: Identified, truth: Facts) -> dict[str, float]:
    true = {"R": truth.R, "L_d": truth.L_d, "L_q": truth.L_q, "psi_m": truth.psi_m, "J": truth.J}
    true["D"], true["V_dead"] = truth.D, truth.dc_link * truth.dead_time / truth.T
    return {e.datum.word: abs(e.value / true[e.datum.word] - 1) for e in found.result.estimates}


# --- the likelihood


@pytest.mark.parametrize("name", ["spmsm_load_torque", "traction_70kw"])
def test_the_compiled_step_is_the_symbolic_one(name: str) -> None:
    equations = Equations(load_drive(name), frozenset({"I_1"}))
    kernel, rng = Kernel(equations), np.random.default_rng(3)
    m = load_drive(name).motor
    letters = {"R": m.stator_resistance, "L_d": m.inductance_d, "L_q": m.inductance_q, "psi_m": m.magnet_flux}
    letters |= {"p": m.pole_pairs, "J": m.inertia, "D": 1e-3, "T": 1e-4, "V_d": 3.0, "I_0": 0.2}
    given = np.array([letters[word] for word in equations.names])
    made = np.array(equations.constants(given)).ravel()
    tuning = [0.1, 0.2, 1e-6, 1e-8, 1e-4, 0.01, 0.012, 0.002, 0.9, 0.1, 0.3, 0.95, 0.01, -0.02]
    p = np.concatenate([given, made, tuning])
    i, R = rng.normal(size=2), [0.01, 0.002, 0.012]
    begin = np.array(equations.start(given, [0.3, 5.0, 0.1, 0.01, 1.0, 0.1, 0.2], i, R)).ravel()
    rows = np.column_stack([rng.normal(size=(40, 4)), rng.integers(0, 2, 40), np.ones(40), rng.uniform(size=(40, 9))])
    rows[:, 9:] *= 1e-4
    lanes, x = np.repeat(p[:, None], 11, axis=1), begin
    for row in rows:
        state = np.repeat(x[:, None], 11, axis=1)
        told = kernel.run(row[None], lanes, state)
        x, expected = (np.array(part).ravel() for part in equations.step(x, p, row))
        assert told.shape == (1, len(TOLD), 11)
        assert np.allclose(told[0], expected[:, None], rtol=1e-9, atol=1e-12)
        assert np.allclose(state, x[:, None], rtol=1e-9, atol=1e-9)
        assert np.array_equal(state[:, 0], state[:, 10])
    assert len(state) == STATES + STATES * (STATES + 1) // 2


@pytest.mark.parametrize("stage", [Stage(), Stage(0.01)])
def test_the_gradient_is_that_of_the_value(stage: Stage) -> None:
    """Differences of the sums, with another step, beside sums of differences."""
    task = problem()
    free = list(range(len(task.unknowns)))
    q = task.guess
    found = slope(task, q, free, stage)
    assert found.value == pytest.approx(float(values(task, q[:, None], stage)[0]), rel=1e-12)
    step = 2 * STEP
    for k in task.data:
        Q = np.repeat(q[:, None], 2, axis=1)
        Q[k] += [step, -step]
        up, down = values(task, Q, stage)
        assert found.gradient[k] == pytest.approx((up - down) / (2 * step), rel=2e-2, abs=0.5)
    assert np.all(np.linalg.eigvalsh(found.information) > 0)


def test_fishers_information_is_the_scatter_of_the_score() -> None:
    """At the truth of a right model the scores' mean square is the information: two ways to one matrix."""
    truth, recording = pump()
    task = Problem(subject(truth, truth, False, "R,psi_m,L_q"), (rows_of(recording, truth.T, truth.dc_link, "pump"),))
    q = task.guess
    q[[task.index("s_v"), task.index("s_d")]] -= 4.0
    q[task.index("s_T")] -= 4.0
    found = slope(task, q, task.data, Stage())
    prior = np.diag(1 / task.prior[task.data] ** 2)
    ratio = np.diag(found.scores.T @ found.scores) / np.diag(found.information - prior)
    assert np.all((ratio > 0.7) & (ratio < 1.4)), ratio


def test_students_factor() -> None:
    for degrees in (5, 11, 23, 100):
        assert student(degrees) == pytest.approx(stats.t.ppf(0.975, degrees), rel=2e-3)


def test_the_ripple_is_that_of_the_legs() -> None:
    """Beside the legs switched and summed up in small steps."""
    T, dc_link = 1e-4, 300.0
    u = np.array([[60.0, 35.0], [-20.0, 90.0], [0.0, 0.0]])
    edges, swing = ripple(u, dc_link, T)
    steps = 200_000
    t = (np.arange(steps) + 0.5) * T / steps
    for row, (alpha, beta) in enumerate(u):
        on = (t[:, None] > edges[row] * T) & (t[:, None] < T - edges[row] * T)
        legs = dc_link * on
        phases = legs - legs.mean(axis=1, keepdims=True)
        mean = np.array([alpha, (np.sqrt(3) * beta - alpha) / 2, (-np.sqrt(3) * beta - alpha) / 2])
        assert np.allclose(phases.mean(axis=0), mean, atol=0.01)
        flux = np.cumsum(phases - mean, axis=0) * T / steps
        at = np.searchsorted(t, edges[row] * T)
        a, b, c = flux[at].T
        axes = np.column_stack([(2 * a - b - c) / 3, (b - c) / np.sqrt(3)])
        assert np.allclose(-axes.ravel(), swing[row], atol=1e-4 * dc_link * T)


@pytest.mark.parametrize("name", ["ipmsm", "spmsm_load_torque"])
def test_the_ripple_of_a_salient_machine_is_that_of_both_axes(name: str) -> None:
    drive = load_drive(name)
    m, equations = drive.motor, Equations(drive)
    x = ca.SX.sym("x", 5)
    made = ca.Function(
        "made", [equations.column, x], [equations.in_letters(equations.inverse_inductance(x.elements()))]
    )
    letters = {"L_d": m.inductance_d, "L_q": m.inductance_q, "psi_m": 0.1, "p": 3, "R": 1, "J": 1, "D": 1, "T": 1e-4}
    theta = 0.7
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    right = turn @ np.diag([1 / m.inductance_d, 1 / m.inductance_q]) @ turn.T
    found = made([letters.get(word, 0.0) for word in equations.names], [0.01, 0.02, 30.0, theta, 0.0])
    assert np.allclose(found.full(), right, rtol=1e-12)


def test_the_model_takes_what_the_other_simulators_legs_took() -> None:
    """Where all signs are whole, flux and resistance of a recording's truth say what arrived: to a hundredth of V_d.

    L is large: of a small one the current between two samples is not the mean of theirs, and the truth says less.
    """
    truth, _ = other_pwm("ipmsm", "ipmsm_flux", 6000)
    data = {name: values.astype(float) for name, values in np.load(DATA / "ipmsm_pwm.npz").items()}
    i, u = (data[f"{letter}_alpha"] + 1j * data[f"{letter}_beta"] for letter in "iu")
    turn = np.exp(1j * data["theta"])
    axes = i * turn.conj()
    flux = (truth.psi_m + truth.L_d * axes.real + 1j * truth.L_q * axes.imag) * turn
    lost = u[1:] - np.diff(flux) / truth.T - truth.R * (i[1:] + i[:-1]) / 2
    volts = truth.dc_link * truth.dead_time / truth.T
    equations = Equations(load_drive("ipmsm_flux"), frozenset({"D", "I_1"}))
    letters = {"R": truth.R, "L_d": truth.L_d, "L_q": truth.L_q, "psi_m": truth.psi_m, "p": truth.p, "J": truth.J}
    letters |= {"T": truth.T, "V_d": volts, "I_0": 0.05}
    applied = equations.applied([letters[name] for name in equations.names])
    nothing = np.zeros(len(u))
    x = np.column_stack([flux.real, flux.imag, data["omega"], data["theta"], data["load_torque"], nothing, nothing])
    columns = np.column_stack([u.real, u.imag])
    edges, swing = ripple(columns, truth.dc_link, truth.T)
    rows = np.column_stack([columns, i.real, i.imag, np.ones(len(u)), nothing, edges, swing])
    v, unsure = (np.array(part).T for part in applied(x[:-1].T, rows[1:].T))
    clear = unsure[:, 0] < 1e-9
    assert clear.sum() > 1500
    off = np.abs(u[1:] - v[:, 0] - 1j * v[:, 1] - lost) / volts
    assert np.count_nonzero(off[clear] > 0.01) == 0, np.count_nonzero(off[clear] > 0.01)


# --- the search


@pytest.fixture(scope="module")
def found() -> Identified:
    truth, recording = pump()
    return identify(subject(truth, guessed(truth, np.random.default_rng(2)), False, FREE), [recording])


@pytest.mark.slow
def test_another_simulators_motor_is_found_from_guesses_half_as_large_again(found: Identified) -> None:
    truth, _ = pump()
    errors = off(found, truth)
    assert all(errors[word] <= limit for word, limit in WITHIN.items()), errors
    assert all(e.told for e in found.result.estimates)
    assert all(e.low < e.value < e.high for e in found.result.estimates)
    assert found.result.rank == 5
    assert not found.result.words
    assert found.result.of("R").value == found.facts.R


@pytest.mark.slow
def test_the_likelihood_falls_to_either_side_as_the_interval_says(found: Identified, tmp_path: Path) -> None:
    """At least by half of 1.96^2 at its ends, which is where a right model ends it; the figures are drawn."""
    for place in found.problem.data:
        x, height = along(found, place)
        e = found.result.estimates[found.problem.data.index(place)]
        assert height[len(x) // 2] == pytest.approx(0.0, abs=1e-6)
        assert np.all(np.interp([e.low, e.high], x, height) < -1.7)
    pictures = write_figures(found, tmp_path / "figures")
    assert [path.name for path in pictures] == ["innovations.svg", "likelihood.svg"]
    assert all(path.read_text(encoding="utf-8").rstrip().endswith("</svg>") for path in pictures)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("name", list(MOTORS))
def test_the_truth_lies_in_the_intervals(name: str) -> None:
    """Ten draws; forty are in ``python -m benchmarks.identify averaged``."""
    from benchmarks.identify import scores

    m, rng = MOTORS[name], np.random.default_rng(11)
    truth = facts_of(m)
    free = "R,L,psi_m,J" if m.L_d == m.L_q else FREE
    runs = [identify(subject(truth, guessed(truth, rng), False, free), [one]) for one in recordings(m, 10, seed=5)]
    table = scores(runs, truth)
    assert all(score.worst <= {**WITHIN, "L": 0.02}[word] for word, score in table.items()), table
    assert np.mean([score.covered for score in table.values()]) >= 0.9, table


@pytest.mark.slow
def test_behind_a_switching_inverter_with_dead_time() -> None:
    truth, draw = other_pwm("ipmsm", "ipmsm_flux", 2200)
    rng = np.random.default_rng(1)
    run = identify(subject(truth, guessed(truth, rng), True), [draw(rng)])
    errors = off(run, truth)
    within = {"R": 0.03, "L_d": 0.1, "L_q": 0.1, "psi_m": 0.005, "V_dead": 0.1}
    assert all(errors[word] <= limit for word, limit in within.items()), errors


@pytest.mark.slow
@pytest.mark.thorough
def test_a_model_without_the_dead_time_is_wrong() -> None:
    """The other half of the claim."""
    truth, draw = other_pwm("ipmsm", "ipmsm_flux", 4000)
    rng = np.random.default_rng(1)
    blind = replace(guessed(truth, rng), dead_time=0.0)
    run = identify(subject(truth, blind, True, FREE), [draw(rng)])
    assert off(run, truth)["R"] > 0.1


@pytest.fixture
def one_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the guesses alone: for what does not hang on how far off they are."""
    monkeypatch.setattr(search_module, "STARTS", 1)


@pytest.mark.slow
@pytest.mark.usefixtures("one_start")
def test_what_a_recording_cannot_show_is_told_with_the_run_that_would() -> None:
    """At steady speed no inertia shows, and friction is never told from a load."""
    m = MOTORS["pump"]
    truth, recording = pump()
    truth = replace(truth, D=0.01)
    guess = replace(truth, J=1.3 * truth.J)
    run = identify(subject(truth, guess, False, "psi_m,J,D"), [cut(recording, slice(2400, 2600))])
    J, D = run.result.of("J"), run.result.of("D")
    assert not J.told
    assert J.low < m.J < J.high
    assert not D.told
    assert D.high > 5 * D.low
    assert run.result.of("psi_m").told
    for word, remedy in (("J", "accelerate"), ("D", "coast")):
        assert any(line.startswith(f"{word}: these") and remedy in line for line in run.result.words)


@pytest.mark.slow
@pytest.mark.usefixtures("one_start")
def test_two_recordings_say_more_than_one() -> None:
    truth, recording = pump()
    parts = [cut(recording, slice(0, 1000)), cut(recording, slice(1000, 2000))]
    task = subject(truth, replace(truth, R=1.3 * truth.R, psi_m=0.8 * truth.psi_m), False, "R,psi_m")
    both, first = identify(task, parts), identify(task, parts[:1])
    assert len(both.problem.recordings) == 2
    assert both.result.of("psi_m").width < first.result.of("psi_m").width
    assert off(both, truth)["R"] < 0.01


@pytest.mark.slow
@pytest.mark.usefixtures("one_start")
def test_offsets_of_the_sensors_are_found() -> None:
    truth, recording = pump()
    short = cut(recording, slice(0, 1200))
    guess = replace(truth, R=0.7 * truth.R, psi_m=1.3 * truth.psi_m)
    task = subject(truth, guess, False, "R,psi_m,i_alpha_offset,i_beta_offset")
    run = identify(task, [replace(short, y=short.y + np.array([0.12, -0.07]))])
    for word, value in (("R", truth.R), ("psi_m", truth.psi_m), ("i_alpha_offset", 0.12), ("i_beta_offset", -0.07)):
        e = run.result.of(word)
        assert e.told
        assert e.low - 0.3 * (e.high - e.low) < value < e.high + 0.3 * (e.high - e.low), word
        assert e.value == pytest.approx(value, rel=0.01, abs=0.006 if e.datum.unit == "A" else 0)


@pytest.mark.slow
@pytest.mark.usefixtures("one_start")
def test_friction_is_told_from_a_constant_load_by_running_at_several_speeds() -> None:
    motor = replace(MOTORS["pump"], D=0.02)
    truth, recording = facts_of(motor), recordings(motor, 1, 0.12)[0]
    run = identify(subject(truth, replace(truth, D=0.6 * truth.D, J=1.3 * truth.J), False, "J,D"), [recording])
    assert run.result.of("D").told
    errors = off(run, truth)
    assert errors["J"] < 0.01
    assert errors["D"] < 0.05


@pytest.mark.slow
@pytest.mark.usefixtures("one_start")
def test_a_machine_of_ones_own_is_found_by_its_own_equations() -> None:
    """Its magnets have harmonics that no shipped machine has, and no L_q is in it."""
    drive = load_drive(EXAMPLE / "my_motor.toml")
    run = trajectory_of(drive, 1500)
    recording = Recorded(Path("own.npz"), run.t, run.u, run.y, {})
    task = read_subject(str(EXAMPLE / "my_motor.toml"), "R,L_d,L_q,psi_m")
    f = task.facts
    found = identify(replace(task, facts=replace(f, R=1.3 * f.R, L_d=0.7 * f.L_d, psi_m=1.2 * f.psi_m)), [recording])
    for word, value, within in (("R", f.R, 0.005), ("L_d", f.L_d, 0.01), ("psi_m", f.psi_m, 0.001)):
        assert found.result.of(word).told
        assert found.result.of(word).value == pytest.approx(value, rel=within)
    assert not found.result.of("L_q").told
    assert found.result.words == ("L_q: the equations of this machine do not have it.",)


def test_an_interrupted_search_keeps_its_best(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search_module, "KAPPAS", (0.03, 0.003))
    seen = []

    def tell(text: str, share: float) -> None:
        seen.append(text)
        if any("start 2" in word for word in seen):
            raise KeyboardInterrupt

    best = search(problem(), tell)
    assert best.interrupted
    assert np.isfinite(best.slope.value)

    def at_once(text: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        search(problem(), at_once)
