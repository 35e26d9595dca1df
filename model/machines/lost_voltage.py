"""The voltage that an inverter keeps back, as the equations see it: :mod:`model.inverter` in letters or constants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.inverter import clarke, legs, saturated
from model.machines.base import Named, Pair, Parameters
from model.quantities import Constants


def constant_voltage(constant: Constants, V_d: Any) -> Any:
    """V_d as the drive file has it: one number by one name in filter and controller.

    Parameters
    ----------
    constant : Constants
        Collects those of the filter or of the controller.
    V_d : SX
        V.
    """
    return constant("V_DEAD", V_d, "V_dc t_d f_sw + V_drop, V: what a leg loses")


@dataclass(frozen=True)
class LostVoltage:
    """v = u - V_d g(i), g the Clarke transform of the legs' saturated current signs."""

    par: Parameters
    constant: Constants

    def signs(self, i: list[Any]) -> tuple[Pair, Named]:
        """g, and what it is made of.

        Parameters
        ----------
        i : list of Any, (2,)
            Stator current, A.
        """
        scale = self.constant("SIGN_PER_A", 1 / self.par.I_0, "1 / I_0, 1/A: below I_0 a leg's sign fades")
        phases, _ = legs((scale * i[0], scale * i[1]))
        signs = [saturated(phase) for phase in phases]
        g = clarke(signs)
        return g, {f"sign_{leg}": sign for leg, sign in zip("abc", signs, strict=True)}

    @staticmethod
    def unsure(signs: list[Any]) -> Any:
        """sqrt(1 - |3/4 g|^2): 0 where all legs' signs are whole, 1 where there are none.

        Of the signs, not of g: where they are whole numbers nothing is rounded, and the 0 is one.

        Parameters
        ----------
        signs : list of SX, (3,)
            Saturated, which makes the longest g 4/3 long.
        """
        a, b, c = signs
        first, second = a - 0.5 * (b + c), b - c
        return ca.sqrt(ca.fmax(0.0, 1 - 0.25 * (first * first) - 0.1875 * (second * second)))

    def seen(self, i: list[Any]) -> Any:
        """How much of what is lost says something of V_d: 0 below I_1, 1 from sqrt(2) I_1 on.

        Parameters
        ----------
        i : list of Any, (2,)
            Stator current, A.
        """
        formula = "1 / (I_1 I_1), 1/A^2: below I_1 nothing is seen of V_d"
        scale = self.constant("SEEN_PER_A_SQ", 1 / (self.par.I_1 * self.par.I_1), formula)
        return ca.fmax(0.0, ca.fmin(1.0, scale * (i[0] * i[0] + i[1] * i[1]) - 1))

    @staticmethod
    def remaining(u: Pair, g: Pair, V_d: Any) -> Pair:
        """The voltage applied, V.

        Parameters
        ----------
        u : Pair
            Commanded, V.
        g : Pair
        V_d : SX
            V.
        """
        return u[0] - V_d * g[0], u[1] - V_d * g[1]
