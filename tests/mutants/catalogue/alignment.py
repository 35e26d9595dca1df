"""A wrong alignment before a start: its numbers, its mode, its current, and the drive that makes that."""

from __future__ import annotations

from tests.mutants.catalogue.supervisor import Rows, rows_of

#: Behind dead time, R a state; salient, what damps is chosen; flux linkages. Of motors, what no shipped drive is.
SERVO, SALIENT, FLUX = (("aligned servo_24v",), ("aligned ipmsm",), ("aligned ipmsm_flux",))
DRAWN = ("pytest tests/runtime/test_alignment.py -k all_motors_that_are_accepted",)

_NUMBERS: Rows = (
    ("align: with all of the current", "ALIGN_SHARE, ACROSS_SHARE = 0.8, 0.5", "ALIGN_SHARE, ACROSS_SHARE = 1.0, 0.5", SERVO),
    ("align: more is left across", "ALIGN_SHARE, ACROSS_SHARE = 0.8, 0.5", "ALIGN_SHARE, ACROSS_SHARE = 0.8, 0.6", SERVO),
    ("align: R takes all of the voltage", "0.5 * inverter_voltage(drive)", "inverter_voltage(drive)", DRAWN),
    ("align: whatever the reluctance", "return min(most, 0.5 * m.magnet_flux / difference) if difference else most", "return most", DRAWN),
    ("align: reluctance helps", "m.magnet_flux - (m.inductance_q - m.inductance_d) * align_current(drive)", "m.magnet_flux + (m.inductance_q - m.inductance_d) * align_current(drive)", SALIENT),
    ("align: damped by less", "swing(drive) * (ratio + 1.0) / 2.0", "swing(drive) * (ratio - 1.0) / 2.0", SALIENT),
    ("align: R damps not", "max(best - m.stator_resistance, 0.0)", "max(best, 0.0)", SALIENT),
    ("align: as stiff as the regulator", "SOFT_SHARE = 0.5", "SOFT_SHARE = 1.0", DRAWN),
    ("align: as soft as the other axis", "current_bandwidth * min(m.inductance_d", "current_bandwidth * max(m.inductance_d", DRAWN),
    ("align: decay of the fastest", "-1.0 / np.max((1.0 / times).real)", "-1.0 / np.min((1.0 / times).real)", SALIENT),
    ("align: decay lost beside a fast root", "times = np.roots(cubic[::-1])", "times = 1.0 / np.roots(cubic)", ("pytest tests/runtime/test_alignment.py -k too_heavy_to_turn",)),
    ("align: no least turn", "return max(TURN_DECAYS * decay_time(drive), LEAST_TURN)", "return TURN_DECAYS * decay_time(drive)", SERVO),
    ("align: six decays", "LEAST_TURN = 1.0, 7.0, 20e-3", "LEAST_TURN = 1.0, 6.0, 20e-3", SALIENT),
    ("align: calm for a whole swing", "return math.pi / swing(drive)", "return 2.0 * math.pi / swing(drive)", SERVO),
)  # fmt: skip

_TABLE: Rows = (
    ("align: with the inverter off", '        inverter=True,\n        aligns=True,\n', '        aligns=True,\n', SERVO),
    ("align: the filter runs", '        inverter=True,\n        aligns=True,\n', '        inverter=True,\n        runs=True,\n        aligns=True,\n', SERVO),
    ("align: skipped", 'follows, stands = "ALIGNING", ("void_voltages",)', 'follows, stands = "RUNNING", ("void_voltages",)', SERVO),
    ("align: voltages of before", 'follows, stands = "ALIGNING", ("void_voltages",)', 'follows, stands = "ALIGNING", ()', SERVO),
    ("align: trips after samples in a row", '_lost("ALIGNING", Not(within("phase", "TRIP_SQUARED"))', '_lost("ALIGNING", at_least("excess", "MAX_EXCESS")', SERVO),
    ("align: NaN is no trip", '_lost("ALIGNING", Not(within("phase", "TRIP_SQUARED"))', '_lost("ALIGNING", Either(tuple(Compare(">", square(Entry("phase", k)), Name("TRIP_SQUARED")) for k in range(2)))', SERVO),
    ("align: the time is over before it is calm", '        _lost("ALIGNING", Not(within("phase", "TRIP_SQUARED")), "a current is too large, or no number", "CURRENT"),\n', '        _lost("ALIGNING", Not(within("phase", "TRIP_SQUARED")), "a current is too large, or no number", "CURRENT"),\n        _lost("ALIGNING", at_least("since", "ALIGN_SAMPLES"), "late", "NOT_ALIGNED"),\n', SERVO),
    ("align: stands at once", 'at_least("calm", "CALM_SAMPLES")', 'at_least("calm", "MAX_EXCESS")', SERVO),
    ("align: for ever", '        _lost("ALIGNING", at_least("since", "ALIGN_SAMPLES"), "the rotor does not come to rest", "NOT_ALIGNED"),\n', "", SERVO),
    ("align: not aligned runs", '_lost("ALIGNING", at_least("since", "ALIGN_SAMPLES"), "the rotor does not come to rest", "NOT_ALIGNED")', 'Transition("ALIGNING", "RUNNING", at_least("since", "ALIGN_SAMPLES"), "late", ("start_filter", "learn", "begin_anew", "begin_window"), "NOT_ALIGNED")', SERVO),
    ("align: no reason of its own", '"the rotor does not come to rest", "NOT_ALIGNED"', '"the rotor does not come to rest", "NOT_CAUGHT"', SERVO),
    ("align: the filter where it was", '("guess_aligned", "place", "start_filter", "learn", ', '("place", "start_filter", "learn", ', SERVO),
    ("align: the filter without its currents", '("guess_aligned", "place", "start_filter", "learn", ', '("guess_aligned", "start_filter", "learn", ', FLUX),
    ("align: the filter is not started", '("guess_aligned", "place", "start_filter", "learn", ', '("guess_aligned", "place", "learn", ', SERVO),
    ("align: motor data are not learnt", '("guess_aligned", "place", "start_filter", "learn", ', '("guess_aligned", "place", "start_filter", ', SERVO),
    ("align: regulators go on", '"start_filter", "learn", "begin_anew", "begin_window"', '"start_filter", "learn", "begin_window"', SERVO),
    ("align: window of before", '"start_filter", "learn", "begin_anew", "begin_window"', '"start_filter", "learn", "begin_anew"', SERVO),
)  # fmt: skip

_ACTIONS: Rows = (
    ("align: calm before it has arrived", 'All((arrived, within("missing", "ZERO_SQUARED")))', 'within("missing", "ZERO_SQUARED")', SERVO),
    ("align: arrived beside the axis", 'Compare(">=", progress, Number(2.0))', 'Compare(">=", progress, Number(1.0))', SERVO),
    ("align: calm by what shows", 'within("missing", "ZERO_SQUARED")', 'within("missing", "PROBE_SQUARED")', SERVO),
    ("align: calm, ever", 'calm = _in_a_row("calm", All((arrived, within("missing", "ZERO_SQUARED"))), "CALM_SAMPLES")', 'calm = If(All((arrived, within("missing", "ZERO_SQUARED"))), (Count("calm", "CALM_SAMPLES"),))', SERVO),
    ("align: calm of the last attempt", 'for entry in (progress, *axis)), _clear("calm"))', "for entry in (progress, *axis)),)", SERVO),
    ("align: begins where the last one was", "for entry in (progress, *axis))", "for entry in axis)", SERVO),
    ("align: its current in other modes", "for entry in (progress, *axis))", "for entry in (progress,))", SERVO),
    ("align: while it runs", 'If(is_label("mode", "ALIGNING"), (Call', 'If(is_label("mode", "RUNNING"), (Call', SERVO),
    ("align: along angle zero", 'Set(guess[2], Number(0.0)), Set(guess[3], Entry("x_0", theta))\n    return', "Set(guess[2], Number(0.0)), Set(guess[3], Number(0.0))\n    return", SERVO),
    ("align: at the speed of a reading", 'place = Set(guess[2], Number(0.0)), Set(', "place = Set(guess[2], guess[2]), Set(", SERVO),
    ("align: as sure as after a reading", '(*place, *_spread("REST_SPEED", "START_ANGLE"))', '(*place, *_spread("UNKNOWN_SPEED", "UNKNOWN_ANGLE"))', SERVO),
)  # fmt: skip

_LIMITS: Rows = (
    ("align: time and calm exchanged", '_samples(drive, "CALM_SAMPLES", calm_time(drive)', '_samples(drive, "CALM_SAMPLES", longest', SERVO),
    ("align: counts beyond an int", "if longest > MOST_SAMPLES * drive.model.sample_time", "if longest > 2 * MOST_SAMPLES * drive.model.sample_time", ("pytest tests/runtime/test_alignment.py -k no_int_can_count",)),
)  # fmt: skip

_BLOCKS: Rows = (
    ("align: turned in half the time", "return drive.model.sample_time / turn_time(drive)", "return 2.0 * drive.model.sample_time / turn_time(drive)", SERVO),
    ("align: turns on", "progress = ca.fmin(before + _align_step(drive), 2.0)", "progress = before + _align_step(drive)", SERVO),
    ("align: half a turn beside first", "aside = ca.fmin(2.0 - progress, 1.0) * (math.pi / 2)", "aside = ca.fmin(2.0 - progress, 1.0) * math.pi", SERVO),
    ("align: along the axis at once", "aside = ca.fmin(2.0 - progress, 1.0) * (math.pi / 2)", "aside = 0.0 * progress", SERVO),
    ("align: all of the current at once", "align_current(drive) * ca.fmin(progress, 1.0)", "align_current(drive) * ca.fmin(1.0 + progress, 1.0)", SERVO),
    ("align: what is across is not missed", 'b.output("missing", [wanted - along, across])', 'b.output("missing", [wanted - along, 0.0 * across])', SERVO),
)  # fmt: skip

_CURRENT: Rows = (
    ("align: across it nothing damps", "-(soft * across + gain.current_d_p * beyond)", "-(gain.current_d_p * beyond)", SALIENT),
    ("align: stiff across", "-(soft * across + gain.current_d_p * beyond)", "-(gain.current_d_p * across)", SALIENT),
    ("align: never stiff across", "-(soft * across + gain.current_d_p * beyond)", "-(soft * across)", SERVO),
    ("align: winds up", "z[1] + gain.current_i * error + _back(gain.current_i, stiff) * (along_lim - v_along)", "z[1] + gain.current_i * error", SERVO),
    ("align: beside its axis", "v = cosine * along_lim - sine * across_lim, sine", "v = cosine * along_lim + sine * across_lim, sine", SALIENT),
)  # fmt: skip

_DRIVE_C: Rows = (
    ("align: no current is made", "        d->status = align(d, phase, command, duty);\n", "        ;\n", SERVO),
    ("align: of any link", "axis[2] = d->supervisor.axis[2] * {{ p }}_link_share(command, 0.0f);", "axis[2] = d->supervisor.axis[2];", SERVO),
    ("align: a link that is no number", "if (command[1] * command[1] <= most * most) {", "if (!(command[1] * command[1] > most * most)) {", SERVO),
    ("align: no current reaches the integrator", "(i[0] * i[0] <= y_max * y_max) && (i[1] * i[1] <= y_max * y_max)", "(i[0] * i[0] <= y_max * y_max)", SERVO),
    ("align: the voltage that acts is to come", "        d->control.v_acting[0] = d->control.v_queued[0];\n        d->control.v_acting[1] = d->control.v_queued[1];\n        d->control.v_queued[0] = v[0];", "        d->control.v_queued[0] = v[0];", SERVO),
    ("align: a refused command is not told", "        status = PMSM_COMMAND_REJECTED;\n", "        status = 0;\n", SERVO),
)  # fmt: skip

_MODULE: Rows = (
    ("align: of any link, Python", "axis = (s.axis[0], s.axis[1], s.axis[2] * share)", "axis = (s.axis[0], s.axis[1], s.axis[2])", SERVO),
    ("align: the voltage acts at once, Python", "            c.v_acting, c.v_queued = c.v_queued, v\n", "            c.v_acting, c.v_queued = v, v\n", SERVO),
)  # fmt: skip

ALIGNMENT = (
    *rows_of("model/alignment.py", _NUMBERS),
    *rows_of("model/supervisor/table.py", _TABLE),
    *rows_of("model/supervisor/actions.py", _ACTIONS),
    *rows_of("model/supervisor/limits.py", _LIMITS),
    *rows_of("model/supervisor/blocks.py", _BLOCKS),
    *rows_of("model/loop/controller.py", _CURRENT),
    *rows_of("codegen/render/templates/drive.c.j2", _DRIVE_C),
    *rows_of("codegen/render/templates/supervisor.py.j2", _MODULE),
)
