"""The equations against outside knowledge: SymPy, finite differences, limits, and an ODE solver."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from codegen.render.equations import equations
from model.drives.load import load_drive
from model.machines import MACHINES, Machine
from model.machines.base import Parameters, Rotor
from model.machines.state_space import build
from model.quantities import Constants
from model.schema import Drive
from runtime.proof.derivation import compare_derivations, second_statement
from tests.conftest import ALL_DRIVES, EVERY_DRIVE, variant

pytestmark = pytest.mark.unit


@pytest.mark.slow
@pytest.mark.parametrize("discretization", ["euler", "exact"])
@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_sympy_derives_the_same_symbolically(name: str, discretization: str) -> None:
    drive = variant(load_drive(name), model={"discretization": discretization})
    link = compare_derivations(drive)
    assert link.passed
    n = len(build(drive).states)
    data, volts = _doubtful(drive)
    arriving = (2 + (3 if volts else 0)) if drive.inverter else 0  # v; and g, with how unsure it is
    assert sum(row.compared for row in link.rows) == n + 2 + n * n + 2 * n + arriving + (data + volts) * n


def _doubtful(drive: Drive) -> tuple[int, int]:
    """How many motor data may be wrong, both inductances counted, and ways in which the inverter's volts may be."""
    about, slow = drive.tolerance, drive.model.adaptive
    if about is None:
        return 0, 0
    single = sum(bool(getattr(about, word)) for word in ("stator_resistance", "magnet_flux") if word not in slow)
    inverter = bool(drive.inverter and about.dead_time and "dead_time_voltage" not in slow)
    return single + (2 if about.inductance else 0), 3 if inverter else 0


@pytest.mark.parametrize("discretization", ["euler", "exact"])
@pytest.mark.parametrize("name", ALL_DRIVES)
def test_sympy_derives_the_same_at_random_points(name: str, discretization: str) -> None:
    """Numbers catch what a symbolic zero test could simplify away; the generated model is the numeric one."""
    # Friction enough for T D / J = 1e-3: SymPy's formula, 1 - exp(-T D / J), is evaluated as it stands.
    drive = variant(load_drive(name), model={"discretization": discretization}, motor={"friction": 0.1})
    model = build(drive)
    outputs = [model.numeric(ca.densify(e)) for e in (model.f, model.h, model.F, model.H)]
    ours = ca.Function("ours", model.arguments, outputs)
    unmoved = [np.zeros(g.numel()) for g in model.arguments[2:]]  # which way a doubtful V_d acts moves no f
    words = drive.model
    x, f, h = second_statement(words.machine, discretization, words.mechanics, words.adaptive, words.return_rate)
    m = drive.motor
    numbers = {
        "R": m.stator_resistance,
        "L_d": m.inductance_d,
        "L_q": m.inductance_q,
        "psi_m": m.magnet_flux,
        "p": m.pole_pairs,
        "J": m.inertia,
        "D": m.friction,
        "T": drive.model.sample_time,
    }
    known = {sp.Symbol(key, real=True): value for key, value in numbers.items()}
    free = [*x, *sp.symbols("v_alpha v_beta", real=True)]
    value_of = sp.lambdify(free, list(f.xreplace(known)) + list(h.xreplace(known)), cse=True)
    n, small = len(x), 1e-100
    rng = np.random.default_rng(3)
    for _ in range(20):
        point, u = rng.normal(0, [1, 1, 100, 2, 5, 1, 1][: len(x)]), rng.normal(0, 100, 2)
        values = np.array(value_of(*point, *u), dtype=float)
        slopes = [np.imag(value_of(*(point + 1j * small * np.eye(n)[k]), *u)) / small for k in range(n)]
        theirs = np.column_stack([values, *slopes])  # of f, then of h; derivatives by complex steps
        f_mine, h_mine, F_mine, H_mine = map(np.array, ours(point, u, *unmoved))
        mine = np.block([[f_mine, F_mine], [h_mine, H_mine]])
        np.testing.assert_allclose(mine, theirs, rtol=1e-11, atol=1e-11)


def test_second_derivation_notices_a_wrong_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    original = MACHINES["surface"].euler

    def flipped(self: Machine, z, v, omega_e, theta):  # type: ignore[no-untyped-def]
        return original(self, z, v, -omega_e, theta)

    monkeypatch.setattr(MACHINES["surface"], "euler", flipped)
    assert not compare_derivations(load_drive("paper_spmsm")).passed


def test_jacobians_against_finite_differences(drive: Drive) -> None:
    model = build(drive)
    values = ca.Function(
        "values", [model.x, model.u], [model.numeric(ca.densify(e)) for e in (model.f, model.h, model.F, model.H)]
    )
    x, u, step = np.array([0.4, -0.3, 80.0, 1.1, 2.0, 0.3, 3.0])[: len(model.states)], np.array([50.0, -20.0]), 1e-6
    _, _, F, H = (np.array(v) for v in values(x, u))
    for k in range(len(x)):
        shift = step * np.eye(len(x))[k]
        up, down = values(x + shift, u), values(x - shift, u)
        np.testing.assert_allclose(F[:, k], (np.array(up[0] - down[0]) / (2 * step)).ravel(), rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(H[:, k], (np.array(up[1] - down[1]) / (2 * step)).ravel(), rtol=1e-6, atol=1e-7)


def test_euler_of_the_surface_machine_is_the_generic_one() -> None:
    """Eq. 7 as written in the class equals z + T dz/dt of eq. 1."""
    par = Parameters.symbolic()
    machine = MACHINES["surface"](par, Constants(named=False))
    z, v, w, th = (ca.SX.sym("a"), ca.SX.sym("b")), (ca.SX.sym("c"), ca.SX.sym("d")), ca.SX.sym("w"), ca.SX.sym("th")
    special, generic = machine.euler(z, v, w, th).z, Machine.euler(machine, z, v, w, th).z
    from model.to_sympy import to_sympy

    difference = to_sympy(ca.vertcat(*special)) - to_sympy(ca.vertcat(*generic))
    assert sp.simplify(difference) == sp.zeros(2, 1)


def test_salient_flux_with_equal_inductances_is_the_surface_machine() -> None:
    """With psi = L i + psi_m e^(j theta), both machines have the same voltage equation and the same currents."""
    par = Parameters.symbolic()
    equal = Parameters(**{**par.__dict__, "L_q": par.L_d})
    flux, surface = (MACHINES[name](equal, Constants(named=False)) for name in ("salient_flux", "surface"))
    i, v = (ca.SX.sym("i_a"), ca.SX.sym("i_b")), (ca.SX.sym("v_a"), ca.SX.sym("v_b"))
    w, th = ca.SX.sym("w"), ca.SX.sym("th")
    rotor = Rotor.at(th)
    psi = flux.electrical_state(i, rotor)
    d_psi = flux.derivative(psi, v, w, rotor)
    d_i = surface.derivative(i, v, w, rotor)
    from model.to_sympy import to_sympy

    torque = to_sympy(ca.SX(flux.torque(psi, rotor) - surface.torque(i, rotor)))
    assert sp.simplify(torque[0, 0]) == 0
    magnet_turning = (-par.psi_m * w * ca.sin(th), par.psi_m * w * ca.cos(th))
    for k in range(2):
        voltage = to_sympy(ca.SX(d_psi[k] - (par.L_d * d_i[k] + magnet_turning[k])))
        current = to_sympy(ca.SX(flux.currents(psi, rotor)[0][k] - i[k]))
        assert sp.simplify(voltage[0, 0]) == 0
        assert sp.simplify(current[0, 0]) == 0


def _error(drive: Drive, T: float, discretization: str | None = None, omega: float = 100.0) -> float:
    """Electrical error after 2 ms at constant speed, against DOP853 of the machine's own derivative."""
    settings = {
        "sample_time": T,
        "discretization": discretization or "exact",
        "mechanics": "constant_speed",
        "adaptive": [],
    }
    drive = variant(drive, model=settings, motor={"friction": 0.0})
    model = build(drive)
    step = ca.Function("step", model.arguments, [model.numeric(model.f)])
    machine = MACHINES[drive.model.machine](Parameters.numeric(drive), Constants(named=False))
    z, t = ca.SX.sym("z", 2), ca.SX.sym("t")
    theta_0 = 0.4
    omega_e = drive.motor.pole_pairs * omega
    v = (40.0, -25.0)
    slope = ca.Function(
        "slope", [t, z], [ca.vertcat(*machine.derivative((z[0], z[1]), v, omega_e, Rotor.at(theta_0 + omega_e * t)))]
    )
    start = np.array(
        [
            *np.array(
                ca.Function("z0", [], [ca.vertcat(*machine.electrical_state((2.0, 1.0), Rotor.at(ca.SX(theta_0))))])()[
                    "o0"
                ]
            ).ravel()
        ]
    )
    exact = solve_ivp(
        lambda t, z: np.array(slope(t, z)).ravel(), (0, 2e-3), start, method="DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    x, unmoved = np.array([*start, omega, theta_0]), [np.zeros(g.numel()) for g in model.arguments[2:]]
    for _ in range(round(2e-3 / T)):
        x = np.array(step(x, np.array(v), *unmoved)).ravel()
    return float(np.max(np.abs(x[:2] - exact)))


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_exact_is_second_order(name: str) -> None:
    drive = load_drive(name)
    errors = [_error(drive, T) for T in (1e-4, 5e-5, 2.5e-5)]
    for coarse, fine in itertools.pairwise(errors):
        assert 3.6 < coarse / fine < 4.4, errors


@pytest.mark.parametrize("name", ["ipmsm_flux", "ipmsm"])
def test_exact_beats_explicit_midpoint_and_euler(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A closed form must earn its place: less error than the generic midpoint rule, with half its sines."""
    drive = load_drive(name)
    exponential, euler = _error(drive, 1e-4), _error(drive, 1e-4, "euler")
    monkeypatch.setattr(MACHINES[drive.model.machine], "exact", Machine.exact)
    midpoint = _error(drive, 1e-4)
    if name == "ipmsm_flux":  # with currents as states the rule is there for stiff windings and equals the surface's
        assert exponential < 0.75 * midpoint, (exponential, midpoint)
    assert exponential < 0.05 * euler, (exponential, euler)


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_exact_is_exact_at_standstill(name: str) -> None:
    assert _error(load_drive(name), 1e-3, omega=0.0) < 1e-9


def test_equations_keep_their_letters(drive: Drive) -> None:
    names = {str(symbol) for symbol in equations(drive).f.free_symbols}
    assert {"T", "R", "p", "omega", "theta"} <= names
