"""Signs of currents as symbols with a derivative of their own.

CasADi would differentiate a limit into a comparison, which no printer of lanes knows. So a sign is a symbol in f; what
it is, and its slope, are put in afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.inverter import saturated


@dataclass(frozen=True)
class Sign:
    """The sign of a current, smooth below I_0: a symbol, the current, its value, and its derivative by the current."""

    symbol: Any
    current: Any
    value: Any
    slope: Any

    @classmethod
    def of(cls, name: str, current: Any, fading: Any) -> Sign:
        """A cubic between -1 and 1.

        Parameters
        ----------
        name : str
            The symbol's.
        current, fading : SX
            A, and the current from which on the sign is whole.
        """
        t = saturated(current / fading)
        return cls(ca.SX.sym(name), current, t * (1.5 - 0.5 * t * t), 1.5 * (1 - t * t) / fading)


def in_values(expression: Any, signs: list[Sign]) -> Any:
    """An expression with what the signs are in their places.

    Parameters
    ----------
    expression : SX
    signs : list of Sign
        Each may hang on those before it.
    """
    for sign in reversed(signs):
        expression = ca.substitute(expression, sign.symbol, sign.value)
    return expression


def total_jacobian(f: Any, x: Any, signs: list[Sign]) -> Any:
    """df/dx, by way of the signs, too; the signs' symbols are still in it.

    Parameters
    ----------
    f : SX, (n, 1)
        Of x and the signs' symbols.
    x : SX, (n, 1)
    signs : list of Sign
        Each may hang on those before it.
    """
    slopes: list[Any] = []

    def along(expression: Any) -> Any:
        whole = ca.jacobian(expression, x)
        for sign, slope in zip(signs, slopes, strict=False):
            whole = whole + ca.jacobian(expression, sign.symbol) @ slope
        return whole

    for sign in signs:
        slopes.append(sign.slope * along(sign.current))
    return along(f)
