"""The continuous motor as simulation needs it: electrical equations with mechanics, one Runge-Kutta step."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.filters.program import BlockBuilder
from model.machines import Machine, find_machine
from model.machines.base import Parameters, Rotor
from model.quantities import Block, Constant, Constants
from model.schema import Drive

#: Electrical states, mechanical speed, electrical angle, and the rotor's cosine and sine as states of their own:
#: d cos/dt = -omega_e sin, d sin/dt = omega_e cos. So a Runge-Kutta stage needs no sine.
STATES = ("z_alpha", "z_beta", "omega", "theta", "rotor_cos", "rotor_sin")

#: The weight of the first slope of four in a classical Runge-Kutta step, by its name in generated text.
RUNGE_KUTTA = Constant("RUNGE_KUTTA_WEIGHT", 1.0 / 6.0, "1 / 6, of the first of four slopes", None)

#: The motor's data, which the generated plant takes as data so that a study can vary them: ohm, 1/H, Wb, 1/(kg m^2),
#: N m s/rad. Reciprocals, so that no division is left.
MOTOR = ("R", "per_L_d", "per_L_q", "psi_m", "per_J", "D")


def _motor(b: BlockBuilder, drive: Drive) -> tuple[Machine, Parameters]:
    """The machine with its data as inputs of the block; pole pairs and sample time stay the drive's."""
    R, per_L_d, per_L_q, psi_m, per_J, D = b.input("motor", list(MOTOR))
    known = Parameters.numeric(drive)
    par = Parameters(R=R, L_d=1 / per_L_d, L_q=1 / per_L_q, psi_m=psi_m, p=known.p, J=1 / per_J, D=D, T=known.T)
    return find_machine(drive)(par, Constants(named=False)), par


def _slope(machine: Machine, par: Parameters, s: list[Any], v: list[Any], load: Any) -> list[Any]:
    """Eq. 1: derivative of the plant's state under voltage v (V) and load torque (N m)."""
    z, omega, rotor = (s[0], s[1]), s[2], Rotor(s[3], s[5], s[4])
    omega_e = par.p * omega
    dz = machine.derivative(z, (v[0], v[1]), omega_e, rotor)
    d_omega = (machine.torque(z, rotor) - load - par.D * omega) / par.J
    return [*dz, d_omega, omega_e, -omega_e * rotor.sin, omega_e * rotor.cos]


def plant_block(drive: Drive) -> Block:
    """One classical Runge-Kutta step of width h (s): s, motor, v, load, h -> s.

    Of eq. 1, continuous in time. The electrical states are the machine's (A or Wb).

    Parameters
    ----------
    drive : Drive
        Its machine and pole pairs; the other motor data are an input.

    Returns
    -------
    Block
        ``s`` (6, see :data:`STATES`), ``motor`` (6, see :data:`MOTOR`), ``v`` (2, V), ``load`` (1, N m), ``width``
        (1, s) -> ``s``.
    """
    b = BlockBuilder("plant_substep", "One Runge-Kutta step (RK4) of the motor, eq. 1")
    s = b.input("s", list(STATES))
    machine, par = _motor(b, drive)
    v = b.input("v", ["v_alpha", "v_beta"])
    (load,) = b.input("load", ["T_L"])
    (h,) = b.input("width", ["h"])
    slopes: list[list[Any]] = []
    b.stage("half", "", "", [0.5 * h], ["half_h"], scale="none")
    for k, reach in enumerate((0.0, 0.5, 0.5, 1.0)):
        point = s
        if k:
            point = [value + (reach * h) * slope for value, slope in zip(s, slopes[-1], strict=True)]
            b.stage(f"at{k + 1}", "", f"point {k + 1}", point, [f"{name}_at{k + 1}" for name in STATES], scale="none")
        i, named = machine.currents((point[0], point[1]), Rotor(point[3], point[5], point[4]))
        inside = {**named, "i_alpha": i[0], "i_beta": i[1]}
        names = [f"{name}_at{k + 1}" for name in inside]
        b.stage(f"inside{k + 1}", "", "", list(inside.values()), names, scale="none")
        slopes.append(_slope(machine, par, point, v, load))
        names = [f"slope{k + 1}_{name}" for name in STATES]
        b.stage(f"slope{k + 1}", "", f"slope {k + 1}", slopes[-1], names, scale="none")
    k1, k2, k3, k4 = slopes
    sixth = RUNGE_KUTTA.value * h
    b.stage("sixth", "", "weighted mean of the slopes", [sixth], ["sixth_h"], scale="none")
    following = [s[j] + sixth * (k1[j] + 2 * (k2[j] + k3[j]) + k4[j]) for j in range(len(STATES))]
    b.output("s", following)
    return b.build()


def outputs_block(drive: Drive) -> Block:
    """Outputs for sensors and plots: s, motor -> i_alpha, i_beta (A) and the electromagnetic torque (N m).

    Parameters
    ----------
    drive : Drive
        Its machine and pole pairs.

    Returns
    -------
    Block
        ``s`` (6), ``motor`` (6) -> ``i`` (2, A), ``torque`` (1, N m).
    """
    b = BlockBuilder("plant_outputs", "Currents and torque of the motor")
    s = b.input("s", list(STATES))
    machine, _ = _motor(b, drive)
    rotor = Rotor(s[3], s[5], s[4])
    i, named = machine.currents((s[0], s[1]), rotor)
    inside = {**named, "i_alpha": i[0], "i_beta": i[1]}
    b.stage("inside", "", "", list(inside.values()), list(inside), scale="none")
    b.output("i", list(i))
    b.output("torque", [machine.torque((s[0], s[1]), rotor)])
    return b.build()


def rest_block(drive: Drive) -> Block:
    """Standstill without current: motor, electrical angle (rad) -> s.

    Parameters
    ----------
    drive : Drive
        Its machine.

    Returns
    -------
    Block
        ``motor`` (6), ``angle`` (1, rad) -> ``s`` (6).
    """
    b = BlockBuilder("plant_at_rest", "Standstill without current at an electrical angle")
    machine, _ = _motor(b, drive)
    (theta,) = b.input("angle", ["theta"])
    rotor = Rotor.at(theta)
    z = machine.electrical_state((ca.SX(0), ca.SX(0)), rotor)
    b.output("s", [*z, ca.SX(0), theta, rotor.cos, rotor.sin])
    return b.build()


def phasor_block() -> Block:
    """The rotor's cosine and sine put back onto the unit circle: angle (rad) -> phasor."""
    b = BlockBuilder("rotor_phasor", "The rotor's phasor, on the unit circle")
    (theta,) = b.input("angle", ["theta"])
    b.output("phasor", [ca.cos(theta), ca.sin(theta)])
    return b.build()


def plant_initial_state(drive: Drive, theta: float = 0.0) -> list[float]:
    """Standstill without current at the electrical angle ``theta`` (rad).

    Parameters
    ----------
    drive : Drive
        The drive.
    theta : float, optional
        Electrical angle, rad.
    """
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    rotor = Rotor.at(ca.SX(theta))
    z = machine.electrical_state((ca.SX(0), ca.SX(0)), rotor)
    return [float(z[0]), float(z[1]), 0.0, theta, float(rotor.cos), float(rotor.sin)]
