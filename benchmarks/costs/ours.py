"""Our own forms of a filter, printed for the chip without certificate and proof: quick enough to print many."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from codegen.evidence.ledger import SIN_COS, Program
from codegen.fast.ablation import ABLATION, AblationStep, Earned, build_ablation, earned
from codegen.render.filter import Description, render_filter, render_port
from codegen.targets.numbers import FLOAT32
from costs.counting import Candidate
from model.machines.state_space import StateSpaceModel, build, default_initial_state
from model.schema import Drive

LITERAL, SHIPPED = ABLATION[0], ABLATION[-1]


@dataclass(frozen=True)
class Problem:
    """A drive with its model, which need not be the one its file names."""

    drive: Drive
    model: StateSpaceModel
    initial_state: tuple[float, ...]

    @classmethod
    def of(cls, drive: Drive) -> Problem:
        return cls(drive, build(drive), tuple(default_initial_state(drive)))


def candidate(
    problem: Problem, kind: str, ablation: AblationStep = SHIPPED, label: str = ""
) -> tuple[Candidate, Earned]:
    """A filter of a problem as C, built as an ablation step says; ``operations`` are at most, a sincos as one."""
    drive = problem.drive
    step, listings = build_ablation(problem.model, kind, drive.filter.gain, ablation)
    about = Description(drive, problem.model, problem.initial_state)
    header, source = render_filter(about, step, listings, FLOAT32, [])
    name = f"{drive.name}_{kind}"
    sources = {"pmsm_port.h": render_port(about.target), f"{name}.h": header, f"{name}.c": source}
    program = Program(sources, f"{name}.c")
    count: Counter[str] = program.count(f"{name}_step", drive.filter.max_iterations, aside=frozenset({SIN_COS}))
    return Candidate(label or f"ours, {ablation.name}, {kind}", name, sources, operations=count), earned(
        ablation, step, listings
    )
