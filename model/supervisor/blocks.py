"""What the supervisor computes: how the angle turned beside the speed, and where a filter is to begin."""

from __future__ import annotations

import math

import casadi as ca

from model.alignment import align_current, aligns, turn_time
from model.filters.program import BlockBuilder
from model.inverter import SQRT_3, TRANSFORM
from model.machines import find_machine
from model.machines.base import Parameters, Rotor
from model.machines.state_space import StateSpaceModel
from model.quantities import Block, Constant, Constants
from model.schema import Drive

#: Share of the stated angle by which the turned one may be off.
ANGLE_SHARE = 0.5
#: An arc tangent within 0.004 rad: q (pi / 4 + ARC (1 - |q|)), |q| <= 1.
ARC = 0.273
#: A current that is smaller is not divided by, A^2.
LEAST_SIZE = 1e-12
#: Absolute cosine and sine of an angle are 1 or more together; so a divisor is seen not to be zero.
LEAST_SUM = 0.5


def constants(drive: Drive) -> tuple[Constant, ...]:
    """The numbers of these blocks that have a name in generated text.

    Parameters
    ----------
    drive : Drive
    """
    m = drive.motor
    return (
        *TRANSFORM,
        Constant("L_D", m.inductance_d, "L_d, H", None),
        Constant("L_Q", m.inductance_q, "L_q, H", None),
        Constant("PSI_M", m.magnet_flux, "magnet flux linkage, Wb", None),
        Constant("QUARTER_PI", math.pi / 4, "pi / 4", None),
        Constant("ARC_BEND", ARC, "of the arc tangent, within 0.004 rad", None),
        Constant("LEAST_SIZE", LEAST_SIZE, "A^2: no less is divided by", None),
        Constant("TURN_PER_SAMPLE", _turn_per_sample(drive), "p T, rad electrical per rad/s", None),
        *_of_alignment(drive),
        Constant("PROBE_SPEED", _probe_speed(drive), "L_q / (psi_m p T), rad/s per A, of one interval", None),
    )


def _of_alignment(drive: Drive) -> tuple[Constant, ...]:
    if not aligns(drive):
        return ()
    return (
        Constant("ALIGN_STEP", _align_step(drive), "of the current's rise and of its turn, a sample", None),
        Constant("ALIGN_CURRENT", align_current(drive), "A", None),
        Constant("QUARTER_TURN", math.pi / 2, "pi / 2", None),
    )


def _align_step(drive: Drive) -> float:
    return drive.model.sample_time / turn_time(drive)


def _turn_per_sample(drive: Drive) -> float:
    return drive.motor.pole_pairs * drive.model.sample_time


def _probe_speed(drive: Drive) -> float:
    return drive.motor.inductance_q / (drive.motor.magnet_flux * _turn_per_sample(drive))


def turning_block(drive: Drive, model: StateSpaceModel) -> Block:
    """How far the angle turned, and how far it should have by the estimated speed.

    A filter that is half a turn off may believe in the opposite speed, but its angle is pushed along by the rotor.
    ``doubt`` is the square of the difference, less that of half of what is stated; ``turn`` what this sample states.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
        Tells the places of speed and angle.
    """
    b = BlockBuilder("watch_turning", "How far the angle turned, and how far it should have by the speed")
    x = b.input("x", [state.name for state in model.states])
    omega, theta = (x[[s.name for s in model.states].index(name)] for name in ("omega", "theta"))
    turned, stated, theta_before, *_ = b.input("turning", ["turned", "stated", "theta_before", "doubt", "turn"])
    turned = turned + ca.remainder(theta - theta_before, 2 * math.pi)
    turn = _turn_per_sample(drive) * omega
    stated = stated + turn
    off = turned - stated
    named = {"turned_now": turned, "turn_now": turn, "stated_now": stated, "off": off}
    b.stage("turned", "", "", list(named.values()), list(named), scale="none")
    doubt = off * off - ANGLE_SHARE**2 * (stated * stated)
    b.output("turning", [turned, stated, theta, doubt, turn])
    return b.build()


def reading_block() -> Block:
    """The current's direction and size, and the sine of the angle by which it turned since the first reading."""
    b = BlockBuilder("read_current", "Direction and size of the current, and how it turned since the first reading")
    i_a, i_b = b.input("phase", ["i_a", "i_b"])
    first = b.input("first", ["first_cosine", "first_sine"])
    i_beta = (1 / SQRT_3) * i_a + (2 / SQRT_3) * i_b
    size = ca.sqrt(ca.fmax(i_a * i_a + i_beta * i_beta, LEAST_SIZE))
    cosine, sine = i_a / size, i_beta / size
    named = {"i_beta": i_beta, "size": size, "cosine": cosine, "sine": sine}
    b.stage("size", "", "", list(named.values()), list(named), scale="none")
    b.output("reading", [cosine, sine, size, first[0] * sine - first[1] * cosine])
    return b.build()


def probe_block(drive: Drive) -> Block:
    """Where a current that zero voltage lets flow says the rotor is.

    Zero voltage leaves the back-EMF to drive the current: i = -(k T / L) e after k intervals, and
    e = omega_e psi_m (-sin theta, cos theta). A rotor that turns the other way is half a turn from there. The angle is
    that of the absolute values, in the first quadrant; signs come after.

    Parameters
    ----------
    drive : Drive
    """
    b = BlockBuilder("read_probe", "Where a current from zero voltage says that the rotor is")
    along_i, across_i, size, _ = b.input("reading", ["i_cosine", "i_sine", "size", "turned_sine"])
    direction, intervals = b.input("probe", ["direction", "intervals"])
    cosine, sine = -direction * across_i, direction * along_i
    omega = direction * _probe_speed(drive) * size / ca.fmax(intervals, 1.0)
    along, across = ca.fmax(cosine, -cosine), ca.fmax(sine, -sine)
    slope = (across - along) / ca.fmax(across + along, LEAST_SUM)
    theta = math.pi / 4 + slope * (math.pi / 4 + ARC * (1 - ca.fmax(slope, -slope)))
    named = {"cosine": cosine, "sine": sine, "along": along, "across": across, "slope": slope, "theta_first": theta}
    b.stage("cosine", "", "", list(named.values()), list(named), scale="none")
    b.output("towards", [cosine, sine, omega, theta])
    return b.build()


def onward_block(drive: Drive) -> Block:
    """Where the rotor of the guess is a sample later: it turns on while the inverter is off.

    Parameters
    ----------
    drive : Drive
    """
    b = BlockBuilder("turn_guess", "Where the rotor of the guess is a sample later")
    z_alpha, z_beta, omega, theta = b.input("guess", ["z_alpha", "z_beta", "omega", "theta"])
    b.output("guess", [z_alpha, z_beta, omega, ca.remainder(theta + _turn_per_sample(drive) * omega, 2 * math.pi)])
    return b.build()


def place_block(drive: Drive) -> Block:
    """The electrical states that carry the measured currents with the rotor at the guessed angle.

    Parameters
    ----------
    drive : Drive
    """
    b = BlockBuilder("place_state", "The states that carry the measured currents, with the rotor where it is guessed")
    i_a, i_b = b.input("phase", ["i_a", "i_b"])
    _, _, omega, theta = b.input("guess", ["z_alpha", "z_beta", "omega", "theta"])
    i_beta = (1 / SQRT_3) * i_a + (2 / SQRT_3) * i_b
    b.stage("i_beta", "", "", [i_beta], ["i_beta"], scale="none")
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    z, named = machine.named_state((i_a, i_beta), Rotor.at(theta))
    if named:
        b.stage(next(iter(named)), "", "", list(named.values()), list(named), scale="none")
    b.output("guess", [z[0], z[1], omega, theta])
    return b.build()


def axis_block(drive: Drive, model: StateSpaceModel) -> Block:
    """Where the current of an alignment points, how large it is wanted, and what is missing of it and across it.

    ``progress`` goes to 1 while the current rises, a quarter of a turn beside the initial state's angle, and to 2 while
    it is turned there.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
        Tells the place of the angle.
    """
    b = BlockBuilder("turn_axis", "Where the current of an alignment points, and how far the measured one is from it")
    (before,) = b.input("aligning", ["progress_before"])
    x_0 = b.input("x_0", [f"{state.name}_0" for state in model.states])
    i_a, i_b = b.input("phase", ["i_a", "i_b"])
    progress = ca.fmin(before + _align_step(drive), 2.0)
    aside = ca.fmin(2.0 - progress, 1.0) * (math.pi / 2)
    theta_axis = ca.remainder(x_0[[s.name for s in model.states].index("theta")] + aside, 2 * math.pi)
    axis = Rotor.at(theta_axis)
    wanted = align_current(drive) * ca.fmin(progress, 1.0)
    i_beta = (1 / SQRT_3) * i_a + (2 / SQRT_3) * i_b
    along, across = axis.to_rotor((i_a, i_beta))
    cosine, sine = axis.to_stator((1.0, 0.0))
    named = {"progress": progress, "aside": aside, "theta_axis": theta_axis, "wanted": wanted, "i_beta": i_beta}
    b.stage("progress", "", "", list(named.values()), list(named), scale="none")
    b.output("aligning", [progress])
    b.output("axis", [cosine, sine, wanted])
    b.output("missing", [wanted - along, across])
    return b.build()
