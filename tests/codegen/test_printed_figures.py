"""Every printed figure, bound, size and unit against what it is said to be, found by another way.

A folder is generated in memory with figures of which no two are alike (certificates, stack, code), so that two
columns, rows or labels that are exchanged show; costs are recomputed from the printed operations, sizes from the
printed structs, certificates by a loop over single samples.
"""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen.evidence.box import sample_box
from codegen.evidence.certificate import Certificate, certify, certify_chip
from codegen.evidence.fpu32 import FPU32, Flushed
from codegen.evidence.ledger import RECIPROCAL, Program
from codegen.evidence.recording import execute
from model.drives.load import load_drive
from model.machines.state_space import build
from runtime.estimator.folder import GENERATED
from tests.codegen.printed import CLOCK, DRIVES, KS, OPERATIONS, Made, make, price, subjects


@pytest.fixture(params=DRIVES)
def made(request: pytest.FixtureRequest) -> Made:
    return make(request.param)


# --- cost


def test_operations_are_those_of_the_text(made: Made) -> None:
    table = made.table("step", "add", "mul")
    assert table["step"] == OPERATIONS
    for row, function, facts, _ in subjects(made):
        stem = function.removesuffix("_foc_step").removesuffix("_step")
        program = Program(made.files, f"{stem}.c", f"{stem}_foc.c")
        counted = program.count(function, made.drive.filter.max_iterations)
        assert [int(cell) for cell in table[row]] == [counted[name] for name in OPERATIONS]
        assert facts["operations"] == {name: counted[name] for name in (*OPERATIONS, RECIPROCAL)}
    assert made.facts["filters"]["ckf"]["operations"]["add"] < made.facts["filters"]["ckf"]["controller"][
        "operations"]["add"]  # fmt: skip
    assert f"every loop over N_max taken {made.drive.filter.max_iterations} times" in made.report


def test_a_whole_interrupt_costs_what_its_mode_asks_for(made: Made) -> None:
    """In report, manifest and the drive's head: filter, controller and supervisor; in STARTING the rival's step."""
    table, T = made.table("filter, mode", "add", "mul"), made.drive.model.sample_time
    modes = {"CATCHING": 3, "RUNNING": 4} | ({"STARTING": 6} if T >= 50e-6 else {})
    assert [*table] == ["filter, mode", *(f"{kind}, {mode}" for kind in made.drive.filter.kinds for mode in modes)]
    for kind in made.drive.filter.kinds:
        stem, n = f"{made.drive.name}_{kind}", made.drive.filter.max_iterations
        program = Program(made.files, *(f"{stem}{end}.c" for end in ("", "_foc", "_supervisor", "_drive")))
        facts, record = made.facts["filters"][kind], made.measured[f"{stem}_drive_step"]
        filter_step, controller = (program.count(f"{stem}{end}", n) for end in ("_step", "_foc_step"))
        assert [*facts["interrupt"]] == [*modes]
        for mode, place in modes.items():
            given = {"mode": place, "runs": 1, "torque": int(mode != "CATCHING"), "rivals": int(mode == "STARTING")}
            ops, found = program.count(f"{stem}_drive_step", n, given=given), facts["interrupt"][mode]
            assert {name: ops[name] for name in found["operations"]} == found["operations"]
            least = controller + filter_step if mode == "STARTING" else controller
            assert all(least[name] <= ops[name] for name in OPERATIONS), mode
            beside = filter_step["mul"] if mode != "STARTING" else 140  # supervisor, square wave, limits of torque
            assert ops["mul"] < least["mul"] + beside
            copied = 3 * program.find(f"{stem}_step")[0].words(f"{stem}_t") if mode == "STARTING" else 0
            assert ops["copied"] == copied
            cycles = [price(found["operations"], k) + copied for k in KS]
            assert found["cycles"] == dict(zip(("2.5", "4", "5"), cycles, strict=True))
            assert found["share_of_sample"] == pytest.approx(cycles[0] / (CLOCK * T), abs=1e-4)
            cells = table[f"{kind}, {mode}"]
            assert [int(cell) for cell in cells[:10]] == [*(ops[name] for name in OPERATIONS), copied]
            assert [int(cell) for cell in cells[10].split(" / ")] == cycles
            assert [int(cell) for cell in cells[11].split(" / ")] == [round(100 * c / round(CLOCK * T)) for c in cycles]
            assert (
                int(cells[12]) == found["state_words"] == program.find(f"{stem}_drive_step")[0].words(f"{stem}_drive_t")
            )
            assert cells[13:] == [str(record["stack_bytes"]), str(record["text_bytes"])]
            head = f"a whole interrupt, {mode}: {ops['add']} add, {ops['mul']} mul, {ops['div']} div"
            assert head in made.words(f"{stem}_drive.c")


def test_cycles_are_the_sum_of_prices(made: Made) -> None:
    table = made.table("step", "cycles, k = 2.5 / 4 / 5")
    T = made.drive.model.sample_time
    periods = [("10 kHz", 1e-4), ("20 kHz", 5e-5), ("50 kHz", 2e-5), (f"T = {T * 1e6:g} us", T)]
    assert table["step"][1:] == [f"% of {name} ({CLOCK * period:.0f})" for name, period in periods]
    for row, _, facts, _ in subjects(made):
        cycles = [price(facts["operations"], k) for k in KS]
        assert facts["cycles"] == dict(zip(("2.5", "4", "5"), cycles, strict=True))
        assert facts["estimated_cycles"] == cycles[0]
        cells = [[int(value) for value in cell.split(" / ")] for cell in table[row]]
        shares = [[round(100 * value / round(CLOCK * period)) for value in cycles] for _, period in periods]
        assert cells == [cycles, *shares]
    assert "`k (add + mul + compare + select) + 25 div + 29 sqrt + 7 branch + 12 call + 60`" in made.report
    assert "TI's fastRTS figures for division and root, and 60 for the interrupt" in made.report
    assert "at 150 MHz, for the three k in turn" in made.report


def test_the_heads_of_the_c_say_what_the_manifest_says(made: Made) -> None:
    for row, function, facts, struct in subjects(made):
        text, ops = made.words(f"{struct.removesuffix('_t')}.c"), facts["operations"]
        title = "Cost at most, with the filter" if "controller" in row else "Cost at most"
        counts = ", ".join(f"{ops[name]} {name}" for name in OPERATIONS if name != "sincos")
        says = (
            f"{title}: {counts}; estimated {price(ops, 2.5)} cycles on C28x + FPU32 (k = 2.5; "
            f"{price(ops, 5)} at k = 5; from published cycles, not measured), {facts['state_words']} words of state."
        )
        assert says in text, function


def test_what_takes_longer_than_the_sample_time_is_said(made: Made) -> None:
    """In one sentence, each with its share."""
    period, late = CLOCK * made.drive.model.sample_time, []
    for kind in made.drive.filter.kinds:
        facts = made.facts["filters"][kind]
        costs = {kind: facts, f"{kind} and controller": facts["controller"]}
        costs |= {f"{kind}, {mode}": found for mode, found in facts["interrupt"].items()}
        shares = {what: found["cycles"]["2.5"] / period for what, found in costs.items()}
        late += [f"{what} ({100 * share:.0f} %)" for what, share in shares.items() if share > 1]
    limit = f"T = {made.drive.model.sample_time * 1e6:g} us"
    assert late
    assert f"**Longer than {limit}, at the worst and by this estimate (k = 2.5): {', '.join(late)}.**" in made.report
    assert "every step ends within" not in made.report


def struct_words(made: Made, struct: str) -> int:
    """16-bit words by hand: floats take two, int and pointers as the C28x has them; even addresses for 32 bits."""
    text = re.sub(r"/\*.*?\*/", "", made.files[f"{struct.removesuffix('_t')}.h"], flags=re.DOTALL)
    body = re.search(rf"typedef struct \{{([^}}]*)\}} {struct};", text)
    assert body is not None
    offset = 0
    for kind, size in re.findall(r"(\w+) \w+(?:\[(\d+)\])?;", body[1]):
        one = {"float32": 2, "int": 1}.get(kind) or struct_words(made, kind)
        offset += (offset % 2 if kind != "int" else 0) + one * int(size or 1)
    return offset + offset % 2


def test_ram_stack_and_code_stand_in_their_columns(made: Made) -> None:
    table = made.table("step", "RAM, words", "stack, bytes (M4F)", "code, bytes (M4F)")
    assert len(table["step"]) == 3
    for row, function, facts, struct in subjects(made):
        words = struct_words(made, struct)
        record = made.measured[function]
        assert [int(cell) for cell in table[row]] == [words, record["stack_bytes"], record["text_bytes"]]
        assert facts["state_words"] == words
        assert made.facts["measured"][function] == record
    assert "measured on a stand-in, arm-none-eabi-gcc 9.8.7 `-mcpu=cortex-m4" in made.report
    assert "not measured:" not in made.report
    assert "(float32 2, int 1, 32-bit fields on even addresses)" in made.report


def test_the_budget_is_the_drive_files(made: Made) -> None:
    limits = {key: value for key, value in made.drive.budget.model_dump().items() if value is not None}
    if len(limits) > 1:
        said = ", ".join(f"{key} = {value}" for key, value in limits.items())
        assert f"The drive file allows: {said}; `generate` fails beyond." in made.report
    else:
        assert "The drive file sets no limits" in made.report


# --- how far float32 can be trusted


def two_digits(value: float) -> str:
    return f"{value:.1e}"


def row_of(certificate: Certificate) -> list[str]:
    numbers = [*certificate.x, certificate.P_99, certificate.P]
    return [*(two_digits(v) for v in numbers), str(certificate.not_finite), str(certificate.indefinite)]


def test_each_certificate_stands_in_its_row(made: Made) -> None:
    units = [f"{state['name']}, {state['unit']}" for state in made.facts["states"]]
    tail = ["P, 99 %", "P, worst", "not finite", "indefinite"]
    host, chip = made.table("filter", units[0]), made.table("filter, arithmetic", units[0])
    assert host["filter"] == chip["filter, arithmetic"] == [*units, *tail]
    for kind, figures in made.figures.items():
        assert host[kind] == row_of(figures.certificate)
        assert chip[f"{kind}, chip"] == row_of(figures.chip.fpu32)
        assert chip[f"{kind}, flush to zero alone"] == row_of(figures.chip.flushed)
        facts = made.facts["filters"][kind]
        for said, certificate in (
            (facts["certificate"], figures.certificate),
            (facts["chip_model"]["fpu32"], figures.chip.fpu32),
            (facts["chip_model"]["flushed"], figures.chip.flushed),
        ):
            assert said == {
                "samples": 2345,
                "x": [float(two_digits(v)) for v in certificate.x],
                "P_99": float(two_digits(certificate.P_99)),
                "P": float(two_digits(certificate.P)),
                "not_finite": certificate.not_finite,
                "indefinite": certificate.indefinite,
            }
    box = made.drive.operating_box
    assert (
        f"worst of 2345 draws from the operating box (|i| <= {box.current:g} A, |v| <= {box.voltage:g} V, "
        f"|omega| <= {box.speed:g} rad/s;"
    ) in made.report


def test_the_heads_of_the_c_quote_their_certificate(made: Made) -> None:
    states = made.facts["states"]

    def says(certificate: Certificate) -> str:
        each = [f"{s['name']} {two_digits(v)} {s['unit']}" for s, v in zip(states, certificate.x, strict=True)]
        return f"{', '.join(each)}, P {two_digits(certificate.P)} relative (99 %: {two_digits(certificate.P_99)})"

    for kind, figures in made.figures.items():
        text = made.words(f"{made.drive.name}_{kind}.c")
        host = "float32 against float64, one step, worst of 2345 draws from the operating box"
        assert f"{host}: {says(figures.certificate)}." in text
        assert f"are expected to add {says(figures.chip.fpu32)} (modelled, not measured;" in text
        assert "float32 against float64" not in made.words(f"host/{made.drive.name}_{kind}_f64.c")


@pytest.mark.parametrize("name", DRIVES)
def test_certificates_are_the_worst_of_single_steps(name: str) -> None:
    """One sample after the other, and the worst kept by hand."""
    drive = load_drive(name)
    module = execute((GENERATED / name / f"{name}.py").read_text(encoding="utf-8"), "m")
    box, kind = sample_box(drive, build(drive), 40), drive.filter.kinds[-1]
    single, double, chip, flushed = (
        [one(module, kind, box, k, dtype, number) for k in range(40)]
        for dtype, number in (("float32", None), ("float64", None), ("float32", FPU32), ("float32", Flushed))
    )
    model = certify_chip(module, kind, box)
    for found, runs, against in (
        (certify(module, kind, box), single, double),
        (model.fpu32, chip, single),
        (model.flushed, flushed, single),
    ):
        x_off, P_off = np.zeros(len(found.x)), []
        for (x, P), (x_2, P_2) in zip(runs, against, strict=True):
            off = np.abs(x - x_2)
            off[3] = min(off[3], 2 * np.pi - off[3])
            x_off = np.maximum(x_off, off)
            sigma = np.sqrt(np.diag(P_2))
            P_off.append(np.max(np.abs(P - P_2) / np.outer(sigma, sigma)))
        ordered = sorted(P_off)
        assert found.samples == 40
        assert found.x == pytest.approx(x_off.tolist(), rel=1e-6)
        assert pytest.approx(ordered[-1], rel=1e-6) == found.P
        assert pytest.approx(ordered[-2] + 0.61 * (ordered[-1] - ordered[-2]), rel=1e-6) == found.P_99
        assert (found.not_finite, found.indefinite) == (0, 0)
    assert certify(module, kind, box).P > 0
    assert model.fpu32.P > 0


def one(module: dict[str, Any], kind: str, box: Any, k: int, dtype: str, number: Any) -> tuple[np.ndarray, np.ndarray]:
    """x and P after one step from one sample."""
    math, n = module["MATH"][dtype], len(module["STATES"])
    to = (lambda v: number(math.dtype(v))) if number else math.dtype
    state = SimpleNamespace(
        **{
            key: tuple(to(v) for v in value) if isinstance(value, tuple) else to(value)
            for key, value in module["DEFAULTS"].items()
            if key != "max_iterations"
        },
        max_iterations=module["DEFAULTS"]["max_iterations"],
    )
    P = np.zeros((n, n))
    P[np.tril_indices(n)] = box.P[:, k]
    words = np.float32(module["pack"](P + np.tril(P, -1).T))
    state.x = tuple(to(v) for v in box.x[:, k])
    setattr(state, module["COVARIANCE"], tuple(to(v) for v in words))
    state.u_held, state.nis, state.repairs = (to(0), to(0)), to(0), 0
    with np.errstate(all="ignore"):
        module["STEPS"][kind](state, [to(v) for v in box.u[:, k]], [to(v) for v in box.y[:, k]], math)
    words = np.array([float(v) for v in getattr(state, module["COVARIANCE"])])
    return np.array([float(v) for v in state.x]), module["unpack"](words)


def test_what_is_no_covariance_is_counted() -> None:
    """A step that leaves, in float32 alone, two lanes that are no number and three with a negative variance."""
    n, lanes = 4, 10

    def step(state: Any, u: Any, y: Any, math: Any) -> int:
        if math.dtype is np.float32:
            x = np.array(state.x)
            x[1, :2] = np.nan
            state.x = tuple(x)
            words = np.array(state.P)
            words[0, 5:8] *= -1
            state.P = tuple(words)
        return 0

    rows, columns = np.tril_indices(n)

    def unpack(words: np.ndarray) -> np.ndarray:
        P = np.zeros((n, n, *words.shape[1:]))
        P[rows, columns] = P[columns, rows] = words
        return P

    module = {
        "MATH": {d: SimpleNamespace(dtype=getattr(np, d)) for d in ("float32", "float64")},
        "STATES": ("a", "b", "c", "d"),
        "COVARIANCE": "P",
        "ANGLE": 3,
        "DEFAULTS": {},
        "new_filter": lambda dtype: SimpleNamespace(),
        "STEPS": {"k": step},
        "pack": lambda P: P[rows, columns],
        "unpack": unpack,
    }
    eye = np.repeat(np.eye(n)[rows, columns][:, None], lanes, axis=1)
    box = SimpleNamespace(x=np.zeros((n, lanes)), P=eye, u=np.zeros((2, lanes)), y=np.zeros((2, lanes)))
    found = certify(module, "k", box)  # type: ignore[arg-type]
    assert (found.samples, found.not_finite, found.indefinite) == (lanes, 2, 3)


def test_draws_fill_the_box_and_no_more() -> None:
    """Within the declared box, near its edges, sigmas from the process noise to twice P_0."""
    for name in ("paper_spmsm", "ipmsm_flux", "spmsm_load_torque"):
        drive = load_drive(name)
        model, box = build(drive), drive.operating_box
        draws = sample_box(drive, model, 2000)
        n = len(model.states)
        P = np.zeros((2000, n, n))
        P[:, *np.tril_indices(n)] = draws.P.T
        sigma = np.sqrt(np.einsum("bii->bi", P))
        low, high = np.sqrt(drive.filter.process_noise), np.sqrt(drive.filter.initial_covariance)
        assert np.all(sigma >= 0.99 * np.minimum(low, high))
        assert np.all(sigma <= 2.02 * np.maximum(low, high))
        assert np.all(np.max(sigma, 0) > 0.8 * np.maximum(low, high))
        assert 0.97 * box.speed < np.max(np.abs(draws.x[2])) <= box.speed * (1 + 1e-6)
        assert 3.1 < np.max(np.abs(draws.x[3])) <= np.pi
        assert np.max(np.min(draws.u, 1)) < -0.97 * box.voltage
        assert np.min(draws.x[2]) < -0.97 * box.speed
        assert np.max(draws.x[2]) > 0.97 * box.speed
        assert 0.97 * box.voltage < np.min(np.max(np.abs(draws.u), 1)) <= np.max(np.abs(draws.u)) <= box.voltage
        assert np.max(np.abs(draws.y)) <= box.current
        if name == "paper_spmsm":
            assert 0.68 * box.current < np.max(np.abs(draws.x[:2])) <= 0.7 * box.current
        if name == "spmsm_load_torque":
            assert 0.97 * box.load_torque < np.max(np.abs(draws.x[4])) <= box.load_torque
        correlation = P / (sigma[:, :, None] * sigma[:, None, :])
        assert np.max(np.abs(correlation[:, 1, 0])) > 0.8
        assert np.min(np.abs(correlation[:, 1, 0])) < 0.05


def test_sine_cosine_and_small_angles_are_within_the_printed_bounds(made: Made) -> None:
    """The module's own functions at other arguments, against the library's float64."""
    name = made.drive.name
    texts = [made.words(f"{name}_ckf.c"), made.words(f"{name}_ckf_foc.c")]
    pattern = r"Error for \|x\| <= (\w+), as wrap_angle leaves it: proved (\S+), worst of (\d+) arguments (\S+)\."
    said = {re.search(pattern, text).groups() for text in texts}  # type: ignore[union-attr]
    report = re.search(r"\|x\| <= (\w+)\): error proved <= (\S+), worst of (\d+) arguments (\S+)\.", made.report)
    assert report is not None
    assert said == {report.groups()}
    limit, *words = report.groups()
    proved, samples, seen = (float(word) for word in words)
    assert (limit, samples) == ("pi", 500_002)
    module = execute(made.files[f"{name}.py"], "m")
    x = np.random.default_rng(5).uniform(-np.pi, np.pi, 300_000).astype(np.float32)
    exact = np.sin(x.astype(float)), np.cos(x.astype(float))
    worst = max(np.max(np.abs(a - b)) for a, b in zip(module["MATH"]["float32"].sin_cos(x), exact, strict=True))
    assert 0.8 * seen <= worst <= 1.25 * seen
    assert worst <= proved <= 5 * worst
    if "How far a column of L turns" not in texts[0]:
        return
    small = re.search(
        r"from z = d\^2 / (\d).*?for d up to (\S+) rad; WIDE_ ones for d up to pi\. "
        r"Error proved: sinc (\S+), cosm1 (\S+) of d\^2 / 2; wide (\S+), (\S+)\.",
        texts[0],
    )
    assert small is not None
    n, widest, *bounds = (float(word) for word in small.groups())
    limit = re.search(r"#define SMALL_TURN (\S+)f", made.files[f"{name}_ckf.c"])
    assert limit is not None
    assert widest == pytest.approx((n * float(limit[1])) ** 0.5, rel=0.01)
    for word, end, proved in (("turn", 0.99 * widest, bounds[:2]), ("wide_turn", np.pi, bounds[2:])):
        z = np.linspace(1e-4, end**2 / n, 20_000).astype(np.float32)
        d = np.sqrt(n * z.astype(float))
        sinc, cosm1 = getattr(module["MATH"]["float32"], f"{word}_{n:g}")(z)
        off = np.max(np.abs(sinc - np.sin(d) / d)), np.max(np.abs(cosm1 + 2 * np.sin(d / 2) ** 2) / (d**2 / 2))
        for bound, worst in zip(proved, off, strict=True):
            assert worst <= bound <= 6 * worst
