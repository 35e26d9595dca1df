"""States, constants, times and units as they are printed, against the drive file and the model."""

from __future__ import annotations

import json
import re

import casadi as ca
import numpy as np
import pytest

from codegen.evidence.recording import execute
from model.machines.state_space import build, default_initial_state
from tests.codegen.printed import DRIVES, Made, make


@pytest.fixture(params=DRIVES)
def made(request: pytest.FixtureRequest) -> Made:
    return make(request.param)


# --- states, constants, times, units


def test_states_and_their_data_stand_in_their_columns(made: Made) -> None:
    drive, model = made.drive, build(made.drive)
    rows = next(table for table in made.tables if table[0][1:3] == ["state", "unit"])
    assert rows[0] == ["", "state", "unit", "meaning", "x_0", "P_0", "Q per step"]
    x_0 = default_initial_state(drive)
    for k, row in enumerate(rows[1:]):
        state = model.states[k]
        numbers = [f"{value[k]:g}" for value in (x_0, drive.filter.initial_covariance, drive.filter.process_noise)]
        assert row == [str(k), f"`{state.name}`", state.unit, state.meaning, *numbers]
    names = [row[1].strip("`") for row in rows[1:]]
    assert names[2:4] == ["omega", "theta"]
    assert [row[2] for row in rows[3:5]] == ["rad/s", "rad"]
    first = ("psi_alpha", "Wb") if drive.model.machine == "salient_flux" else ("i_alpha", "A")
    assert (names[0], rows[1][2]) == first
    R = ", ".join(str(value) for value in drive.filter.measurement_noise)
    assert f"Measured: `i_alpha`, `i_beta` in A, noise variances R = {R} A^2." in made.report
    facts = made.facts
    assert facts["states"] == [{"name": s.name, "unit": s.unit} for s in model.states]
    assert facts["parameters"] == json.loads(json.dumps(drive.model_dump(exclude={"sha256", "name"})))


def test_the_sample_time_is_said_everywhere_alike(made: Made) -> None:
    T, name = made.drive.model.sample_time, made.drive.name
    said = f"T = {1e6 * T:.0f} us"
    around = [f"{name}_ckf_{part}.{end}" for part in ("supervisor", "drive") for end in "hc"]
    for file in (f"{name}_ckf.h", f"{name}_ckf.c", f"{name}_ckf_foc.h", *around, f"{name}.py", "REPORT.md"):
        assert said in made.files[file][:700], file
        assert not re.search(r"T = (?!" + said[4:] + r")[\d.e+-]+ \w?s\b", made.files[file][:700])
    assert f"once every {1e6 * T:.0f} us" in made.files["example_isr.c"]
    said = re.search(
        r"#define TURN_PER_SAMPLE (\S+)f /\* p T, rad electrical per rad/s \*/", made.files[f"{name}_ckf_supervisor.c"]
    )
    assert said is not None
    assert float(said[1]) == pytest.approx(made.drive.motor.pole_pairs * T)
    module = execute(made.files[f"{name}.py"], "m")
    assert module["SAMPLE_TIME"] == T
    assert "SAMPLE_TIME = " + repr(T) + "  # s" in made.files[f"{name}.py"]


def test_iteration_is_told_as_it_is(made: Made) -> None:
    drive = made.drive
    if drive.name == "paper_spmsm":
        assert "**Proved idle.**" in made.report
        assert "tolerance; /* eps of (33); unused here" in made.files[f"{drive.name}_ickf.h"]
    else:
        said = f"at most N_max = {drive.filter.max_iterations} passes that ends early once (33) holds with eps = "
        assert f"{said}{drive.filter.tolerance}." in made.report
        assert "eps of (33) */" in made.files[f"{drive.name}_ickf.h"]
        assert "max_iterations; /* N_max */" in made.files[f"{drive.name}_ickf.h"]
    ickf = made.words(f"{drive.name}_ickf.c")
    assert f"Gain: {drive.filter.gain}. Iteration: " in ickf
    assert "Gain:" not in made.words(f"{drive.name}_ckf.c")


def test_entries_that_are_not_zero_are_counted(made: Made) -> None:
    """Central differences of f and h at random points."""
    model = build(made.drive)
    rng = np.random.default_rng(3)
    f = ca.Function("f", [model.x, model.u], [model.numeric(model.f)])
    h = ca.Function("h", [model.x], [model.numeric(model.h)])
    n = len(model.states)
    F, H = np.zeros((n, n)), np.zeros((2, n))
    for _ in range(5):
        x, u = rng.uniform(0.5, 2.0, n), rng.uniform(1, 2, 2)
        for k in range(n):
            d = 1e-4 * np.eye(n)[k]
            F[:, k] += np.abs(np.array(f(x + d, u) - f(x - d, u)).ravel())
            H[:, k] += np.abs(np.array(h(x + d) - h(x - d)).ravel())
    counts = int(np.sum(F > 1e-14)), int(np.sum(H > 1e-14))
    said = f"F has {counts[0]} of {n * n} entries that are not structurally zero, H {counts[1]} of {2 * n}."
    assert said in made.report


def test_constants_are_their_formulas(made: Made) -> None:
    """Of the names that both drives explain: values by hand from the drive file, in report and C."""
    m, T = made.drive.motor, made.drive.model.sample_time
    by_hand = {
        "POLE_PAIRS": m.pole_pairs,
        "SAMPLE_TIME": T,
        "DECAY_I": 1 - T * m.stator_resistance / m.inductance_d,
        "GAIN_V": T / m.inductance_d,
        "GAIN_E": T * m.magnet_flux / m.inductance_d,
        "DECAY_OMEGA": 1 - T * m.friction / m.inertia,
        "L_D": m.inductance_d,
        "L_Q": m.inductance_q,
        "PSI_M": m.magnet_flux,
    }
    if made.drive.model.discretization == "exact":
        for name in ("DECAY_I", "GAIN_V", "GAIN_E", "DECAY_OMEGA"):
            del by_hand[name]
    table = made.table("constant", "value", "formula")
    seen = 0
    for name, value in by_hand.items():
        if f"`{name}`" in table:
            assert float(table[f"`{name}`"][0]) == pytest.approx(value, rel=1e-9)
            seen += 1
        for text in (made.files[f"{made.drive.name}_ckf.c"], made.files[f"{made.drive.name}_ckf_foc.c"]):
            for found in re.findall(rf"^#define {name} (\S+)f ", text, re.MULTILINE):
                assert float(found) == pytest.approx(value, rel=1e-7)
    assert seen >= 2


#: Field of a struct: words of its comment that say the unit.
FILTER_UNITS = {
    "R": "measurement noise variances, A^2, each positive: 1e-18 .. 1e18",
    "Q": "process noise variances per step, each positive: 1e-18 .. 1e18",
    "u_max": "V: voltages beyond are rejected; 1e-18 .. 1e18: NaN rejects none",
    "y_max": "A: currents beyond are rejected; 1e-18 .. 1e18: NaN rejects none",
    "u_held": "V: last accepted voltages",
    "nis_max": "from this mean of the normalised innovation squared on; expected: 2",
}
CONTROLLER_UNITS = {
    "integrator": "speed N m, d and q current V, weakening A",
    "command_max": "speed reference rad/s, DC link V",
    "v_acting": "V: voltage of the interval that begins now",
    "v_queued": "V: with a sample of delay",
    "sensed": "speed rad/s mechanical, angle rad electrical",
    "delay": "0 or 1",
}
#: Of the supervisor's numbers: those of every drive, of one with a rival, and of one whose states are flux linkages.
LIMIT_UNITS = {
    "TRIP_SQUARED": "A^2",
    "ZERO_SQUARED": "A^2",
    "PROBE_SQUARED": "A^2",
    "PROBE_SPEED": "rad/s per A",
    "UNKNOWN_SPEED": "(rad/s)^2",
    "UNKNOWN_ANGLE": "rad^2",
    "CATCH_JOLT_SQUARED": "rad^2",
    "RUN_JOLT_SQUARED": "rad^2",
}
RIVAL_UNITS = {
    "WINDOW_TURN_SQUARED": "rad^2",
    "LEAST_TURN_SQUARED": "rad^2",
    "REST_SPEED": "(rad/s)^2",
    "MIRROR_SPEED": "(rad/s)^2",
    "START_ANGLE": "rad^2",
}
FLUX_UNITS = {"FLUX_SQUARED": "Wb^2"}
SUPERVISOR_UNITS = {"turning": "rad", "reading": "A", "spread": "variances of that speed and angle"}


def test_units_in_headers(made: Made) -> None:
    name = made.drive.name
    for kind in made.drive.filter.kinds:
        header, controller = made.files[f"{name}_{kind}.h"], made.files[f"{name}_{kind}_foc.h"]
        for text, units in ((header, FILTER_UNITS), (controller, CONTROLLER_UNITS)):
            for field, said in units.items():
                comment = re.search(rf"^ +\w+ {field}(?:\[\d\])?; /\* (.*) \*/", text, re.MULTILINE)
                assert comment is not None, field
                assert said in comment[1], field
        states = ", ".join(f"{s['name']} {s['unit']}" for s in made.facts["states"])
        assert f"float32 x[{len(made.facts['states'])}]; /* {states} */" in header
        words = " ".join(header.replace(" * ", " ").split())
        assert "u: v_alpha, v_beta in V, mean over the interval ending now; y: i_alpha, i_beta in A, now." in words
        words = " ".join(controller.replace(" * ", " ").split())
        assert (
            "phase: i_a, i_b in A; command: speed reference rad/s mechanical, DC link V; duty: phases a, b, c, 0..1"
            in words
        )
    supervisor, flux = made.files[f"{name}_ckf_supervisor.c"], name == "ipmsm_flux"
    for macro, unit in (LIMIT_UNITS | RIVAL_UNITS | FLUX_UNITS).items():
        found = re.search(rf"^#define {macro} \S+ /\* (.*) \*/$", supervisor, re.MULTILINE)
        assert (found is None) == (macro not in LIMIT_UNITS and not flux), macro
        if found is not None:
            assert re.search(rf"(?:^|, ){re.escape(unit)}(?::|,|$)", found[1]), macro
    for field, said in SUPERVISOR_UNITS.items():
        comment = re.search(rf"^ +float32 {field}\[\d\]; /\* (.*) \*/", made.files[f"{name}_ckf_supervisor.h"], re.M)
        assert comment is not None, field
        assert said in comment[1], field
    example, drive = made.files["example_isr.c"], made.words(f"{name}_ckf_drive.h")
    assert (
        "phase: i_a, i_b in A; command: speed reference rad/s mechanical, DC link V; duty: phases a, b, c, 0..1"
        in drive
    )
    for words in ("i_a, i_b in A, positive", "DC link in V", "Speed reference in rad/s, mechanical"):
        assert words in example
    for place, unit in enumerate(("rad/s mechanical", "electrical turn", "Hz electrical")):
        assert re.search(rf"words\[{place}\] = .*; +/\* {unit} \*/", example)


def test_tuning_in_the_c_is_the_drive_files(made: Made) -> None:
    """The numbers that _init loads: each number by its name, as float32."""
    drive = made.drive
    wanted = {
        **{f"Q[{k}]": v for k, v in enumerate(drive.filter.process_noise)},
        **{f"R[{k}]": v for k, v in enumerate(drive.filter.measurement_noise)},
        **{f"P_0[{k}]": v for k, v in enumerate(drive.filter.initial_covariance)},
        **{f"x_0[{k}]": v for k, v in enumerate(default_initial_state(drive))},
        "u_max": drive.operating_box.voltage,
        "y_max": drive.operating_box.current,
        "tolerance": drive.filter.tolerance,
        "max_iterations": drive.filter.max_iterations,
    }
    for kind in drive.filter.kinds:
        text = made.files[f"{drive.name}_{kind}.c"]
        found = dict(re.findall(r"f->(\w+(?:\[\d\])?) = ([-+.\de]+)f?;", text))
        for name, value in wanted.items():
            assert np.float32(found[name]) == np.float32(value), name
