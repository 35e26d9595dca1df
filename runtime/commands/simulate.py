"""The command ``simulate``: the closed loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.numbers import ANGLE, ANY, POSITIVE, SECONDS, within
from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, working
from runtime.commands.words import DRIVE, Json, caution
from runtime.drive.simulate import simulate_drive
from runtime.system.values import read_words
from runtime.system.verdicts import all_hold

Theta = Annotated[
    float,
    typer.Option(
        metavar="RAD", callback=ANGLE, help="Rotor's electrical angle at the start; other than 0: --supervised."
    ),
]
Supervised = Annotated[
    bool | None,
    typer.Option("--supervised/--alone", help="From power-up, with the supervisor; or the controller alone."),
]
DeadTime = Annotated[
    float | None,
    typer.Option(metavar="S", callback=within(0.0, 1e-4), help="Dead time in s; default: the drive file's."),
]
SwitchDrop = Annotated[
    float | None,
    typer.Option(metavar="V", callback=POSITIVE, help="Drop of a switch in V; default: the drive file's."),
]
Noise = Annotated[
    float | None,
    typer.Option(metavar="A", callback=POSITIVE, help="Current sensor noise, rms; 0.05 or the filter's if less."),
]
Speed = Annotated[float | None, typer.Option(metavar="R/MIN", callback=ANY, help="Default: rated speed.")]
Load = Annotated[
    float | None, typer.Option(metavar="N_M", callback=ANY, help="Of the load step; default: rated torque.")
]
Ramp = Annotated[float | None, typer.Option(metavar="S", callback=SECONDS, help="From standstill to speed.")]
Factors = Annotated[
    str, typer.Option(metavar="R=1.1,...", help="True motor's R, L, L_d, L_q, psi_m, J over the filter's.")
]
SensorOffset = Annotated[float, typer.Option(metavar="A", callback=ANY, help="Offset of phase a's current sensor.")]
MinPulse = Annotated[float, typer.Option(metavar="S", callback=within(0.0, 1e-3), help="Shortest pulse in s (pwm).")]


def simulate(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)] = "paper_spmsm",
    scenario: Annotated[str, typer.Option(metavar="NAME", help="no_load, load_step, or all.")] = "all",
    filters: Annotated[str, typer.Option(metavar="KINDS", help="Comma-separated: ckf,ickf,ekf,ukf.")] = "ckf,ickf",
    inverter: Annotated[str, typer.Option(metavar="NAME", help="averaged or pwm.")] = "averaged",
    dead_time: DeadTime = None,
    switch_drop: SwitchDrop = None,
    min_pulse: MinPulse = 0.0,
    delay: Annotated[int, typer.Option(min=0, max=1, help="Samples from measuring to acting.")] = 0,
    noise: Noise = None,
    bits: Annotated[int, typer.Option(min=0, max=24, help="Converter resolution; 0: no quantisation.")] = 0,
    offset: SensorOffset = 0.0,
    sensored: Annotated[bool, typer.Option("--sensored", help="Close the loops with true speed and angle.")] = False,
    theta: Theta = 0.0,
    supervised: Supervised = None,
    speed: Speed = None,
    load: Load = None,
    ramp: Ramp = None,
    factors: Factors = "",
    seed: Annotated[int, typer.Option(min=0, max=2**63, help="Of the sensor noise.")] = 1,
    controller: Annotated[str, typer.Option(metavar="NAME", help="c (the generated C) or numpy (its twin).")] = "c",
    sweep: Annotated[bool, typer.Option("--sweep", help="Also sweep the sample time, Euler and exact.")] = False,
    json: Json = None,
    out: Annotated[Path | None, writes_folder("Write recorded data (npz) and figures (svg).")] = None,
) -> None:
    """Close the loop: the generated controller drives the motor, sensorless from standstill."""
    from runtime.drive.motor import parse_factors
    from runtime.drive.tables import claims, claims_table, remarks, runs_table, sweep_table, task_line
    from runtime.estimator.folder import KINDS

    conditions = {"inverter": inverter, "dead_time": dead_time, "delay": delay, "noise": noise, "bits": bits}
    conditions |= {"switch_drop": switch_drop, "min_pulse": min_pulse}
    others = {"offset": (offset, 0.0), "sensored": sensored, "theta": theta, "seed": seed, "supervised": supervised}
    setting = {**conditions, **others, "factors": parse_factors(factors)}
    task, kinds = {"speed": speed, "load": load, "ramp": ramp}, read_words(filters, "filter", KINDS)
    caution([drive])
    with working() as progress:
        result = simulate_drive(drive, scenario, kinds, setting, controller, sweep, json, out, progress, task)
    for asked in dict.fromkeys(run.scenario for run in result.runs):
        console.print(task_line(asked), highlight=False)
    console.print(runs_table(result.runs))
    for line in remarks(result.runs):
        console.print(line, highlight=False, soft_wrap=True)
    if drive == "paper_spmsm" and claims(result.runs):
        console.print()
        console.print(claims_table(claims(result.runs)))
    if result.sweep:
        console.print("\nLargest speed error after a step of the speed reference, by sample time:")
        console.print(sweep_table(result.sweep))
    if not all_hold(run.good for run in result.runs):
        raise typer.Exit(1)
