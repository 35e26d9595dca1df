"""How fast the closed loop simulates: seconds of drive time per second of wall time on one core, and runs a second
side by side.

Run: python benchmarks/simulation.py
"""

from __future__ import annotations

import time

import numpy as np

from model.drives.load import load_drive
from runtime.drive.experiment import HARD
from runtime.drive.fleet import Cases, Fleet
from runtime.drive.scenario import Scenario, find_scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.folder import find_folder
from runtime.estimator.threads import thread_count

LONG = Scenario("long", speed=1000.0, load=5.0, duration=10.0)


def rate(simulator: Simulator, conditions: Conditions, repeats: int = 5) -> float:
    """Best of some runs: simulated seconds per wall second."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.perf_counter()
        simulator.run(LONG, conditions)
        best = min(best, time.perf_counter() - begin)
    return LONG.duration / best


def fleet_rate(fleet: Fleet, threads: int, runs: int = 640, repeats: int = 7) -> float:
    """Best of some fleets: runs of 0.4 s per wall second, averaged inverter."""
    best = float("inf")
    for _ in range(repeats):
        begin = time.perf_counter()
        fleet.run(find_scenario("load_step", load_drive(fleet.folder.drive)), Cases(seed=np.arange(runs)), threads)
        best = min(best, time.perf_counter() - begin)
    return runs / best


def fleets() -> None:
    threads = thread_count()
    print(
        f"\n{'drive':<20}{'filter':<8}{'T, us':>6}{'1 thread':>10}{f'{threads} threads':>11}   runs of 0.4 s per wall s"
    )
    for drive in ("spmsm_load_torque", "ipmsm_flux", "paper_spmsm"):
        for kind in ("ckf", "ickf"):
            fleet = Fleet(find_folder(drive), kind)
            rates = [fleet_rate(fleet, count) for count in (1, threads)]
            T = fleet.folder.module.SAMPLE_TIME * 1e6
            print(f"{drive:<20}{kind:<8}{T:>6.0f}{rates[0]:>10.0f}{rates[1]:>11.0f}")


def supervised() -> None:
    """Whole drives in lanes and one by one, from power-up at the same angles: processor time, one thread."""
    print(f"\n{'drive':<20}{'filter':<8}{'in lanes':>10}{'scalar':>8}{'ratio':>7}   runs of 0.4 s per CPU s")
    theta = np.linspace(-np.pi, np.pi, 32)
    for drive in ("spmsm_load_torque", "ipmsm_flux", "paper_spmsm"):
        fleet, simulator = Fleet(find_folder(drive), "ckf", supervised=True), Simulator(find_folder(drive), "ckf")
        scenario, cases = find_scenario("load_step", load_drive(drive)), Cases(seed=1, theta=theta)
        begin = time.process_time()
        for _ in range(5):
            fleet.run(scenario, cases, threads=1)
        middle = time.process_time()
        for angle in theta:
            simulator.run(scenario, Conditions(theta=float(angle), supervised=True))
        lanes, scalar = 5 * len(theta) / (middle - begin), len(theta) / (time.process_time() - middle)
        print(f"{drive:<20}{'ckf':<8}{lanes:>10.0f}{scalar:>8.0f}{lanes / scalar:>7.1f}")


def main() -> None:
    print(f"{'drive':<20}{'filter':<8}{'T, us':>6}{'averaged':>10}{'PWM':>8}   simulated s per wall s, one core")
    for drive in ("spmsm_load_torque", "ipmsm_flux", "paper_spmsm"):
        for kind in ("ckf", "ickf"):
            simulator = Simulator(find_folder(drive), kind)
            T = simulator.module.SAMPLE_TIME * 1e6
            rates = [rate(simulator, conditions) for conditions in (Conditions(), HARD)]
            print(f"{drive:<20}{kind:<8}{T:>6.0f}{rates[0]:>10.0f}{rates[1]:>8.0f}")
    fleets()
    supervised()


if __name__ == "__main__":
    main()
