"""Recordings from another simulator, motulator (MIT): a sensored start to 1000 r/min and a load step of 5 N m.

Not run by the tests, which read what it left beside it. To make them again, in an environment of its own::

    pip install motulator==0.5.0
    python record_with_motulator.py

One sample of computation delay, no measurement noise, RK45 to 1e-9. ``ramp`` and ``step``: an averaged inverter;
``pwm``: one that switches, whose dead time nobody makes up for. Columns are those of recorded data: u the mean over the
interval ending at t, as commanded; all else at t; float32 but for t.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import motulator.common.model._simulation as simulation
import motulator.drive.control.sm as sm
import numpy as np
from motulator.common.utils import abc2complex, complex2abc
from motulator.drive import control, model
from motulator.drive.utils import SynchronousMachinePars
from scipy.integrate import solve_ivp

simulation.solve_ivp = lambda rhs, span, state, max_step: solve_ivp(rhs, span, state, rtol=1e-9, atol=1e-10)

MOTORS = {
    "spmsm": {"R": 2.875, "L_d": 835e-6, "L_q": 835e-6, "psi": 0.175, "p": 4, "J": 0.008, "D": 0.002, "u_dc": 311.0},
    "ipmsm": {"R": 3.6, "L_d": 36e-3, "L_q": 51e-3, "psi": 0.545, "p": 3, "J": 0.015, "D": 0.0, "u_dc": 540.0},
}
CURRENT = {"spmsm": 20.0, "ipmsm": 15.0}  # A, largest
T = 100e-6
DEAD_TIME = 2e-6  # s
ZERO = 0.01  # A: below, the potential of a leg that no switch holds goes from one rail to the other
SPEED, START_AT, LOAD, LOAD_AT, DURATION = 1000 * math.pi / 30, 0.02, 5.0, 0.4, 0.6
COLUMNS = ("t", "u_alpha", "u_beta", "i_alpha", "i_beta", "omega", "theta", "load_torque")


class Tap:
    """Stands in the computation delay's place: once a sample it sees the motor before the new voltage acts."""

    def __init__(self, drive: Any, u_dc: float) -> None:
        self.drive, self.u_dc = drive, u_dc
        self.waiting = [0.0, 0.0, 0.0]
        self.acting = 0j
        self.rows: list[tuple[float, ...]] = []

    def __call__(self, duty: Any) -> Any:
        machine, mechanics, t = self.drive.machine, self.drive.mechanics, self.drive.t0
        rotor = machine.state.exp_j_theta_m
        i = machine.i_s * rotor
        truth = (np.real(mechanics.state.w_M), np.angle(rotor), mechanics.tau_L(t))
        self.rows.append((t, self.acting.real, self.acting.imag, i.real, i.imag, *truth))
        acting, self.waiting = self.waiting, duty
        a, b, c = acting
        self.acting = 2 / 3 * (a + b * np.exp(2j * np.pi / 3) + c * np.exp(-2j * np.pi / 3)) * self.u_dc
        return acting


class DeadTime(model.CarrierComparison):
    """Motulator's carrier, up and down once a sample, switches turning on late; NaN: both of a leg are off."""

    def __init__(self) -> None:
        super().__init__(return_complex=False)
        self.now, self.level, self.turned = 0.0, np.zeros(3), np.full(3, -np.inf)

    def __call__(self, T_s: float, duty: Any) -> tuple[Any, Any]:
        halves = [super(DeadTime, self).__call__(T_s / 2, duty) for _ in range(2)]
        ends = self.now + np.cumsum(np.concatenate([steps for steps, _ in halves]))
        steps, gates, levels = [], [], np.concatenate([levels for _, levels in halves])
        for end, level in zip(ends, levels, strict=True):
            if end - self.now < 1e-12:
                continue
            self.turned = np.where(level == self.level, self.turned, self.now)
            self.level = level
            on_at = self.turned + DEAD_TIME
            for until in [*sorted(at for at in set(on_at) if self.now + 1e-12 < at < end - 1e-12), end]:
                gates.append(np.where(on_at > self.now + 1e-12, np.nan, level))
                steps.append(until - self.now)
                self.now = until
        return np.array(steps), gates


class Legs(model.VoltageSourceConverter):
    """While both switches of a leg are off its current keeps the diode on that it flows through."""

    @property
    def u_cs(self) -> Any:
        diodes = 0.5 - 0.5 * np.clip(complex2abc(self.inp.i_cs) / ZERO, -1.0, 1.0)
        return abc2complex(np.where(np.isnan(self.inp.q_cs), diodes, self.inp.q_cs)) * self.u_dc


class SwitchingDrive(model.Drive):
    """The converter's voltage follows this instant's current, where motulator's own would take the last one."""

    def interconnect(self, t: float) -> None:
        self.converter.inp.i_cs = self.machine.out.i_ss
        self.converter.set_outputs(t)
        super().interconnect(t)

    def save(self, solution: Any) -> None:
        """Nothing: what happens between the samples is not recorded."""


def record(name: str, ramp: float, switching: bool = False) -> dict[str, Any]:
    """One run; ``ramp`` in s, 0 for a step of the speed reference."""
    m = MOTORS[name]
    par = SynchronousMachinePars(n_p=m["p"], R_s=m["R"], L_d=m["L_d"], L_q=m["L_q"], psi_f=m["psi"])
    mechanics = model.StiffMechanicalSystem(J=m["J"], B_L=m["D"], tau_L=lambda t: (t >= LOAD_AT) * LOAD)
    converter, whole = (Legs, SwitchingDrive) if switching else (model.VoltageSourceConverter, model.Drive)
    drive = whole(converter(u_dc=m["u_dc"]), model.SynchronousMachine(par), mechanics)
    drive.pwm = DeadTime() if switching else drive.pwm
    limits = sm.CurrentReferenceCfg(par, nom_w_m=2 * m["p"] * SPEED, max_i_s=CURRENT[name])
    controller = sm.CurrentVectorControl(par, limits, T_s=T, J=m["J"], sensorless=False, alpha_c=2 * np.pi * 200)
    controller.speed_ctrl = control.SpeedController(m["J"], 60.0, max_tau_M=15.0)
    controller.ref.w_m = lambda t: m["p"] * SPEED * (min(max(t - START_AT, 0.0) / ramp, 1.0) if ramp else t >= START_AT)
    drive.delay = tap = Tap(drive, m["u_dc"])
    simulation.Simulation(drive, controller)._simulation_loop(DURATION, math.inf)
    columns = dict(zip(COLUMNS, np.array(tap.rows[: round(DURATION / T)], dtype=float).T, strict=True))
    return {name: values if name == "t" else values.astype(np.float32) for name, values in columns.items()}


if __name__ == "__main__":
    for motor in MOTORS:
        for kind, *how in (("ramp", 0.15), ("step", 0.0), ("pwm", 0.15, True)):
            np.savez_compressed(Path(__file__).with_name(f"{motor}_{kind}.npz"), **record(motor, *how))
