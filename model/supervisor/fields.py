"""What the machine keeps from one interrupt to the next."""

from __future__ import annotations

from model.supervisor.words import Field

#: Of every drive.
FIELDS = (
    Field("mode", "PMSM_RESTING, ..."),
    Field("reason", "why the drive last gave up its rotor: PMSM_REASON_NONE, ..."),
    Field("inverter", "1: gates may be enabled"),
    Field("runs", "1: filter and controller take their step at the next interrupt"),
    Field("torque", "1: the controller may ask for current"),
    Field("rivals", "1: the rival takes its step too, and START_SHARE of the largest current is allowed"),
    Field("fresh", "1: no voltage is under way"),
    Field("anew", "1: the regulators begin anew"),
    Field("acknowledged", "set it to 1 to leave FAULT"),
    Field("since", "interrupts in this mode, or in a window of it"),
    Field("quiet", "samples in a row, RESTING: both currents read zero"),
    Field("readings", "currents from zero voltage that were read; MAX_READINGS: it is known which way the rotor turns"),
    Field("rejected", "inputs rejected in a row"),
    Field("diverged", "steps in a row"),
    Field("excess", "samples in a row beyond the trip current"),
    Field("open", "steps in a row in which a phase had been silent for half a turn"),
    Field("content", "steps in a row of which the status is good"),
    Field("mirrored", "1: the guess is not turned round: it was already, or the current told which way"),
    Field("failures", "attempts in a row that did not end in steady running"),
    Field("steady", "windows of RUNNING in a row"),
    Field("turning", "rad: the angle turned, should have by the speed; angle before; rad^2: doubt; rad, now", 5),
    Field("silent", "rad: so far the rotor turned while phase a, b, c alone carried no current", 3),
    Field("eased", "share of the largest current that RUNNING allows", 1),
    Field("probe", "1 or -1: where the reference points, or pointed last; intervals of zero voltage", 2),
    Field("reading", "cosine and sine of the current's angle; its size, A; sine of the angle since the first one", 4),
    Field("first", "cosine and sine of the first current's angle", 2),
    Field("guess", "the filter's first two states, speed and angle to begin with", 4),
    Field("spread", "variances of that speed and angle", 2),
)

#: What a start from an unknown angle needs besides.
RIVAL_FIELDS = (
    Field("side", "on which side of the filter the rival was last"),
    Field("windows", "of STARTING, so far"),
    Field("good", "of them in a row in which the angle turned as stated"),
    Field("asked", "rad/s: the speed that STARTING goes for: the reference, or START_SPEED where that is less", 1),
    Field("rival", "the second filter of STARTING", filter=True),
)

#: What an alignment needs besides.
ALIGN_FIELDS = (
    Field("aligns", "1: duty cycles are those of a current along the axis, the filter does not run"),
    Field("calm", "samples in a row in which the current was along the axis alone"),
    Field("aligning", "how far the alignment is: to 1 the current rises, to 2 it is turned to its axis", 1),
    Field("axis", "cosine and sine of where that current points; A: how large it is to be", 3),
    Field("missing", "A: what the measured current lacks along the axis; what it is across", 2),
)
