"""Wrong verdicts, exit codes, tables, figures and conversions: what tells people whether to turn on an inverter."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

#: File -> the tests that must notice, and rows: what is wrong, what stands there, what would stand there, which test.
_ROWS: dict[str, tuple[str, tuple[tuple[str, str, str, str], ...]]] = {
    "runtime/proof/result.py": ("proof_verdicts", (
        ("one good row is enough", "self.compared > 0 and all(", "self.compared > 0 and any(", "test_a_row_passes_up_to_what_is_allowed"),
        ("nothing compared is a pass", "self.compared > 0 and all(", "all(", "test_a_link_without_a_comparison_is_not_passed"),
        ("a divergence is forgiven", "self.divergence is None and self.compared", "self.compared", "test_a_first_divergence_is_no_pass_whatever_the_rows_say"),
        ("NaN stays NaN", 'object.__setattr__(self, "worst", math.inf)', "pass", "test_figures_of_a_link"),
        ("double of what is allowed", "return self.worst <= self.allowed", "return self.worst <= 2 * self.allowed", "test_a_row_passes_up_to_what_is_allowed"),
        ("one proved link is enough", "and all(link.passed for link in self.links)", "and any(link.passed for link in self.links)", "test_a_proof_needs_every_link_and_every_effect"),
        ("no link is a proof", "bool(self.links)", "True", "test_a_proof_needs_every_link_and_every_effect"),
        ("an unexplained effect passes", 'e.verdict != "unexplained"', 'e.verdict != "unknown"', "test_a_proof_needs_every_link_and_every_effect"),
        ("proved said of what failed", 'return "NOT proved"', 'return "proved"', "test_words_of_a_proof"),
        ("JSON passes always", '"passed": self.passed,\n            "kept"', '"passed": True,\n            "kept"', "test_json_of_a_proof"),
        ("JSON links pass always", '"passed": link.passed, "worst"', '"passed": True, "worst"', "test_json_of_a_proof"),
        ("smallest deviation of a link", "return max((row.worst for", "return min((row.worst for", "test_figures_of_a_link"),
        ("share of the smallest", "return max(shares, default=0.0)", "return min(shares, default=0.0)", "test_figures_of_a_link"),
        ("failures of what passed", "if not link.passed:", "if link.passed:", "test_every_broken_link_is_a_line_and_no_other"),
        ("the first row is told, broken or not", "(row for row in link.rows if not row.passed)", "(row for row in link.rows)", "test_every_broken_link_is_a_line_and_no_other"),
    )),
    "runtime/proof/drives.py": ("proof_verdicts", (
        ("JSON: one proved drive is enough", 'all_hold(p["passed"]', 'any(p["passed"]', "test_one_drive_of_three_that_fails_fails_all"),
        ("JSON: no drive is a proof", 'all_hold(p["passed"]', 'all(p["passed"]', "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_proof_is_no_proof"),
    )),
    "runtime/commands/verify.py": ("proof_verdicts", (
        ("one proved drive is enough", "if not all_hold(", "if not any(", "test_one_drive_of_three_that_fails_fails_all"),
        ("no drive is a proof", "if not all_hold(", "if not all(", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_proof_is_no_proof"),
        ("verify ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "test_verify_ends_with_1_if_one_link_fails"),
        ("the JSON is not written", "verify_drives(drives or [], json, ", "verify_drives(drives or [], None, ", "test_verify_ends_with_1_if_one_link_fails"),
    )),
    "runtime/commands/words.py": ("proof_verdicts", (
        ("failures are not shown", "for line in proof.failures():", "for line in ():", "test_verify_ends_with_1_if_one_link_fails"),
    )),
    "runtime/proof/verify.py": ("proof_verdicts", (
        ("effects: real and unexplained alike", '(False, False): "real"', '(True, False): "real"', "test_effect_of_iterating"),
        ("effects in variances", "difference / np.sqrt(np.einsum", "difference / (np.einsum", "test_effect_of_iterating"),
        ("effects' median", "worst = float(in_sigma.max())", "worst = float(np.median(in_sigma))", "test_effect_of_iterating"),
        ("rounding explains a thousandth", "ROUNDING = 1e-9", "ROUNDING = 1e-2", "test_effect_of_iterating"),
    )),
    "runtime/proof/compare.py": ("proof_verdicts", (
        ("a missing number is no error", "error[np.isnan(error)] = np.inf", "error[np.isnan(error)] = 0.0", "test_a_deviation_is_relative_turns_with_the_circle_and_is_never_no_number"),
        ("scales add", "np.maximum(full, natural)", "(full + natural)", "test_scales_are_the_rows_largest_or_its_natural_size"),
        ("gain by the smaller sigma", "sigmas.state / high", "sigmas.state / low", "test_scales_are_the_rows_largest_or_its_natural_size"),
        ("scale of a covariance is a variance", "sigma[..., :, None] * sigma[..., None, :])\n\n\ndef minuend", "sigma[..., :, None] * sigma[..., :, None])\n\n\ndef minuend", "test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas"),
        ("a hundredth of what is added to", "ADDED = 1e-4", "ADDED = 1e-2", "test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas"),
        ("ten times the roundings", "PER_CONDITION = 1e-5", "PER_CONDITION = 1e-4", "test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas"),
        ("ten times the points' roundings", "PER_OFFSET = 2e-6", "PER_OFFSET = 2e-5", "test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas"),
        ("a hundredth of the minuend", "CANCELLED = 1e-4", "CANCELLED = 1e-2", "test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas"),
        ("what is no difference is one", 'if stage.scale == "difference":', "if True:", "test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas"),
    )),
    "runtime/proof/link_ab.py": ("proof_verdicts", (
        ("offset in variances", 's.stages["x_pred"]) / state, axis=1)', 's.stages["x_pred"]) / state**2, axis=1)', "test_sigmas_of_a_step_are_those_of_its_predictions"),
        ("offset of what is no number's sign", 'np.max(np.abs(s.stages["x_pred"])', 'np.max((s.stages["x_pred"])', "test_sigmas_of_a_step_are_those_of_its_predictions"),
        ("innovation in variances", 'state, innovation = (np.sqrt(np.einsum("kii->ki", c))', 'state, innovation = ((np.einsum("kii->ki", c))', "test_sigmas_of_a_step_are_those_of_its_predictions"),
    )),
    "runtime/proof/link_cd.py": ("proof_verdicts", (
        ("envelope of the least", "count + 1), cut.max(axis=1)", "count + 1), cut.min(axis=1)", "tests/judges/test_proof_tables.py::test_figures_of_drift_effect_and_trajectory"),
        ("a hundred times what float32 may cost", "ALLOWED = 1e-2", "ALLOWED = 1.0", "test_drift_is_the_difference_and_its_allowance_a_share_of_that_steps_sigma"),
        ("allowance in variances", "sigma = np.sqrt(np.einsum(\"kii->ki\", result.exact.P[tail]))", "sigma = np.einsum(\"kii->ki\", result.exact.P[tail])", "test_drift_is_the_difference_and_its_allowance_a_share_of_that_steps_sigma"),
        ("largest deviation, not largest share", "np.argmax(deviation / sigma[:, k])", "np.argmax(deviation)", "test_drift_is_the_difference_and_its_allowance_a_share_of_that_steps_sigma"),
        ("best entry of P", "dP.max(axis=(1, 2))", "dP.min(axis=(1, 2))", "test_drift_is_the_difference_and_its_allowance_a_share_of_that_steps_sigma"),
    )),
    "runtime/proof/tables.py": ("proof_verdicts", (
        ("a table of the best", "max(cell.get(link.variant, 0.0), row.worst)", "row.worst", "tests/judges/test_proof_tables.py::test_stages_by_equation_shows_the_worst_of_all"),
        ("every link is ok", "if passed else Text(\"FAILED\"", "if True else Text(\"FAILED\"", "tests/judges/test_proof_tables.py::test_the_proofs_tables_say_what_the_rows_say"),
        ("a share, not per cent", "{100 * link.used:.2g} % of allowed", "{link.used:.2g} % of allowed", "tests/judges/test_proof_tables.py::test_shares_of_what_is_allowed"),
        ("counts are measured", 'f"no: {worst:g}"', '"yes"', "tests/judges/test_proof_tables.py::test_the_proofs_tables_say_what_the_rows_say"),
    )),
    "runtime/proof/figures.py": ("proof_verdicts", (
        ("speed in rad/s under r/min", "data.omega * 30 / np.pi", "data.omega", "tests/judges/test_proof_tables.py::test_figures_of_drift_effect_and_trajectory"),
        ("currents and voltages exchanged", '(axes[1], data.y, "i, A")', '(axes[1], data.u, "i, A")', "tests/judges/test_proof_tables.py::test_figures_of_drift_effect_and_trajectory"),
    )),
    "runtime/firmware/gates.py": ("firmware_verdicts", (
        ("firmware never fails", "return bool(self.checks) and not self.failed and", "return True or", "test_what_is_good"),
        ("not run is a pass", "(allow_missing or not self.missing)", "True", "test_what_is_good"),
        ("nothing checked is good", "return bool(self.checks) and not", "return not", "test_what_is_good"),
        ("JSON forgives what is missing", "all_hold(r.good(allow_missing=False)", "all_hold(r.good(allow_missing=True)", "tests/target/test_link_ef.py::test_json"),
        ("JSON: no drive is good", "all_hold(r.good(allow_missing=False)", "all(r.good(allow_missing=False)", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_gate_is_no_gate"),
        ("one gate is left out", "for gate in GATES for check", "for gate in GATES[:1] for check", "test_checks_of_all_gates_are_kept"),
    )),
    "runtime/commands/firmware.py": ("firmware_verdicts", (
        ("one good drive is enough", "if not all_hold(", "if not any(", "test_one_drive_of_three_fails_all"),
        ("no drive is good", "if not all_hold(", "if not all(", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_gate_is_no_gate"),
        ("missing is always allowed", "result.good(allow_missing)", "result.good(True)", "test_what_is_good"),
    )),
    "runtime/firmware/link_ef.py": ("firmware_verdicts", (
        ("worst cycles that are the median", "np.median(self.outcome.cost), np.max(self.outcome.cost)", "np.median(self.outcome.cost), np.median(self.outcome.cost)", "test_a_comparison_says_bits_median_and_worst"),
        ("worst is the median", "np.max(self.outcome.cost)", "np.median(self.outcome.cost)", "test_a_comparison_says_bits_median_and_worst"),
        ("median is the mean", "np.median(self.outcome.cost), np", "np.mean(self.outcome.cost), np", "test_a_comparison_says_bits_median_and_worst"),
        ("any count of the known loop", "<= self.processor.resolution", ">= 0", "test_a_counter_is_believed_where_it_counts_a_known_loop"),
        ("what does not end passes", 'subject.name, "failed", "did not run', 'subject.name, "passed", "did not run', "test_every_subject_on_every_processor_and_one_that_does_not_end"),
        ("a divergence passes", 'self.subject.name, "failed", f"differs', 'self.subject.name, "passed", f"differs', "test_a_comparison_says_bits_median_and_worst"),
        ("the last step that differs", "int(different[0])", "int(different[-1])", "test_the_first_word_that_differs_is_told"),
    )),
    "runtime/firmware/emulator.py": ("firmware_verdicts", (
        ("cost with the empty function", "(rows[:, 1] - calibration[\"E\"]) * unit", "rows[:, 1] * unit", "test_lines_of_a_run"),
    )),
    "runtime/firmware/cortex_m.py": ("firmware_verdicts", (
        ("ticks for instructions", "1 / (self.board.clock * INSTRUCTION)", "self.board.clock * INSTRUCTION", "test_units_of_the_stand_ins"),
    )),
    "runtime/firmware/static/compilers.py": ("static_verdicts", (
        ("warnings are no failure", '"failed" if said or not sources', '"failed" if not sources', "test_compilers_verdict"),
        ("a silent failure passes", "if code else [])", "if False else [])", "test_compilers_verdict"),
    )),
    "runtime/firmware/static/misra.py": ("static_verdicts", (
        ("unexplained rules are forgiven", "bad = [*broken, *required, *unexplained]", "bad = [*broken, *required]", "test_misra_verdict"),
    )),
    "runtime/firmware/static/eva.py": ("static_verdicts", (
        ("a failed analysis is not proved, no more", 'if verdict.failure:\n        return "failed"', 'if verdict.failure:\n        return "not proved"', "test_evas_verdict"),
        ("no end is no failure", 'elif "NON TERMINATING FUNCTION" in said:', 'elif "NO SUCH WORDS" in said:', "test_evas_verdict"),
    )),
    "runtime/commands/run.py": ("pages", (
        ("run ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "test_run_ends_with_1_whatever_failed"),
        ("GOOD without a chapter", "if failures or not ran.chapters else", "if failures else", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_chapter_is_no_result"),
        ("run passes with one good chapter", "if not all_hold(", "if not any(", "test_run_ends_with_1_whatever_failed"),
        ("run passes without a chapter", "if not all_hold(", "if not all(", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_chapter_is_no_result"),
    )),
    "runtime/report/page.py": ("pages", (
        ("one good chapter, and all links hold", "passed=all_hold(", "passed=any(", "test_one_chapter_of_two_decides_what_the_page_begins_with"),
        ("no chapter, and all links hold", "passed=all_hold(", "passed=all(", "tests/judges/test_nothing_is_shown_by_nothing.py::test_a_page_without_chapters_passes_nothing"),
    )),
    "runtime/drive/simulation.py": ("drive_figures", (
        ("locked if it was once", "np.max(np.abs(self.angle_error[self.late]))", "np.min(np.abs(self.angle_error[self.late]))", "test_lock"),
        ("worst that is the median", '"start": float(np.max(', '"start": float(np.median(', "test_figures_against_a_loop_over_samples"),
        ("angle of the start too", "self.angle_error[moving]", "self.angle_error[start]", "test_figures_against_a_loop_over_samples"),
        ("60 degrees are locked", "LOCKED_ANGLE = 30.0", "LOCKED_ANGLE = 60.0", "test_lock"),
        ("good without the reference", "return self.locked and self.reached", "return self.locked", "test_a_reference_that_is_not_reached_is_no_lost_lock"),
        ("reached if it was once", "return bool(np.max(apart)", "return bool(np.min(apart)", "tests/runtime/test_fleet.py"),
        ("not reached called lost", "return LOCKED if self.reached else", 'return LOCKED if self.reached else "LOST LOCK" or', "test_a_reference_that_is_not_reached_is_no_lost_lock"),
        ("lost called not reached", 'return "LOST LOCK"', "pass", "test_lock"),
        ("the filter blamed for the motor", "if not np.all(np.isfinite(self.omega)):", "if False:", "test_lock_needs_a_true_speed_that_is_a_number"),
        ("every sample counts as set", "self.status & bit))", "self.status | bit))", "test_remarks_count_the_status"),
        ("numbers that are none", "if value is not None and not math.isfinite(value):", "if False:", "tests/judges/test_drive_commands.py::test_conditions_that_are_no_numbers"),
        ("mean error of the start", '"start": float(np.max(np.abs(', '"start": float(np.mean(np.abs(', "test_figures_against_a_loop_over_samples"),
        ("mean square for rms", "float(np.sqrt(np.mean(error[late] ** 2)))", "float(np.mean(error[late] ** 2))", "test_figures_against_a_loop_over_samples"),
        ("steady over all of it", "self.t[-1] - LATE)", "self.t[-1] - 10 * LATE)", "test_figures_against_a_loop_over_samples"),
        ("after the load step, before it", "after = ~start if", "after = start if", "test_figures_against_a_loop_over_samples"),
        ("u for i in a recording", '"i_alpha": self.i[:, 0]', '"i_alpha": self.u[:, 0]', "test_a_saved_run_gives_the_same_figures"),
    )),
    "runtime/drive/experiment.py": ("drive_figures", (
        ("JSON says locked always", '"locked": run.locked', '"locked": True', "test_facts_of_a_run"),
        ("JSON says reached always", '"reached": run.reached', '"reached": True', "test_facts_of_a_run"),
        ("JSON with NaN", "value if math.isfinite(value) else None for", "value for", "test_facts_of_a_run"),
    )),
    "runtime/drive/tables.py": ("drive_figures", (
        ("start and steady exchanged", "cells = (f\"{f['start']:.2f}\"", "cells = (f\"{f['steady_rms']:.2f}\"", "test_the_table_of_runs_is_the_figures"),
        ("green always", 'style="green" if run.good else "bold red"', 'style="green"', "test_the_table_of_runs_is_the_figures"),
        ("no word of a reference that is not reached", "if run.locked and not run.reached:", "if False:", "test_a_reference_that_is_not_reached_is_no_lost_lock"),
        ("status not told", "if run.status_counts:", "if False:", "test_remarks_count_the_status"),
        ("the claim is reached at 200 r/min", 'start["ickf"] < 20.0', 'start["ickf"] < 200.0', "test_the_papers_claims_are_told_by_the_numbers"),
        ("T in ms called us", 'f"{T * 1e6:g} us"', 'f"{T * 1e3:g} us"', "test_the_sweeps_table_and_figure"),
    )),
    "runtime/drive/scenario.py": ("units", (
        ("a speed off by half is reached", "REACHED, REACHED_OF_RATED = 0.1,", "REACHED, REACHED_OF_RATED = 0.5,", "tests/judges/test_drive_figures.py::test_a_reference_that_is_not_reached_is_no_lost_lock"),
        ("standstill is reached anywhere", "0.1, 0.02\n", "0.1, 0.2\n", "tests/judges/test_drive_figures.py::test_standstill_is_reached_within_a_share_of_rated_speed"),
        ("rated speed in rad/s", "speed=_rounded(task.speed * RPM)", "speed=_rounded(task.speed)", "test_the_papers_scenarios"),
        ("the load of the paper's motor", "load=task.torque)}", "load=5.0)}", "test_a_scenario_belongs_to_its_motor"),
        ("the ramp of the paper's motor", "ramp = task.ramp(drive.motor.inertia, RAMP)", "ramp = RAMP", "test_a_scenario_belongs_to_its_motor"),
        ("a slow loop is not waited for", "REST[1] * slow)", "0.0)", "test_a_scenario_belongs_to_its_motor"),
        ("a load without a load step", "if load is not None and found.load:", "if load is not None:", "test_a_scenario_belongs_to_its_motor"),
        ("NaN is a speed", "if value is not None and not math.isfinite(value):", "if False:", "test_a_scenario_belongs_to_its_motor"),
    )),
    "model/rating.py": ("units", (
        ("motor torque for 2 phases", "return 1.5 * m.pole_pairs * (m.magnet_flux", "return m.pole_pairs * (m.magnet_flux", "tests/model/test_rating.py"),
        ("i_d of the other sign", "return -share * current", "return share * current", "tests/model/test_rating.py"),
        ("voltage from leg to leg", "dc_link / math.sqrt(3.0), drive", "dc_link, drive", "tests/model/test_rating.py"),
        ("stated torque ignored", "drive.rated.torque if drive.rated else min(torque, BOX", "5.0 if drive.rated else min(torque, BOX", "tests/model/test_rating.py"),
        ("friction is free", "[FRICTION_SHARE * largest / m.friction] if m.friction else []", "[]", "tests/model/test_rating.py"),
        ("the box is no limit", "BOX_SHARE * box.speed, TURN", "box.speed, TURN", "tests/model/test_rating.py"),
    )),
    "runtime/proof/own_trajectory.py": ("units", (
        ("every motor meets the usual load", "load = min(task.torque, task.largest_torque)", "load = 5.0", "tests/runtime/test_trajectory.py"),
        ("voltage without end", "np.max(np.hypot(*data.u.T)) <= inverter_voltage(drive)", "True", "tests/runtime/test_trajectory.py"),
    )),
    "codegen/evidence/box.py": ("units", (
        ("a sample beyond what is accepted", "nearest if float(nearest) <= limit else", "nearest if True else", "tests/runtime/test_trajectory.py"),
    )),
    "runtime/faults/starts.py": ("units", (
        ("a slow drive is lost", "max(START_TIME, START_WINDOWS * window_time(drive) + LATE)", "START_TIME", "tests/runtime/test_start_survey.py::test_a_drive_of_little_torque_has_the_time_that_its_rotor_takes"),
        ("a reference that waits for the power", "task.start_ramp(drive.motor.inertia", "task.ramp(drive.motor.inertia", "tests/runtime/test_start_survey.py::test_a_drive_of_little_torque_has_the_time_that_its_rotor_takes"),
    )),
    "runtime/study/map.py": ("units", (
        ("another cell's motor", "R=float(resistance[at])", "R=float(resistance[0])", "tests/runtime/test_map.py"),
        ("locked is good", "success=float(np.mean(found.good[part]))", "success=float(np.mean(found.locked[part]))", "tests/runtime/test_map.py"),
        ("smallest angle", "angle=float(np.max(angle[part]))", "angle=float(np.min(angle[part]))", "tests/runtime/test_map.py"),
        ("best corner first", "key=lambda cell: (cell.success,", "key=lambda cell: (-cell.success,", "tests/runtime/test_map.py"),
        ("a lost rotor has its last angle", "np.where(found.locked, found.angle, 180.0)", "found.angle", "tests/runtime/test_map.py"),
    )),
    "runtime/study/map_page.py": ("units", (
        ("mean angle for the largest", "float(np.max(angle[..., k][of]))", "float(np.mean(angle[..., k][of]))", "tests/runtime/test_map.py"),
        ("a fifth called a tenth", "0.9 <= R <= 1.1", "0.8 <= R <= 1.2", "tests/runtime/test_map.py"),
    )),
    "runtime/drive/motor.py": ("units", (
        ("a step of any length", "STEP_SHARE = 12.5e-6, 0.05", "STEP_SHARE = 12.5e-6, 5.0", "tests/runtime/test_simulation.py"),
        ("L is one inductance", '("L_d", "L_q") if name == "L"', '("L_d",) if name == "L"', "tests/judges/test_drive_commands.py::test_simulate_hands_its_options_on"),
    )),
    "model/drives/load.py": ("units", (
        ("no word of what the box excludes", "if value > limit\n", "if False\n", "tests/model/test_drive.py"),
        ("voltage from leg to leg", "c.dc_link / math.sqrt(3.0), \"voltage\"", "c.dc_link, \"voltage\"", "tests/model/test_drive.py"),
    )),
    "runtime/commands/simulate.py": ("drive_figures", (
        ("one locked run is enough", "if not all_hold(", "if not any(", "tests/judges/test_drive_commands.py::test_simulate_ends_with_1_if_one_run_lost_lock"),
        ("no run is enough", "if not all_hold(", "if not all(", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_run_is_no_lock"),
        ("inverter's conditions are dropped", '"dead_time": dead_time', '"dead_time": 0.0', "tests/judges/test_drive_commands.py::test_simulate_hands_its_options_on"),
    )),
    "runtime/commands/compare.py": ("drive_figures", (
        ("compare ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "tests/judges/test_drive_commands.py::test_compare_ends_with_1_if_one_lost_lock"),
    )),
    "runtime/commands/generate.py": ("drive_figures", (
        ("stale is not told", 'any(item.state == "stale"', 'all(item.state == "stale"', "tests/judges/test_drive_commands.py::test_generate_check_ends_with_1_on_any_difference"),
    )),
    "runtime/folders/generate.py": ("drive_figures", (
        ("stale is unchanged", '"stale" if check else', '"unchanged" if check else', "tests/judges/test_drive_commands.py::test_generate_check_ends_with_1_on_any_difference"),
        ("--check writes", "if diff and not check:", "if diff:", "tests/judges/test_drive_commands.py::test_generate_check_ends_with_1_on_any_difference"),
    )),
    "runtime/recorded/units.py": ("units", (
        ("degrees a second are radians", '"deg/s": _TURN', '"deg/s": 1.0', "test_a_unit_is_what_it_is"),
        ("mNm are Nm", '"mNm": 1e-3', '"mNm": 1.0', "test_a_unit_is_what_it_is"),
        ("kA are mA", '"kA": 1e3', '"kA": 1e-3', "test_a_unit_is_what_it_is"),
        ("ns are us", '"ns": 1e-9', '"ns": 1e-6', "test_a_unit_is_what_it_is"),
        ("kV are V", '"kV": 1e3', '"kV": 1.0', "test_a_unit_is_what_it_is"),
        ("r/min of radians", '"r/min": math.pi / 30', '"r/min": math.pi / 60', "test_a_unit_is_what_it_is"),
        ("degrees of half a turn", "_TURN = math.pi / 180", "_TURN = math.pi / 360", "test_a_unit_is_what_it_is"),
        ("rad/s in r/min", "RPM = 30 / math.pi", "RPM = 60 / math.pi", "test_a_thousand_turns_a_minute"),
    )),
    "runtime/recorded/data.py": ("units", (
        ("a factor is not applied", "values[name] = values[name] * factor[name]", "pass", "test_columns_arrive_in_si"),
    )),
    "runtime/recorded/truth.py": ("drive_figures", (
        ("rms without the root", "return float(np.sqrt(np.mean(e**2)))", "return float(np.mean(e**2))", "tests/judges/test_truth_figures.py::test_errors_of_an_estimate_sample_by_sample"),
        ("an angle in radians", "np.degrees(np.remainder(x[:, 3].astype(float) - theta + np.pi, 2 * np.pi) - np.pi)", "(np.remainder(x[:, 3].astype(float) - theta + np.pi, 2 * np.pi) - np.pi)", "test_errors_have_a_sign_and_a_unit"),
        ("a lost rotor that is no number", "not self.position_steady_rms <= LOST", "self.position_steady_rms > LOST", "tests/judges/test_truth_figures.py::test_a_lost_rotor_is_told"),
    )),
    "runtime/replay/statistics.py": ("replay_figures", (
        ("a band of 90 % called 95 %", "-2 * math.log(0.975), -2 * math.log(0.025)", "-2 * math.log(0.95), -2 * math.log(0.05)", "test_consistency_step_by_step"),
        ("99 % that is 90 %", "Z_95 = 1.959963984540054", "Z_95 = 1.6448536269514722", "test_consistency_step_by_step"),
        ("size is never too large", "if self.nis_mean > high:", "if self.nis_mean > 1e9:", "test_words_of_consistency"),
        ("one white axis is enough", "min(self.ljung_box)", "max(self.ljung_box)", "test_words_of_consistency"),
    )),
    "runtime/replay/replay.py": ("replay_figures", (
        ("one number is finite", "bool(np.all(np.isfinite(self.x)))", "bool(np.any(np.isfinite(self.x)))", "test_json_of_a_replay"),
        ("a run over next to nothing is good", "2 * self.count(REJECTED) > len", "self.count(REJECTED) > len", "test_a_run_of_which_most_was_rejected_ends_with_1"),
        ("rejected counts the other bit", "REJECTED, NOT_CONVERGED = 1, 2", "REJECTED, NOT_CONVERGED = 2, 1", "test_json_of_a_replay"),
    )),
    "runtime/commands/replay.py": ("replay_figures", (
        ("replay ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "test_replay_ends_with_1_if_the_estimate_is_no_number"),
    )),
    "runtime/replay/tables.py": ("replay_figures", (
        ("sigma that is the variance", "diagonal() ** 0.5", "diagonal()", "test_the_table_of_a_replay_has_sigmas_and_units"),
        ("T in ms called us", "replay.sample_time * 1e6:g} us", "replay.sample_time * 1e3:g} us", "test_the_table_of_a_replay_has_sigmas_and_units"),
        ("a share called per cent", "{100 * found.nis_inside:.1f} %", "{found.nis_inside:.1f} %", "test_the_table_of_a_replay_has_sigmas_and_units"),
    )),
    "runtime/replay/figures.py": ("replay_figures", (
        ("one sigma called two", "2 * sigma(2) * RPM", "sigma(2) * RPM", "test_the_drawing_of_an_estimate"),
        ("a sigma that is the variance", "np.asarray(np.sqrt(variances[:, state]))", "np.asarray(variances[:, state])", "test_the_drawing_of_an_estimate"),
        ("an expectation of 1", "axes[2].axhline(2.0", "axes[2].axhline(1.0", "test_the_drawing_of_innovations"),
    )),
    "runtime/study/analysis.py": ("study_figures", (
        ("intervals of 90 %", "Z_95 = 1.959963984540054", "Z_95 = 1.6448536269514722", "test_wilsons_interval_solves_its_equation"),
        ("quantiles of 90 %", "(0.025, 0.975)", "(0.05, 0.95)", "test_a_resampled_interval_is_the_means_own"),
        ("worst that is 99 %", "QUANTILES = (0.05, 0.5, 0.95, 1.0)", "QUANTILES = (0.05, 0.5, 0.95, 0.99)", "test_success_quickness_and_quantiles"),
        ("of all runs, lost ones too", "getattr(group.outcomes, name)[locked]", "getattr(group.outcomes, name)[:]", "test_success_quickness_and_quantiles"),
        ("first minus second", "getattr(second.outcomes, name)[b] - getattr(first.outcomes, name)[a]", "getattr(first.outcomes, name)[a] - getattr(second.outcomes, name)[b]", "test_pairs_are_second_minus_first_of_the_same_run"),
    )),
    "runtime/study/tables.py": ("study_figures", (
        ("the worse is better", "better = (item.mean > 0) ==", "better = (item.mean > 0) !=", "test_words_of_a_difference"),
        ("median called worst", "for q in (0.5, 0.95, 1.0)", "for q in (0.5, 0.95, 0.5)", "test_tables_of_a_study"),
        ("low and high exchanged", "{100 * rate.rate:.1f} ({100 * rate.low:.1f} .. {100 * rate.high:.1f})\", style", "{100 * rate.rate:.1f} ({100 * rate.high:.1f} .. {100 * rate.low:.1f})\", style", "test_tables_of_a_study"),
    )),
    "runtime/faults/survey.py": ("fault_verdicts", (
        ("JSON: with and without the reaction exchanged", 'for recovery in outcome.recoveries],\n        "alone"', 'for recovery in outcome.alone],\n        "alone"', "test_json_of_an_outcome"),
        ("a band in radians", "np.abs(run.angle_error) < ANGLE_BAND", "np.abs(run.angle_error) < np.degrees(ANGLE_BAND)", "test_an_angle_out_of_its_band"),
        ("one recovered run is enough", "return all_hold(run.recovered", "return any(run.recovered", "test_figures_over_runs"),
        ("no run is recovered", "return all_hold(run.recovered", "return all(run.recovered", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_fault_is_survived_by_nobody"),
        ("given up is good enough", "run.safe and (lasts or run.driven_off)", "run.safe", "test_where_a_fault_lasts_to_give_up_and_say_why_is_safe"),
        ("driven off is good enough", "(run.safe and (lasts or run.driven_off))", "run.driven_off", "test_a_rotor_that_its_load_drives_off_may_be_given_up"),
        ("driven off one way alone", "abs(run.omega[-1]) > run.diodes", "run.omega[-1] > run.diodes", "test_a_rotor_that_its_load_drives_off_may_be_given_up"),
        ("ten times the band", "LEAST_REST = 10.0, 0.05", "LEAST_REST = 100.0, 0.05", "test_an_angle_out_of_its_band"),
        ("no band for the speed", "np.abs(run.speed_error) < run.band", "np.abs(run.speed_error) < 10 * run.band", "test_recovery_counts_from_the_faults_end_to_the_last_bad_sample"),
        ("recovered without torque", "run.running & (np.abs(run.speed_error)", "(np.abs(run.speed_error)", "test_who_has_no_rest_or_no_torque_has_not_recovered"),
        ("time from the fault's begin", "max(0, back - run.after) * T", "max(0, back - run.first) * T", "test_recovery_counts_from_the_faults_end_to_the_last_bad_sample"),
    )),
    "runtime/faults/standstill.py": ("start_verdicts", (
        ("any angle is held", "good = back.locked and kept and angle < ANGLE_BAND", "good = back.locked and kept", "test_a_salient_rotor_is_held_and_then_turns"),
        ("who left RUNNING has held", "good = back.locked and kept and angle", "good = back.locked and angle", "test_a_salient_rotor_is_held_and_then_turns"),
        ("who does not turn again has held", "good = back.locked and kept and angle", "good = kept and angle", "test_a_salient_rotor_is_held_and_then_turns"),
        ("held is judged to the end", "(run.t < attempt.held[1])", "(run.t < np.inf)", "test_a_salient_rotor_is_held_and_then_turns"),
        ("a round rotor may turn at any speed", "<= SLIP_SHARE * attempt.speed", "<= np.inf", "test_a_round_rotor_may_slip_but_neither_turn_fast_nor_stay_away"),
        ("a round rotor may stay away", "good &= back.locked or", "good &= True or", "test_a_round_rotor_may_slip_but_neither_turn_fast_nor_stay_away"),
        ("every drive may end in FAULT", "(bool(run.gave_up) and not attempt.rival)", "bool(run.gave_up)", "test_only_a_drive_without_a_rival_may_end_in_fault_at_rest"),
        ("speed with the gates off counts", "on = held & (run.mode != run.mode[-1]) if run.gave_up else held", "on = held", "test_only_a_drive_without_a_rival_may_end_in_fault_at_rest"),
        ("ripple of slow currents", "* (-1.0) ** np.arange(len(phase))", "", "test_the_injected_current_is_what_changes_its_sign"),
    )),
    "runtime/faults/tables.py": ("fault_verdicts", (
        ("worst that is the median", "worst = float(np.max(column(runs, name)))", "worst = float(np.median(column(runs, name)))", "test_figures_over_runs"),
        ("seconds called ms", '"time") * 1e3', '"time")', "test_figures_over_runs"),
    )),
    "runtime/commands/faults.py": ("fault_verdicts", (
        ("faults ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "test_faults_ends_with_1_if_one_run_did_not_recover"),
        ("one recovered outcome is enough", "if not all_hold(outcome.recovered", "if not any(outcome.recovered", "test_faults_ends_with_1_if_one_run_did_not_recover"),
        ("no outcome is enough", "if not all_hold(outcome.recovered", "if not all(outcome.recovered", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_fault_is_survived_by_nobody"),
    )),
    "runtime/endurance/soak.py": ("endurance_verdicts", (
        ("no step is a soak", "if not self.decades:", "if False:", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_step_is_no_soak"),
        ("lock at half a turn", "LOCKED = math.pi / 4", "LOCKED = math.pi", "test_what_fails_a_soak"),
        ("growth is not told", "if not now <= GROWTH * then:", "if False:", "test_growth_and_the_truths_own_angle"),
        ("status without a reason is fine", "if decade.unexpected:", "if decade.unexpected > 99:", "test_what_fails_a_soak"),
    )),
    "runtime/endurance/tables.py": ("endurance_verdicts", (
        ("soak JSON passes always", "passed = all_hold(not result", "passed = any(not result", "test_soak_ends_with_1_if_one_failed"),
        ("soak JSON passes without a soak", "passed = all_hold(not result", "passed = all(not result", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_step_is_no_soak"),
        ("fuzz JSON passes always", "all_hold(one.good", "any(one.good", "test_fuzz_ends_with_1_if_anything_was_found"),
        ("fuzz JSON passes without a campaign", "all_hold(one.good", "all(one.good", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_execution_is_no_campaign"),
        ("hours of seconds", "result.sample_time / 3600", "result.sample_time / 60", "test_the_table_and_figure_of_a_soak"),
    )),
    "runtime/commands/soak.py": ("endurance_verdicts", (
        ("soak ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "test_soak_ends_with_1_if_one_failed"),
        ("every soak must fail", "if not all_hold(not result.failures()", "if not any(not result.failures()", "test_soak_ends_with_1_if_one_failed"),
        ("no soak is enough", "if not all_hold(not result.failures()", "if not all(not result.failures()", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_step_is_no_soak"),
    )),
    "runtime/commands/fuzz.py": ("endurance_verdicts", (
        ("fuzz ends with 0", "raise typer.Exit(1)", "raise typer.Exit(0)", "test_fuzz_ends_with_1_if_anything_was_found"),
        ("every campaign must find", "if not all_hold(campaign.good", "if not any(campaign.good", "test_fuzz_ends_with_1_if_anything_was_found"),
        ("no campaign is enough", "if not all_hold(campaign.good", "if not all(campaign.good", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_execution_is_no_campaign"),
    )),
    "runtime/board/pil.py": ("board_verdicts", (
        ("lost steps are agreed steps", "self.compared == self.wanted > 0 and", "self.compared > 0 and", "test_pils_verdict"),
        ("differing steps pass", "self.divergence is None and not self.different", "self.divergence is None", "test_pils_verdict"),
        ("status is not compared", "answer.words.view(np.uint32), [answer.status, answer.iterations]", "answer.words.view(np.uint32), [status, answer.iterations]", "test_every_word_status_and_iteration_of_a_board_is_compared"),
        ("worst ticks are the median", '"max": int(ticks.max())', '"max": int(np.median(ticks))', "test_ticks_by_hand"),
        ("seconds from ticks, the other way", "value / ticks_hz for", "value * ticks_hz for", "test_ticks_by_hand"),
        ("a missing number is within the certificate", "np.isnan(shares), np.inf, shares", "np.isnan(shares), 0.0, shares", "test_the_certificate_allows_what_it_says_and_no_more"),
    )),
    "runtime/commands/pil.py": ("board_verdicts", (
        ("pil ends with 0", "is not None else f\"{len(result.lost)} steps were lost\"\n        console.print(f\"{name}: [bold red]NOT proved[/bold red], {reason}\", highlight=False)\n        raise typer.Exit(1)", "is not None else f\"{len(result.lost)} steps were lost\"\n        console.print(f\"{name}: [bold red]NOT proved[/bold red], {reason}\", highlight=False)\n        raise typer.Exit(0)", "test_pils_verdict"),
        ("an interrupted run that differed is only interrupted", "typer.Exit(1 if result.divergence is not None else 130)", "typer.Exit(130)", "test_an_interrupted_board_that_differed_is_a_failure"),
    )),
    "runtime/board/tables.py": ("board_verdicts", (
        ("ms called us", "{1e6 * value:.4g} us", "{1e3 * value:.4g} us", "test_the_tables_of_a_board"),
        ("steps that differ called agreed", "{result.compared - result.different:,} of", "{result.different:,} of", "test_the_tables_of_a_board"),
    )),
    "runtime/compare/facts.py": ("side_by_side", (
        ("stack and code exchanged", 'stack=measured.get("stack_bytes")', 'stack=measured.get("text_bytes")', "test_costs_are_the_manifests"),
        ("k = 5 with k = 4's cycles", "(prices.factors[0], prices.factors[-1])", "(prices.factors[0], prices.factors[1])", "test_json_costs_by_name"),
        ("99 % that is the worst", '"P, 99 %": c["P_99"]', '"P, 99 %": c["P"]', "test_json_costs_by_name"),
    )),
    "runtime/compare/tables.py": ("side_by_side", (
        ("locked always", '*figures, run.verdict))', '*figures, LOCKED))', "test_accuracy_in_order_and_with_verdicts"),
        ("ratio upside down", "cost.typical / first.typical", "first.typical / cost.typical", "test_costs_are_the_manifests"),
    )),
    "runtime/compare/figures.py": ("side_by_side", (
        ("the bound is the typical price", 'bound = [cost.bound', 'bound = [cost.typical', "test_drawings_of_a_comparison"),
    )),
    "runtime/report/page.html.j2": ("pages", (
        ("rms of rad/s", "<th>steady rms, r/min</th>", "<th>steady rms, rad/s</th>", "test_the_page_shows_what_the_chapters_hold"),
        ("an angle in radians", "<th>largest error</th><th>angle after start, deg</th>", "<th>largest error</th><th>angle after start, rad</th>", "test_the_page_shows_what_the_chapters_hold"),
        ("words called bytes", "<th>state, 16-bit words</th>", "<th>state, bytes</th>", "test_the_page_shows_what_the_chapters_hold"),
        ("T in ms called us", "point.sample_time * 1e6", "point.sample_time * 1e3", "test_the_page_shows_what_the_chapters_hold"),
        ("rms and largest exchanged", '{{ "%.2f" | format(f.load_step) }}</td><td>{{ "%.3f" | format(f.steady_rms) }}', '{{ "%.2f" | format(f.steady_rms) }}</td><td>{{ "%.3f" | format(f.load_step) }}', "test_the_page_shows_what_the_chapters_hold"),
    )),
    "runtime/compare/compare.html.j2": ("comparison_page", (
        ("us called ms", "<th>T, us</th>", "<th>T, ms</th>", "test_the_page_of_a_comparison"),
        ("T in ms called us", "s.drive.model.sample_time * 1e6", "s.drive.model.sample_time * 1e3", "test_the_page_of_a_comparison"),
        ("load step and rms exchanged", "<th>load step, r/min</th><th>steady rms, r/min</th>", "<th>steady rms, r/min</th><th>load step, r/min</th>", "test_the_page_of_a_comparison"),
    )),
    "runtime/commands/study.py": ("study_figures", (
        ("an interrupted study ends with 0", "            soft_wrap=True,\n        )\n        raise typer.Exit(130)", "            soft_wrap=True,\n        )\n        raise typer.Exit(0)", "test_a_study_that_was_interrupted_ends_with_130"),
        ("an interrupted tuning ends with 0", "    if tuned.interrupted:", "    if False:", "test_a_tuning_that_was_interrupted_ends_with_130"),
    )),
    "runtime/study/tune.py": ("study_figures", (
        ("JSON: fresh runs exchanged", '"drive_file": checked(tuned.check_own), "recommended": checked(tuned.check_recommended)', '"drive_file": checked(tuned.check_recommended), "recommended": checked(tuned.check_own)', "test_json_of_a_tuning"),
        ("JSON: objectives in another order", "objectives = dict(zip(OBJECTIVES, point.values, strict=True))", "objectives = dict(zip(OBJECTIVES, reversed(point.values), strict=True))", "test_json_of_a_tuning"),
    )),
    "runtime/endurance/fuzz.py": ("endurance_verdicts", (
        ("nothing executed is good", "self.executions > 0 and not", "self.executions >= 0 and not", "tests/judges/test_nothing_is_shown_by_nothing.py::test_no_execution_is_no_campaign"),
    )),
    "runtime/system/verdicts.py": ("endurance_verdicts", (
        ("nothing holds", "bool(found) and all(found)", "all(found)", "tests/judges/test_nothing_is_shown_by_nothing.py::test_all_hold_by_truth_table"),
    )),
}  # fmt: skip


def _check(tests: str, node: str) -> str:
    return f"pytest {node}" if "/" in node else f"pytest tests/judges/test_{tests}.py::{node}"


JUDGES: tuple[Mutant, ...] = tuple(
    Mutant("judges", f"{file.removeprefix('runtime/')}: {name}", (_check(tests, node),), file, old, new)
    for file, (tests, rows) in _ROWS.items()
    for name, old, new, node in rows
)
