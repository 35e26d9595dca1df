"""A wrong inverter: in the model, before the time update, in the controller."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

UNIT = ("pytest tests/model/test_inverter.py",)
HAND = ("pytest tests/model/test_inverter.py -k 'by_hand or small_current or own_voltage'",)
SYMPY = ("pytest tests/runtime/test_inverter.py -k sympy_states",)
LOOP = ("pytest tests/runtime/test_inverter.py -k controller_and_data",)
CHAIN = ("noticed tests/runtime/test_inverter.py -k 'chain_holds and load_torque-False-exact-ckf'",)
LOST = ("pytest tests/runtime/test_inverter.py -k drive_file_says",)


def _of(file: str, *rows: tuple[str, str, str, tuple[str, ...]]) -> tuple[Mutant, ...]:
    short = file.rpartition("/")[2]
    return tuple(Mutant("inverter", f"{short}: {name}", checks, file, old, new) for name, old, new, checks in rows)


NUMBERS = _of(
    "model/inverter.py",
    ("drop of two switches", "+ drive.inverter.switch_drop", "+ 2 * drive.inverter.switch_drop", UNIT),
    ("one dead time a sample", "dead_time * drive.switching_frequency", "dead_time / drive.model.sample_time", UNIT),
    ("dead time of half the link", "return drive.control.dc_link *", "return 0.5 * drive.control.dc_link *", UNIT),
    ("an inverter that takes nothing", "or lost_voltage(drive) > 0.0", "or drive.inverter is not None", UNIT),
    ("fading by another sensor", "drive.filter.measurement_noise[0]", "drive.filter.measurement_noise[1]", UNIT),
    ("fading by a variance", "sigma = math.sqrt(drive.filter.measurement_noise[0])", "sigma = 0.05**2", UNIT),
    ("fading too wide", "FADING_SIGMAS, FADING_SHARE = 3.0, 0.005", "FADING_SIGMAS, FADING_SHARE = 6.0, 0.005", UNIT),
    (
        "fading of a larger share",
        "FADING_SIGMAS, FADING_SHARE = 3.0, 0.005",
        "FADING_SIGMAS, FADING_SHARE = 3.0, 0.01",
        UNIT,
    ),
    (
        "the paper's fading",
        "if not takes_voltage(drive):\n        return",
        "if takes_voltage(drive):\n        return",
        UNIT,
    ),
    ("a compensation that is stated and not heard", "if stated is None else stated", "if True else stated", UNIT),
    ("a fading that is stated and not heard", "return drive.inverter.fading_current", "return UNTOLD_CURRENT", UNIT),
    ("seen from another share on", "SEEN_SHARE = 0.05", "SEEN_SHARE = 0.1", UNIT),
    ("legs b and c exchanged", "half + cross, half - cross], {", "half - cross, half + cross], {", SYMPY),
    ("axes of the legs", "(SQRT_3 / 2) * vector[1]", "(SQRT_3 / 2) * vector[0]", SYMPY),
    ("a sign of any size", "ca.fmax(-1.0, ca.fmin(1.0, value))", "ca.fmax(-1.0, value)", SYMPY),
    ("one side alone", "ca.fmax(-1.0, ca.fmin(1.0, value))", "ca.fmax(0.0, ca.fmin(1.0, value))", SYMPY),
    ("power-invariant", "return (2 / 3) * (a - 0.5 * (b + c))", "return (2 / 3) ** 0.5 * (a - 0.5 * (b + c))", SYMPY),
    ("beta reversed", "(1 / SQRT_3) * (b - c)", "(1 / SQRT_3) * (c - b)", SYMPY),
    ("common mode left in", "(a - 0.5 * (b + c))", "(a - 0.4 * (b + c))", SYMPY),
)

TERM = _of(
    "model/machines/lost_voltage.py",
    ("alpha added", "u[0] - V_d * g[0]", "u[0] + V_d * g[0]", SYMPY),
    ("beta added", "u[1] - V_d * g[1]", "u[1] + V_d * g[1]", SYMPY),
    ("axes exchanged", "u[0] - V_d * g[0]", "u[0] - V_d * g[1]", SYMPY),
    ("scale of the fading", "1 / self.par.I_0", "self.par.I_0", SYMPY),
    ("fading of one axis", "legs((scale * i[0], scale * i[1]))", "legs((scale * i[0], i[1]))", SYMPY),
    ("seen from nothing on", "(i[0] * i[0] + i[1] * i[1]) - 1)", "(i[0] * i[0] + i[1] * i[1]))", SYMPY),
    ("seen of one axis", "(i[0] * i[0] + i[1] * i[1])", "(i[0] * i[0])", SYMPY),
    ("seen beyond all", "ca.fmin(1.0, scale * (i[0]", "ca.fmin(2.0, scale * (i[0]", SYMPY),
    ("unseen against", "return ca.fmax(0.0, ca.fmin", "return ca.fmax(-1.0, ca.fmin", SYMPY),
)

APPLIED = _of(
    "model/machines/state_space.py",
    ("all of it taken off twice", "hidden = (1 - seen) * self._voltage(x)", "hidden = self._voltage(x)", SYMPY),
    ("what is unseen forgotten", "hidden = (1 - seen) * self._voltage(x)", "hidden = seen * self._voltage(x)", SYMPY),
    ("beta seen whole", "(seen * g[0], seen * g[1])", "(seen * g[0], g[1])", SYMPY),
    ("signs of the states", "g, signs = self.lost.signs(i)", "g, signs = self.lost.signs(x[:2])", SYMPY),
    ("another state for V_d", "[self.adaptive.words.index(STATE)]", "[0]", HAND),
    ("V_d begins at nothing", "slow = [own_value(drive, word)", "slow = [0 * own_value(drive, word)", LOOP),
    ("inverter of its own words", "if takes_voltage(drive) else None", "if drive.inverter else None", HAND),
)

BEFORE = _of(
    "codegen/fast/steps.py",
    ("voltage of the step before", "(Guard(), *inverter_calls(model), *time_update)", "(*inverter_calls(model), Guard(), *time_update)", CHAIN),
)  # fmt: skip

CONTROLLER = _of(
    "model/loop/controller.py",
    ("volts for a share", "lost = gain.dead_share * V_d / v_link", "lost = gain.dead_share * V_d", LOOP),
    ("made up for whatever the gain", "lost = gain.dead_share * V_d / v_link", "lost = V_d / v_link", LOOP),
    ("never made up for", "dead_share=1.0 if takes_voltage(drive)", "dead_share=0.0 if takes_voltage(drive)", LOOP),
    ("the filter is told of what should arrive", "_commanded(b, duty, v_link) if takes_voltage(drive) else v", "v", LOOP),
    ("duty cycles for volts", "v = v_link * v_alpha, v_link * v_beta", "v = v_alpha, v_link * v_beta", LOOP),
    ("V_d of the drive file, whatever is learnt", "V_d = estimated[0] if estimated else", "V_d = 0 * estimated[0] + 1 if estimated else", LOOP),
    ("fading of its own", "dead_current=compensation_current(drive)", "dead_current=2 * compensation_current(drive)", LOOP),
)  # fmt: skip

SIMULATED = _of(
    "runtime/drive/motor.py",
    ("carrier of one sample", 'own = known["dead_time"] * periods', 'own = known["dead_time"]', LOST),
    ("dead time as stated in the file alone", "own if dead_time is None else dead_time", "own", LOST),
    ("drop never", 'known["switch_drop"] if drop is None else drop', "drop or 0.0", LOST),
)

INVERTER = (*NUMBERS, *TERM, *APPLIED, *BEFORE, *CONTROLLER, *SIMULATED)
