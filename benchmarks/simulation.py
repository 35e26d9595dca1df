"""How fast the closed loop simulates: seconds of drive time per second of wall time, on one core.

Run: python benchmarks/simulation.py
"""

from __future__ import annotations

import time

from runtime.drive.experiment import HARD
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.folder import find_folder

LONG = Scenario("long", load=5.0, duration=10.0)


def rate(simulator: Simulator, conditions: Conditions, repeats: int = 5) -> float:
    """Best of some runs: simulated seconds per wall second."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.perf_counter()
        simulator.run(LONG, conditions)
        best = min(best, time.perf_counter() - begin)
    return LONG.duration / best


def main() -> None:
    print(f"{'drive':<20}{'filter':<8}{'T, us':>6}{'averaged':>10}{'PWM':>8}   simulated s per wall s, one core")
    for drive in ("spmsm_load_torque", "ipmsm_flux", "paper_spmsm"):
        for kind in ("ckf", "ickf"):
            simulator = Simulator(find_folder(drive), kind)
            T = simulator.module.SAMPLE_TIME * 1e6
            rates = [rate(simulator, conditions) for conditions in (Conditions(), HARD)]
            print(f"{drive:<20}{kind:<8}{T:>6.0f}{rates[0]:>10.0f}{rates[1]:>8.0f}")


if __name__ == "__main__":
    main()
