"""Wrong noise of motor data that may be wrong: [tolerance], from the drive file to both forms."""

from __future__ import annotations

from tests.mutants.catalogue.rewriting import of

DRAWN = ("pytest tests/model/test_tolerance.py",)
TEXT = ("pytest tests/codegen/test_tolerance.py",)
FORMS = ("pytest tests/runtime/test_tolerance.py -k 'both_forms and paper_spmsm and (ckf or ekf)'",)
NOTICED = ("noticed tests/runtime/test_tolerance.py -k 'both_forms and paper_spmsm and ckf'",)
OWN = ("pytest tests/runtime/test_tolerance.py -k ones_own",)

#: Bounds of adaptive states, and a V_d that may be off.
COASTS = ("pytest tests/runtime/test_tolerance.py -k without_a_measurement",)
HELD = ("pytest tests/model/test_tolerance.py -k held_within",)
VOLTS = ("pytest tests/model/test_tolerance.py -k by_hand_says",)
UNSURE = ("pytest tests/model/test_inverter.py -k unsure",)
CHAIN = ("pytest tests/runtime/test_tolerance.py -k 'doubtful_inverter and ipmsm-'",)
BOTH = ("pytest tests/runtime/test_tolerance.py -k 'doubtful_inverter and spmsm_adaptive'",)

LACKS = ("pytest tests/runtime/test_tolerance.py -k 'says_what or one_line'",)
#: What P says of the angle.
SIGMA = ("pytest tests/runtime/test_deviation.py -k root",)

TOLERANCE = (
    *of(
        "tolerance",
        "model/machines/adaptive.py",
        ("least for most", "ca.fmax(least, ca.fmin(most, value))", "ca.fmax(most, ca.fmin(least, value))", HELD),
        ("no least", "ca.fmax(least, ca.fmin(most, value))", "ca.fmin(most, value)", HELD),
        ("no most", "ca.fmax(least, ca.fmin(most, value))", "ca.fmax(least, value)", HELD),
        ("absolute for relative", "own * (1 + width)", "own + width", HELD),
        (
            "widths of the other",
            "zip(self.words, values, widths, strict",
            "zip(self.words, values, widths[::-1], strict",
            HELD,
        ),
    ),
    *of(
        "tolerance",
        "model/machines/state_space.py",
        ("bounds forgotten", "*self.adaptive.within(x[len(x) - slow :])", "*x[len(x) - slow :]", HELD),
        ("V_d acts with g", '"V_d": -g[:2]', '"V_d": g[:2]', VOLTS),
        ("V_d acts on all axes alike", '"V_d": -g[:2]', '"V_d": -v', VOLTS),
        (
            "V_d surely right",
            "columns |= {letter: sigmas[letter] * slope for letter, slope in self.voltage_slopes.items()}",
            "pass",
            VOLTS,
        ),
        (
            "loss along twice",
            '"loss_across": rotor.to_stator((0.0, 1.0))',
            '"loss_across": rotor.to_stator((1.0, 0.0))',
            VOLTS,
        ),
        ("V_d's sigma for the loss", '"loss_along": noise,', '"loss_along": sigma,', VOLTS),
        ("loss as noisy where signs are whole", "noise = noise * self.arguments[2][2]", "pass", VOLTS),
        ("loss per volt", "loss = self.doubt.of_signs * self.lost.par.V_d", "loss = ca.SX(self.doubt.of_signs)", VOLTS),
    ),
    *of(
        "tolerance",
        "model/machines/salient_flux.py",
        ("back-EMF the other way", "((turned * b, -turned * a),", "((turned * b, turned * a),", DRAWN),
        ("flux linkages that do not turn", "((turned * b, -turned * a),", "((turned * a, turned * b),", DRAWN),
        ("torque against", "gain * (a * i[1] - b * i[0])", "gain * (b * i[0] - a * i[1])", DRAWN),
        (
            "q axis as d",
            '"L_q": (-rotor.sin * i_q, rotor.cos * i_q)',
            '"L_q": (rotor.cos * i_q, rotor.sin * i_q)',
            DRAWN,
        ),
        (
            "current of the other axis",
            '"L_d": (rotor.cos * i_d, rotor.sin * i_d)',
            '"L_d": (rotor.cos * i_q, rotor.sin * i_q)',
            DRAWN,
        ),
        ("magnet on the q axis", '"psi_m": (rotor.cos, rotor.sin)', '"psi_m": (-rotor.sin, rotor.cos)', DRAWN),
        (
            "per second",
            'turned = self.constant("SAMPLE_TIME", self.par.T, "sample time, s") * omega_e',
            "turned = omega_e",
            DRAWN,
        ),
    ),
    *of(
        "tolerance",
        "model/machines/state_space.py",
        ("torque that does not act", "torque * by_torque) for letter", "0 * by_torque) for letter", DRAWN),
        ("at the mechanical speed", "lacking((x[0], x[1]), speed,", "lacking((x[0], x[1]), x[2],", DRAWN),
    ),
    *of(
        "tolerance",
        "runtime/proof/second.py",
        ("one's own h is right", "_WrongCurrents(moved, stated) if letter in through else moved", "moved", LACKS),
        ("lacking need not be stated", 'if letter in through and not hasattr(motor, "lacking"):', "if False:", LACKS),
    ),
    *of(
        "tolerance",
        "runtime/estimator/deviation.py",
        ("rows before another state", "module.ROWS[module.ANGLE]", "module.ROWS[2]", SIGMA),
        ("another state's row", "module.word(module.ANGLE, state)", "module.word(2, state)", SIGMA),
        ("own pivot left out", " + pivots[:, -1]))", "))", SIGMA),
        ("variance for sigma", "np.asarray(np.sqrt(np.sum", "np.asarray((np.sum", SIGMA),
    ),
    *of(
        "tolerance",
        "model/machines/lost_voltage.py",
        ("variance for sigma", "return ca.sqrt(ca.fmax(", "return (ca.fmax(", UNSURE),
        ("second axis as the first", "- 0.1875 * (second * second)", "- 0.25 * (second * second)", UNSURE),
        ("second axis left out", " - 0.1875 * (second * second)", "", UNSURE),
        ("phase a alone", "first, second = a - 0.5 * (b + c), b - c", "first, second = 1.5 * a, b - c", UNSURE),
    ),
    *of(
        "tolerance",
        "model/filters/inverter.py",
        (
            "half a direction",
            "b.output(name, list(values))",
            'b.output(name, list(values) if name == "v" else [values[1], values[0], *values[2:]])',
            CHAIN,
        ),
    ),
    *of(
        "tolerance",
        "codegen/fast/steps.py",
        (
            "the measured estimate free",
            "        x = self._kept(b, x)\n",
            "",
            BOTH,
        ),
        (
            "the coasting estimate free",
            'b.output("x", self._kept(b, x))',
            'b.output("x", x)',
            COASTS,
        ),
    ),
    *of(
        "tolerance",
        "model/machines/tolerance.py",
        ("variance of the half-width itself", "/ drive.model.sample_time / 3)", "/ drive.model.sample_time)", DRAWN),
        ("one sample for two", "math.sqrt(2 * drive", "math.sqrt(drive", DRAWN),
        ("variance for deviation", "return math.sqrt(2 *", "return (2 *", DRAWN),
        (
            "V_d's width alone",
            "volts * stated.dead_time *",
            "stated.dead_time *",
            VOLTS,
        ),
        (
            "all of the loss on each axis",
            "math.sqrt(stated.unsure_samples * longest)",
            "math.sqrt(2 * stated.unsure_samples * longest)",
            UNSURE,
        ),
        ("alike for no time", "math.sqrt(stated.unsure_samples * longest)", "math.sqrt(longest)", UNSURE),
        ("R's width for V_d", '"V_d": "dead_time"}', '"V_d": "stator_resistance"}', HELD),
        (
            "a state's datum kept",
            "for letter, key in DATA.items() if letter not in slow",
            "for letter, key in DATA.items()",
            DRAWN,
        ),
        ("R's width for psi_m", '"psi_m": "magnet_flux",', '"psi_m": "stator_resistance",', DRAWN),
        ("relative for absolute", "size = value * deviation", "size = deviation", DRAWN),
        (
            "datum's own place left out",
            "along(f, letter, ca.SX(size), shares)",
            "along(f, letter, ca.SX(0), shares)",
            OWN,
        ),
        ("share's sign", "self._in_numbers(slope) * size,", "-self._in_numbers(slope) * size,", DRAWN),
        ("unit datum", "columns[name] = sigma * through[name]", "columns[name] = through[name]", DRAWN),
        ("wrong h taken for a wrong f", "if name in through:", "if False:", DRAWN),
        ("columns of nothing kept", "if not column.is_zero()}", "if column is not None}", (*DRAWN, *TEXT)),
    ),
    *of(
        "tolerance",
        "model/quantities.py",
        (
            "through constants of constants only once",
            "self.spelled.setdefault(name, spelled)",
            "self.spelled.setdefault(name, ca.SX(value))",
            DRAWN,
        ),
    ),
    *of(
        "tolerance",
        "model/machines/base.py",
        ("digits lost in a slow winding", "return -ca.expm1(-z)", "return 1 - ca.exp(-z)", DRAWN),
    ),
    *of(
        "tolerance",
        "model/filters/noise.py",
        ("Q for Q_p", "P[i][i] = P[i][i] + Q[i]", "P[i][i] = P[i][i] + (0 if model.G else Q[i])", FORMS),
        ("diagonal alone", "P[i][j] = P[i][j] + Q_p[i][j]", "P[i][j] = P[i][j] + (Q_p[i][j] if i == j else 0)", FORMS),
        ("subtracted", "P[i][j] = P[i][j] + Q_p[i][j]", "P[i][j] = P[i][j] - Q_p[i][j]", NOTICED),
        (
            "without voltage",
            "for values in at for value",
            "for values in (at[0], [0 * v for v in at[1]], *at[2:]) for value",
            FORMS,
        ),
        (
            "one datum",
            "zip(a, b, strict=True)]\n    return sum(terms[1:], terms[0])",
            "zip(a, b, strict=True)]\n    return terms[0]",
            FORMS,
        ),
    ),
    *of(
        "tolerance",
        "codegen/fast/spread.py",
        (
            "diagonal alone",
            "bend + dot(wrong[i], wrong[j]) if wrong else bend",
            "bend + dot(wrong[i], wrong[j]) if wrong and i == j else bend",
            FORMS,
        ),
        ("left out", "bend + dot(wrong[i], wrong[j]) if wrong else bend", "bend", FORMS),
        (
            "at the stator's angle",
            "SplitAlgebra(zero, frame.angle if frame else None), [zero] * n",
            "SplitAlgebra(zero, None), [zero] * n",
            FORMS,
        ),
        (
            "transposed",
            "values[n * k + i] for k in range(len(G))",
            "values[len(G) * i + k] for k in range(len(G))",
            FORMS,
        ),
    ),
    *of(
        "tolerance",
        "codegen/fast/dependent_rows.py",
        (
            "never asked",
            "sum(axis=0)):\n            return False",
            "sum(axis=0)):\n            return True",
            TEXT,
        ),
    ),
    *of(
        "tolerance",
        "codegen/fast/frame.py",
        ("G not asked", "for column in model.G.values()]", "for column in ()]", TEXT),
    ),
    *of(
        "tolerance",
        "codegen/render/equations.py",
        ("derivative left out of the report", "if not column[i].is_zero()\n    }", "if i == 0\n    }", TEXT),
    ),
)
