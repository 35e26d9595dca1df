"""The drive's modes, from power-up on and after a fault: the whole of what decides about the inverter.

RESTING, inverter off, until the currents read zero; PROBING, zero voltage, until a current shows where the back-EMF
points; CATCHING, the filter runs without torque until it has found the rotor; RUNNING; and FAULT, inverter off, after
too many attempts in a row. Read :func:`transitions` as a table: from a mode, where a guard holds, to a mode.

Once an interrupt, after filter and controller where they ran. ``PMSM_NOT_CONVERGED`` is no reason to stop: the last
iterate is kept and the next step goes on from it. ``PMSM_DIVERGED`` says that currents, voltages and motor do not fit
each other: a stuck sensor, a DC link that was not measured. The angle may be good for all that, and the fault may pass;
torque goes on as long as the angle turns as it should.
"""

from __future__ import annotations

import math

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
    Whole,
    square,
)
from model.filters.program import Call, Count, If, Node, Restart, Set
from model.machines.state_space import StateSpaceModel
from model.schema import Drive
from model.supervisor.blocks import probe_block, turning_block
from model.supervisor.words import (
    Action,
    Field,
    Limit,
    Mode,
    Reason,
    Supervisor,
    Transition,
    at_least,
    equals,
    is_label,
    within,
)

#: s. Lost is who is blind for so long, or diverged: a fault of some 50 ms is ridden through, and torque is cut where
#: the angle no longer turns as the speed says.
BLIND_TIME, DIVERGED_TIME = 2e-3, 100e-3
#: s. Currents must read zero for REST; zero voltage is tried for PROBE; the filter has CATCH to lock, of which its
#: angle may jump for SETTLE, and must be content for LOCKED. Attempts are forgotten after STEADY of running.
REST_TIME, PROBE_TIME, CATCH_TIME, SETTLE_TIME, LOCKED_TIME, STEADY_TIME = 2e-3, 2e-3, 10e-3, 1e-3, 3e-3, 100e-3
#: Samples in a row beyond the trip current; attempts in a row that failed.
MAX_EXCESS, MAX_FAILURES = 3, 10
#: Shares of the maximum current: what reads as zero, what shows where the back-EMF points, what is too much. Of the
#: operating box's speed: what may be unknown.
ZERO_CURRENT, PROBE_CURRENT, TRIP_CURRENT, UNKNOWN_SPEED = 0.05, 0.1, 1.5, 0.5
#: rad^2: what the probe leaves open of the angle.
UNKNOWN_ANGLE = 0.01
#: rad: what a jolt may turn the angle by, beside half of what the speed says: while it is looked for, and in a window.
CATCH_JOLT, RUN_JOLT = 0.1, 0.3
#: Share of their variance that adaptive states keep meanwhile.
HELD = 1e-3
#: An int of 16 bits counts no further.
MOST_SAMPLES = 32000

MODES = (
    Mode("RESTING", "inverter off, until the currents read zero", lasting=True),
    Mode("PROBING", "zero voltage, until a current shows where the back-EMF points", inverter=True),
    Mode("CATCHING", "zero torque, until the filter has found the rotor", inverter=True, runs=True),
    Mode("RUNNING", "speed and torque as commanded", inverter=True, runs=True, torque=True, lasting=True),
    Mode("FAULT", "inverter off, until the fault is acknowledged", lasting=True),
)

REASONS = (
    Reason("NONE", "nothing went wrong since power-up or the last acknowledgement"),
    Reason("CURRENT", "a current was beyond TRIP_CURRENT, or no number"),
    Reason("BLIND", "the filter rejected its inputs for too long"),
    Reason("DIVERGED", "for too long the currents were not what voltages and motor data say"),
    Reason("RESTARTED", "the filter's state was lost, and it began anew"),
    Reason("SLIPPED", "the angle did not turn as the estimated speed says"),
    Reason("NOT_CAUGHT", "the filter did not find the turning rotor in time"),
    Reason("SELF_TEST", "the self-test failed: no acknowledgement helps"),
)

FIELDS = (
    Field("mode", "PMSM_RESTING, ..."),
    Field("reason", "why the drive last gave up its rotor: PMSM_REASON_NONE, ..."),
    Field("inverter", "1: gates may be enabled"),
    Field("runs", "1: filter and controller take their step at the next interrupt"),
    Field("torque", "1: the controller may ask for current"),
    Field("fresh", "1: voltages and regulators of what went before are void"),
    Field("acknowledged", "set it to 1 to leave FAULT"),
    Field("since", "interrupts in this mode, or in a window of RUNNING"),
    Field("quiet", "samples in a row, RESTING: both currents read zero"),
    Field("rejected", "inputs rejected in a row"),
    Field("diverged", "steps in a row"),
    Field("excess", "samples in a row beyond the trip current"),
    Field("content", "steps in a row of which the status is good"),
    Field("mirrored", "1: the guess was turned round already"),
    Field("failures", "attempts in a row that did not end in steady running"),
    Field("steady", "windows of RUNNING in a row"),
    Field("turning", "rad: the angle turned, and should have by the speed; the angle before; rad^2: doubt", 4),
    Field("probe", "1 or -1: where the reference points; intervals of zero voltage", 2),
    Field("guess", "the filter's first two states, speed and angle to begin with", 4),
)


def supervisor(drive: Drive, model: StateSpaceModel) -> Supervisor:
    """The machine of a drive.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
        Of its filter: which states there are.
    """
    names = [state.name for state in model.states]
    return Supervisor(
        modes=MODES,
        reasons=REASONS,
        fields=FIELDS,
        limits=limits(drive, model),
        watch=watch(drive, model),
        actions=actions(drive, model, names),
        transitions=transitions(),
    )


def transitions() -> tuple[Transition, ...]:
    """The table, in the order in which the transitions of a mode are tried."""
    excess, as_stated = at_least("excess", "MAX_EXCESS"), _turns_as_stated
    half_way = All((at_least("since", "TWICE_SETTLE_SAMPLES"), equals("mirrored", 0)))
    found = All((at_least("since", "TWICE_SETTLE_SAMPLES"), at_least("content", "LOCKED_SAMPLES"), as_stated("CATCH")))
    accepted = All((equals("acknowledged", 1), Not(is_label("reason", "REASON_SELF_TEST"))))

    def lost(source: str, guard: Condition, why: str, reason: str) -> Transition:
        return Transition(source, "RESTING", guard, why, ("fail",), reason)

    return (
        Transition("RESTING", "FAULT", at_least("failures", "MAX_FAILURES"), "attempts failed again and again"),
        Transition("RESTING", "PROBING", at_least("quiet", "REST_SAMPLES"), "the currents read zero"),
        lost("PROBING", Not(within("phase", "TRIP_SQUARED")), "a current is too large, or no number", "CURRENT"),
        Transition(
            "PROBING",
            "CATCHING",
            Not(within("phase", "PROBE_SQUARED")),
            "a current shows that the rotor turns",
            ("guess_from_probe", "start_filter"),
        ),
        Transition(
            "PROBING",
            "RUNNING",
            at_least("since", "PROBE_SAMPLES"),
            "no current came: the rotor stands, and starts as the drive file says",
            ("start_at_rest", "begin_window"),
        ),
        lost("CATCHING", excess, "a current is too large", "CURRENT"),
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
            All((*half_way.conditions, Not(as_stated("CATCH")))),
            "the angle turns the other way than the speed says: half a turn on there is the other guess",
            ("guess_mirrored", "start_filter", "mark_mirrored"),
        ),
        Transition(
            "CATCHING",
            "RUNNING",
            found,
            "the filter is content, and its angle turns as its speed says",
            ("learn", "begin_window"),
        ),
        lost("CATCHING", at_least("since", "CATCH_SAMPLES"), "the filter did not find the rotor in time", "NOT_CAUGHT"),
        lost("RUNNING", excess, "a current is too large", "CURRENT"),
        lost("RUNNING", at_least("rejected", "MAX_REJECTED"), "the filter is blind", "BLIND"),
        lost("RUNNING", at_least("diverged", "MAX_DIVERGED"), "currents, voltages and motor do not fit", "DIVERGED"),
        lost("RUNNING", Reported(("RESTARTED",)), "the filter began anew", "RESTARTED"),
        lost(
            "RUNNING",
            All((at_least("since", "LOCKED_SAMPLES"), Not(as_stated("RUN")))),
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
        Transition("FAULT", "RESTING", accepted, "the fault is acknowledged", ("forget",)),
    )


def _turns_as_stated(when: str) -> Condition:
    """Within half of what is stated, and an angle that a jolt may make; what is no number is not."""
    return Compare("<=", Entry("turning", 3), Name(f"{when}_JOLT_SQUARED"))


def _in_a_row(counter: str, where: Condition, most: str) -> If:
    """One more in a row, or none; never beyond a limit, as an int that counts on would come round."""
    return If(where, (Count(counter, most),), (_clear(counter),))


def _clear(counter: str) -> Set:
    return Set(Entry(counter), Whole(0))


def _mark(field: str) -> Set:
    return Set(Entry(field), Whole(1))


def watch(drive: Drive, model: StateSpaceModel) -> tuple[Node, ...]:
    """What is counted in every mode, and of the step that ran.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
    """
    turning = turning_block(drive, model)
    probe, phase = [Entry("probe", k) for k in range(2)], [Entry("phase", k) for k in range(2)]
    trip = Name("TRIP_SQUARED")
    good = All((equals("rejected", 0), equals("diverged", 0), Not(Reported(("RESTARTED",)))))
    return (
        Count("since", "MOST_SAMPLES"),
        If(Compare("<", Name("reference"), Number(0.0)), (Set(probe[0], Number(-1.0)),), (Set(probe[0], Number(1.0)),)),
        If(
            is_label("mode", "PROBING"),
            (Set(probe[1], Operation("+", probe[1], Number(1.0))),),
            (Set(probe[1], Number(0.0)),),
        ),
        If(
            is_label("mode", "RESTING"),
            (_in_a_row("quiet", within("phase", "ZERO_SQUARED"), "REST_SAMPLES"),),
            (_clear("quiet"),),
        ),
        If(Not(is_label("mode", "FAULT")), (_clear("acknowledged"),)),
        _in_a_row("excess", Either(tuple(Compare(">", square(i), trip) for i in phase)), "MAX_EXCESS"),
        If(
            equals("runs", 1),
            (
                _in_a_row("rejected", Reported(("INPUT_REJECTED",)), "MAX_REJECTED"),
                _in_a_row("diverged", Reported(("DIVERGED",)), "MAX_DIVERGED"),
                _in_a_row("content", good, "LOCKED_SAMPLES"),
                Call(turning),
            ),
        ),
    )


def actions(drive: Drive, model: StateSpaceModel, names: list[str]) -> tuple[Action, ...]:
    """What transitions do.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
    names : list of str
        Of the states.
    """
    flux_states = model.states[0].unit == "Wb"
    slow = [names.index(state.name) for state in model.adaptive.states]
    omega, theta = names.index("omega"), names.index("theta")
    begun = (0, 1, omega, theta)
    guess, towards = [Entry("guess", k) for k in range(4)], [Entry("towards", k) for k in range(2)]
    x = [Entry("x", k) for k in range(len(names))]

    def spread(state: int, value: Name | Operation | Entry) -> Set:
        return Set(Entry("variance", state), value)

    def minus(value: Entry) -> Operation:
        return Operation("-", Number(0.0), value)

    unknown = [(0, "UNKNOWN_FLUX"), (1, "UNKNOWN_FLUX")] if flux_states else []
    unknown += [(omega, "UNKNOWN_SPEED"), (theta, "UNKNOWN_ANGLE")]
    clear = tuple(_clear(counter) for counter in ("rejected", "diverged", "content"))
    turned = tuple(Set(guess[k], minus(x[k]) if flux_states else x[k]) for k in range(2))
    known = tuple(spread(k, Entry("P_0", k)) for k in slow)
    return (
        Action("fail", "One more attempt that failed.", (Count("failures", "MAX_FAILURES"),)),
        Action("forget", "The next attempt is the first one again.", (_clear("failures"), _clear("reason"))),
        Action(
            "guess_from_probe",
            "The current says where the back-EMF points, and how fast the rotor turns.",
            (
                Call(probe_block(drive, model)),
                If(Compare("<", towards[0], Number(0.0)), (Set(guess[3], Operation("-", Name("PI"), guess[3])),)),
                If(Compare("<", towards[1], Number(0.0)), (Set(guess[3], minus(guess[3])),)),
                _clear("mirrored"),
            ),
        ),
        Action(
            "guess_mirrored",
            "Half a turn on, and the other way round: what makes the same voltage at this instant.",
            (*turned, Set(guess[2], minus(x[omega])), Set(guess[3], Operation("+", x[theta], Name("PI")))),
        ),
        Action("mark_mirrored", "There are two guesses, and this is the second one.", (_mark("mirrored"),)),
        Action(
            "start_filter",
            "The filter from anew at the guess, neither speed nor angle known.",
            (
                Restart(),
                *(Set(x[state], guess[k]) for k, state in enumerate(begun)),
                *(spread(state, Name(limit)) for state, limit in unknown),
                *(spread(k, Operation("*", Name("HELD"), Entry("P_0", k))) for k in slow),
                *clear,
                _mark("fresh"),
            ),
        ),
        Action(
            "start_at_rest",
            "The filter as the drive file begins it.",
            (Restart(), *clear, _mark("fresh"), _clear("steady")),
        ),
        Action(
            "learn",
            "Torque is allowed, and motor data that are states are learnt again." if slow else "Torque is allowed.",
            (*known, _clear("steady")),
        ),
        Action(
            "begin_window",
            "From here on the angle's turning is compared with the speed.",
            (
                Set(Entry("turning", 0), Number(0.0)),
                Set(Entry("turning", 1), Number(0.0)),
                Set(Entry("turning", 2), x[theta]),
            ),
        ),
        Action(
            "count_steady",
            "After some windows in a row the attempts that went before are forgotten.",
            (
                Count("steady", "STEADY_WINDOWS"),
                If(at_least("steady", "STEADY_WINDOWS"), (_clear("failures"),)),
            ),
        ),
    )


def limits(drive: Drive, model: StateSpaceModel) -> tuple[Limit, ...]:
    """The numbers that guards ask for: samples as integers, and what suits the drive.

    Parameters
    ----------
    drive : Drive
        Its sample time (s), largest current (A), operating box and magnet.
    model : StateSpaceModel
        Which states there are.
    """
    T, current = drive.model.sample_time, drive.control.max_current

    def samples(name: str, time: float, meaning: str, times: int = 1) -> Limit:
        return Limit(name, times * min(MOST_SAMPLES // times, max(1, round(time / T))), meaning)

    def squared(name: str, share: float, meaning: str) -> Limit:
        return Limit(name, (share * current) ** 2, f"({share:g} of the largest current)^2, A^2: {meaning}")

    flux = [Limit("UNKNOWN_FLUX", UNKNOWN_ANGLE * drive.motor.magnet_flux**2, "Wb^2: psi_m^2 times UNKNOWN_ANGLE")]
    held = [Limit("HELD", HELD, "of P_0: motor data that are states are not learnt while the rotor is looked for")]
    return (
        samples("MAX_REJECTED", BLIND_TIME, "inputs rejected in a row: no estimate is left"),
        samples("MAX_DIVERGED", DIVERGED_TIME, "steps in a row with PMSM_DIVERGED: less is ridden through"),
        Limit("MAX_EXCESS", MAX_EXCESS, "samples in a row beyond the trip current"),
        Limit("MAX_FAILURES", MAX_FAILURES, "attempts in a row that fail end in FAULT"),
        samples("REST_SAMPLES", REST_TIME, "so long both currents must read zero before the inverter is enabled"),
        samples("PROBE_SAMPLES", PROBE_TIME, "without a current from zero voltage for so long the rotor stands"),
        samples("SETTLE_SAMPLES", SETTLE_TIME, "so long the angle may jump; then it must turn as the speed says"),
        samples("TWICE_SETTLE_SAMPLES", SETTLE_TIME, "or the guess is turned round", times=2),
        samples("CATCH_SAMPLES", CATCH_TIME, "so long the filter may take to lock"),
        samples("LOCKED_SAMPLES", LOCKED_TIME, "so long it must be content; and the length of a window of RUNNING"),
        Limit("STEADY_WINDOWS", round(STEADY_TIME / LOCKED_TIME), "of RUNNING, after which failures are forgotten"),
        Limit("MOST_SAMPLES", MOST_SAMPLES, "an int of 16 bits counts no further"),
        squared("ZERO_SQUARED", ZERO_CURRENT, "reads as zero; above noise and offset of the sensors"),
        squared("PROBE_SQUARED", PROBE_CURRENT, "tells where the back-EMF points"),
        squared("TRIP_SQUARED", TRIP_CURRENT, "no torque needs so much; beside the hardware's trip"),
        Limit("CATCH_JOLT_SQUARED", CATCH_JOLT**2, "rad^2: so far off may the angle be, beside half of what is stated"),
        Limit("RUN_JOLT_SQUARED", RUN_JOLT**2, "rad^2: the same in a window of RUNNING, where a jolt may come"),
        Limit("UNKNOWN_SPEED", (UNKNOWN_SPEED * drive.operating_box.speed) ** 2, "(rad/s)^2: where the rotor may turn"),
        Limit("UNKNOWN_ANGLE", UNKNOWN_ANGLE, "rad^2: what the probe leaves open"),
        *(flux if model.states[0].unit == "Wb" else []),
        *(held if model.adaptive.states else []),
        Limit("PI", math.pi, "half a turn"),
    )
