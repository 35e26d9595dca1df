"""Wrong conversions of facts, wrong rules, wrong verdicts on a design, lost comments: what ``design`` and ``new`` do."""

from __future__ import annotations

from tests.mutants.catalogue.rewriting import of

KIND = "design"
FILE = ("pytest tests/judges/test_design_verdicts.py", "pytest tests/runtime/test_design.py")
ASKED = ("pytest tests/runtime/test_new.py -m unit",)


def trial(name: str) -> tuple[str, ...]:
    """A test of the trial."""
    return (f"pytest tests/runtime/test_design_trial.py::{name}",)


def verdict(name: str) -> tuple[str, ...]:
    """A test on trials made by hand."""
    return (f"pytest tests/judges/test_design_verdicts.py::{name}",)


JUDGED, HELD = (
    trial("test_a_run_is_judged_by_angle_and_speed"),
    trial("test_a_trial_holds_where_enough_draws_do_and_never_over_nothing"),
)
DRAWN, BLAME = (
    trial("test_draws_fill_their_tolerances_and_a_round_rotor_stays_round"),
    trial("test_blame_names_the_highest_speed_a_fact_is_short_of"),
)
SHOWN, NAMED = (
    verdict("test_the_table_and_the_figures_of_a_trial"),
    verdict("test_blame_is_for_what_mends_and_for_no_more_than_two"),
)
BUDGET, CHECKED = (
    verdict("test_cost_of_a_design_by_hand"),
    verdict("test_words_that_do_not_go_together_are_refused"),
)

FACTS = of(
    KIND,
    "runtime/design/facts.py",
    ("peak for rms of Ke", "math.sqrt(2 / 3)", "math.sqrt(1 / 3)", FILE),
    ("Ke of a pole pair", "(self.pairs * 1000 / RPM)", "(1000 / RPM)", FILE),
    ("Ke in V s", "(self.pairs * 1000 / RPM)", "(self.pairs * 1000)", FILE),
    ("Kv of a phase", "1 / (math.sqrt(3) * self.pairs", "1 / (self.pairs", FILE),
    ("poles for pole pairs", "(self.poles or 0) // 2", "(self.poles or 0)", FILE),
    ("resistance of two phases", "(self.line_resistance or 0.0) / 2", "(self.line_resistance or 0.0)", FILE),
    ("inductance of two phases", "self.line_inductance / 2, self.line_inductance / 2", "self.line_inductance, self.line_inductance", FILE),
    ("d and q exchanged", "return self.inductance_d or 0.0, self.inductance_q or 0.0", "return self.inductance_q or 0.0, self.inductance_d or 0.0", FILE),
    ("r/min for rad/s", "(self.speed_rpm or 0.0) / RPM", "(self.speed_rpm or 0.0)", FILE),
    ("torque times speed", "(self.power or 0.0) / self.omega", "(self.power or 0.0) * self.omega", FILE),
    ("half the DC link", "return self.dc_link / math.sqrt(3)", "return self.dc_link / 2", FILE),
    ("half of a converter's range", "step = 2 * self.range", "step = self.range", FILE),
    ("noise without rounding", "math.sqrt(self.noise**2 + step**2 / 12)", "self.noise", FILE),
    ("half a period of the PWM", "return self.sample_time or 1 / (", "return self.sample_time or 0.5 / (", FILE),
    ("dead time of two samples", "self.dead_time > 0.2 * self.period", "self.dead_time > 2 * self.period", FILE),
    ("degrees for rad", "angle=math.radians(file.start.angle)", "angle=file.start.angle", FILE),
    ("unknown is a right angle", "return 180.0 if angle", "return 90.0 if angle", FILE),
    ("tolerance of another datum", "d_L=tolerance.inductance", "d_L=tolerance.magnet_flux", FILE),
    ("R's tolerance for the inertia's", "d_J=tolerance.inertia", "d_J=tolerance.stator_resistance", FILE),
    ("noise of 1 mA, whatever the range", "NOISE_SHARE * file.sensor.range", "NOISE_SHARE", FILE),
    ("mechanical for electrical speed", "return self.p * self.speed", "return self.speed", FILE),
    ("stated twice", "if len(stated) > 1:", "if len(stated) > 2:", FILE),
    ("half a way", "if getattr(self, key) is None:", "if False:", FILE),
    ("sensor's range for the current", "max_current=rated.max_current", "max_current=file.sensor.range", FILE),
    ("friction forgotten", "D=motor.friction", "D=0.0", FILE),
)  # fmt: skip

KNOWN = of(
    KIND,
    "runtime/design/known.py",
    ("kappa without dead time", "math.hypot(LEAST_SHARE, ", "math.hypot(LEAST_SHARE, 0 * ", FILE),
    ("bandwidth without what no fact says", "math.sqrt(unsaid_share(f) ** 2 + 4", "math.sqrt(4", FILE),
    ("kappa: L_d for L_q", "SEEN_SHARE * f.d_L * f.omega_e * f.L_q", "SEEN_SHARE * f.d_L * f.omega_e * f.L_d", FILE),
    ("kappa: mechanical speed", "SEEN_SHARE * f.d_psi * f.omega_e * f.psi_m", "SEEN_SHARE * f.d_psi * f.speed * f.psi_m", FILE),
    ("kappa: all of an adapted R", "kept * f.d_R * f.R", "f.d_R * f.R", FILE),
    ("kappa of the DC link", "4 / (3 * f.voltage**2)", "4 / (3 * f.dc_link**2)", FILE),
    ("psi_m: hidden by the dead time", "HIDING_SIGMAS * LEAST_SHARE", "HIDING_SIGMAS * unsaid_share(f)", FILE),
    ("psi_m: nothing hides it", "off**2 + hidden**2", "off**2", FILE),
    ("psi_m: mechanical speed is hidden", "f.d_psi * f.omega_e * f.psi_m, HIDING", "f.d_psi * f.speed * f.psi_m, HIDING", FILE),
    ("a salient rotor's legs kept as long", "UNSURE_SAMPLES = {False: 4.0, True: 0.5}", "UNSURE_SAMPLES = {False: 4.0, True: 4.0}", FILE),
    ("dead time times T", "math.sqrt(3) * f.dead_time / f.T", "math.sqrt(3) * f.dead_time * f.T", FILE),
    ("below the least accepted", "max(low, float(", "max(0.0, float(", ("noticed tests/runtime/test_design.py -k any_accepted",)),
    ("three digits of a fact", "{value:.6g}", "{value:.3g}", FILE),
    ("torque of one pole pair", "(f.p / f.J) ** 2", "(1 / f.J) ** 2", FILE),
    ("salient one way only", "return abs(f.L_q - f.L_d) >", "return f.L_q - f.L_d >", FILE),
    ("currents exchanged", "i_d, i_q = mtpa_currents(", "i_q, i_d = mtpa_currents(", FILE),
    ("sensor that covers is said not to", "if f.max_current > f.range:", "if f.max_current < f.range:", FILE),
    ("box within the current limit", "rounded(2.5 * f.max_current, Current)", "rounded(0.5 * f.max_current, Current)", FILE),
)  # fmt: skip

WRITTEN = of(
    KIND,
    "runtime/design/write.py",
    ("a long reason is lost", '[f"# {choice.reason}", entry]', "[entry]", FILE),
    ("a reason is lost", "return [line] if len(line)", "return [entry] if len(line)", FILE),
    ("her comment is lost", 'f"{said}{NOW}{choice.reason}" if said else choice.reason', "choice.reason", FILE),
    ("now and now", '.partition(NOW)[0] if key in table', ' if key in table', FILE),
    ("what is the same is said anew", "if table.get(key) == choice.value:", "if False:", FILE),
    ("another drive's file", 'if document.get("name") != name:', "if False:", FILE),
    ("the old value stays", "table[key] = choice.value\n", "table[key] = table.get(key, choice.value)\n", FILE),
    ("six digits", "else repr(value)", 'else f"{value:g}"', FILE),
    ("facts without what they mean", "Choice(value, meaning(section, key))", 'Choice(value, "")', ASKED),
)  # fmt: skip

TOLD = of(
    KIND,
    "runtime/design/tables.py",
    ("r/min over rad/s", "/ (trial.facts.speed * RPM)", "/ trial.facts.speed", SHOWN),
    ("locked shown as at speed", 'f"{np.mean(point.reached):.1%}"', 'f"{np.mean(point.locked):.1%}"', SHOWN),
    ("lost that did not reach", "if np.mean(point.locked) < ENOUGH", "if np.mean(point.reached) < ENOUGH", HELD),
    ("a tenth need not hold", 'if point.share >= MUST_HOLD else "yellow"', 'if point.share > MUST_HOLD else "yellow"', HELD),
    ("JSON: it holds", '"holds": trial.holds', '"holds": True', SHOWN),
    ("JSON: held is locked", '"held": float(np.mean(point.held))', '"held": float(np.mean(point.locked))', SHOWN),
    ("JSON: percent of a point that holds", '"holds": point.holds', '"holds": not point.holds', SHOWN),
    ("median for 95 %", "np.quantile(values, 0.95", "np.quantile(values, 0.5", SHOWN),
    ("JSON with infinity", "value if np.isfinite(value) else None", "value", SHOWN),
    ("rad called degrees", "math.degrees(value) if name == 'angle' else value", "value", ASKED),
    ("L_d shown twice", '"L_q": ("motor", "inductance_q")', '"L_q": ("motor", "inductance_d")', ASKED),
)  # fmt: skip

COST = of(
    KIND,
    "runtime/design/cost.py",
    ("too slow is budgeted", "if spent <= period:", "if spent <= 2 * period:", BUDGET),
    ("all of a sample", "SHARE = 0.5", "SHARE = 1.0", BUDGET),
    ("RAM rounded down", "-(-account.filter.words // WORDS)", "account.filter.words // WORDS", BUDGET),
    ("said where it is not", "if share == 1.0:", "if share < 1.0:", BUDGET),
    ("us for s", "spent / prices.clock * 1e6", "spent / prices.clock * 1e3", BUDGET),
)  # fmt: skip

TRIED = of(
    KIND,
    "runtime/design/trial.py",
    ("errors before the load", "after = run.t >= run.scenario.load_at", "after = run.t < run.scenario.load_at", trial("test_errors_count_from_the_load_step_on")),
    ("locked and reached exchanged", "float(run.locked), float(run.reached)", "float(run.reached), float(run.locked)", JUDGED),
    ("locked or at speed", "self.locked & self.reached", "self.locked | self.reached", HELD),
    ("one speed is enough", "bool(must) and all(must)", "bool(must) and any(must)", HELD),
    ("no speed is enough", "bool(must) and all(must)", "all(must)", HELD),
    ("success at any speed", "np.all(held, axis=0)", "np.any(held, axis=0)", HELD),
    ("half of the draws are enough", "ENOUGH = 0.99", "ENOUGH = 0.5", HELD),
    ("nothing drawn holds", "bool(len(self.held)) and float", "float", ("noticed" + HELD[0].removeprefix("pytest"),)),
    ("the lowest speed it is short of", "{max(speeds):.3g}", "{min(speeds):.3g}", BLAME),
    ("adapt what is adapted", '"identify it" if trial.adaptive else', '"identify it" if not trial.adaptive else', BLAME),
    ("unexplained where explained", "trial.hurts.get(point.share) == []", "trial.hurts.get(point.share) != []", BLAME),
    ("a wrong datum's width", '"psi_m": 1 + facts.d_psi', '"psi_m": 1 + facts.d_L', DRAWN),
    ("R's width for the inertia", '"J": 1 + facts.d_J', '"J": 1 + facts.d_R', DRAWN),
    ("round rotors out of round", "L_q if is_salient(facts) else L_d", "L_q", DRAWN),
    ("the rotor always starts at 0", "facts.angle * theta)", "0 * theta)", DRAWN),
    ("known exactly and drawn all the same", "np.ones_like(f) if name in names else f", "f", DRAWN),
    ("blame for what held", "np.flatnonzero(~point.held)", "np.flatnonzero(point.held)", NAMED),
    ("blame for luck", "max(MENDED, by_luck + LUCK, best - LUCK / 2)", "max(MENDED, best - LUCK / 2)", NAMED),
    ("blame for a little", "max(MENDED, by_luck + LUCK, best - LUCK / 2)", "max(by_luck + LUCK, best - LUCK / 2)", NAMED),
    ("blame beside the best", "max(MENDED, by_luck + LUCK, best - LUCK / 2)", "max(MENDED, by_luck + LUCK)", NAMED),
    ("everything is to blame", "return named if len(named) <= SINGLE else []", "return named", NAMED),
)  # fmt: skip

ASKING = of(
    KIND,
    "runtime/design/questions.py",
    ("milli for micro", '"u": "1e-6"', '"u": "1e-3"', ASKED),
    ("per cent as they stand", '"%": "1e-2"', '"%": "1"', ASKED),
    ("what is missing is accepted", "if key not in answered and is_needed(section, key):", "if False:", ASKED),
    ("nonsense is accepted", 'if problem["loc"][:2] == place or', "if", ASKED),
    ("what does not go together is accepted", '(last and problem["loc"] == (section,))', "False", ASKED),
    ("a default for a needed fact", "return stated or holder", "return holder", ASKED),
    ("other ways are forgotten", "asked |= {name for way in ways for name in way}", "asked |= {*ways[0]}", ASKED),
)  # fmt: skip

COMMANDS = (
    *of(
        KIND,
        "runtime/commands/design.py",
        ("what does not hold ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", verdict("test_exit_code_and_words_follow_the_verdict")),
        ("holds whatever is found", '("green", "holds") if trial.holds', '("green", "holds") if trial.points', verdict("test_exit_code_and_words_follow_the_verdict")),
        ("--check writes", "if check and (out or write):", "if False:", CHECKED),
        ("nowhere to write", "if not check and not (out or write):", "if False:", CHECKED),
    ),
    *of(
        KIND,
        "runtime/commands/new.py",
        ("overwritten without a yes", 'if answer in {"y", "yes"}:', 'if answer != "n":', verdict("test_a_file_stays_without_a_yes")),
        ("answers lost at their end", "write_text(part, facts_text(tables))", "pass", verdict("test_nonsense_is_not_kept_and_an_end_loses_nothing")),
        ("nonsense is kept", "into.pop(key, None)", "pass", verdict("test_nonsense_is_not_kept_and_an_end_loses_nothing")),
        ("the last question of a section unknown", "last = after is None or after.section != question.section", "last = False", verdict("test_a_dead_time_of_half_a_sample_is_asked_for_again")),
    ),
)  # fmt: skip

DESIGN = (*FACTS, *KNOWN, *WRITTEN, *TOLD, *COST, *TRIED, *ASKING, *COMMANDS)
