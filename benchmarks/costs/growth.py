"""Cost against the size of the model: the same motor with 4, 5 and 6 states.

The sixth state is a mechanics class of this file: nothing in the packages knows of it, which is how a user adds one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from codegen.fast.ablation import accepted_path, build_ablation
from codegen.ir.layout import Listing
from codegen.passes import weight
from costs import ours
from costs.counting import figure, host_instructions
from costs.step_tables import X86, Length, inputs_of
from costs.table import Row, Table
from model.drives.load import load_drive
from model.machines import MACHINES
from model.machines.adaptive import Adaptive
from model.machines.base import Parameters
from model.machines.mechanics import ConstantSpeed, LoadTorque, Mechanics, Next, Torque
from model.machines.state_space import StateSpaceModel
from model.quantities import Constants, Quantity
from model.schema import Drive

Progress = Callable[[str], None]


class DriftingLoad(LoadTorque):
    """A load torque that has a rate: T_L' = T_L + T r, and r wanders."""

    states = (*LoadTorque.states, Quantity("torque_rate", "r", "N m / s", "rate of the load torque"))

    def exact(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """As with a load torque that is held, which then moves on."""
        (omega, theta, load), named = super().exact(x[:3], omega_e, torque)
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        return [omega, theta, load + T * x[3], x[3]], named


#: Tuning of the states beyond the load torque: initial variance, process noise.
_MORE = {"torque_rate": (100.0, 1.0)}
SIZES: tuple[type[Mechanics], ...] = (ConstantSpeed, LoadTorque, DriftingLoad)


def problem(mechanics: type[Mechanics]) -> ours.Problem:
    """spmsm_load_torque's motor and discretisation with other mechanics."""
    drive = load_drive("spmsm_load_torque")
    parameters, constants = Parameters.numeric(drive), Constants(named=True)
    machine = MACHINES[drive.model.machine](parameters, constants)
    none_adaptive = Adaptive((), 0.0, parameters, constants)
    model = StateSpaceModel(
        machine, mechanics(parameters, constants), drive.model.discretization, none_adaptive, constants
    )
    return ours.Problem(_tuned(drive, model), model, (0.0,) * len(model.states))


def _tuned(drive: Drive, model: StateSpaceModel) -> Drive:
    extra = [_MORE[state.name] for state in model.states if state.name in _MORE]
    n = len(model.states) - len(extra)
    tuning = drive.filter.model_copy(
        update={
            "initial_covariance": [*drive.filter.initial_covariance[:n], *(p for p, _ in extra)],
            "process_noise": [*drive.filter.process_noise[:n], *(q for _, q in extra)],
        }
    )
    return drive.model_copy(update={"name": f"growth_{len(model.states)}", "filter": tuning})


#: Where the work of a step goes, by equation number.
PARTS = {"13": "f", "14": "f", "15": "f", "16": "f", "17": "P_pred", "18": "factor"}


def parts(step: Any, listings: dict[str, Listing]) -> Counter[str]:
    """Weight of the points and f (eq. 13-16), P_pred (17), its factor (18) and the update (the rest)."""
    found: Counter[str] = Counter()
    for block in accepted_path(step.body):
        listing = listings[block.name]
        done: list[int] = []
        for stage in block.stages:
            before = weight(listing.graph, done)
            done += [node for node in listing.stages[stage.name] if node in listing.live]
            found[PARTS.get(stage.equation, "update")] += weight(listing.graph, done) - before
        whole = weight(listing.graph, [node for nodes in listing.outputs.values() for node in nodes])
        found["update"] += whole - weight(listing.graph, done)
    return found


def growth_table(length: Length, progress: Progress) -> Table:
    """Literal and fast for n = 4, 5, 6."""
    rows: list[Row] = []
    for mechanics in SIZES:
        here = problem(mechanics)
        inputs = inputs_of(ours.Problem.of(load_drive("spmsm_load_torque")), length)
        for label, rung in (("literal", ours.LITERAL), ("fast", ours.SHIPPED)):
            n = len(here.model.states)
            progress(f"n = {n}, {label}: counting")
            subject, cost = ours.candidate(here, "ckf", rung)
            split = parts(*build_ablation(here.model, "ckf", here.drive.filter.gain, rung))
            row: Row = {"form": f"{label}, n = {n}", "weight": float(cost.weight)}
            row |= {name: float(split[key]) for name, key in COLUMNS.items()}
            row |= {op: float(cost.operations[op]) for op in ("add", "mul", "div", "sqrt", "sincos")}
            row[X86] = figure(lambda subject=subject, inputs=inputs: host_instructions(subject, inputs))
            rows.append(row)
    return Table("growth", "Cost against the number of states (surface PMSM, exact, CKF)", rows, [EXPLANATION])


COLUMNS = {"points and f": "f", "P_pred (17)": "P_pred", "factor (18)": "factor", "update": "update"}

EXPLANATION = (
    "How it grows: in the literal form P_pred is 2n points times n(n+1)/2 entries, n^3; the two Cholesky factors take "
    "n^3/6 multiplications each; points, Pxy and K Pyy K^T grow as n^2; f is evaluated 2n times, each with a sine and "
    "a cosine. In the fast form P_pred is n columns times n(n+1)/2 products of odd parts, still n^3, but half of them "
    "and without what the triangle of L makes zero; the bend adds (columns that reach a nonlinear state) x (pairs of "
    "nonlinear rows), which a linear state does not raise; f costs columns times nonlinear rows with one sine for all; "
    "one factor is left, n^3/6; two scalar measurements see two columns, so the update grows as n. A state that enters "
    "linearly, as the sixth does, adds next to nothing to f; the fifth was dearer, because with the torque omega and "
    "theta become nonlinear rows too."
)


def write_figure(table: Table, path: Path) -> None:
    """Weight by part, literal beside fast."""
    from runtime.style.figures import pyplot, svg_text

    figure_, axes = pyplot().subplots(1, 2, figsize=(7.5, 2.8), sharey=True)
    colours = ("#3b6ea8", "#c8553d", "#e0a030", "#5a9e6f")
    for axis, form in zip(axes, ("literal", "fast"), strict=True):
        rows = [row for row in table.rows if str(row["form"]).startswith(form)]
        labels = [str(row["form"]).rpartition(", ")[2] for row in rows]
        bottom = [0.0] * len(rows)
        for (column, _), colour in zip(COLUMNS.items(), colours, strict=True):
            heights = [float(row[column]) for row in rows]  # type: ignore[arg-type]
            axis.bar(labels, heights, 0.6, bottom=bottom, label=column, color=colour)
            bottom = [a + b for a, b in zip(bottom, heights, strict=True)]
        axis.set_title(form, loc="left", fontsize=9)
    axes[0].set_ylabel("operations, in additions")
    axes[0].legend(fontsize=8)
    path.write_text(svg_text(figure_), encoding="utf-8")
