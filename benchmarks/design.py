"""How often designs from facts alone hold: every motor of tests/data/facts, 512 draws within its tolerances.

``python -m benchmarks.design [MOTOR...] [--held-out] [--draws N] [--json F]``; some ten minutes for all on two quiet
cores. ``--held-out``: the motors of tests/data/facts_held_out, which no rule was chosen by.
"3 sigma" is the share of the samples, starts included, in which the angle is within three sigmas of P.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runtime.design.facts import read_facts
from runtime.design.rules import design
from runtime.design.trial import Trial, package, try_out

DATA = Path(__file__).parents[1] / "tests" / "data"
FACTS, HELD_OUT = DATA / "facts", DATA / "facts_held_out"
SPEEDS = (0.05, 0.1, 0.5, 1.0)


def motors(held_out: bool, names: Sequence[str]) -> list[Path]:
    """Facts files of all motors, or of those named."""
    paths = sorted((HELD_OUT if held_out else FACTS).glob("*.toml"))
    return [path for path in paths if not names or path.stem in names]


def measure(path: Path, draws: int, seed: int) -> tuple[Trial, float]:
    """A motor's trial, and the processor seconds of design and trial together."""
    begun = time.process_time()
    facts = read_facts(path)
    chosen = design(facts)
    trial = try_out(facts, chosen, package(chosen), draws, seed, SPEEDS, blamed=False)
    return trial, time.process_time() - begun


def row(name: str, trial: Trial, seconds: float) -> str:
    """A line of the table."""
    shares = "  ".join(f"{np.mean(point.held):6.1%} {np.mean(point.honest):8.1%}" for point in trial.points)
    return f"{name:14s} {trial.success:6.1%}   {shares}   {seconds:5.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motors", nargs="*", help="names of facts files; default: all")
    parser.add_argument("--held-out", action="store_true", help="motors that no rule was chosen by")
    parser.add_argument("--draws", type=int, default=512)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    words = parser.parse_args()
    speeds = "  ".join(f"{f'held {share:.0%} 3 sigma':>15s}" for share in SPEEDS)
    print(f"{'motor':14s} 10..100%   {speeds}   cpu s")
    found = {}
    for path in motors(words.held_out, words.motors):
        trial, seconds = measure(path, words.draws, words.seed)
        found[path.stem] = {
            "success": trial.success,
            "points": {
                f"{p.share:g}": [float(np.mean(share)) for share in (p.held, p.locked, p.honest)] for p in trial.points
            },
        }
        print(row(path.stem, trial, seconds), flush=True)
    shares = [motor["success"] for motor in found.values()]
    print(f"{'mean':14s} {np.mean(shares):6.1%}, worst {min(shares):.1%}")
    if words.json:
        words.json.write_text(json.dumps({"draws": words.draws, "seed": words.seed, "motors": found}, indent=2) + "\n")


if __name__ == "__main__":
    main()
