"""Wrong noise of motor data that may be wrong: [tolerance], from the drive file to both forms."""

from __future__ import annotations

from tests.mutants.catalogue.rewriting import of

DRAWN = ("pytest tests/model/test_tolerance.py",)
TEXT = ("pytest tests/codegen/test_tolerance.py",)
FORMS = ("pytest tests/runtime/test_tolerance.py -k 'both_forms and paper_spmsm and (ckf or ekf)'",)
NOTICED = ("noticed tests/runtime/test_tolerance.py -k 'both_forms and paper_spmsm and ckf'",)
OWN = ("pytest tests/runtime/test_tolerance.py -k ones_own",)

TOLERANCE = (
    *of(
        "tolerance",
        "model/machines/tolerance.py",
        ("variance of the half-width itself", "/ drive.model.sample_time / 3)", "/ drive.model.sample_time)", DRAWN),
        ("one sample for two", "math.sqrt(2 * stated", "math.sqrt(stated", DRAWN),
        ("variance for deviation", "alike = math.sqrt(2 *", "alike = (2 *", DRAWN),
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
