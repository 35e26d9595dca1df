"""Load steps that ``identify`` finds, and the inertia that then shows."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.identify import guessed, other_pwm, subject
from benchmarks.other_motor import MOTORS, recordings
from runtime.identify.identify import identify
from runtime.identify.likelihood import slope
from runtime.identify.load_steps import with_next_step
from runtime.identify.problem import Problem, Stage
from runtime.identify.rows import rows_of
from tests.runtime.test_identify import off, pump


def problem_with_load(steps_at: float) -> Problem:
    """Of the truth, the load taken for one that wanders, as the search leaves it."""
    truth, _ = pump()
    recording = recordings(MOTORS["pump"], 1, 0.12, load=0.8, steps_at=steps_at)[0]
    return Problem(subject(truth, truth, False, "J"), (rows_of(recording, truth.T, truth.dc_link, "pump"),))


def test_the_step_of_a_load_is_found_and_inertia_shows() -> None:
    task = problem_with_load(0.7)
    q, J = task.guess, [task.index("J"), task.index("s_T")]
    q[[task.index("s_v"), task.index("s_d")]] -= 4.0
    stepped, quieter = with_next_step(task, q) or pytest.fail("no step")
    (at,) = stepped.recordings[0].load_steps
    assert at == pytest.approx(0.084, abs=0.003)
    assert with_next_step(stepped, quieter) is None, "and no other"
    before, after = (slope(one, at_q, J, Stage()).information for one, at_q in ((task, q), (stepped, quieter)))
    assert after[0, 0] > 30 * before[0, 0]


def test_a_load_without_steps_has_none() -> None:
    task = problem_with_load(0.0)
    q = task.guess
    q[[task.index("s_v"), task.index("s_d")]] -= 4.0
    assert with_next_step(task, q) is None


@pytest.mark.slow
@pytest.mark.thorough
def test_inertia_is_told_beside_a_load_step() -> None:
    """Behind a switching inverter; without the step it lies between a seventh and seven times its value."""
    truth, draw = other_pwm("ipmsm", "ipmsm_flux", 6000)
    rng = np.random.default_rng(1)
    run = identify(subject(truth, guessed(truth, rng), True), [draw(rng)])
    assert run.problem.recordings[0].load_steps == (pytest.approx(0.4, abs=0.005),)
    assert run.result.of("J").told
    assert off(run, truth)["J"] < 0.03
