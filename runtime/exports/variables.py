"""The parts that are exported, and their variables: the one owner of names, units, roles and places."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.estimator.folder import GeneratedFolder
from runtime.system.errors import UserError

#: What may be exported.
PARTS = ("filter", "drive", "motor")

#: Roles: inputs are held over a sample; outputs are of the last one; tunable data may change at any time, fixed ones
#: before the first sample.
INPUT, OUTPUT, TUNABLE, FIXED = "input", "output", "tunable", "fixed"

#: Types in C.
SINGLE, DOUBLE, INTEGER = "float32", "float64", "int"


@dataclass(frozen=True)
class Variable:
    """One number of a part.

    ``name`` is what a user sees, ``place`` the expression under the part's struct in C, ``unit`` as the project writes
    it ("" for a number), ``type`` float32, float64 or int. Variables of one ``port`` belong together, in order.
    """

    name: str
    role: str
    place: str
    unit: str
    words: str
    port: str
    type: str = SINGLE


def variables(folder: GeneratedFolder, part: str) -> tuple[Variable, ...]:
    """Inputs, outputs and data of a part.

    Parameters
    ----------
    folder : GeneratedFolder
    part : {"filter", "drive", "motor"}

    Raises
    ------
    UserError
        Another word.
    """
    made = {"filter": _filter, "drive": _drive, "motor": _motor}.get(part)
    if made is None:
        raise UserError(f"no part '{part}' to export; there are: {', '.join(PARTS)}.")
    return tuple(made(folder))


def _estimates(folder: GeneratedFolder, place: str) -> list[Variable]:
    """The states as columns of recordings name them."""
    module = folder.module
    return [
        Variable(f"{name}_estimate", OUTPUT, f"{place}.x[{k}]", unit, f"{name}, estimated", "estimate")
        for k, (name, unit) in enumerate(zip(module.STATES, module.UNITS, strict=True))
    ]


def _health(place: str) -> list[Variable]:
    return [
        Variable("nis", OUTPUT, f"{place}.nis", "", "normalised innovation squared, mean over its window", "nis"),
        Variable("repairs", OUTPUT, f"{place}.repairs", "", "steps with a repaired covariance", "repairs", INTEGER),
        Variable("iterations", OUTPUT, f"{place}.iterations", "", "measurement updates made", "iterations", INTEGER),
    ]


def _squared(unit: str) -> str:
    """The unit of a variance: A -> A^2, N m -> (N m)^2."""
    return f"({unit})^2" if " " in unit or "/" in unit else f"{unit}^2"


def _tuning(folder: GeneratedFolder, place: str) -> list[Variable]:
    """The filter's tuning; x_0 and P_0 act before the first sample, and where the filter restarts."""
    module = folder.module
    states = list(enumerate(zip(module.STATES, module.UNITS, strict=True)))
    found = []
    for field, role, words, power in (
        ("Q", TUNABLE, "process noise variance a step", _squared),
        ("x_0", FIXED, "first estimate", str),
        ("P_0", FIXED, "first variance", _squared),
    ):
        for k, (name, unit) in states:
            found.append(Variable(f"{field}.{name}", role, f"{place}.{field}[{k}]", power(unit), words, field))
    for k, name in enumerate(("i_alpha", "i_beta")):
        found.append(Variable(f"R.{name}", TUNABLE, f"{place}.R[{k}]", "A^2", "measurement noise variance", "R"))
    found += [
        Variable("u_max", TUNABLE, f"{place}.u_max", "V", "voltages beyond are rejected", "u_max"),
        Variable("y_max", TUNABLE, f"{place}.y_max", "A", "currents beyond are rejected", "y_max"),
        Variable("nis_max", TUNABLE, f"{place}.nis_max", "", "divergence is reported from here on", "nis_max"),
        Variable("nis_weight", TUNABLE, f"{place}.nis_weight", "", "one over the window of nis, samples", "nis_weight"),
        Variable("tolerance", TUNABLE, f"{place}.tolerance", "", "eps of (33)", "tolerance"),
        Variable("max_iterations", TUNABLE, f"{place}.max_iterations", "", "N_max of (33)", "max_iterations", INTEGER),
    ]
    return found


def _filter(folder: GeneratedFolder) -> list[Variable]:
    """Inputs are named as the columns of a recording."""
    return [
        *(
            Variable(f"{letter}_{axis}", INPUT, f"{field}[{k}]", unit, words, letter)
            for letter, field, unit, words in (
                ("u", "u", "V", "voltage, mean over the interval that ends now"),
                ("i", "y", "A", "current, now"),
            )
            for k, axis in enumerate(("alpha", "beta"))
        ),
        *_estimates(folder, "filter"),
        Variable("status", OUTPUT, "status", "", "status bits of the last step, 0: good", "status", INTEGER),
        *_health("filter"),
        *_tuning(folder, "filter"),
    ]


#: Units of the controller's gains, by name.
_GAIN_UNITS = {
    "speed_p": "N m s/rad",
    "speed_i": "N m/rad",
    "current_d_p": "V/A",
    "current_q_p": "V/A",
    "current_i": "V/A",
    "max_current": "A",
    "dead_share": "",
    "compensation": "",
    "dead_current": "A",
    "advance": "s",
    "weakening": "A/V^2",
    "max_torque": "N m",
    "max_power": "W",
}


def _modes(folder: GeneratedFolder) -> str:
    """The numbers of the modes; the last is the start's, of drives that have one for it."""
    last = "ALIGNING" if "ALIGNING" in folder.module.MODES else "STARTING"
    return f"0 RESTING .. 4 RUNNING, 5 FAULT, 6 {last}"


def _drive(folder: GeneratedFolder) -> list[Variable]:
    control, modes = "drive.control", "drive.supervisor"
    return [
        Variable("i_a", INPUT, "phase[0]", "A", "current of phase a", "phase"),
        Variable("i_b", INPUT, "phase[1]", "A", "current of phase b", "phase"),
        Variable("speed_reference", INPUT, "command[0]", "rad/s", "mechanical", "command"),
        Variable("dc_link", INPUT, "command[1]", "V", "as measured", "command"),
        Variable("acknowledge", INPUT, "acknowledge", "", "from 0 to 1: leave FAULT", "acknowledge", INTEGER),
        *(
            Variable(f"duty_{leg}", OUTPUT, f"duty[{k}]", "", f"duty cycle of phase {leg}, 0 .. 1", "duty")
            for k, leg in enumerate("abc")
        ),
        Variable("gates", OUTPUT, "gates", "", "1: enabled, 0: all six off", "gates", INTEGER),
        *_estimates(folder, f"{control}.filter"),
        Variable("mode", OUTPUT, f"{modes}.mode", "", _modes(folder), "mode", INTEGER),
        Variable("reason", OUTPUT, f"{modes}.reason", "", "why it last gave up its rotor", "reason", INTEGER),
        Variable("status", OUTPUT, "drive.status", "", "status bits of the last step", "status", INTEGER),
        *_health(f"{control}.filter"),
        Variable("delay", FIXED, "delay", "", "samples from measuring to acting, 0 or 1", "delay", INTEGER),
        *(
            Variable(f"gain.{name}", TUNABLE, f"{control}.gain[{k}]", _GAIN_UNITS[name], "controller", "gain")
            for k, name in enumerate(folder.module.GAIN_NAMES)
        ),
        *_tuning(folder, f"{control}.filter"),
    ]


def _motor(folder: GeneratedFolder) -> list[Variable]:
    salient = "per_L_q" in folder.manifest["plant"]["motor"]
    data = [("R", "ohm", "stator resistance", 0), ("L_d" if salient else "L", "H", "inductance", 1)]
    data += [("L_q", "H", "inductance", 2)] if salient else []
    data += [
        ("psi_m", "Wb", "magnet flux linkage", 3),
        ("J", "kg m^2", "inertia", 4),
        ("D", "N m s/rad", "friction", 5),
    ]
    axes = list(enumerate(("alpha", "beta")))
    return [
        *(
            Variable(f"duty_{leg}", INPUT, f"duty[{k}]", "", f"duty cycle of phase {leg}, 0 .. 1", "duty")
            for k, leg in enumerate("abc")
        ),
        Variable("gates", INPUT, "gates", "", "1: enabled, 0: all six off", "gates", INTEGER),
        Variable("dc_link", INPUT, "dc_link", "V", "of the inverter", "dc_link", DOUBLE),
        Variable("load_torque", INPUT, "load", "N m", "against the rotor", "load_torque", DOUBLE),
        Variable("i_a", OUTPUT, "phase[0]", "A", "as the sensor of phase a says", "phase"),
        Variable("i_b", OUTPUT, "phase[1]", "A", "as the sensor of phase b says", "phase"),
        *(Variable(f"i_{axis}", OUTPUT, f"i[{k}]", "A", "true", "i", DOUBLE) for k, axis in axes),
        Variable("omega", OUTPUT, "m.s[2]", "rad/s", "mechanical", "omega", DOUBLE),
        Variable("theta", OUTPUT, "m.s[3]", "rad", "electrical, unwrapped", "theta", DOUBLE),
        Variable("torque", OUTPUT, "torque[0]", "N m", "of the magnetic field", "torque", DOUBLE),
        *(Variable(name, TUNABLE, f"data[{k}]", unit, words, "motor", DOUBLE) for name, unit, words, k in data),
        Variable("omega_0", FIXED, "start[0]", "rad/s", "speed at the start, mechanical", "start", DOUBLE),
        Variable("theta_0", FIXED, "start[1]", "rad", "angle at the start, electrical", "start", DOUBLE),
        Variable("switching", FIXED, "m.switching", "", "0: averaged inverter, 1: carrier", "switching", INTEGER),
        Variable("inverter_delay", FIXED, "m.delay", "", "samples until duty cycles act, 0 or 1", "delay", INTEGER),
        Variable("dead_time", TUNABLE, "m.dead_time", "s", "of a leg, a carrier period", "inverter", DOUBLE),
        Variable("switch_drop", TUNABLE, "m.drop", "V", "of what conducts", "inverter", DOUBLE),
        Variable("min_pulse", TUNABLE, "m.min_pulse", "s", "shorter pulses are left out", "inverter", DOUBLE),
        Variable("i_a_offset", TUNABLE, "m.offset[0]", "A", "of the sensor", "sensor", DOUBLE),
        Variable("i_b_offset", TUNABLE, "m.offset[1]", "A", "of the sensor", "sensor", DOUBLE),
        Variable("sensor_range", TUNABLE, "m.range", "A", "full scale", "sensor", DOUBLE),
        Variable("sensor_bits", TUNABLE, "bits", "", "of the converter; 0: no quantisation", "bits", INTEGER),
    ]


def by_port(found: tuple[Variable, ...], *roles: str) -> dict[str, list[Variable]]:
    """Variables of these roles in groups that belong together.

    Parameters
    ----------
    found : tuple of Variable
    *roles : str
    """
    ports: dict[str, list[Variable]] = {}
    for variable in found:
        if variable.role in roles:
            ports.setdefault(variable.port, []).append(variable)
    return ports
