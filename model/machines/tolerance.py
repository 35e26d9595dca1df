"""Motor data that may be wrong: how far f moves with each, which the filters' time update adds to P_pred.

A datum p that lies within a half-width d p of its own is given the deviation sigma = d p / sqrt(3), that of an even
distribution. What it does to a sample is ``(df/dp) dp``, along one direction in the state space: a wrong R with the
current, a wrong psi_m with speed and torque. Its error is the same in every sample, where process noise is another in
each; noise that stays alike for ``correlation_time`` tau has, over times longer than that, the effect of independent
noise of 2 tau / T times the variance. So::

    P_pred = ... + Q + Q_p,     Q_p = sum over data of (2 tau / T) sigma_p^2 (df/dp)(df/dp)^T,  at the estimate.

Where flux linkages are the states, L and psi_m act in h, where they are wrong in every sample alike; what f lacks then
is the voltage and the torque of what h has wrong (:meth:`model.machines.base.Machine.lacking`). With df/dp in its
place, which is next to nothing, the angle of a salient machine was within 3 sigma of P in 36 to 76 % of the samples at
half of and at rated speed (four motors behind PWM, all data within tolerance), with it in 83 to 97 %.

Data that are states have their uncertainty in P, and none here: a tolerance bounds them (:func:`half_widths`).

An inverter whose V_d may be off may be off in its direction, too. Where a leg's sign is none, the leg takes whatever it
is left to: up to V_d no current flows at standstill, and of a current that ripples about zero nothing is lost. g can be
4/3 long; what it lacks of that, in its square, is noise of the voltage, half of it on each axis, alike for k samples
(``unsure_samples``) as a datum's error is for tau::

    Q_p = ... + sigma_v^2 (df/dv)(df/dv)^T,     sigma_v^2 = k V_d^2 (16/9 - |g|^2)

It is zero where all three signs are whole. Ripple and sensor noise make another sign of it within few samples, and a
leg that carries nothing keeps what it is left to; k was measured, 1/2 (another sign in each sample) / 2 / 4. Recordings
of a switching inverter: ``ipmsm_flux`` starts with errors of 51 / 45 / 39 r/min and is 3.5 / 3.0 / 2.7 degrees off
afterwards, ``spmsm_load_torque`` 37 / 24 / 17 r/min, 2.6 / 2.7 / 3.0 degrees and, in the load step, 13 / 20 / 24 r/min.
Designs of fourteen motors with round rotors at a twentieth of rated speed, 16 draws: within 3 sigma of P in 79 .. 99,
83 .. 100 and, with 4.5, 91 .. 100 % of the samples; of a heavy disk whose current is about zero while it starts 88 %
of 64 draws were held with 1/2, 94 with 4, and with 32 more are lost at low speed. Designs of salient machines, whose
angle hangs on their inductances more, lose by it: the load step at a tenth of rated speed turns a compressor's
estimate by 13 / 18 / 24 degrees. Where V_d is a state there is none of it: there f's g is as long as V_d shows, and P
has V_d's own uncertainty.

Why noise, and how long it stays alike: measured on ``spmsm_load_torque`` with tolerances of R 20, L 10 and psi_m 5 %,
averaged inverter, 5 N m stepped on. tau 0.3, 0.5, 0.6 and 1.5 ms hold an R that is off by a fifth to 5 degrees at 100
r/min, where it made 37 without; at 0.3 ms half of the errors are within 3 sigma of P, at 0.5 ms (the default) 93 and at
0.6 ms 97 %. The load step is felt as late with all of them (14 instead of 8 r/min, for psi_m alone).

A consider state a datum (Schmidt: its covariance with the state is carried along, the datum not corrected) knows that
the error does not change. It was no better at 100 r/min and above (2 to 4 degrees, load step 13 r/min at 1000), lost
the rotor at 10, 30 and 50 r/min as the noise does, and carries as many covariances as a datum that is learnt. To learn
R does hold down to 10 r/min (4 to 18 degrees): R belongs to ``model.adaptive`` where d R i is more than about a third
of the back-EMF.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.inverter import STATE, lost_voltage
from model.machines.adaptive import ADAPTIVE
from model.quantities import Constants, Formulas
from model.schema import Drive

#: The data that may be off, as :class:`model.machines.base.Parameters` calls them, and the key that says how far.
DATA = {
    "R": "stator_resistance",
    "L_d": "inductance",
    "L_q": "inductance",
    "psi_m": "magnet_flux",
}


def half_widths(drive: Drive) -> tuple[float, ...]:
    """Half the width of the range that each adaptive state is held in, relative; 0 where nothing is said.

    Parameters
    ----------
    drive : Drive
    """
    keys = {**DATA, "V_d": "dead_time"}
    return tuple(getattr(drive.tolerance, keys[ADAPTIVE[word][1]], 0.0) for word in drive.model.adaptive)


def deviations(drive: Drive) -> dict[str, float]:
    """Data of a drive that may be wrong: the deviation that counts in a sample, relative to the datum.

    Parameters
    ----------
    drive : Drive
        Data that are states and data without a tolerance are left out.

    >>> from model.drives.load import load_drive
    >>> deviations(load_drive("paper_spmsm"))
    {}
    """
    stated = drive.tolerance
    if stated is None:
        return {}
    slow = {ADAPTIVE[word][1] for word in drive.model.adaptive}
    widths = {letter: getattr(stated, key) for letter, key in DATA.items() if letter not in slow}
    return {letter: width * _alike(drive) for letter, width in widths.items() if width}


@dataclass(frozen=True)
class WrongVoltage:
    """How unsure a V_d that is no state is.

    ``of_size``: its own deviation as it counts in a sample, V; ``of_signs``: that of the voltage on an axis where no
    leg's sign is sure, relative to V_d.
    """

    of_size: float
    of_signs: float


def wrong_voltage(drive: Drive) -> WrongVoltage | None:
    """How unsure the inverter's V_d is; None where it is a state or told exactly, or there is none.

    Parameters
    ----------
    drive : Drive
    """
    stated, volts = drive.tolerance, lost_voltage(drive)
    if stated is None or STATE in drive.model.adaptive or not (stated.dead_time and volts):
        return None
    longest = 16 / 9  # of g, squared
    return WrongVoltage(volts * stated.dead_time * _alike(drive), math.sqrt(stated.unsure_samples * longest))


def _alike(drive: Drive) -> float:
    """The deviation that counts in a sample, of a half-width."""
    assert drive.tolerance is not None
    return math.sqrt(2 * drive.tolerance.correlation_time / drive.model.sample_time / 3)


@dataclass(frozen=True)
class WrongData:
    """The data that may be wrong, of one model.

    ``letters``: symbol, value and relative deviation of each. ``propagate``: the model's, its constants the symbols
    of ``formulas``.
    """

    letters: tuple[tuple[Any, float, float], ...]
    propagate: Callable[..., tuple[list[Any], dict[str, Any]]]
    formulas: Formulas

    def columns(self, f: Any, constants: Constants, through: dict[str, Any]) -> dict[str, Any]:
        """For each datum that f or h hangs on its deviation times df/dp, (n, 1), by its letter.

        Parameters
        ----------
        f : SX, (n, 1)
            What ``propagate`` gave.
        constants : Constants
            Those of the model proper, which the columns are made of; new ones are named after datum and constant.
        through : dict of str to SX
            In place of df/dp for a datum of h, by its letter.
        """
        columns = {}
        for letter, value, deviation in self.letters:
            name = str(letter)
            if name in through:
                sigma = constants(f"SIGMA_{name.upper()}", ca.SX(value * deviation), f"one sigma of {name}")
                columns[name] = sigma * through[name]
            else:
                columns[name] = self._column(f, constants, letter, value, deviation)
        return {name: column for name, column in columns.items() if not column.is_zero()}

    def _column(self, f: Any, constants: Constants, letter: Any, value: float, deviation: float) -> Any:
        size = value * deviation
        shares = {
            name: constants(
                f"SIGMA_{str(letter).upper()}_{name}",
                self._in_numbers(slope) * size,
                f"what {name} changes with one sigma of {letter}",
            )
            for name, slope in self.formulas.slopes(letter).items()
        }
        column = self.formulas.along(f, letter, ca.SX(size), shares)
        known = ca.vertcat(*(self._known(constants, name) for name in self.formulas.symbols))
        return self._in_numbers(ca.substitute(column, ca.vertcat(*self.formulas.symbols.values()), known))

    def _in_numbers(self, expression: Any) -> Any:
        """An expression with the letters' values."""
        letters, values, _ = zip(*self.letters, strict=True)
        return ca.substitute(expression, ca.vertcat(*letters), ca.vertcat(*values))

    def _known(self, constants: Constants, name: str) -> Any:
        """A constant as the model proper has it: under its name, or a number that is not worth one."""
        if name in constants.items:
            return constants.items[name].symbol
        return self._in_numbers(self.formulas.spelled[name])
