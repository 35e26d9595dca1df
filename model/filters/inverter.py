"""What comes before the time update where the inverter is part of the model: from the voltage commanded to f's inputs.

A block of its own, once a step and at the estimate alone (:meth:`StateSpaceModel.applied` says why): the time update
after it has points and derivatives of f as before, and its symmetry under a turn of the stator frame, which the signs
of three legs do not have.
"""

from __future__ import annotations

from typing import Any

from model.filters.program import BlockBuilder, Call
from model.machines.state_space import INPUTS, StateSpaceModel

#: Where V_d is a constant, and where it is a state.
_KNOWN = {
    "v": "v = u - V_d g(h(x)), g the Clarke transform of the legs' saturated signs",
    "g": "g(h(x)): the direction in which a wrong V_d acts; sqrt(1 - |3/4 g|^2): how unsure it is",
}
_ESTIMATED = {
    "v": "v = u - (1 - seen) V_d g(h(x)), V_d the estimate's",
    "g": "seen g(h(x)): what each point's own V_d acts on",
}


def inverter_calls(model: StateSpaceModel) -> tuple[Call, ...]:
    """The call of the block, none where the voltage applied is the one commanded.

    Parameters
    ----------
    model : StateSpaceModel
        Says what f takes beside the state.
    """
    if model.lost is None:
        return ()
    b = BlockBuilder("inverter", "Inverter: what dead time and switches leave of the voltage")
    x = b.input("x", [state.name for state in model.states])
    applied, named = model.applied(x, b.input("u", [quantity.name for quantity in INPUTS]))
    b.working("", named, "here")
    meanings = _ESTIMATED if model.estimates_voltage else _KNOWN
    for name, values in applied.items():
        labels = [f"{quantity.name}_now" for quantity in model.inputs[name]]
        b.stage(name, "", meanings[name], list(values), labels, columns=len(values))
        b.output(name, list(values))
    return (Call(b.build()),)


def f_inputs(b: Any, model: StateSpaceModel) -> list[list[Any]]:
    """What f takes beside the state, declared as a block's inputs: scalars, one list an array.

    Parameters
    ----------
    b : BlockBuilder or GraphBuilder
    model : StateSpaceModel
    """
    return [b.input(name, [q.name for q in quantities]) for name, quantities in model.inputs.items()]
