"""How much torque the DC link allows: less and less as it falls or, of torque that brakes, as it rises.

A drive that asks a falling link for the same power takes more current from it, until it is gone; a motor that brakes
pumps its energy into the link's capacitors, until they or the transistors burst. So either end takes away torque, in a
straight line, as controllers that live on batteries do (VESC firmware: battery cut and regenerative cut, each with
start and end). All limits are shares of the drive file's ``dc_link``, and act on the largest current. Beside them, of
ABB's ACS850 (a table of its application guide "Common DC configuration", U_DC of 540 V): undervoltage is held off from
80 % on and trips at 71 %; the braking chopper begins at 119 %, overvoltage is held off from 125 % on and trips at
138 %. Here nobody trips, so torque begins to fall where that drive gives up, and is gone before its braking one would
be.

Torque brakes where the reference is less than the speed, in the direction of motion: (reference - omega) omega < 0.
"""

from __future__ import annotations

import casadi as ca

from model.filters.program import BlockBuilder
from model.quantities import Block, Constant
from model.schema import Drive

#: Shares of the nominal link: any torque is gone, falls from here; torque that brakes falls from here, is gone.
LOW_END, LOW_START, HIGH_START, HIGH_END = 0.5, 0.7, 1.15, 1.25
#: Of the operating box's speed: (omega - reference) omega of its square counts as braking in full, less in part, lest
#: the sign of a small number switch torque on and off. Slower a motor has 1/2500 of its kinetic energy to give back.
BRAKES = 0.02


def limit_constants(drive: Drive) -> tuple[Constant, ...]:
    """The numbers of the block, by name.

    Parameters
    ----------
    drive : Drive
        Its DC link (V) and the speed of its operating box (rad/s).
    """
    link, slow = drive.control.dc_link, BRAKES * drive.operating_box.speed
    low, high = (LOW_START - LOW_END) * link, (HIGH_END - HIGH_START) * link
    return (
        Constant("LINK_LOW", LOW_END * link, f"{LOW_END:g} of the DC link, V: no torque from here down", None),
        Constant("PER_LOW", 1.0 / low, f"1 / ({low:g} V): all torque from {LOW_START:g} of the DC link up", None),
        Constant("LINK_HIGH", HIGH_END * link, f"{HIGH_END:g} of the DC link, V: no braking from here up", None),
        Constant("PER_HIGH", 1.0 / high, f"1 / ({high:g} V): all braking up to {HIGH_START:g} of the DC link", None),
        Constant("PER_BRAKING", 1.0 / (slow * slow), f"1 / ({BRAKES:g} of the box's speed)^2, (s/rad)^2", None),
    )


def limit_block(drive: Drive) -> Block:
    """Share of the largest current that the DC link allows, 0 .. 1.

    A link that is no number (NaN) allows none; a reference or a speed that is none counts as braking. About the nominal
    link the share is 1 to the bit.

    Inputs: ``command`` speed reference (rad/s, mechanical) and DC link (V), as measured; ``rotor`` estimated speed
    (rad/s, mechanical). Output: ``share``.

    Parameters
    ----------
    drive : Drive
        Its DC link and operating box.
    """
    low, per_low, high, per_high, per_braking = (constant.value for constant in limit_constants(drive))
    b = BlockBuilder("allow", "What the DC link allows: a share of the largest current")
    reference, v_dc = b.input("command", ["omega_ref", "v_dc"])
    (omega,) = b.input("rotor", ["omega"])
    held = ca.fmin(ca.fmax((v_dc - low) * per_low, 0.0), 1.0)
    taken = ca.fmin(ca.fmax((high - v_dc) * per_high, 0.0), 1.0)
    braking = ca.fmax(ca.fmin((omega - reference) * omega * per_braking, 1.0), 0.0)
    b.stage("held", "", "", [held, taken, braking], ["held", "taken", "braking"], scale="none")
    b.output("share", [held * (1.0 - braking * (1.0 - taken))])
    return b.build()
