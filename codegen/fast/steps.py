"""The filters in their fast form: x, L D L^T in; x, L D L^T out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca

from codegen.fast.dependent_rows import find_dependent_rows, follows
from codegen.fast.factored import Matrix, ScalarUpdates, decorrelated, factor, from_packed, to_packed
from codegen.fast.frame import turns_freely
from codegen.fast.guards import average, look_at_result, watch_pivots
from codegen.fast.measurement import Measurement
from codegen.fast.spread import SigmaPoints
from codegen.fast.tape import Tape
from codegen.fast.turns import split_turns, spread_of
from codegen.ir.covariance import place
from codegen.ir.expr import Expr, GraphBlock, GraphBuilder, dot, sum_of
from codegen.passes import PIPELINES, Pipelines, run_passes, weight
from model.filters.conditions import ACCEPTED
from model.filters.cubature import CUBATURE, Rule
from model.filters.ickf import idle_iteration_proof, iterate
from model.filters.inverter import f_inputs, inverter_calls
from model.filters.program import Call, Copy, FilterStep, Guard, If, Node, Repeat, Turns, wrap_angle
from model.filters.ukf import UNSCENTED
from model.machines.state_space import OUTPUTS, StateSpaceModel

Vector = list[Expr]

#: How a kind spreads its points; None: it does not, it takes derivatives.
RULES: dict[str, Rule | None] = {"ckf": CUBATURE, "ickf": CUBATURE, "ukf": UNSCENTED, "ekf": None}


@dataclass(frozen=True)
class Options:
    """Options of the fast form, switched off to see what each earns; blocks are to be laid out with the same pipelines.

    ``turning``: a turning frame, where it is cheaper. ``pipelines``: the passes by which forms are compared.
    """

    turning: bool = True
    pipelines: Pipelines = PIPELINES


EVERYTHING = Options()


def build_fast_filter(model: StateSpaceModel, kind: str, gain: str, options: Options = EVERYTHING) -> FilterStep:
    """The step of a filter, equal to :func:`model.filters.build_filter`'s up to rounding."""
    _ = model.constants  # which appear in one order then, whatever asks for them first
    if kind == "ickf":
        proof = idle_iteration_proof(model, iterate(model, gain))
    else:
        gain, proof = "cubature" if RULES[kind] else "jacobian", None
    builders = _builders(model, kind, gain, options)
    if kind == "ickf" and proof is None:
        *passes, finish = _cheapest([builder.loop() for builder in builders], options)
        *head, call = _calls(passes)
        assert not any(port.name == "x_j" for turns in head for port in turns.block.inputs), (
            "a turn that moves with x^j"
        )
        update: tuple[Node, ...] = (*head, Copy("x_j", "x_pred"), Repeat((call,)), Call(finish))
    else:
        forms = [split_turns(builder.measurement_update(), "_pred") for builder in builders]
        update = _calls(_cheapest(forms, options))
    time_update = _calls(_time_update(model, "ckf" if kind == "ickf" else kind, options))
    choice = If(ACCEPTED, (*update, average()), (Call(builders[0].coast()),))
    before: tuple[Node, ...] = (Guard(), *inverter_calls(model), *time_update)
    body: tuple[Node, ...] = (*before, watch_pivots(model), choice, *look_at_result(model), wrap_angle(model))
    return FilterStep(kind, gain, model, body, proof, covariance="LD")


def _calls(blocks: list[GraphBlock]) -> tuple[Call, ...]:
    """A block behind that of its small angles."""
    *turns, block = blocks
    return (*(Turns(angles, spread_of(angles)) for angles in turns), Call(block))


def _builders(model: StateSpaceModel, kind: str, gain: str, options: Options) -> list[FilterBuilder]:
    """The blocks' builders: in a turning frame, if f and h allow it, and in the stator's; of equals the first."""
    frames = (True, False) if options.turning and turns_freely(model) else (False,)
    return [FilterBuilder(model, kind, gain, RULES[kind], turning) for turning in frames]


@cache
def _time_update(model: StateSpaceModel, kind: str, options: Options) -> list[GraphBlock]:
    """The time update, which CKF and ICKF share, behind its turns."""
    builders = _builders(model, kind, "cubature", options)
    return _cheapest([split_turns(builder.time_update(), "") for builder in builders], options)


def _cheapest(forms: list[list[GraphBlock]], options: Options) -> list[GraphBlock]:
    """The form whose blocks compute their outputs with the least work."""

    def work(block: GraphBlock) -> int:
        graph, moved = run_passes(block.graph, block.roots, options.pipelines)
        return weight(graph, [moved[entry.node] for port in block.outputs for entry in port.entries])

    return min(forms, key=lambda blocks: sum(work(block) for block in blocks))


class FilterBuilder(SigmaPoints):
    """Builds the blocks of one filter of one model."""

    # --- blocks

    def time_update(self) -> GraphBlock:
        """Eq. 13-17 along the columns of L, and L D L^T of P_pred."""
        name = {"ckf": "time_update", "ickf": "time_update"}.get(self.kind, f"{self.kind}_time_update")
        number = self.equation
        b = GraphBuilder(name, f"Time update{', eq. 13-18' if self.is_paper else ' of the ' + self.kind.upper()}")
        x, L, D = self._inputs(b, "x", "LD", "", "")
        Q = b.input("Q", [f"Q_{i}" for i in range(self.n)])
        inputs = f_inputs(b, self.model)
        f, named = self.model.propagate(*map(ca.vertsplit, self.model.arguments))
        tape = Tape(self.model, self.model.arguments, f, named)
        here, frame = tape.at(b, [x, *inputs]), None
        if self.turning:
            frame = tape.frame(b, [x, *inputs])
        run = self.along(b, tape, x, L, D, inputs, number("15"), [f"{s}_next" for s in self.states], frame)
        columns = [[row[c] for row in L] for c in range(self.n)]
        turned = zip(*(frame.into(column) if frame else column for column in columns), strict=True)
        dependent = find_dependent_rows(b, tape, [x, *inputs], [list(row) for row in turned])
        wrong = self.wrong_data(b, [x, *inputs], frame)
        dependent = {i: row for i, row in dependent.items() if follows(row, i, self.model)}
        numbers = number("16"), number("17")
        offset, P = self.moments(b, run, D, numbers, self.states, dependent=dependent, wrong=wrong)
        shift = frame.out(offset) if frame else offset
        x_pred = [base + d for base, d in zip(here, shift, strict=True)]
        b.hint({f"{s}_of_x": value for s, value in zip(self.states, here, strict=True)})
        b.hint({f"{s}_mean": base + d for s, base, d in zip(self.states, run.base, offset, strict=True)})
        labels = [f"{s}_pred" for s in self.states]
        b.stage("x_pred", number("16"), "x_pred = mean X_i'", x_pred, labels, scale="state")
        if frame:
            named = {f"P_turned_{i}{j}": P[i][j] for i in range(self.n) for j in range(min(i + 1, 2))}
            b.stage("P_turned", number("17"), "", list(named.values()), list(named), scale="none")
            tilt = frame.tilt(P)
            b.hint({"P_tilt": tilt, "P_turn": frame.sine * tilt})
            P = frame.out_matrix(P)
        for i in range(self.n):
            P[i][i] = P[i][i] + Q[i]
        added = "Q + Q_p" if wrong else "Q"
        b.lower(
            "P_pred", number("17"), f"P_pred = mean (X_i' - x_pred)(X_i' - x_pred)^T + {added}", P, scale="covariance"
        )
        L_pred, D_pred, LD = factor(P, Q, self.model.order)
        self._name_factors(b, number("18"), "_pred", L_pred, D_pred)
        b.hint({f"LD_pred_{k}{j}": LD[i][j] for k, i in enumerate(self.model.order) for j in range(k)})
        check = sum_of(D_pred)
        b.stage("check", "", CHECK, [check], ["check"], scale="none")
        b.output("x_pred", x_pred)
        b.output("LD_pred", to_packed(L_pred, D_pred, self.model.order))
        b.output("check", [check])
        bends = [f"{label}_{self.states[0]}" for label in ("curv", "dev", "offset")]
        return b.build(last=("LD_pred", "P_turned", "P_pred", *bends, "x_pred", "check"))

    def measurement_update(self) -> GraphBlock:
        """Eq. 18-26, or for the ICKF eq. 28-34 where one pass is exact: scalar measurements in L D L^T."""
        title = "Measurement update of the " + self.kind.upper()
        if self.kind == "ckf":
            title = "Measurement update, eq. 18-26"
        elif self.kind == "ickf":
            title = "Measurement update, eq. 18 and 28-34 (H is constant: one pass is exact)"
        b = GraphBuilder(f"{self.kind}_measurement_update", title)
        x_pred, L, D = self._inputs(b, "x_pred", "LD_pred", "_pred", "_pred")
        R, y = self._measured(b)
        meas = self._measurement(b, x_pred, L, D, R, y)
        one_pass = self.kind == "ickf"
        number = self.equation("31" if one_pass else "25")
        b.stage(
            "innovation",
            number,
            f"y - y_pred{meas.where}",
            meas.innovation,
            _innovation_names(),
            scale="none",
        )
        x, state = self._take(b, number, x_pred, (L, D), meas)
        x = _read_off(x, x_pred, y, L, meas, state)
        if one_pass:
            b.stage("x_next", "31", "x^{j+1}", x, [f"{s}_after" for s in self.states], scale="state")
        self._close(b, x, state, ("34", "32") if one_pass else (self.equation("25"), self.equation("26")))
        b.stage("nis", "", "normalised innovation squared", [state.nis], ["nis"], scale="none")
        b.output("nis", [state.nis])
        return b.build()

    def loop(self) -> list[GraphBlock]:
        """One iterate, behind its turns, and what follows the last."""
        iterate, meas = self.iterate()
        return [*split_turns(iterate, "_pred"), self.finish(meas)]

    def iterate(self) -> tuple[GraphBlock, Measurement]:
        """One iterate, eq. 28-33; the covariance waits for the last one."""
        b = GraphBuilder("ickf_iterate", "One iterate, eq. 28-33")
        x_j = b.input("x_j", [f"{s}_j" for s in self.states])
        x_pred, L, D = self._inputs(b, "x_pred", "LD_pred", "_pred", "_pred")
        R, y = self._measured(b)
        back = [before - now for before, now in zip(x_pred, x_j, strict=True)]
        b.stage("back", "31", "x_pred - x^j", back, [f"deviation_{s}" for s in self.states], scale="none")
        meas = self._measurement(b, x_j, L, D, R, y, (x_pred, back))
        meaning = f"y - h(x^j) - H^j (x_pred - x^j){meas.where}"
        b.stage("innovation", "31", meaning, meas.innovation, _innovation_names(), scale="none")
        rows = meas.rows
        D_HL = [[d * f for d, f in zip(D, row, strict=True)] for row in rows]
        b.hint({f"D_HL_{k}{c}": entry for k, row in enumerate(D_HL) for c, entry in enumerate(row)})
        Pyy = [[dot(D_HL[i], rows[j]) + meas.noise[i][j] for j in range(i + 1)] for i in range(2)]
        entries = [Pyy[0][0], Pyy[1][0], Pyy[1][1]]
        b.stage("Pyy", "22", f"Pyy^j{meas.where}", entries, ["Pyy_00", "Pyy_10", "Pyy_11"], scale="none")
        weighted = _solved(Pyy, meas.innovation, meas.floor)
        b.stage(
            "weighted_innovation", "28", "Pyy^-1 innovation", weighted, ["Pyy_inv_nu_0", "Pyy_inv_nu_1"], scale="none"
        )
        along = [D_HL[0][c] * weighted[0] + D_HL[1][c] * weighted[1] for c in range(self.n)]
        b.stage("along", "31", "K innovation = L along", along, [f"along_{c}" for c in range(self.n)], scale="none")
        x_next = [x_pred[i] + dot(L[i], along) for i in range(self.n)]
        b.stage("x_next", "31", "x^{j+1}", x_next, [f"{s}_after" for s in self.states], scale="state")
        moved = [after - before for after, before in zip(x_next, x_j, strict=True)]
        b.stage("moved", "33", "x^{j+1} - x^j", moved, [f"step_{s}" for s in self.states], scale="none")
        change = dot(moved, moved)
        b.stage("change", "33", "|x^{j+1} - x^j|^2", [change], ["change"], scale="none")
        b.output("x_j", x_next)
        b.output("nis", [dot(meas.innovation, weighted)])
        for name, carried in meas.carried(self._lasting).items():
            b.output(name, list(carried.values()))
        b.output("change", [change])
        return b.build(), meas

    @property
    def _lasting(self) -> list[str]:
        """Inputs of an iterate that are the same after the last one."""
        return [*self._factor_names("_pred"), "R_0", "R_1"]

    def finish(self, last: Measurement) -> GraphBlock:
        """Eq. 32 and 34: the covariance of the last iterate, which saw ``last``."""
        b = GraphBuilder("ickf_finish", "Result of the last iterate, eq. 32 and 34")
        x = b.input("x_j", [f"{s}_j" for s in self.states])
        factors, R = b.input("LD_pred", self._factor_names("_pred")), b.input("R", ["R_0", "R_1"])
        L, D = from_packed(factors, self.model.order)
        given = dict(zip(self._lasting, [*factors, *R], strict=True))
        for name, entries in last.carried(self._lasting).items():
            given |= dict(zip(entries, b.input(name, list(entries)), strict=True))
        zero = x[0] * 0.0
        meas = last.in_block(b, given, [zero, zero], self._floor(R))
        x, state = self._take(b, "32", x, (L, D), meas)
        self._close(b, x, state, ("34", "32"))
        return b.build()

    def coast(self) -> GraphBlock:
        """A rejected measurement: the prediction becomes the estimate."""
        b = GraphBuilder("coast", "No measurement: the prediction is the estimate")
        x, L, D = self._inputs(b, "x_pred", "LD_pred", "_pred", "_pred")
        b.output("x", self._kept(b, x))
        b.output("LD", to_packed(L, D, self.model.order))
        return b.build()

    # --- pieces

    def _inputs(
        self, b: GraphBuilder, state: str, factors: str, tag: str, suffix: str
    ) -> tuple[Vector, Matrix, Vector]:
        x = b.input(state, [f"{s}{suffix}" for s in self.states])
        L, D = from_packed(b.input(factors, self._factor_names(tag)), self.model.order)
        return x, L, D

    @staticmethod
    def _measured(b: GraphBuilder) -> tuple[Vector, Vector]:
        return b.input("R", ["R_0", "R_1"]), b.input("y", [f"{quantity.name}_meas" for quantity in OUTPUTS])

    def _measurement(
        self,
        b: GraphBuilder,
        x: Vector,
        L: Matrix,
        D: Vector,
        R: Vector,
        y: Vector,
        back: tuple[Vector, Vector] | None = None,
    ) -> Measurement:
        """The measurement linearised about ``x`` as the filter takes it: rows of (effective H) L, noise, innovation.

        ``back``: x_pred and x_pred - x, for an iterate; then the innovation is eq. 31's, with H by the dual numbers.
        """
        h, named = self.model.measure(ca.vertsplit(self.model.x))
        tag = "pred" if back is None else "j"
        tape = Tape(self.model, [self.model.x], h, {f"{name}_{tag}": value for name, value in named.items()})
        frame = tape.frame(b, [x]) if self.turning else None
        measured = [f"y_{quantity.name}" for quantity in OUTPUTS]
        run = self.along(b, tape, x, L, D, [], self.equation("20"), measured, frame)
        zero = D[0] * 0.0
        numbers = self.equation("21"), self.equation("22")
        offset, bend = self.moments(b, run, D, numbers, measured, linear=False)
        noise = frame.into_diagonal(R) if frame else [[R[0], zero], [zero, R[1]]]
        b.hint({f"R_turned_{i}{j}": noise[i][j] for i in range(2) for j in range(i + 1)} if frame else {})
        noise = [[noise[i][j] + bend[i][j] for j in range(2)] for i in range(2)]
        if frame or not bend[0][0].is_zero():  # turned, bent: no less than what it was, whatever that is rounded to
            noise[0][0] = noise[0][0].apply("max", self._floor(R) if frame else R[0])
        b.hint({f"HL_{k}{c}": entry for k, row in enumerate(run.odd) for c, entry in enumerate(row)})
        entries = [noise[0][0], noise[1][0], noise[1][1]]
        b.stage("noise", self.equation("22"), _NOISE, entries, ["noise_00", "noise_10", "noise_11"], scale="none")
        turned = frame.into(y) if frame else y
        where = ", in the rotor's frame" if frame else ""
        if back is None:
            # The mean of the points' images; the Jacobian filters take the image of the mean.
            mean = [base + d for base, d in zip(run.base, offset, strict=True)]
            innovation = [turned[k] - mean[k] for k in range(2)]
        else:
            expected = self.expected(b, tape, x, back, frame, run)
            innovation = [turned[k] - held - moved for k, (held, moved) in enumerate(expected)]
        return Measurement(run.odd, noise, innovation, self._floor(R), where)

    def _floor(self, R: Vector) -> Expr:
        """The lower bound of a measurement's variance in any frame."""
        return R[0].apply("min", R[1]) if self.turning else R[1]

    def _take(
        self, b: GraphBuilder, equation: str, x: Vector, factors: tuple[Matrix, Vector], meas: Measurement
    ) -> tuple[Vector, ScalarUpdates]:
        """Both measurements, one after the other: the estimate after them, and the factors."""
        L, D = factors
        rows, innovation, variances = decorrelated(meas.rows, meas.innovation, meas.noise, meas.floor)
        b.hint({f"HL_1{c}_apart": entry for c, entry in enumerate(rows[1])} | {"R_second": variances[1]})
        state = ScalarUpdates(
            [list(row) for row in L],
            list(D),
            [x[0] * 0.0] * self.n,
            [list(row) for row in rows],
            list(innovation),
            variances,
            order=self.model.order,
        )
        state.take()
        if not innovation[1].is_zero():
            b.stage("second", equation, "", state.innovations, ["innovation_after_first"], scale="none")
        state.take()
        b.hint(
            state.named
            | {"nu_by_var_first": state.weighted_innovations[0], "nu_by_var_second": state.weighted_innovations[1]}
        )
        b.stage(
            "innovation_variances", equation, "", state.innovation_variances, ["var_first", "var_second"], scale="none"
        )
        return [value + change for value, change in zip(x, state.correction, strict=True)], state

    def _close(self, b: GraphBuilder, x: Vector, state: ScalarUpdates, equations: tuple[str, str]) -> None:
        x = self._kept(b, x)
        b.stage("x", equations[0], self.model.kept_meaning, x, [f"{s}_new" for s in self.states], scale="state")
        self._name_factors(b, equations[1], "_new", state.L, state.D)
        b.output("x", x)
        b.output("LD", to_packed(state.L, state.D, self.model.order))

    def _kept(self, b: GraphBuilder, x: Vector) -> Vector:
        return Tape(self.model, [self.model.x], self.model.kept(ca.vertsplit(self.model.x)), {}).at(b, [x])

    def _factor_names(self, tag: str) -> list[str]:
        """L_10, D_i_beta, ... in the places of a packed lower triangle: a pivot is called after its state."""
        rows = [self.states[i] for i in self.model.order]
        return [f"D{tag}_{rows[i]}" if i == j else f"L{tag}_{i}{j}" for i in range(self.n) for j in range(i + 1)]

    def _name_factors(self, b: GraphBuilder, equation: str, tag: str, L: Matrix, D: Vector) -> None:
        entries, names = to_packed(L, D, self.model.order), self._factor_names(tag)
        b.hint({f"inv_{names[place(k, k)]}": 1.0 / pivot for k, pivot in enumerate(D)})
        b.stage(f"LD{tag}", equation, f"L D L^T = P{tag}", entries, names, scale="none")


#: The step's guard adds the states to it: no pivot or state that is not a number, or absurdly large, leaves it small.
CHECK = "sum of the pivots, for the guard"

#: The term that eq. 22 adds to the odd parts.
_NOISE = "R, and what the bend of h adds to it"


def _read_off(x: Vector, before: Vector, y: Vector, L: Matrix, meas: Measurement, state: ScalarUpdates) -> Vector:
    """The estimate, a state that the measurement taken last reads directly said shorter: y - x = R / S (y - x_pred).

    That is what a scalar measurement leaves of its own innovation, of variance S; it needs no row of the gain.
    """
    for i, (row, value) in enumerate(zip(L, before, strict=True)):
        if row == meas.rows[-1] and meas.innovation[-1] == y[-1] - value and meas.noise[-1][0].is_zero():
            x = [*x[:i], y[-1] - meas.noise[-1][-1] * state.weighted_innovations[-1], *x[i + 1 :]]
    return x


def _innovation_names() -> list[str]:
    return [f"innovation_{quantity.name}" for quantity in OUTPUTS]


def _solved(Pyy: Matrix, nu: Vector, floor: Expr) -> Vector:
    """Pyy^-1 nu for a 2x2 Pyy by L D L^T; its second pivot is at least the second measurement's variance."""
    m = Pyy[1][0] / Pyy[0][0]
    pivot = (Pyy[1][1] - m * Pyy[1][0]).apply("max", floor)
    second = (nu[1] - m * nu[0]) / pivot
    return [nu[0] / Pyy[0][0] - m * second, second]
