"""Recordings misread, and wrong words about why they do not fit."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

#: File -> the tests that must notice, and rows: what is wrong, what stands there, what would stand there, which test.
_ROWS: dict[str, tuple[str, tuple[tuple[str, str, str, str], ...]]] = {
    "runtime/recorded/frames.py": ("judges/test_units", (
        ("line voltages by phase", "return (2 * ab + bc) / 3, bc / _SQRT3", "return ab, bc / _SQRT3", "test_frames_against_phasors"),
        ("two phases as three", "(a, (a + 2 * b) / _SQRT3)", "(a, (a + b) / _SQRT3)", "test_frames_against_phasors"),
        ("an order read backwards", "zip(order, recorded, strict=True)", "zip(order, recorded[::-1], strict=True)", "test_a_wiring_is_what_its_word_says"),
    )),
    "runtime/recorded/clock.py": ("judges/test_truth_figures", (
        ("a solver's rows are steps", "if not found.rms <= UNEVEN * T:", "if not found.rms <= 9 * T:", "test_the_clock_of_a_recording"),
    )),
    "runtime/recorded/resample.py": ("runtime/test_unlike", (
        ("currents where a step begins", "np.interp(edges[1:], recorded.t, column) for", "np.interp(edges[:-1], recorded.t, column) for", "test_steps_that_end_on_rows_are_exact"),
        ("a hole has a mean", "mean[integral(unknown.astype(float)) > 1e-6] = np.nan", "pass", "test_what_is_missing_spoils_its_step_alone"),
        ("three rows a step are enough", "if rows >= ANY_ROWS or", "if rows >= 3 or", "test_too_few_rows_a_step_are_refused"),
    )),
    "runtime/recorded/rest.py": ("runtime/test_unlike", (
        ("a rotor that turns rests", "if variance > 2.0 * by_steps:", "if variance > 1e9 * by_steps:", "test_offsets_are_not_told_where_there_is_none_or_no_rest"),
        ("an offset is doubled", "--offset {name}={-level:.4g}", "--offset {name}={level:.4g}", "test_offsets_are_estimated_where_there_is_a_rest"),
    )),
    "runtime/replay/conventions.py": ("runtime/test_unlike", (
        ("a standing rotor has a convention", "> STANDS:", "> 2.0:", "test_a_convention_is_not_blamed_for_what_is_none"),
        ("degrees for radians", "math.radians(offset) if", "offset if", "test_an_angle_of_another_convention_is_told_from_a_lost_rotor"),
        ("what was applied is forgotten", "{factor * scale:.6g}", "{factor:.6g}", "test_options_come_on_top_of_those_a_column_was_read_with"),
        ("any constant bias is a convention", "abs(offset) <= LOST", "abs(offset) <= 1.0", "test_a_convention_is_not_blamed_for_what_is_none"),
    )),
    "runtime/replay/wiring.py": ("runtime/test_unlike", (
        ("any wiring fits", "misfit < min(FITS, before / BETTER)", "misfit < np.inf", "test_what_no_wiring_mends_is_said"),
        ("the worst wiring first", "misfit, option = fitting[0]", "misfit, option = fitting[-1]", "test_of_another_drive_too"),
    )),
    "runtime/replay/words.py": ("runtime/test_long_replay", (
        ("a chunk of another place", "self._backend.restore(self._marks[chunk])", "self._backend.restore(self._marks[0])", "test_pieces_and_what_is_worked_out_again_are_the_bits_of_one_run"),
    )),
}  # fmt: skip

RECORDINGS: tuple[Mutant, ...] = tuple(
    Mutant("judges", f"{file.removeprefix('runtime/')}: {name}", (f"pytest tests/{tests}.py::{node}",), file, old, new)
    for file, (tests, rows) in _ROWS.items()
    for name, old, new, node in rows
)
