"""How well ``identify`` finds motor data, from guesses 30 to 50 % off, and how honest its intervals are.

``python -m benchmarks.identify [averaged|pwm|design|time ...] [--draws N] [--json F]``; without words all of them, some
twenty minutes on two quiet cores.

``averaged``: recordings of :mod:`benchmarks.other_motor`, 0.4 s, 0.05 A of noise. ``pwm``: recordings in service of
another simulator (tests/data) and of the project's own, behind a switching inverter with dead time, converters of 12
bits, voltage as commanded. ``design``: the errors, on another run, of a filter designed from what was found beside
those of one designed from the true data. ``time``: one recording of 4000 samples, six data.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_motor import MOTORS, Motor, recordings
from codegen.output.folder import write_folder
from model.drives.load import load_drive
from runtime.design.facts import Facts, parse_facts, read_facts
from runtime.identify.identify import Identified, identify
from runtime.identify.subject import Subject, read_subject
from runtime.recorded.data import Recorded

Array = NDArray[np.float64]
DATA = Path(__file__).parents[1] / "tests" / "data"
#: Factors on the truth that guesses are drawn from.
OFF = (0.5, 0.6, 0.7, 1.3, 1.4, 1.5)
NOISE, BITS, DEAD_TIME = 0.05, 12, 2e-6


@dataclass(frozen=True)
class Score:
    """Of a datum over the draws: largest and mean error, mean half-width (all relative), shares covered and told."""

    worst: float
    mean: float
    half: float
    covered: float
    told: float


def facts_of(m: Motor) -> Facts:
    """The truth as facts."""
    return parse_facts(
        {
            "name": m.name,
            "motor": {
                "stator_resistance": m.R,
                "inductance_d": m.L_d,
                "inductance_q": m.L_q,
                "magnet_flux": m.psi_m,
                "pole_pairs": m.p,
                "inertia": m.J,
                "friction": m.D,
            },
            "rated": {"speed": m.speed, "torque": m.torque, "max_current": m.max_current},
            "inverter": {"dc_link": m.dc_link, "sample_time": m.T},
            "sensor": {"range": 2.5 * m.max_current, "bits": 16, "noise": NOISE},
        },
        m.name,
    )


def guessed(facts: Facts, rng: np.random.Generator) -> Facts:
    """Each datum 30 to 50 % off; of a round rotor one inductance."""
    R, L_d, L_q, psi, J = rng.choice(OFF, 5)
    L_q = L_d if facts.L_d == facts.L_q else L_q
    return replace(
        facts, R=facts.R * R, L_d=facts.L_d * L_d, L_q=facts.L_q * L_q, psi_m=facts.psi_m * psi, J=facts.J * J
    )


def subject(truth: Facts, guess: Facts, of_phases: bool, free: str | None = None) -> Subject:
    """A subject of facts that lie in no file."""
    import tempfile

    from runtime.design.write import facts_text
    from runtime.identify.write import facts_tables

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "facts.toml"
        path.write_text(facts_text(facts_tables(truth)), encoding="utf-8")
        made = read_subject(str(path), free)
    s2 = truth.sigma**2
    noise = (s2, s2 / math.sqrt(3), 5 * s2 / 3) if of_phases else (s2, 0.0, s2)
    return replace(made, facts=guess, noise=noise)


def scores(runs: list[Identified], truth: Facts) -> dict[str, Score]:
    """A score a datum."""
    volts = truth.dc_link * truth.dead_time / truth.T
    true = {"R": truth.R, "L": truth.L_d, "L_d": truth.L_d, "L_q": truth.L_q, "psi_m": truth.psi_m, "J": truth.J}
    true["V_dead"] = volts
    found = {}
    for k, first in enumerate(runs[0].result.estimates):
        each, value = [run.result.estimates[k] for run in runs], true[first.datum.word]
        errors = np.array([e.value / value - 1 for e in each])
        found[first.datum.word] = Score(
            float(np.max(np.abs(errors))),
            float(np.mean(errors)),
            float(np.mean([(e.high - e.low) / 2 / value for e in each])),
            float(np.mean([e.low <= value <= e.high for e in each])),
            float(np.mean([e.told for e in each])),
        )
    return found


def averaged(draws: int) -> Iterator[tuple[str, dict[str, Score]]]:
    """Every motor of the other simulator."""
    for m in MOTORS.values():
        truth, rng = facts_of(m), np.random.default_rng(7)
        free = "R,L,psi_m,J" if m.L_d == m.L_q else "R,L_d,L_q,psi_m,J"
        runs = [
            identify(subject(truth, guessed(truth, rng), False, free), [recording])
            for recording in recordings(m, draws)
        ]
        yield m.name, scores(runs, truth)


def converted(i: Array, full_scale: float, rng: np.random.Generator) -> Array:
    """What two sensors and a converter make of currents (N, 2), A."""
    phases = np.column_stack([i[:, 0], (np.sqrt(3) * i[:, 1] - i[:, 0]) / 2]) + NOISE * rng.normal(size=i.shape)
    step = 2 * full_scale / 2**BITS
    a, b = (np.round(phases / step) * step).T
    return np.column_stack([a, (a + 2 * b) / np.sqrt(3)])


def other_pwm(motor: str, drive: str, samples: int) -> tuple[Facts, Callable[[np.random.Generator], Recorded]]:
    """A recording of motulator's switching inverter, its truth, and its draws."""
    from runtime.identify.subject import facts_of as of_drive

    facts = replace(of_drive(load_drive(drive)), dead_time=DEAD_TIME, bits=BITS, noise=NOISE, D=0.0)
    data = {name: values[:samples].astype(float) for name, values in np.load(DATA / f"{motor}_pwm.npz").items()}
    i, u = (np.column_stack([data[f"{x}_alpha"], data[f"{x}_beta"]]) for x in "iu")

    def draw(rng: np.random.Generator) -> Recorded:
        return Recorded(Path(f"{motor}_pwm.npz"), data["t"], u, converted(i, facts.range, rng), {})

    return facts, draw


def own_pwm(name: str) -> tuple[Facts, Callable[[np.random.Generator], Recorded]]:
    """Recordings in service of a motor of tests/data/facts, of the project's own simulator; a draw is a run."""
    from runtime.design.rules import design
    from runtime.design.trial import package, simulator
    from runtime.drive.scenario import find_scenario
    from runtime.drive.simulation import Conditions

    facts = read_facts(DATA / "facts" / f"{name}.toml")
    drawn = design(facts)
    made = package(drawn)

    def draw(rng: np.random.Generator) -> Recorded:
        seed = int(rng.integers(1, 2**31))
        dead = facts.dead_time or 0.01 * facts.T
        conditions = Conditions(
            "pwm", dead_time=dead, delay=1, noise=facts.noise, bits=facts.bits, range=facts.range, seed=seed
        )
        with simulator(made, drawn.kind) as loop:
            run = loop.run(find_scenario("load_step", made.drive), conditions)
        return Recorded(Path(f"{name}.npz"), run.t, run.u, run.i, {})

    return replace(facts, dead_time=facts.dead_time or 0.01 * facts.T), draw


def pwm(draws: int) -> Iterator[tuple[str, dict[str, Score]]]:
    """Recordings in service, behind a switching inverter."""
    cases = [
        (f"{drive} {samples}", *other_pwm(motor, drive, samples))
        for motor, drive in (("spmsm", "spmsm_load_torque"), ("ipmsm", "ipmsm_flux"))
        for samples in (4000, 6000)
    ]
    cases += [(name, *own_pwm(name)) for name in ("pump_2kw", "servo_400w", "servo_24v")]
    for name, truth, draw in cases:
        runs = []
        for seed in range(draws):
            rng = np.random.default_rng(seed)
            runs.append(identify(subject(truth, guessed(truth, rng), True), [draw(rng)]))
        yield name, scores(runs, truth)


def designed(draws: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Errors on another run, of designs from what was found over those of designs from the truth."""
    import tempfile

    from codegen.generate import generate_bare
    from runtime.estimator.folder import GeneratedFolder
    from runtime.identify.redesign import redesigned
    from runtime.replay.replay import Settings, replay

    def errors(facts: Facts, recording: Recorded) -> Array:
        drive = redesigned(facts)
        with tempfile.TemporaryDirectory() as folder:
            write_folder(Path(folder) / drive.name, generate_bare(drive).files)
            run = replay(GeneratedFolder(Path(folder) / drive.name), recording, Settings(drive.filter.kinds[0]))
        found = run.errors
        assert found is not None
        return np.array([found.speed_start, found.speed_steady_rms, found.position_steady_rms], dtype=float)

    for m in MOTORS.values():
        truth, rng = facts_of(m), np.random.default_rng(7)
        free = "R,L,psi_m,J" if m.L_d == m.L_q else "R,L_d,L_q,psi_m,J"
        other = recordings(m, 1, 0.6, seed=99, speed=0.7, load=0.8)[0]
        ratios = []
        for recording in recordings(m, draws):
            found = identify(subject(truth, guessed(truth, rng), False, free), [recording])
            exact = replace(
                truth, d_R=found.facts.d_R, d_L=found.facts.d_L, d_psi=found.facts.d_psi, d_J=found.facts.d_J
            )
            ratios.append(errors(found.facts, other) / errors(exact, other))
        worst = np.max(ratios, axis=0)
        yield m.name, dict(zip(("speed, start", "speed, steady rms", "position, rms"), worst.tolist(), strict=True))


def timed(draws: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Seconds of one recording of 4000 samples with six data: the whole of ``identify``, and with a cold cache."""
    import os
    import tempfile

    m = MOTORS["pump"]
    truth, rng = facts_of(m), np.random.default_rng(7)
    recording = recordings(m, 1)[0]
    with tempfile.TemporaryDirectory() as folder:
        kept = os.environ.get("PMSM_ICKF_CACHE")
        os.environ["PMSM_ICKF_CACHE"] = folder
        seconds = []
        for _ in range(1 + draws):
            begin = time.perf_counter()
            identify(subject(truth, guessed(truth, rng), False), [recording])
            seconds.append(time.perf_counter() - begin)
        os.environ.pop("PMSM_ICKF_CACHE")
        if kept is not None:
            os.environ["PMSM_ICKF_CACHE"] = kept
    yield "pump", {"compiling, too": seconds[0], "again, worst": max(seconds[1:])}


TASKS = {"averaged": (averaged, 40), "pwm": (pwm, 20), "design": (designed, 3), "time": (timed, 3)}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=", ".join(TASKS))
    parser.add_argument("--draws", type=int)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found: dict[str, dict[str, dict[str, object]]] = {}
    for task in asked.tasks or TASKS:
        run, draws = TASKS[task]
        found[task] = {}
        for name, figures in run(asked.draws or draws):
            found[task][name] = {
                word: asdict(value) if isinstance(value, Score) else value for word, value in figures.items()
            }
            for word, value in figures.items():
                if isinstance(value, Score):
                    print(
                        f"{task} {name:24} {word:7} worst {value.worst:8.3%} mean {value.mean:+8.3%} half "
                        f"{value.half:8.3%} covered {value.covered:5.0%} told {value.told:5.0%}",
                        flush=True,
                    )
                else:
                    print(f"{task} {name:24} {word}: {value:.3f}", flush=True)
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
