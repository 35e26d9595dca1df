"""Errors around the filters: in the example interrupt, the self-tests, printed figures, and what judges and measures.

Templates are mutated as modules are: the generator prints the mutated text, and the test that must notice reads it.
"""

from __future__ import annotations

from tests.mutants.mutant import Mutant

Row = tuple[str, str, str, tuple[str, ...]]

# --- the example interrupt

_TESTS = "tests/codegen/test_example.py tests/codegen/test_modes_start.py tests/codegen/test_modes_read.py -k"
WHOLE = (f"example paper_spmsm {_TESTS} paper_spmsm-1",)
ALONE = (f"example paper_spmsm {_TESTS} paper_spmsm-0",)
LINKED = ("example paper_spmsm tests/codegen/test_modes_run.py -k 'dc_link and paper_spmsm-0'",)
RIVAL = ("example ipmsm_flux tests/codegen/test_modes_rival.py -k ipmsm_flux-0",)

_EXAMPLE: tuple[Row, ...] = (
    ("gates stay on", "        inverter_off();\n    } else if", "        inverter_on();\n    } else if", WHOLE),
    ("gates told on again and again", "} else if (gates == 0) {", "} else if (gates >= 0) {", WHOLE),
    ("gates not remembered", "    gates = inverter;\n", "", WHOLE),
    ("gates on before rest", "    drive_gates(0); /* the motor may", "    drive_gates(1); /* the motor may", WHOLE),
    ("gates not driven", "    drive_gates(inverter);", "    (void)inverter;", WHOLE),
    ("gates by torque", "return supervisor.inverter;", "return supervisor.torque;", ALONE),
    ("DC link for the reference", "command[0] = read_speed_reference();\n    command[1] = read_dc_link();\n    inverter", "command[0] = read_dc_link();\n    command[1] = read_dc_link();\n    inverter", WHOLE),
    ("no duty is written", "    write_duty(duty);\n", "", WHOLE),
    ("filter runs in every mode", "    if (supervisor.runs != 0) {", "    if (supervisor.runs >= 0) {", ALONE),
    ("supervisor told of no status", "_supervise(&supervisor, &filter, status[0], phase", "_supervise(&supervisor, &filter, 0, phase", ALONE),
    ("supervisor told of no reference", "status[0], phase, reference);", "status[0], phase, 0.0f);", ALONE),
    ("queued voltage left", "    v_queued[0] = 0.0f;\n", "", ALONE),
    ("voltages never forgotten", "    if (supervisor.fresh != 0) {", "    if (supervisor.fresh > 1) {", ALONE),
    ("voltage of one interrupt ago", "    v_acting[0] = v_queued[0];", "    v_acting[0] = v[0];", ALONE),
    ("torque in every mode", "(supervisor.torque != 0) ? supervisor.eased[0] : 0.0f", "supervisor.eased[0]", ALONE),
    ("torque of any DC link", "        share = share * {{ p }}_link_share(command, filter.x[OMEGA]); /* less where the DC link is low, or high */\n", "", LINKED),
    ("modulated by the reference", "your_svgen(v, command[1], duty);", "your_svgen(v, command[0], duty);", ALONE),
    ("regulators go on from where they were", "share, supervisor.anew, v);", "share, 0, v);", ALONE),
    ("speed loop gets the angle in rad", "per_unit(filter.x[THETA]), share", "filter.x[THETA], share", ALONE),
    ("Clarke's factor in the example", "i[1] = INV_SQRT_3 * (phase[0] + (2.0f * phase[1]));", "i[1] = INV_SQRT_3 * (phase[0] + phase[1]);", ALONE),
    ("a rival that takes no step", "        (void){{ p }}_step(&supervisor.rival, v_acting, i);\n", "", RIVAL),
    ("a rival at other voltages", "&supervisor.rival, v_acting, i)", "&supervisor.rival, v_queued, i)", RIVAL),
    ("a start with all of the current", "        share = {{ p | upper }}_START_SHARE;\n", "", RIVAL),
    ("a rival in every mode", "    if (supervisor.rivals != 0) {", "    if (supervisor.rivals >= 0) {", RIVAL),
    ("telemetry: speed in r/min", "words[0] = FILTER.x[OMEGA];", "words[0] = FILTER.x[OMEGA] * 9.549f;", WHOLE),
    ("telemetry: mechanical hertz", "words[2] = FILTER.x[OMEGA] * POLE_PAIRS", "words[2] = FILTER.x[OMEGA]", WHOLE),
    ("telemetry: no status", "words[3] = (float32)status;", "words[3] = 0.0f * (float32)status;", WHOLE),
    ("telemetry: no mode", "words[4] = (float32)SUPERVISOR.mode;", "words[4] = 0.0f;", WHOLE),
    ("telemetry: one word less", "telemetry(words, 5);", "telemetry(words, 4);", WHOLE),
    ("telemetry twice as seldom", "    if (ticks < TELEMETRY_EVERY) {", "    if (ticks < 2 * TELEMETRY_EVERY) {", WHOLE),
    ("telemetry's time of an earlier life", "    drive_gates(0); /* the motor may turn already */\n    ticks = 0;", "    drive_gates(0);", WHOLE),
    ("not acknowledged", "    report(status[0]);\n    acknowledge_interrupt();", "    report(status[0]);", WHOLE),
    ("self-test's code without its sign", "failed = -{{ p }}_selftest(&drive.control.filter", "failed = {{ p }}_selftest(&drive.control.filter", WHOLE),
    ("controller's self-test passes whatever it says", "        failed = {{ p }}_foc_selftest(", "        (void){{ p }}_foc_selftest(", WHOLE),
    ("self-test without its tolerance", "{{ p }}_selftest(&drive.control.filter, PMSM_SELFTEST_TOLERANCE)", "{{ p }}_selftest(&drive.control.filter, 1.0f)", WHOLE),
    ("a self-test that fails is not refused", "        {{ p }}_supervisor_refuse(&SUPERVISOR);\n", "", WHOLE),
    ("filter begins with what the self-test left", "    {{ p }}_init(&filter);\n", "", ALONE),
    ("supervisor goes on from an earlier life", "    {{ p }}_supervisor_init(&supervisor);\n", "", ALONE),
    ("drive begins with what the self-test left", "    {{ p }}_drive_init(&drive, 1);\n", "", WHOLE),
    ("controller without the delay", "{{ p }}_drive_init(&drive, 1);", "{{ p }}_drive_init(&drive, 0);", WHOLE),
    ("zero voltage is none", "    duty[0] = 0.5f;\n", "    duty[0] = 0.0f;\n", ALONE),
)  # fmt: skip

_EXAMPLE_NUMBERS: tuple[Row, ...] = (
    ("telemetry's rate", "TELEMETRY_RATE = 50.0", "TELEMETRY_RATE = 25.0", WHOLE),
    ("sample time of the example in ms", 'sample_time_us=f"{T * 1e6:g}"', 'sample_time_us=f"{T * 1e3:g}"', ("pytest tests/codegen/test_printed_units.py",)),
)  # fmt: skip

# --- the self-tests

_WORDS = "tests/codegen/test_selftest_words.py -k"
FILTER = (f"regenerated paper_spmsm {_WORDS} 'paper_spmsm and not foc'",)
CONTROLLER = (f"regenerated paper_spmsm {_WORDS} paper_spmsm-foc",)
HEADERS = (f"regenerated paper_spmsm {_WORDS} 'paper_spmsm and (plan or sizes or comments)'",)

_FILTER_TEST: tuple[Row, ...] = (
    ("a vector left out", "for (k = 0; (k < N_VECTORS) && (stage == 0); k++) {", "for (k = 0; (k < N_VECTORS - 1) && (stage == 0); k++) {", FILTER),
    ("nothing compared but x", "for (k = 0; k < N_WORDS; k++) {", "for (k = 0; k < N_STATES; k++) {", FILTER),
    ("status not compared", "if (status != v->status) {", "if (status != v->status && v->status != 0) {", FILTER),
    ("iterations not compared", "if (!(tolerance > 0.0f) && (f->iterations != v->iterations)) {", "if ((tolerance > 0.0f) && (f->iterations != v->iterations)) {", FILTER),
    ("rejected inputs tolerated", "status = (status & PMSM_INPUT_REJECTED) | (v->status & ~PMSM_INPUT_REJECTED);", "status = v->status;", FILTER),
    ("starts not begun", "            begin(work, &STARTS[next]);\n", "", FILTER),
    ("P_0 not set", "        f->P_0[k] = value_of(s->P_0[k]);\n", "", FILTER),
    ("root not looked at", "agrees(PMSM_SQRT(a), s->root, s->root_allowed, tolerance) == 0", "agrees(PMSM_SQRT(a), s->root, s->root_allowed, 1e30f) == 0", FILTER),
    ("sine with a tolerance", "agrees(pair.sine, s->sine, 0, 0.0f)", "agrees(pair.sine, s->sine, 254, tolerance)", FILTER),
    ("wrapped angle not looked at", "if (agrees(wrap_angle(angle), s->wrapped, 0, 0.0f) == 0) {", "if (0) {", FILTER),
    ("code of x for P", "(10 + k) : (20 + k - N_STATES)", "(10 + k) : (10 + k)", FILTER),
    ("first vector is number 0", "(100 * k) + stage; /*", "(100 * (k - 1)) + stage; /*", FILTER),
    ("work left as the last vector left it", "    {{ p }}_init(work);\n    return", "    return", FILTER),
    ("voltage twice", "        y[k] = value_of(v->y[k]);", "        y[k] = value_of(v->u[k]);", FILTER),
)  # fmt: skip

_COMPARE: tuple[Row, ...] = (
    (
        "no number agrees",
        "((off <= limit) && (off >= -limit)) ? 1 : 0",
        "((off > limit) || (off < -limit)) ? 0 : 1",
        FILTER,
    ),
    ("one side compared", "((off <= limit) && (off >= -limit)) ? 1 : 0", "(off <= limit) ? 1 : 0", FILTER),
    ("allowance not scaled", "limit = tolerance * value_of", "limit = value_of", FILTER),
    ("allowance doubled", "(Uint32)allowed << 23", "(Uint32)(allowed + 1U) << 23", FILTER),
    (
        "bits compared as numbers",
        "return (b.word == expected) ? 1 : 0;",
        "return (b.word + 1U >= expected) ? 1 : 0;",
        FILTER,
    ),
)

_CONTROLLER_TEST: tuple[Row, ...] = (
    ("controller's compares nothing", "if (agrees(found, v->expected[k], v->allowed[k], tolerance) == 0) {", "if (agrees(found, v->expected[k], v->allowed[k], tolerance) == 2) {", CONTROLLER),
    ("duty alone compared", "for (k = 0; k < N_WORDS; k++) {", "for (k = 0; k < 3; k++) {", CONTROLLER),
    ("status not compared by the controller's", "    if (status != v->status) {", "    if (0) {", CONTROLLER),
    ("controller's last vector left out", "(k < N_VECTORS) && (stage == 0)", "(k < N_VECTORS - 1) && (stage == 0)", CONTROLLER),
    ("commands not replayed", "        command[k] = value_of(v->command[k]);", "        command[k] = value_of(VECTORS[0].command[k]);", CONTROLLER),
    ("integrators' places", "duty[k] : c->integrator[k - 3]", "duty[k] : c->integrator[5 - k]", CONTROLLER),
)  # fmt: skip

_SELFTEST_PRINT: tuple[Row, ...] = (
    ("size without the starts", " + len(runs) * _even(1 + 4 * n)", "", HEADERS),
    ("size in bytes", "_even(8 + 2 + 3 * outputs)\n    p = f", "2 * _even(8 + 2 + 3 * outputs)\n    p = f", (f"regenerated paper_spmsm {_WORDS} 'paper_spmsm-foc and sizes'",)),
    ("plan begins with vector 0", "plan += [(int(a) + 1, int(b), run.title)", "plan += [(int(a), int(b), run.title)", HEADERS),
    ("stages of x and P exchanged", '("10 + k", "x[k]")', '("20 + k", "x[k]")', HEADERS),
    ("inputs' units exchanged", '(u[k], "u", "V"), (y[k], "y", "A")', '(u[k], "u", "A"), (y[k], "y", "V")', HEADERS),
    ("allowance of nothing", "allowed = [int(np.frexp(value)[1]) - 1 + 127 - 23 + 2", "allowed = [int(np.frexp(value)[1]) - 1 + 127 - 23 + 6", FILTER),
    ("one start's P_0 for another", "zip(firsts, runs, strict=False)]", "zip(firsts, [runs[0], runs[2], runs[1], *runs[3:]], strict=False)]", FILTER),
)  # fmt: skip

_SELFTEST_EVIDENCE = {
    "codegen/evidence/recording.py": (
        ("errors one way", "rng.integers(-UNITS, UNITS,", "rng.integers(0, UNITS,", (f"pytest {_WORDS} three_units",)),
        ("two units", "UNITS = 3", "UNITS = 2", (f"pytest {_WORDS} three_units",)),
        ("median for the worst", "deviation = np.max(np.abs(blurred", "deviation = np.median(np.abs(blurred", FILTER),
        ("margin lost", "bound = np.maximum(MARGIN * np.where", "bound = np.maximum(np.where", FILTER),
        ("margin squared", "MARGIN = 64, 8", "MARGIN = 64, 64", FILTER),
        ("a power of two less", ".astype(int) + 127)", ".astype(int) + 124)", FILTER),
    ),
    "codegen/evidence/selftest.py": (
        ("no bad input in the start", "runs[0].y[BEYOND, 0] = 2 * drive", "runs[0].y[BEYOND, 0] = 0.2 * drive", ("pytest tests/codegen/test_status_bits.py -k recorded_starts",)),
        ("no bad command", "run.command[CONTROL_BAD_COMMAND] = np.inf, np.nan", "run.command[CONTROL_BAD_COMMAND] = 0.0, 0.0", ("pytest tests/codegen/test_status_bits.py -k recorded_starts",)),
        ("speed within reach to the end", "< CONTROL_STEPS - 2, 0.1, 1.0)", "< CONTROL_STEPS, 0.1, 1.0)", (f"regenerated paper_spmsm {_WORDS} 'paper_spmsm-foc and plan'",)),
    ),
}  # fmt: skip

# --- printed figures

FIGURES = ("pytest tests/codegen/test_printed_figures.py tests/codegen/test_printed_units.py",)
BUDGET = "pytest tests/codegen/test_budget.py"

_REPORT_TEMPLATE: tuple[Row, ...] = (
    ("stack and code exchanged", "{{ row.subject }} | {{ row.ledger.words * per_word }} | {{ row.stack }} | {{ row.text }}", "{{ row.subject }} | {{ row.ledger.words * per_word }} | {{ row.text }} | {{ row.stack }}", FIGURES),
    ("heads of stack and code exchanged", "| step | RAM, {{ memory }} | stack, bytes ({{ stand_in.short }}) | code, bytes ({{ stand_in.short }})", "| step | RAM, {{ memory }} | code, bytes ({{ stand_in.short }}) | stack, bytes ({{ stand_in.short }})", FIGURES),
    ("RAM in bytes", '("words", 1) if target', '("words", 2) if target', FIGURES),
    ("longest first, whatever is late", '{{ budget.late | join(", ") }}', '{{ budget.late | first }}', FIGURES),
    ("x_0 and P_0 exchanged", "{{ s.x_0 }} | {{ s.P_0 }}", "{{ s.P_0 }} | {{ s.x_0 }}", FIGURES),
    ("P_0 and Q exchanged", "| {{ s.P_0 }} | {{ s.Q }} |", "| {{ s.Q }} | {{ s.P_0 }} |", FIGURES),
    ("unit of the noise", '| join(", ") }} A^2.', '| join(", ") }} A.', FIGURES),
    ("99 % and worst exchanged", "c.x + (c.P_99, c.P)", "c.x + (c.P, c.P_99)", FIGURES),
    ("not finite and indefinite exchanged", "{{ c.not_finite }} | {{ c.indefinite }}", "{{ c.indefinite }} | {{ c.not_finite }}", FIGURES),
    ("chip's certificate is the host's", 'certificate(kind ~ ", chip", f.chip.fpu32)', 'certificate(kind ~ ", chip", f.certificate)', FIGURES),
    ("current of the box in V", "{{ \"%g\" | format(drive.operating_box.current) }} A", "{{ \"%g\" | format(drive.operating_box.current) }} V", FIGURES),
    ("sine: proved and seen exchanged", 'error proved <= {{ "%.1e" | format(trig.proved) }}', 'error proved <= {{ "%.1e" | format(trig.seen) }}', FIGURES),
    ("counts of an interrupt backwards", "{% for name in budget.operations %}{{ row.ledger.operations[name] }} | {% endfor %}", "{% for name in budget.operations | reverse %}{{ row.ledger.operations[name] }} | {% endfor %}", FIGURES),
)  # fmt: skip

_FIGURES = {
    "codegen/render/templates/report.md.j2": _REPORT_TEMPLATE,
    "codegen/render/report.py": (
        ("late as a share of one", "({100 * part:.0f} %)", "({part:.0f} %)", FIGURES),
        ("shares per mille", "round(100 * value / period)", "round(1000 * value / period)", FIGURES),
        ("row of the step's record", "_row(subject, ledger, measured[function], prices, periods)", '_row(subject, ledger, measured[f"{account.name}_step"], prices, periods)', FIGURES),
        ("controller's ledger for the filter's", '(kind, account.filter, f"{account.name}_step")', '(kind, account.controller, f"{account.name}_step")', FIGURES),
        ("stack is the code's size", 'record.get("stack_bytes", "not measured")', 'record.get("text_bytes", "not measured")', FIGURES),
    ),
    "codegen/render/notes.py": (
        ("k = 5 with k = 4's cycles", "prices.factors[0], prices.factors[-1]", "prices.factors[0], prices.factors[1]", FIGURES),
        ("operations named by their successors", 'f"{ops[name]} {name}" for name in OPERATIONS', 'f"{ops[name]} {after}" for name, after in zip(OPERATIONS, OPERATIONS[1:] + OPERATIONS[:1])', FIGURES),
        ("P's 99 % for its worst", "P {certificate.P:.1e} relative (99 %: {certificate.P_99:.1e})", "P {certificate.P_99:.1e} relative (99 %: {certificate.P:.1e})", FIGURES),
        ("chip says flush to zero", "{_deviation(states, chip.fpu32)}", "{_deviation(states, chip.flushed)}", FIGURES),
        ("units one state on", '"{state.name} {error:.1e} {state.unit}" for state', '"{state.name} {error:.1e} {states[0].unit}" for state', FIGURES),
    ),
    "codegen/targets/chips/f28335.py": (
        ("price of a root", '"sqrt": 29', '"sqrt": 92', FIGURES),
        ("k of the bound", "factors=(2.5, 4.0, 5.0)", "factors=(2.5, 4.0, 6.0)", FIGURES),
        ("clock of another chip", "clock=150e6", "clock=100e6", FIGURES),
        ("copies for nothing", '"copied": 1}', '"copied": 0}', FIGURES),
        ("branches for nothing", '"branch": 7,', '"branch": 0,', FIGURES),
        ("calls without their return", '"call": 12,', '"call": 4,', FIGURES),
        ("selections for nothing", '"compare", "select"),', '"compare"),', FIGURES),
        ("a long of one word", '"int": 1, "long": 2, "float": 2', '"int": 1, "long": 2, "float": 1', FIGURES),
    ),
    "codegen/targets/description.py": (
        ("interrupt not counted", "+ priced + self.interrupt)", "+ priced)", FIGURES),
        ("20 kHz at 100 us", "for f in (10, 20, 50)", "for f in (10, 10, 50)", FIGURES),
    ),
    "codegen/evidence/budget.py": (
        ("late at the bound", "    return prices.total(operations, prices.factors[0]) /", "    return prices.total(operations, prices.factors[-1]) /", (BUDGET,)),
        ("just in time is late", "if part > 1}", "if part >= 1}", (BUDGET,)),
        ("late without its modes", "            ledgers |= {f\"{kind}, {mode}\"", "            _ = {f\"{kind}, {mode}\"", (BUDGET,)),
        ("a rival's step in every mode", '"rivals": mode.rivals}', '"rivals": True}', FIGURES),
        ("modes without a filter are priced", "if mode.runs and (rivals", "if (rivals", FIGURES),
        ("STARTING of who has no rival", "(rivals or not mode.rivals)", "(True or rivals)", FIGURES),
        ("budget refuses what it allows", "    if spent[kind] <= allowed:\n", "    if spent[kind] < allowed:\n", (BUDGET,)),
        ("RAM's budget refuses what it allows", "account.filter.words > budget.ram_words", "account.filter.words >= budget.ram_words", (BUDGET,)),
        ("cheapest kind named", "    kind = max(spent, key", "    kind = min(spent, key", (BUDGET,)),
        ("controller's budget not asked", '("controller_cycles", "_foc_step")', '("controller_cycles", "_step")', (BUDGET,)),
        ("iterations that do not fit are offered", "<= budget]\n", "<= 2 * budget]\n", (BUDGET,)),
    ),
    "codegen/facts.py": (
        ("estimated at k = 4", "prices.total(ledger.operations, prices.factors[0])", "prices.total(ledger.operations, prices.factors[1])", FIGURES),
        ("filter's cost for the controller's", "_cost_facts(accounts[kind].controller, accounts", "_cost_facts(accounts[kind].filter, accounts", FIGURES),
        ("share of another mode", "round(share(ledger.operations, drive, prices), 4)", "round(2 * share(ledger.operations, drive, prices), 4)", FIGURES),
        ("three digits", '[float(f"{value:.1e}") for value', '[float(f"{value:.0e}") for value', FIGURES),
        ("self-test of the controller", "tests[kind].vectors,", 'tests[f"{kind}_foc"].vectors,', HEADERS),
    ),
    "codegen/render/templates/filter.h.j2": (
        ("u_max in A", "u_max; /* V: voltages", "u_max; /* A: voltages", FIGURES),
        ("R is a sigma", "measurement noise variances, A^2,", "measurement noise variances, A,", FIGURES),
        ("u after the interval", "mean over the interval ending now; y", "mean over the interval beginning now; y", FIGURES),
    ),
    "codegen/render/templates/foc.h.j2": (
        ("speed reference in r/min", "speed reference rad/s mechanical, DC link V", "speed reference r/min mechanical, DC link V", FIGURES),
        ("integrators' units", "speed N m, d and q current V", "speed A, d and q current V", FIGURES),
    ),
    "codegen/render/templates/port.h.j2": (
        ("two bits exchanged", "#define PMSM_DIVERGED 0x10", "#define PMSM_DIVERGED 0x8", ("regenerated paper_spmsm tests/codegen/test_status_bits.py -k 'values_agree and paper_spmsm'",)),
    ),
    "codegen/render/trig.py": (
        ("proved and seen in the note", "proved {bound.proved:.1e}", "proved {bound.seen:.1e}", FIGURES),
    ),
    "codegen/render/filter.py": (
        ("what NaN rejects by bits and by squares", '"none" if numbers.generated_trig else "all"', '"all" if numbers.generated_trig else "none"', ("regenerated paper_spmsm tests/codegen/test_guard.py -k nan_does",)),
        ("sample time in ms", "sample_time * 1e6:g} us", "sample_time * 1e3:g} us", FIGURES),
        ("sinc's bound for cosm1's", "sinc {bound.sinc:.1e}, cosm1 {bound.cosm1:.1e}", "sinc {bound.cosm1:.1e}, cosm1 {bound.sinc:.1e}", FIGURES),
        ("small angles as far as d^2", "for d up to {LIMIT**0.5:.2g} rad", "for d up to {LIMIT:.2g} rad", FIGURES),
        ("units of x forgotten one on", 'f"{state.name} {state.unit}" for state', 'f"{state.name} {model.states[0].unit}" for state', FIGURES),
        ("y_max is the voltage", '"y_max": drive.operating_box.current', '"y_max": drive.operating_box.voltage', FIGURES),
    ),
}  # fmt: skip

# --- what measures and judges

STATIC = "pytest tests/target/test_static.py -k "
DIVISIONS, EVA = "pytest tests/target/test_divisions.py", "pytest tests/target/test_eva.py"
EVA_MODES = "pytest tests/target/test_eva_modes.py"
REPLAYED = "pytest tests/target/test_link_ef.py -k 'replayed or largest or subjects'"
MEASURE, LEDGER, FPU = (f"pytest tests/codegen/test_{name}.py" for name in ("measure", "ledger", "fpu32"))
TOLD, PROGRAMS = "noticed tests/codegen/test_measure.py", "noticed tests/runtime/test_programs.py"
#: The other count, of what is executed; the ledger's own tests come first, since it takes longer.
COUNTED = "pytest tests/codegen/test_counted.py -m 'not thorough'"

_EVIDENCE = {
    "codegen/evidence/certificate.py": (
        ("90 % for 99 %", "np.quantile(dP[good], 0.99)", "np.quantile(dP[good], 0.9)", FIGURES),
        ("mean for the worst", "P=float(np.max(dP[good]))", "P=float(np.mean(dP[good]))", FIGURES),
        ("angle not taken round", "dx[angle] = np.abs(np.remainder(", "dx[angle] = np.abs(1.5 * np.remainder(", FIGURES),
        ("relative to P_ii alone", "scale = sigma[:, :, None] * sigma[:, None, :]", "scale = sigma[:, :, None] * sigma[:, :, None]", FIGURES),
        ("bad draws not counted", "not_finite=int(np.sum(~good))", "not_finite=0", FIGURES),
        ("indefinite not counted", "eigvalsh(P)[:, 0] <= 0", "eigvalsh(P)[:, 0] < -1e9", FIGURES),
        ("chip against float64", "return ChipModel(_compare(module, fpu32, host)", 'return ChipModel(_compare(module, fpu32, one_step(module, kind, box, "float64"))', FIGURES),
    ),
    "codegen/evidence/box.py": (
        ("half the speed", "omega = rng.uniform(-box.speed, box.speed, count)", "omega = rng.uniform(-box.speed / 2, box.speed / 2, count)", FIGURES),
        ("voltage of one sign", "rng.uniform(-voltage, voltage, (2, count))", "rng.uniform(0, voltage, (2, count))", (*FIGURES, "pytest tests/codegen/test_fpu32.py")),
        ("sigma for the variance", "high = np.sqrt(drive.filter.initial_covariance)", "high = np.array(drive.filter.initial_covariance)", FIGURES),
    ),
    "codegen/evidence/measure.py": (
        ("own frame forgotten", "return own + max((depth(*callee)", "return 0 * own + max((depth(*callee)", (MEASURE,)),
        ("smallest clone", "frames[name] = max(frames.get(name, 0), int(size))", "frames[name] = int(size)", (MEASURE,)),
        ("flags not in the key", '" ".join(flags), *(f"{name}', '"", *(f"{name}', (MEASURE,)),
        ("only the own file's code", "sum(text for _, text in objects.values())", "max(text for _, text in objects.values())", (MEASURE,)),
        ("data for text", "splitlines()[1].split()[0])", "splitlines()[1].split()[1])", (MEASURE,)),
        ("a crash is a refusal", "    if ended.crash:\n", "    if False:\n", (TOLD,)),
        ("a refusal is an answer", "    if ended.code:\n", "    if False:\n", (TOLD,)),
        ("what cannot be read is a traceback", "except (OSError, ValueError, IndexError):", "except OSError:", (TOLD,)),
        ("kept though the code changed", 'usable = kept.get("source_sha256") == key', 'usable = "source_sha256" in kept', (MEASURE,)),
    ),
    "codegen/evidence/programs.py": (
        ("what it started goes on", "os.killpg(process.pid, signal.SIGKILL)", "process.kill()", (PROGRAMS,)),
        ("waits for ever", "process.communicate(timeout=limit)", "process.communicate(timeout=None)", (PROGRAMS,)),
        ("a driver that ends well", 'return next(lines, "")[:200] if self.code else ""', 'return ""', (TOLD,)),
    ),
    "codegen/evidence/units.py": (
        ("padding forgotten", "offset += -offset % align + chars", "offset += chars", (LEDGER,)),
    ),
    "codegen/evidence/ledger.py": (
        ("what is given decides the other way", "(value == other) is (condition.op ==", "(value != other) is (condition.op ==", (LEDGER,)),
        ("a count under other circumstances taken", "            if all(self.given.get(field)", "            if True or all(self.given.get(field)", (LEDGER,)),
        ("what a callee asked forgotten", "        self.asked[-1] |= known[-1][0]\n", "", (LEDGER,)),
        ("what a known callee asked forgotten", "                self.asked[-1] |= asked\n", "", (LEDGER,)),
        ("what is given decides nothing", "        if holds is not None:\n", "        if holds is not None and False:\n", (LEDGER,)),
        ("copies not counted", "own[COPIED] += self.unit.words", "own[COPIED] += 0 * self.unit.words", (LEDGER,)),
        ("cheaper side of a branch", "return self._asked(node.cond) + (self.count(node.iftrue) | self.count(node.iffalse))\n\n    def _count_DoWhile", "return self._asked(node.cond) + (self.count(node.iftrue) & self.count(node.iffalse))\n\n    def _count_DoWhile", (LEDGER,)),
        ("a loop once", "bound * number for name, number in once", "number for name, number in once", (LEDGER,)),
        ("minus not counted", '"-": "add", "*": "mul"', '"*": "mul"', (LEDGER, COUNTED)),
        ("branches not counted", "+ Counter({\"branch\": 1})\n\n    def _loop", "+ Counter()\n\n    def _loop", (LEDGER, COUNTED)),
        ("&& for nothing", 'return Counter({"branch": 1}) + self._children(node)', "return self._children(node)", (LEDGER, COUNTED)),
        ("calls not counted", 'total += Counter({"call": 1} |', 'total += Counter({"call": 0} |', (LEDGER, COUNTED)),
        ("sides that compute chosen", 'sides or self._kind(node) != "float"', 'self._kind(node) != "float"', (LEDGER, COUNTED)),
        ("whole numbers chosen for nothing", '"float" else "select": 1})', '"float" else "select": 0})', (LEDGER, COUNTED)),
        ("leaves and their neighbours", "_LEAVES = (c_ast.ID, c_ast.Constant)", "_LEAVES = (c_ast.ID, c_ast.Constant, c_ast.UnaryOp)", (LEDGER,)),
    ),
    "codegen/evidence/fpu32.py": (
        ("one Newton step", "    y = seed = reciprocal_seed(b)\n    for _ in range(2):", "    y = seed = reciprocal_seed(b)\n    for _ in range(1):", (FPU,)),
        ("denormals kept", "(np.abs(value) >= TINY)", "(np.abs(value) >= 0)", (FPU,)),
    ),
}  # fmt: skip

_GATES = {
    "runtime/firmware/static/bans.py": (
        ("double allowed", 'TYPE_WORDS = frozenset({"float",', 'TYPE_WORDS = frozenset({"double", "float",', (STATIC + "plant",)),
        ("double literals allowed", 'CONSTANTS = frozenset({"float",', 'CONSTANTS = frozenset({"double", "float",', (STATIC + "plant",)),
        ("globals allowed", "if _variable(item) and not open_ended:", "if _variable(item) and open_ended:", (STATIC + "plant",)),
        ("recursion allowed", "        if start in reached:\n", "        if start in reached and not calls:\n", (STATIC + "plant",)),
        ("unknown calls allowed", "if node.name.name not in known and node.name.name not in SQRT:", "if node.name.name not in known and node.name.name in SQRT:", (STATIC + "plant",)),
        ("gate passes whatever is found", '"failed" if found or not good else "passed"', '"failed" if not good else "passed"', (STATIC + "plant",)),
        ("unguarded divisions pass", '"failed" if unguarded or broken or not good else "passed"', '"failed" if broken or not good else "passed"', (STATIC + "plant",)),
    ),
    "runtime/firmware/static/divisions.py": (
        ("zero is avoided at zero", "return self.low > 0.0 or self.high < 0.0", "return self.low >= 0.0 or self.high <= 0.0", (DIVISIONS,)),
        ("anything is positive", 'POSITIVE = ("Q",', 'POSITIVE = ("x", "y", "Q",', (DIVISIONS,)),
    ),
    "runtime/firmware/static/misra.py": (
        ("required rules forgiven", "bad = [*broken, *required, *unexplained]", "bad = [*broken, *unexplained]", (STATIC + "misra",)),
        ("advisory rules forgiven", 'category(f.rule) == "advisory" and f.rule not in deviations()]', 'category(f.rule) == "advisory" and f.rule in ()]', (STATIC + "misra",)),
        ("unknown rules are advisory", 'if rule in rules() else "required"', 'if rule in rules() else "advisory"', (STATIC + "does_not_know",)),
    ),
    "runtime/firmware/static/compilers.py": (
        ("warnings pass", '"failed" if said or not sources else "passed"', '"passed"', (STATIC + "plant",)),
        ("the other example not read", "for source in sources if is_example(source)]", "for source in sources if not is_example(source)]", (STATIC + "both_examples",)),
    ),
    "runtime/firmware/static/eva.py": (
        ("alarms pass", "return not self.alarms and not self.failure", "return not self.failure", (EVA,)),
        ("a failed analysis is not proved", '    if verdict.failure:\n        return "failed"\n', "", (EVA,)),
        ("a step that never ends is proved", 'failure = "no execution reaches the end of the step"', 'failure = ""', (EVA,)),
        ("a division that may overflow is no alarm", '_ASKED = tuple(', '_ASKED = ("div_float",) + tuple(', (EVA,)),
    ),
    "runtime/firmware/static/eva_modes.py": (
        ("integers that no count overflows", "Frama_C_interval(-32768, 32767)", "Frama_C_interval(-999, 999)", (EVA_MODES,)),
        ("rivals as they begin", 'if re.search(rf"^    {prefix}_t rival;"', 'if not re.search(rf"^    {prefix}_t rival;"', (EVA_MODES,)),
        ("a direction whatever the length", "\\* (?P=b), LEAST_SIZE", "\\* \\w+, LEAST_SIZE", (EVA_MODES,)),
        ("one supervisor is enough", "for kind in kinds]\n\n\n", "for kind in kinds[:1]]\n\n\n", (EVA_MODES,)),
        ("a machine of one's own is proved", "if not known_machine(manifest):", "if False:", (EVA_MODES,)),
    ),
    "runtime/firmware/drive_recording.py": (
        ("counts that do not end", "getattr(module, limit) - (name in COUNTED)", "getattr(module, limit) - 9", (REPLAYED,)),
        ("modes without their filter", '("inverter", "runs", "torque", "rivals", "aligns")', '("inverter", "torque", "rivals")', (REPLAYED,)),
        ("no current trips", "NONE, TELLS, TRIPS = 0.01, 0.5, 2.0", "NONE, TELLS, TRIPS = 0.01, 0.5, 1.4", (REPLAYED,)),
        ("the filter is not tuned", "for name, value in case.tuned.items()", "for name, value in case.ends.items()", (REPLAYED,)),
    ),
    "runtime/firmware/subject.py": (
        ("no drive is replayed", 'for part in _PIECES\n', 'for part in ("", "foc")\n', ("pytest tests/target/test_link_ef.py -k subjects_of_a_folder",)),
    ),
}  # fmt: skip

_TEMPLATES = "codegen/render/templates"


def _of(kind: str, file: str, rows: tuple[Row, ...]) -> tuple[Mutant, ...]:
    return tuple(Mutant(kind, f"{file}: {name}", checks, file, old, new) for name, old, new, checks in rows)


def _of_all(kind: str, files: dict[str, tuple[Row, ...]]) -> tuple[Mutant, ...]:
    return tuple(mutant for file, rows in files.items() for mutant in _of(kind, file, rows))


SURROUNDINGS = (
    *_of("example interrupt", f"{_TEMPLATES}/example_isr.c.j2", _EXAMPLE),
    *_of("example interrupt", "codegen/render/drive.py", _EXAMPLE_NUMBERS),
    *_of("self-test", f"{_TEMPLATES}/selftest.c.j2", _FILTER_TEST),
    *_of("self-test", f"{_TEMPLATES}/selftest_compare.j2", _COMPARE),
    *_of("self-test", f"{_TEMPLATES}/foc_selftest.c.j2", _CONTROLLER_TEST),
    *_of("self-test", "codegen/render/selftest.py", _SELFTEST_PRINT),
    *_of_all("self-test", _SELFTEST_EVIDENCE),
    *_of_all("printed figures", _FIGURES),
    *_of_all("evidence", _EVIDENCE),
    *_of_all("gates", _GATES),
)
