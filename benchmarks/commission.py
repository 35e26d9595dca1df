"""How well ``commission`` finds motors that nobody knows: every motor on the simulated board, from facts 50 % off.

``python -m benchmarks.commission [MOTOR...] [--draws N] [--seed N] [--json F]``; a draw of all motors takes some six
minutes on two quiet cores. The board's C is the generated one; behind it are a switching inverter whose dead time
nobody makes up for, switches that drop something, converters of 12 bits with noise and offsets, dry friction, and a
rotor that stands anywhere. Every fact is drawn between half and one and a half times the truth. The motors are those of
tests/data/facts, and a second reluctance machine with magnets from tests/data/facts_held_out.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime.board.link import SerialPort
from runtime.commission.commission import Commissioned, commission
from runtime.commission.line import Bench as Board
from runtime.commission.session import limits_of
from runtime.commission.simulated import SimulatedMotor, Truth
from runtime.design.facts import Facts, read_facts

DATA = Path(__file__).parents[1] / "tests" / "data"
#: What must be reached, as a share of the truth.
WANTED = {"R": 0.005, "V_dead": 0.03, "L": 0.015, "L_d": 0.015, "L_q": 0.015, "psi_m": 0.01, "J": 0.03}
#: Half-width of what the facts are off.
OFF = 0.5
#: Of the dead time's voltage, that a switch drops; of the sensors' range, their offsets; of the rated torque, friction.
DROP, OFFSET, DRY = 0.1, 0.005, 0.003


@dataclass(frozen=True)
class Outcome:
    """A draw of a motor: errors as shares by word, half-widths, words not told with the reason, and extremes."""

    name: str
    seed: int
    errors: dict[str, float]
    widths: dict[str, float]
    untold: dict[str, str]
    current: float
    speed: float
    seconds: float
    wall: float

    @property
    def within(self) -> bool:
        """Whether everything is told, and as well as wanted."""
        return not self.untold and all(abs(error) <= WANTED[word] for word, error in self.errors.items())


def motors(names: Sequence[str]) -> list[Path]:
    """Facts files of all motors, or of those named."""
    paths = [*sorted((DATA / "facts").glob("*.toml")), DATA / "facts_held_out" / "ferrite.toml"]
    return [path for path in paths if not names or path.stem in names]


def drawn(facts: Facts, seed: int) -> tuple[Truth, Facts]:
    """A motor on its bench, and what is believed of it."""
    rng = np.random.default_rng(seed)
    if not facts.dead_time:
        facts = replace(facts, dead_time=0.01 * facts.T)
    R, L_d, L_q, psi, J, dead = rng.uniform(1 - OFF, 1 + OFF, 6)
    L_q = L_d if facts.L_d == facts.L_q else L_q
    believed = replace(
        facts,
        R=facts.R * R,
        L_d=facts.L_d * L_d,
        L_q=facts.L_q * L_q,
        psi_m=facts.psi_m * psi,
        J=facts.J * J,
        dead_time=facts.dead_time * dead,
    )
    offset = rng.uniform(-OFFSET, OFFSET, 2) * facts.range
    truth = Truth(
        facts,
        drop=DROP * facts.dc_link * facts.dead_time / facts.T,
        offset=(float(offset[0]), float(offset[1])),
        dry=DRY * facts.torque,
        theta=float(rng.uniform(-np.pi, np.pi)),
        seed=int(rng.integers(1, 1 << 30)),
    )
    return truth, believed


def true_value(truth: Truth, word: str) -> float:
    """The truth of a datum."""
    f = truth.facts
    lost = f.dc_link * f.dead_time / f.T + truth.drop
    return {"R": f.R, "V_dead": lost, "L": f.L_d, "L_d": f.L_d, "L_q": f.L_q, "psi_m": f.psi_m, "J": f.J}[word]


def measure(path: Path, seed: int) -> Outcome:
    """One motor, one draw."""
    truth, believed = drawn(read_facts(path), seed)
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "extremes"
        with SimulatedMotor(truth, report) as simulated:
            port = SerialPort(simulated.port, 115200)
            found = commission(
                Board(port, 115200),
                believed,
                limits_of(believed, None, None),
                lambda: False,
                lambda text, share: None,
                lambda ran: None,
            )
            port.close()
            while not report.exists():
                time.sleep(0.01)
        largest, fastest, *_ = (float(word) for word in report.read_text().split())
    return outcome(path.stem, seed, truth, found, (largest, fastest), time.perf_counter() - begun)


def outcome(
    name: str, seed: int, truth: Truth, found: Commissioned, extremes: tuple[float, float], wall: float
) -> Outcome:
    """What a draw has shown."""
    told = {word: found.told[word] for word in found.words if word in found.told and found.told[word].surely}
    untold = {word: found.why.get(word, "too unsure") for word in found.words if word not in told}
    return Outcome(
        name,
        seed,
        {word: one.value / true_value(truth, word) - 1 for word, one in told.items()},
        {word: one.width for word, one in told.items()},
        untold,
        extremes[0] / truth.facts.max_current,
        extremes[1] / truth.facts.speed,
        sum(ran.samples * ran.period for ran in found.runs),
        wall,
    )


def row(one: Outcome) -> str:
    """A line of the table: errors in per cent, one beyond what is wanted marked."""
    cells = [
        f"{word} {100 * error:+.2f}{'' if abs(error) <= WANTED[word] else ' !'}" for word, error in one.errors.items()
    ]
    cells += [f"{word} not told ({why})" for word, why in one.untold.items()]
    extremes = f"I {one.current:.2f}  n {one.speed:.2f}  {one.seconds:.0f} s"
    return f"{one.name:14s} {one.seed:3d}  {'  '.join(cells)}   {extremes}"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motors", nargs="*", help="names of facts files; default: all")
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    words = parser.parse_args()
    print("errors in % of the truth; I, n: largest current and speed, of the largest allowed and the rated; bench time")
    tasks = [(path, words.seed + k) for k in range(words.draws) for path in motors(words.motors)]
    found: list[Outcome] = []
    with ThreadPoolExecutor(2) as pool:
        for one in pool.map(lambda task: measure(*task), tasks):
            found.append(one)
            print(row(one), flush=True)
    for word in WANTED:
        errors = [abs(one.errors[word]) for one in found if word in one.errors]
        if errors:
            covered = np.mean([abs(one.errors[word]) <= one.widths[word] for one in found if word in one.errors])
            print(f"{word:7s} worst {max(errors):7.2%}  wanted {WANTED[word]:5.1%}  inside its interval {covered:4.0%}")
    print(
        f"{sum(one.within for one in found)} of {len(found)} wholly as wanted; largest current "
        f"{max(one.current for one in found):.2f} of the limit"
    )
    if words.json:
        words.json.write_text(json.dumps([one.__dict__ for one in found], indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
