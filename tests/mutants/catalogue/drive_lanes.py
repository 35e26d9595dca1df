"""A wrong lane form of the drive: its printer and its text."""

from __future__ import annotations

from tests.mutants.catalogue.supervisor import Rows, rows_of

#: By its scalar form: a surface motor whose load is a state, with a rival; flux linkages, with the square wave.
LOADED_LANES, FLUX_LANES = ((f"drive-lanes {drive}",) for drive in ("spmsm_load_torque", "ipmsm_flux"))

_PRINTER: Rows = (
    ("lanes: the rival is not copied", 'return [f"{pad}copy_lane(&s->rival, f, sizeof(s->rival), lane);"]', "return []", LOADED_LANES),
    ("lanes: filter and rival stay", 'return [f"{pad}exchange_lane(f, &s->rival, sizeof(s->rival), lane);"]', "return []", LOADED_LANES),
    ("lanes: no restart", 'return [f"{pad}reset(f, lane);"]', "return []", LOADED_LANES),
    ("lanes: a filter's field of lane 0", 'return f"{text}[lane]" if entry.place is None else f"{text}.of[lane]"', 'return f"{text}[lane]" if entry.place is None else f"{text}.of[0]"', LOADED_LANES),
    ("lanes: nothing is fetched for a block", 'return [*lines(dict.fromkeys(inputs), True), call,', "return [call,", LOADED_LANES),
    ("lanes: what a block made is lost", "call, *lines(outputs, False)]", "call]", LOADED_LANES),
    ("lanes: a branch within no other", 'lines = [f"{hit} = {given}(', 'lines = [f"{hit} = (', LOADED_LANES),
    ("lanes: the other branch within no other", '{miss} = {given}!(', "{miss} = !(", LOADED_LANES),
    ("lanes: counted in every lane", "({f'{where} & ' if where else ''}{more})", "({more})", LOADED_LANES),
    ("lanes: a block in every lane", 'self._kept(f"{name}[{k}]", f"{name}_new[{k}]", where)', 'self._kept(f"{name}[{k}]", f"{name}_new[{k}]", "")', LOADED_LANES),
    ("lanes: the last guard has the last word", "in reversed(self.machine.leaving(mode.name)):", "in self.machine.leaving(mode.name):", LOADED_LANES),
    ("lanes: no mode rests not", 'go(s, PMSM_{first}, lane); /* no mode', "; /* no mode", LOADED_LANES),
    ("lanes: no reason is kept", 's->reason[lane] = PMSM_REASON_{transition.reason};', ";", LOADED_LANES),
    ("lanes: one word of what a mode allows", "' | '.join(modes)", "modes[0]", LOADED_LANES),
)  # fmt: skip

_TEXT: Rows = (
    ("lanes: reset keeps the voltage", "    f->u_held[1].of[lane] = 0.0f;\n", "", LOADED_LANES),
    ("lanes: reset keeps the count", "    f->iterations[lane] = 0;\n", "", LOADED_LANES),
    ("lanes: time goes on in a new mode", "    s->since[lane] = 0;\n", "", LOADED_LANES),
    ("lanes: voltages of before", "(s->fresh[lane] != 0) ? 0.0f : queued", "queued", LOADED_LANES),
    ("lanes: regulators of before", "(s->anew[lane] != 0) ? 0.0f : before", "before", LOADED_LANES),
    ("lanes: a filter that rests runs", "            if (d->supervisor.runs[lane] == 0) {\n", "            if (d->supervisor.runs[lane] < 0) {\n", LOADED_LANES),
    ("lanes: a start with all of the current", "const float32 start = {{ p | upper }}_START_SHARE * max_current;", "const float32 start = max_current;", LOADED_LANES),
    ("lanes: torque of any link", "allowed * share[0].of[lane];", "allowed;", LOADED_LANES),
    ("lanes: current limited for ever", "    d->control.gain[MAX_CURRENT] = max_current;\n", "", LOADED_LANES),
    ("lanes: not seen without torque", "((torque & (1 - seen)) != 0)", "((1 - seen) != 0)", LOADED_LANES),
    ("lanes: status of before", "(runs != 0) ? bits : 0", "bits", LOADED_LANES),
    ("lanes: duty cycles of before", "(d->supervisor.runs[lane] != 0) ? own : 0.5f", "own", LOADED_LANES),
)  # fmt: skip


_COPIES: Rows = (
    ("lanes: a status that is not filled", "    d->status[lane] = drive->status;\n", "", LOADED_LANES),
)  # fmt: skip

_RIVALS: Rows = (
    ("lanes: every rival runs", "if ((d->supervisor.runs[lane] == 0) || (d->supervisor.rivals[lane] == 0)) {", "if (d->supervisor.runs[lane] == 0) {", LOADED_LANES),
    ("lanes: a start by the reference", "(s->rivals[lane] != 0) ? start : reference", "reference", LOADED_LANES),
    ("lanes: always by what a start asks for", "(s->rivals[lane] != 0) ? start : reference", "start", LOADED_LANES),
)  # fmt: skip


_WAVE: Rows = (
    ("lanes: the wave in the wrong voltage", "take_injected(d->control.v_acting, v, d, 2, 0);", "take_injected(d->control.v_acting, v, d, 2, 1);", FLUX_LANES),
    ("lanes: the wave without torque", "const int here = ((delayed == ANY_DELAY) | (delayed == of_delay)) ? torque : 0;", "const int here = ((delayed == ANY_DELAY) | (delayed == of_delay)) ? 1 : 0;", FLUX_LANES),
    ("lanes: learnt by the sign of no delay", "(d->control.delay[lane] != 0) ? sign : -sign", "(d->control.delay[lane] != 0) ? -sign : sign", FLUX_LANES),
    ("lanes: learnt from a current that was rejected", "(rejected != 0) ? 0.0f : phase[1].of[lane]", "phase[1].of[lane]", FLUX_LANES),
    ("lanes: learnt from no current at all", "(rejected != 0) ? 0.0f : d->injection[0].of[lane]", "d->injection[0].of[lane]", FLUX_LANES),
    ("lanes: the last motor's resistance", "(alone != 0) ? before : 0.0f", "before", FLUX_LANES),
    ("lanes: learnt with a rival", "((d->supervisor.runs[lane] != 0) ? 1 : 0) & alone", "((d->supervisor.runs[lane] != 0) ? 1 : 0)", FLUX_LANES),
    ("lanes: nothing taken from the voltage", "(learns != 0) ? v[k].of[lane] : acting", "acting", FLUX_LANES),
)  # fmt: skip


DRIVE_LANES = (
    *rows_of("codegen/render/printers/mode_lanes.py", _PRINTER),
    *rows_of("codegen/render/templates/drive_lanes.c.j2", _TEXT),
    *rows_of("codegen/render/templates/lane_rivals.j2", _RIVALS),
    *rows_of("codegen/render/templates/lane_copies.j2", _COPIES),
    *rows_of("codegen/render/templates/lane_wave.j2", _WAVE),
)
