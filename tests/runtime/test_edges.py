"""Motors at the ends of what a drive file accepts: designed from facts, generated, proved, self-tested in C."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from codegen.fast.guards import SANE_LIMIT, sane_limit
from model.drives.load import accepted_range, load_drive
from model.schema import Motor, Rated
from runtime.design.facts import parse_facts
from runtime.design.rules import design
from runtime.design.write import drive_text
from runtime.folders.generate import generate_drives
from runtime.folders.resolve import find_drive
from runtime.proof.verify import prove
from tests.conftest import ALL_DRIVES, thoroughly
from tests.runtime.test_proof import QUICK


def motor(R: float, L: Any, psi_m: float, p: int, J: float, D: float = 0.0) -> dict[str, Any]:
    inductances = {"inductance_d": L[0], "inductance_q": L[1]} if isinstance(L, tuple) else {"line_inductance": 2 * L}
    known = {"stator_resistance": R, "magnet_flux": psi_m, "pole_pairs": p, "inertia": J, "friction": D}
    return known | inductances


def task(speed: float, torque: float, current: float, volts: float, T: float) -> dict[str, Any]:
    return {
        "rated": {"speed": speed, "torque": torque, "max_current": current},
        "inverter": {"dc_link": volts, "sample_time": T},
        "sensor": {"range": 1.4 * current},
    }


#: Each is sold, or is a size beyond what is; together they stand at every end that the ranges have for them.
EDGES: dict[str, dict[str, Any]] = {
    # a ship's propulsion, 8 MW at 100 r/min
    "ship": {"motor": motor(0.01, 50e-3, 100.0, 6, 1e5)} | task(10.5, 8e5, 1500.0, 12e3, 2e-4),
    "ship_salient": {"motor": motor(0.01, (40e-3, 60e-3), 100.0, 6, 1e5)} | task(10.5, 8e5, 1500.0, 13e3, 2e-4),
    # a wind generator without a gear, its blades at the shaft
    "wind": {"motor": motor(1e-3, 1e-3, 10.0, 100, 1e8)} | task(1.0, 8e6, 8000.0, 2500.0, 2e-4),
    "wind_friction": {"motor": motor(1e-3, 1e-3, 10.0, 100, 1e8, 1e6)} | task(1.0, 7e6, 8000.0, 2500.0, 2e-4),
    "wind_torque": {"motor": motor(1e-3, 1e-3, 12.0, 100, 1e6)} | task(1.0, 1e7, 8000.0, 3000.0, 2e-4),
    # a telescope's axis
    "telescope": {"motor": motor(0.5, 5e-3, 0.5, 200, 500.0)} | task(0.1, 500.0, 10.0, 100.0, 1e-4),
    # motors of a few millimetres
    "micro": {"motor": motor(10.0, 0.1e-3, 3e-4, 1, 1e-11)} | task(4000.0, 2e-5, 0.1, 6.0, 1e-5),
    "micro_torque": {"motor": motor(30.0, 0.2e-3, 1e-4, 1, 1e-10)} | task(2000.0, 1e-7, 0.1, 5.0, 2e-5),
}


@pytest.mark.unit
def test_the_edges_are_those_of_the_ranges() -> None:
    ends = {
        "magnet_flux": (None, 100.0),
        "inertia": (1e-11, 1e8),
        "friction": (None, 1e6),
        "pole_pairs": (1, 200),
        "torque": (1e-7, 1e7),
    }
    for key, (least, most) in ends.items():
        section = "rated" if key == "torque" else "motor"
        _, low, high = accepted_range(Rated if key == "torque" else Motor, key)
        stated = [edge[section][key] for edge in EDGES.values()]
        assert high == most == max(stated)
        assert least is None or low == least == min(stated)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["micro", *thoroughly(*(name for name in EDGES if name != "micro"))])
def test_what_is_accepted_is_proved(name: str, tmp_path: Path) -> None:
    chosen = design(parse_facts({"name": name, **EDGES[name]}, name))
    (tmp_path / "mine.toml").write_text(drive_text(chosen, "facts"))
    (written,) = generate_drives([str(tmp_path / "mine.toml")], tmp_path)
    proof, _ = prove(find_drive(written.folder), QUICK, lambda text: None, current=True)
    assert proof.passed, proof.failures()
    stem = f"{name}_{chosen.kind}"
    for end in ("", "_foc"):
        p = f"{stem}{end}"
        (tmp_path / "main.c").write_text(
            f'#include "{p}_selftest.h"\nstatic {p}_t work;\nint main(void) {{ return {p}_selftest(&work, 0.0f); }}\n'
        )
        sources = [str(written.folder / f"{file}.c") for file in sorted({stem, p, f"{p}_selftest"})]
        command = ["gcc", "-O1", "-ffp-contract=off", f"-I{written.folder}", "main.c", *sources, "-o", "t", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        assert subprocess.run([tmp_path / "t"]).returncode == 0, p


@pytest.mark.unit
def test_no_variance_that_is_stated_makes_a_step_restart() -> None:
    """What a drive file states may grow a thousandfold without measurements; float32 holds the square of the limit."""
    for name in ALL_DRIVES:
        tuning = load_drive(name).filter
        assert sane_limit(tuning.initial_covariance, tuning.process_noise) == SANE_LIMIT
    for largest in (1.0, 1e9, 3e10, 1e12):
        for stated in (([1.0, largest], [1.0, 1.0]), ([1.0, 1.0], [largest, 1.0])):
            limit = sane_limit(*stated)
            assert limit >= 1000 * largest
            assert limit**2 < 1e34
