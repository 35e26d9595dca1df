"""What a design gives up: its load-step error with exactly known data, beside copies tuned for just that run.

``python -m benchmarks.design_tuned [MOTOR...] [--held-out] [--dead-time] [--json F]``; some twenty minutes for all on
two quiet cores. A copy is the same generated filter and controller with another process noise, found by trial: the one
of least error in the load step that is no worse while starting and no noisier at the end; a ``free`` copy may be both.
The motor is exactly as stated, starts within the facts' angle, goes to rated speed and meets rated torque; the inverter
is the averaged one, without dead time unless ``--dead-time`` is given (design and inverter then have the facts'); the
sensors have the facts' noise and rounding. All are judged on noise and starts that no trial had.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.design import motors
from runtime.design.facts import Facts, read_facts
from runtime.design.rules import Design, design
from runtime.design.trial import package
from runtime.drive.fleet import Cases
from runtime.drive.scenario import find_scenario
from runtime.recorded.units import RPM
from runtime.study.package import Package, open_fleet

Array = NDArray[np.float64]
#: Half-widths that count as small, and those of a facts file that states none.
TOLERANCES = {
    "small": {"d_R": 0.02, "d_L": 0.01, "d_psi": 0.005, "d_J": 0.02},
    "default": {"d_R": 0.20, "d_L": 0.10, "d_psi": 0.05, "d_J": 0.20},
}
#: Seeds of the runs that copies are tuned on, and of those that they are judged on.
TUNED_ON, JUDGED_ON = range(16), range(1000, 1064)
#: The search: rounds of so many copies, drawn about the mean of the last round's best, with the spread of those; at
#: first about the design, each entry by a factor of e^WIDTH.
ROUNDS, COPIES, BEST, WIDTH = 16, 24, 6, 1.5


@dataclass(frozen=True)
class Errors:
    """Of the speed estimate, r/min, mean over the runs: largest while starting, rms of the end, largest from the load
    step on. Infinite where a run lost the rotor."""

    start: float
    steady: float
    load: float

    def excess(self, other: Errors) -> float:
        """By which share this is worse than another while starting or at the end; 0: in neither."""
        return max(self.start / other.start, self.steady / other.steady, 1.0) - 1.0


class Bench:
    """A design's closed loop with exact motor data, run with any process noise."""

    def __init__(self, facts: Facts, chosen: Design) -> None:
        made = package(chosen)
        self.facts, self.scenario = facts, find_scenario("load_step", made.drive)
        self.fleet = open_fleet(Package(chosen.name, chosen.kind, tuple(made.files.items())))
        self.noise = np.array(chosen.sections["filter"]["process_noise"].value)

    def errors(self, scales: Array, seeds: Sequence[int]) -> list[Errors]:
        """Errors of copies.

        Parameters
        ----------
        scales : (copies, entries - 1) array
            Factors on the design's process noise; both electrical states have the same.
        seeds : sequence of int
            Of each copy's runs.
        """
        scales, runs = np.atleast_2d(scales), len(seeds)
        factors = np.column_stack([scales[:, :1], scales])  # the second electrical state
        starts = [np.random.default_rng(seed).uniform(-self.facts.angle, self.facts.angle) for seed in seeds]
        cases = Cases(
            seed=np.tile(seeds, len(scales)),
            theta=np.tile(starts, len(scales)),
            noise=self.facts.sigma,
            tuning={"Q": np.repeat((factors * self.noise).T, runs, axis=1)},
        )
        found = self.fleet.run(self.scenario, cases)
        rows = np.stack([found.start, found.steady_rms, found.load_step])
        rows = np.where(found.good, rows, np.inf).reshape(3, len(scales), runs)
        return [Errors(*copy) for copy in rows.mean(axis=2).T.tolist()]

    def tuned(self, free: bool) -> Array:
        """The factors of the best copy found; the design's own, 1, are the first that is tried.

        Parameters
        ----------
        free : bool
            Whether it may be worse than the design while starting and at the end.
        """
        own = np.ones(len(self.noise) - 1)
        (limit,) = self.errors(own, TUNED_ON)

        def costs(scales: Array) -> list[float]:
            copies = self.errors(scales, TUNED_ON)
            excess = [0.0 if free else copy.excess(limit) for copy in copies]
            # Whatever exceeds the design comes after all that do not, the nearest first.
            return [1e3 + e if e > 0.0 else copy.load / limit.load for e, copy in zip(excess, copies, strict=True)]

        return least(costs, own)


def least(costs: Callable[[Array], list[float]], first: Array) -> Array:
    """Where the cost of positive numbers is least, as far as a search over their logarithms finds it.

    Parameters
    ----------
    costs : callable
        Of many at once, (B, n).
    first : (n,) array
        Found again if nothing costs less.
    """
    rng = np.random.default_rng(1)
    best, cost = first, costs(first[None])[0]
    centre, spread = np.log(first), WIDTH**2 * np.eye(len(first))
    for _ in range(ROUNDS):
        tried = rng.multivariate_normal(centre, spread, COPIES)
        found = costs(np.exp(tried))
        order = np.argsort(found)
        if found[order[0]] < cost:
            best, cost = np.exp(tried[order[0]]), found[order[0]]
        elite = np.vstack([np.log(best), tried[order[:BEST]]])
        centre, spread = elite.mean(axis=0), 0.5 * spread + 0.5 * np.cov(elite.T)
    return best


def measure(facts: Facts) -> dict[str, Any]:
    """A motor's figures: a design's own beside a copy's that is tuned, and one's that is free to be noisy."""
    bench = Bench(facts, design(facts))
    own = np.ones(len(bench.noise) - 1)
    return judged(bench, {"design": own, "tuned": bench.tuned(free=False), "free": bench.tuned(free=True)})


def judged(bench: Bench, factors: dict[str, Array]) -> dict[str, Any]:
    """Errors of "design", "tuned" and "free" on runs that no trial had, and ratios of those in the load step.

    A copy that turns out worse here, or loses a rotor, is none that anyone would keep: its ratio is 1.
    """
    found = dict(zip(factors, bench.errors(np.stack(list(factors.values())), JUDGED_ON), strict=True))
    return {
        "errors": {name: asdict(errors) for name, errors in found.items()},
        "factors": {name: values.tolist() for name, values in factors.items()},
        "ratio": found["design"].load / min(found["design"].load, found["tuned"].load),
        "free ratio": found["design"].load / min(found["design"].load, found["free"].load),
    }


def row(name: str, found: dict[str, Any], rated: float) -> str:
    """A line of the table; ``rated`` r/min."""
    copies = "   ".join(
        f"{e['start']:7.3g} {e['steady']:7.3g} {e['load']:7.3g} {e['load'] / rated:6.2%}"
        for e in found["errors"].values()
    )
    return f"{name:22s} {copies}   {found['ratio']:5.2f} {found['free ratio']:5.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motors", nargs="*", help="names of facts files; default: all")
    parser.add_argument("--held-out", action="store_true", help="motors that no rule was chosen by")
    parser.add_argument("--dead-time", action="store_true", help="the facts' dead time instead of none")
    parser.add_argument("--tolerance", choices=TOLERANCES, action="append", help="default: all of them")
    parser.add_argument("--json", type=Path)
    words = parser.parse_args()
    print(f"{'r/min':22s}" + "".join(f" {name:>29s}  " for name in ("design", "tuned", "free")) + "ratios")
    print(f"{'motor':22s}" + 3 * f" {'start':>7s} {'steady':>7s} {'load':>7s} {'':6s}  " + "tuned  free")
    found: dict[str, dict[str, Any]] = {tolerance: {} for tolerance in words.tolerance or TOLERANCES}
    for path in motors(words.held_out, words.motors):
        for tolerance, motors_found in found.items():
            facts = replace(read_facts(path), **TOLERANCES[tolerance])
            facts = facts if words.dead_time else replace(facts, dead_time=0.0)
            motors_found[path.stem] = measure(facts)
            print(row(f"{path.stem} {tolerance}", motors_found[path.stem], facts.speed * RPM), flush=True)
    for tolerance, motors_found in found.items():
        for name in ("ratio", "free ratio"):
            ratios = [motor[name] for motor in motors_found.values()]
            figures = f"mean {np.mean(ratios):.2f}, median {np.median(ratios):.2f}, worst {max(ratios):.2f}"
            print(f"{tolerance}, {name}: {figures}")
    if words.json:
        words.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
