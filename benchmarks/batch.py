"""How fast filters run over recorded data: batches in C, on one and two threads, and a single step from Python.

Run: python benchmarks/batch.py
Every figure is the best of several runs taken in turn, because other programs only ever slow a run down; the median
stands beside it. The bits of each batch are compared with the scalar form's before anything is timed.
"""

from __future__ import annotations

import os
import timeit
from collections.abc import Callable
from typing import Any

import numpy as np

import runtime
from runtime.estimator.c_backend import CBackend
from runtime.estimator.folder import GeneratedFolder, find_folder
from runtime.estimator.lanes import OPTIMISATION, USUAL
from runtime.estimator.threads import VARIABLE

FILTERS, STEPS, ROUNDS = 1000, 1000, 15
CASES = (("paper_spmsm", "ckf"), ("paper_spmsm", "ickf"), ("spmsm_load_torque", "ickf"), ("ipmsm_flux", "ickf"))

Batch = Callable[[], tuple[Any, ...]]


def currents(folder: GeneratedFolder) -> tuple[Any, Any]:
    """Voltages and noisy currents of a motor at speed, each filter with noise of its own."""
    rng = np.random.default_rng(0)
    angle = np.arange(STEPS) * folder.module.SAMPLE_TIME * 400.0
    pair = np.column_stack([np.cos(angle), np.sin(angle)])[:, :, None]
    noise = rng.normal(0, 0.05, (STEPS, 2, FILTERS))
    return np.broadcast_to(60.0 * pair, noise.shape).astype(np.float32), (4.0 * pair + noise).astype(np.float32)


def batches(folder: GeneratedFolder, kind: str) -> dict[str, Batch]:
    """The ways to run a batch, by the heading of their column."""
    module = folder.module
    x0 = np.repeat(np.array(module.DEFAULTS["x_0"], dtype=np.float32)[:, None], FILTERS, axis=1)
    words = np.repeat(module.pack(np.diag(module.DEFAULTS["P_0"])).astype(np.float32)[:, None], FILTERS, axis=1)
    u, y = currents(folder)

    def batch(lanes: bool, last_only: bool, threads: int, optimisation: tuple[str, ...] = OPTIMISATION) -> Batch:
        backend = CBackend(folder, kind, "float32", lanes=lanes, lane_flags=optimisation)
        backend.reset(x0, words)

        def run() -> tuple[Any, ...]:
            os.environ[VARIABLE] = str(threads)
            return backend.run(u, y, last_only)

        return run

    return {
        "scalar": batch(False, True, 1),
        "half vectors": batch(True, True, 1, USUAL),
        "1 thread": batch(True, True, 1),
        "2 threads": batch(True, True, 2),
        "1, all": batch(True, False, 1),
        "2, all": batch(True, False, 2),
    }


def rates(ways: dict[str, Batch]) -> dict[str, tuple[float, float]]:
    """Million steps a second, best and median, the ways taken in turn; first their results are compared."""
    results = {name: run() for name, run in ways.items()}
    for name, result in results.items():
        for mine, scalar in zip(result, results["scalar"], strict=True):
            assert np.array_equal(mine[-1:].view(np.int32), scalar.view(np.int32)), f"{name}: other bits"
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, run in ways.items():
            times[name].append(timeit.timeit(run, number=1))
    million = FILTERS * STEPS / 1e6
    return {name: (million / min(t), million / float(np.median(t))) for name, t in times.items()}


def microseconds(call: str, names: dict[str, Any], number: int) -> tuple[float, float]:
    """One call, best and median of many rounds."""
    rounds = timeit.repeat(call, globals=names, number=number, repeat=500)
    return min(rounds) / number * 1e6, float(np.median(rounds)) / number * 1e6


def filterpy_ukf() -> Any:
    """filterpy's unscented filter on the paper's motor, or None if it is not installed."""
    try:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ImportError:
        return None
    T, R, L, psi, p = 20e-6, 2.875, 835e-6, 0.175, 4

    def f(x: Any, dt: float, u: Any) -> Any:
        a, b, w, th = x
        sine, cosine = np.sin(th), np.cos(th)
        return np.array(
            [
                a + dt * (u[0] - R * a + psi * p * w * sine) / L,
                b + dt * (u[1] - R * b - psi * p * w * cosine) / L,
                w,
                th + dt * p * w,
            ]
        )

    points = MerweScaledSigmaPoints(4, 1e-3, 2.0, 0.0)
    ukf = UnscentedKalmanFilter(4, 2, T, hx=lambda x: x[:2], fx=f, points=points)
    ukf.P, ukf.Q, ukf.R = np.diag([0.1, 0.1, 50, 0.1]), np.diag([0.01, 0.02, 0.24, 0.001]), 0.01 * np.eye(2)
    return ukf


def show_batches() -> None:
    print(f"{FILTERS} filters, {STEPS} steps, float32: million steps a second, best (median) of {ROUNDS} runs.")
    print(
        "scalar: the firmware's C in a loop, one thread; 1, 2 threads: lane form, keep='last'; all: every step kept;\n"
        "half vectors: 1 thread without -mprefer-vector-width=512, which is the same where there is no AVX-512.\n"
    )
    for drive, kind in CASES:
        found = rates(batches(find_folder(drive), kind))
        if (drive, kind) == CASES[0]:
            print(
                f"{'':<24}" + "".join(f"{name:>15}" for name in found) + f"{'1 thread/scalar':>18}{'1 thread/half':>15}"
            )
        row = "".join(f"{f'{best:.1f} ({median:.1f})':>15}" for best, median in found.values())

        def ratio(other: str, found: dict[str, tuple[float, float]] = found) -> float:
            return found["1 thread"][0] / found[other][0]

        print(f"{f'{drive} {kind}':<24}{row}{ratio('scalar'):>18.1f}{ratio('half vectors'):>15.2f}")


def show_single_steps() -> None:
    print("\nOne step() call from Python, paper_spmsm ickf: microseconds, best (median).\n")
    pairs, arrays = ([10.0, 0.0], [0.1, 0.0]), (np.array([10.0, 0.0]), np.array([0.1, 0.0]))
    medians = {}
    for label, backend, (u, y) in (("C, lists", "c", pairs), ("C, arrays", "c", arrays), ("NumPy", "numpy", pairs)):
        f = runtime.load("paper_spmsm", "ickf", backend, "float32")
        best, medians[label] = microseconds(
            "step(u, y)", {"step": f.step, "u": u, "y": y}, 1000 if backend == "c" else 20
        )
        print(f"{label:<36}{best:>9.2f} ({medians[label]:.2f})")
    peer = filterpy_ukf()
    if peer is None:
        print("filterpy's UKF: not run, filterpy is not installed (pip install filterpy)")
        return
    names = {"ukf": peer, "u": np.array(pairs[0]), "y": np.array(pairs[1])}
    best, median = microseconds("ukf.predict(u=u); ukf.update(y)", names, 20)
    print(f"{'filterpy UKF, predict and update':<36}{best:>9.2f} ({median:.2f})")
    print(f"{'filterpy / C, lists':<36}{'':>9} {median / medians['C, lists']:.0f} times")


if __name__ == "__main__":
    show_batches()
    show_single_steps()
