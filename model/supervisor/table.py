"""The drive's modes, from power-up on and after a fault: the whole of what decides about the inverter.

RESTING, inverter off, until the currents read zero; PROBING, zero voltage: a rotor that turns makes a current, which is
read, and read again after WAITING, inverter off, until it has turned far enough to tell which way the rotor turns.
CATCHING, once that current has died out, too: the filter runs without torque until it has found the rotor. Where no
current comes the rotor stands, or nearly. Once the reference asks for motion: STARTING, torque is on, and a rival
filter half a turn away runs beside the filter; whichever expects the currents better is followed. As standstill tells
nothing of either, a start turns at START_SPEED at least, however small the reference is. RUNNING, in which a rotor that
was caught gets its torque little by little: braking from beyond the rated speed, field weakening has to come first. And
FAULT, inverter off, after too many attempts in a row, or where the currents never read zero. Read :func:`transitions`
as a table: from a mode, where a guard holds, to a mode.

Once an interrupt, after filter and controller where they ran. ``PMSM_NOT_CONVERGED`` is no reason to stop: the last
iterate is kept and the next step goes on from it. ``PMSM_DIVERGED`` says that currents, voltages and motor do not fit
each other: a stuck sensor, a DC link that was not measured. The angle may be good for all that, and the fault may pass;
torque goes on as long as the angle turns as it should.

Why one rival is enough. Of a round rotor (theta + pi, -omega, -T_L) makes the same currents as (theta, omega, T_L)
until the angle has turned: a filter that is off settles at one of the two, and the rival, put half a turn from it at
the end of every window, at the other. Where nothing turns in a window both may be a quarter off: then the rival goes
there.
"""

from __future__ import annotations

from model.alignment import aligns
from model.filters.conditions import (
    All,
    Compare,
    Condition,
    Either,
    Entry,
    Name,
    Not,
    Number,
    Operation,
    Reported,
    Value,
    square,
    total,
)
from model.machines.state_space import StateSpaceModel
from model.schema import Drive
from model.supervisor.actions import actions, watch
from model.supervisor.fields import ALIGN_FIELDS, FIELDS, RIVAL_FIELDS
from model.supervisor.limits import has_rival, limits
from model.supervisor.words import (
    Mode,
    OnRival,
    Reason,
    Supervisor,
    Transition,
    at_least,
    equals,
    is_label,
    within,
)

#: A mode's place is its number in C: the one that not every drive has is the last.
MODES = (
    Mode("RESTING", "inverter off, until the currents read zero"),
    Mode("PROBING", "zero voltage, until a current shows where the back-EMF points", inverter=True),
    Mode("WAITING", "inverter off, until the current of a reading has died out"),
    Mode("CATCHING", "zero torque, until the filter has found the rotor that turns", inverter=True, runs=True),
    Mode("RUNNING", "speed and torque as commanded", inverter=True, runs=True, torque=True, lasting=True),
    Mode("FAULT", "inverter off, until the fault is acknowledged", lasting=True),
    Mode(
        "STARTING",
        "a rotor that stood: torque, and a rival half a turn from the filter",
        inverter=True,
        runs=True,
        torque=True,
        rivals=True,
    ),
    Mode(
        "ALIGNING",
        "a rotor that stood: a direct current, until it stands along a known axis",
        inverter=True,
        aligns=True,
    ),
)

REASONS = (
    Reason("NONE", "nothing went wrong since power-up or the last acknowledgement"),
    Reason("CURRENT", "a current was beyond TRIP_CURRENT, or no number, or did not die out"),
    Reason("BLIND", "the filter rejected its inputs for too long"),
    Reason("DIVERGED", "for too long the currents were not what voltages and motor data say"),
    Reason("RESTARTED", "the filter's state was lost, and it began anew"),
    Reason("SLIPPED", "the angle did not turn as the estimated speed says"),
    Reason("RUNAWAY", "the estimated speed went beyond all that the motor can do"),
    Reason("PHASE", "a phase carried no current while the others did and the rotor turned"),
    Reason("NOT_CAUGHT", "the filter did not find the turning rotor in time"),
    Reason("NOT_STARTED", "the rotor did not turn as either filter says"),
    Reason("SELF_TEST", "the self-test failed: no acknowledgement helps"),
    Reason("NOT_ALIGNED", "the rotor did not come to rest along the axis of its alignment"),
)


def supervisor(drive: Drive, model: StateSpaceModel, scored: bool = True) -> Supervisor:
    """The machine of a drive.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
        Of its filter: which states there are.
    scored : bool, optional
        The filter tells how well it expects the currents; one that does not has no rival.
    """
    rivals = scored and has_rival(drive)
    aligned = aligns(drive)
    table = transitions([state.name for state in model.states], rivals, aligned)
    fields = tuple(field for field in FIELDS if rivals or field.name != "rivals")
    named = {action if isinstance(action, str) else action.name for row in table for action in row.actions}
    return Supervisor(
        modes=tuple(mode for mode in MODES if (rivals or not mode.rivals) and (aligned or not mode.aligns)),
        reasons=tuple(reason for reason in REASONS if aligned or reason.name != "NOT_ALIGNED"),
        fields=fields + (ALIGN_FIELDS if aligned else ()) + (RIVAL_FIELDS if rivals else ()),
        limits=limits(drive, model, rivals),
        watch=watch(drive, model, rivals),
        actions=tuple(action for action in actions(drive, model, rivals) if action.name in named),
        transitions=table,
    )


def transitions(states: list[str], rivals: bool, aligned: bool = False) -> tuple[Transition, ...]:
    """The table, in the order in which the transitions of a mode are tried.

    Parameters
    ----------
    states : list of str
        Names of the filter's.
    rivals : bool
        There is a second filter, and STARTING.
    aligned : bool, optional
        A start begins with ALIGNING.
    """
    return (
        *_from_rest(rivals, aligned),
        *_catching(),
        *(_aligning() if aligned else ()),
        *(_starting(states) if rivals else ()),
        *_running(states.index("omega")),
        Transition(
            "FAULT",
            "RESTING",
            All((equals("acknowledged", 1), Not(is_label("reason", "REASON_SELF_TEST")))),
            "the fault is acknowledged",
            ("forget",),
        ),
    )


def _lost(source: str, guard: Condition, why: str, reason: str) -> Transition:
    return Transition(source, "RESTING", guard, why, ("fail",), reason)


def _from_rest(rivals: bool, aligned: bool) -> tuple[Transition, ...]:
    """RESTING, PROBING and WAITING tell whether the rotor turns."""
    seen = Not(within("phase", "PROBE_SQUARED"))
    known, none = at_least("readings", "MAX_READINGS"), within("phase", "ZERO_SQUARED")
    return (
        Transition("RESTING", "FAULT", at_least("failures", "MAX_FAILURES"), "attempts failed again and again"),
        Transition(
            "RESTING", "PROBING", at_least("quiet", "REST_SAMPLES"), "the currents read zero", ("await_reading",)
        ),
        Transition(
            "RESTING",
            "FAULT",
            at_least("since", "RESTLESS_SAMPLES"),
            "the currents never read zero: a sensor is off, or the rotor so fast that diodes conduct",
            (),
            "CURRENT",
        ),
        _lost("PROBING", Not(within("phase", "TRIP_SQUARED")), "a current is too large, or no number", "CURRENT"),
        Transition(
            "PROBING",
            "WAITING",
            All((seen, equals("readings", 0))),
            "a current shows that the rotor turns, not yet which way",
            ("take_reading", "keep_reading"),
        ),
        Transition(
            "PROBING",
            "WAITING",
            seen,
            "a later current shows which way the rotor turns, or not yet",
            ("take_reading", "guess_from_probe"),
        ),
        _from_standstill(rivals, aligned),
        Transition(
            "WAITING",
            "CATCHING",
            All((known, none)),
            "the last current has died out: the filter begins where the rotor is by now",
            ("place", "start_filter", "void_voltages", "begin_anew"),
        ),
        Transition(
            "WAITING",
            "PROBING",
            All((Not(known), at_least("since", "GAP_SAMPLES"), none)),
            "the current has died out: it is read again",
        ),
        _lost("WAITING", at_least("since", "WAIT_SAMPLES"), "the current does not die out", "CURRENT"),
    )


def _from_standstill(rivals: bool, aligned: bool) -> Transition:
    """Where no current comes: as one rotor of two, turned to where it is known, or as the drive file says."""
    both = ("guess_rest", "place", "start_filter", "copy_filter", "guess_opposite", "place", OnRival("start_filter"))
    stands: tuple[str | OnRival, ...] = (*(both if rivals else ("start_at_rest",)), "void_voltages")
    follows, how = (
        ("STARTING", ", and the reference asks for motion")
        if rivals
        else ("RUNNING", ", and starts as the drive file says")
    )
    if aligned:
        follows, stands = "ALIGNING", ("void_voltages",)
        how = ", and a current turns it to where it is known"
    tried = at_least("since", "PROBE_SAMPLES")
    wanted = All((tried, Compare(">", square(Name("reference")), Name("STILL_SQUARED"))))
    return Transition(
        "PROBING",
        follows,
        wanted if rivals else tried,
        "no current came: the rotor stands" + how,
        (*stands, "begin_anew", "begin_window"),
    )


def _turns_as_stated(when: str) -> Condition:
    """Within half of what is stated, and an angle that a jolt may make; what is no number is not."""
    return Compare("<=", Entry("turning", 3), Name(f"{when}_JOLT_SQUARED"))


def _catching() -> tuple[Transition, ...]:
    as_stated, tried = _turns_as_stated("CATCH"), at_least("since", "TWICE_SETTLE_SAMPLES")
    return (
        _lost("CATCHING", at_least("excess", "MAX_EXCESS"), "a current is too large", "CURRENT"),
        Transition(
            "CATCHING",
            None,
            Compare("==", Entry("since"), Name("SETTLE_SAMPLES")),
            "the angle has jumped where it would",
            ("begin_window",),
        ),
        Transition(
            "CATCHING",
            "CATCHING",
            All((tried, equals("mirrored", 0), Not(as_stated))),
            "the angle turns the other way than the speed says: half a turn on there is the other guess",
            ("guess_mirrored", "place", "start_filter", "begin_anew"),
        ),
        Transition(
            "CATCHING",
            "RUNNING",
            All((tried, at_least("content", "LOCKED_SAMPLES"), as_stated)),
            "the filter is content, and its angle turns as its speed says",
            ("learn", "begin_window"),
        ),
        _lost("CATCHING", at_least("since", "CATCH_SAMPLES"), "the filter has not found the rotor", "NOT_CAUGHT"),
    )


def _aligning() -> tuple[Transition, ...]:
    return (
        _lost("ALIGNING", Not(within("phase", "TRIP_SQUARED")), "a current is too large, or no number", "CURRENT"),
        Transition(
            "ALIGNING",
            "RUNNING",
            at_least("calm", "CALM_SAMPLES"),
            "for half a swing the rotor made no current across the axis: it stands there",
            ("guess_aligned", "place", "start_filter", "learn", "begin_anew", "begin_window"),
        ),
        _lost("ALIGNING", at_least("since", "ALIGN_SAMPLES"), "the rotor does not come to rest", "NOT_ALIGNED"),
    )


def _score(nis: str, load: Entry, has_load: bool) -> Value:
    """How badly a filter expects the currents, and how large a load it takes for the reason."""
    added = (Operation("*", Name("LOAD_PENALTY"), square(load)),) if has_load else ()
    return total(Entry(nis), *added)


def _starting(states: list[str]) -> tuple[Transition, ...]:
    has_load = "load_torque" in states
    place = states.index("load_torque") if has_load else 0
    own, other = (_score(name, Entry(x, place), has_load) for name, x in (("nis", "x"), ("rival_nis", "rival_x")))
    turned = square(Entry("turning", 0))
    moved = Compare(">=", turned, Name("WINDOW_TURN_SQUARED"))
    over = Either((moved, at_least("since", "WINDOW_SAMPLES")))
    good = (Compare(">=", turned, Name("LEAST_TURN_SQUARED")), Compare("<=", Entry("turning", 3), Number(0.0)))
    again = ("copy_filter", "place", OnRival("start_filter"), "level_scores", "begin_window")

    def window(guard: Condition, why: str, *actions: str) -> Transition:
        return Transition("STARTING", "STARTING", guard, why, (*actions, *again))

    return (
        _lost("STARTING", at_least("excess", "MAX_EXCESS"), "a current is too large", "CURRENT"),
        _lost("STARTING", at_least("rejected", "MAX_REJECTED"), "the filter is blind", "BLIND"),
        _lost("STARTING", Reported(("RESTARTED",)), "the filter began anew", "RESTARTED"),
        _lost("STARTING", at_least("windows", "MAX_WINDOWS"), "neither filter is right", "NOT_STARTED"),
        Transition(
            "STARTING",
            "STARTING",
            All((at_least("since", "LOCKED_SAMPLES"), Compare("<", Operation("+", other, Name("PREFERENCE")), own))),
            "the rival has expected the currents better for a while",
            ("exchange_filters", "count_window", "begin_anew", "begin_window"),
        ),
        Transition(
            "STARTING",
            "RUNNING",
            All((over, *good, at_least("good", "GOOD_WINDOWS"))),
            "the angle turned as stated in window after window",
            ("learn", "begin_window"),
        ),
        window(
            All((over, *good)),
            "the angle turned as stated: half a turn from there nothing must be better",
            "count_good",
            "guess_half_turn",
        ),
        window(
            moved,
            "the angle turned, not as stated: half a turn from there may be better",
            "count_none",
            "guess_half_turn",
        ),
        window(
            at_least("since", "WINDOW_SAMPLES"),
            "nothing turned: a quarter of a turn from there may be better",
            "count_none",
            "guess_aside",
        ),
    )


def _running(omega: int) -> tuple[Transition, ...]:
    return (
        _lost("RUNNING", at_least("excess", "MAX_EXCESS"), "a current is too large", "CURRENT"),
        Transition(
            "RUNNING",
            "FAULT",
            at_least("open", "MAX_OPEN"),
            "a phase is open: turn after turn goes by without a current in it",
            reason="PHASE",
        ),
        _lost("RUNNING", at_least("rejected", "MAX_REJECTED"), "the filter is blind", "BLIND"),
        _lost(
            "RUNNING",
            Compare(">", square(Entry("x", omega)), Name("MOST_SPEED_SQUARED")),
            "no motor turns as fast as is estimated",
            "RUNAWAY",
        ),
        _lost("RUNNING", at_least("diverged", "MAX_DIVERGED"), "currents, voltages and motor do not fit", "DIVERGED"),
        _lost("RUNNING", Reported(("RESTARTED",)), "the filter began anew", "RESTARTED"),
        _lost(
            "RUNNING",
            All((at_least("since", "LOCKED_SAMPLES"), Not(_turns_as_stated("RUN")))),
            "the angle does not turn as the speed says: the filter may be half a turn off",
            "SLIPPED",
        ),
        Transition(
            "RUNNING",
            "RUNNING",
            at_least("since", "LOCKED_SAMPLES"),
            "a window is over, and the next one begins",
            ("count_steady", "begin_window"),
        ),
    )
