"""A supervisor in C and in Python: what it counts, its table, and a function an action.

C prints the table as it is declared: a branch a mode, in it a branch a transition. Python, which serves scalars and
arrays of lanes, first finds the number of the transition that each lane takes, then carries out one after the other.
"""

from __future__ import annotations

from codegen.ir.covariance import CovarianceLayout, state_place, variance_place
from codegen.render.printers.c import INDENT, CPrinter
from codegen.render.printers.expression import WIDTH, unbroken, wrap_line
from codegen.render.printers.places import SCORE, Body, Places
from codegen.render.printers.python import PythonPrinter
from codegen.targets.numbers import NumberFormat
from model.filters.conditions import Entry
from model.filters.program import Call, Count, If, Node, Restart, Set, Wrap
from model.quantities import Block
from model.supervisor.words import Action, CopyFilter, ExchangeFilters, OnRival, Supervisor, Transition

#: Columns of the table of modes that the machine tells whoever drives the inverter.
TOLD = ("inverter", "runs", "torque", "rivals", "aligns")
#: Entries of the rival filter begin so.
RIVAL = "rival_"


class ModesC(CPrinter):
    """Prints a machine for the chip; the machine's struct is ``s``, the filter's ``f``."""

    def __init__(self, machine: Supervisor, layout: CovarianceLayout, prefix: str, numbers: NumberFormat) -> None:
        super().__init__(numbers)
        self.machine, self.places, self.prefix = machine, Places(machine, layout), prefix

    # --- spelling

    def _array(self, name: str) -> str:
        if name in self.places.own:
            return f"s->{name}"
        return f"f->{name}" if name in self.places.filter else name

    def format_entry(self, entry: Entry) -> str:
        """Spell an entry of an array or a field; states by the names of the filter's header.

        Parameters
        ----------
        entry : Entry
        """
        names = self.places.layout.states
        if entry.name.startswith(RIVAL) and entry.name not in self.places.own:
            own = Entry(entry.name.removeprefix(RIVAL), entry.place)
            return self.format_entry(own).replace("f->", "s->rival.", 1)
        if entry.place is None:
            return self._array(entry.name)
        if entry.name in {"x", "P_0"}:
            return f"f->{entry.name}[{state_place(self.prefix, names[entry.place])}]"
        if entry.name == "variance":
            layout = self.places.layout
            return f"f->{layout.field}[{variance_place(self.prefix, layout, names[entry.place])}]"
        return f"{self._array(entry.name)}[{entry.place}]"

    def format_counter(self, counter: str) -> str:
        """Spell a field that counts.

        Parameters
        ----------
        counter : str
        """
        return f"s->{counter}"

    def _format_call(self, node: Call, pad: str) -> list[str]:
        ports = [self._array(port.name) for port in (*node.block.inputs, *node.block.outputs)]
        return [wrap_line(f"{node.block.name}({', '.join(ports)});", pad, INDENT)]

    def _format_node(self, node: Node | CopyFilter | ExchangeFilters, depth: int) -> list[str]:
        pad = INDENT * depth
        if isinstance(node, Restart):
            return [f"{pad}{self.prefix}_reset(f);"]
        if isinstance(node, CopyFilter):
            return [f"{pad}s->rival = *f;"]
        if isinstance(node, ExchangeFilters):
            copies = [f"{pad}kept = *f;", f"{pad}*f = s->rival;", f"{pad}s->rival = kept;"]
            return [f"{pad}{self.prefix}_t kept;", *copies]
        return super()._format_node(node, depth)

    # --- functions

    def format_watch(self) -> str:
        """What is counted before the table is asked, as a static function."""
        own = (f"{self.prefix}_supervisor_t *s", f"const {self.prefix}_t *f", "int status")
        given = ", ".join(map(unbroken, (*own, "const float32 phase[2]", "float32 reference")))
        return self._function("Counts, in every mode, and of the step that ran.", f"watch({given})", self.machine.watch)

    def _function(self, note: str, head: str, body: Body) -> str:
        return "\n".join(
            [
                wrap_line(f"/* {note} */", "", " * "),
                wrap_line(f"static void {head}", "", INDENT),
                "{",
                *(f"{INDENT}float32 {name}[{size}];" for name, size in self.places.local(body).items()),
                *self.format_program(body),  # type: ignore[arg-type]
                "}",
            ]
        )

    def _takes(self, action: Action) -> dict[str, str]:
        """The arguments of an action's function, and how they are declared."""
        read, changed = self.places.read(action.body), self.places.changed(action.body)
        const = "" if any(name in self.places.filter for name in changed) else "const "
        types = {
            "s": f"{self.prefix}_supervisor_t *s" if any(name in self.places.own for name in read) else "",
            "f": f"{const}{self.prefix}_t *f" if any(name in self.places.filter for name in read) else "",
            "phase": "const float32 phase[2]" if "phase" in read else "",
        }
        return {name: text for name, text in types.items() if text}

    def format_action(self, action: Action) -> str:
        """An action as a static function.

        Parameters
        ----------
        action : Action
        """
        arguments = ", ".join(map(unbroken, self._takes(action).values()))
        return self._function(action.meaning, f"{action.name}({arguments})", action.body)

    def _format_action_call(self, action: str | OnRival) -> str:
        name = action if isinstance(action, str) else action.name
        given = self._takes(self.machine.action(name))
        spelled = [own if own != "f" or isinstance(action, str) else "&s->rival" for own in given]
        return f"{name}({', '.join(spelled)});"

    def _format_taken(self, number: int, transition: Transition) -> list[str]:
        pad = INDENT * 3
        calls = [self._format_action_call(action) for action in transition.actions]
        kept = [f"s->reason = PMSM_REASON_{transition.reason};"] if transition.reason else []
        goes = [f"go(s, PMSM_{transition.target});"] if transition.target else []
        return [pad + line for line in (*calls, *kept, *goes, f"taken = {number};")]

    def format_table(self) -> list[str]:
        """A branch a mode, in it a branch a transition; a mode that is none rests."""
        lines: list[str] = []
        for k, mode in enumerate(self.machine.modes):
            opening = "if" if k == 0 else "} else if"
            lines.append(f"{INDENT}{opening} (s->mode == PMSM_{mode.name}) {{")
            for j, (number, transition) in enumerate(self.machine.leaving(mode.name)):
                opening = "if" if j == 0 else "} else if"
                condition = self.format_condition(transition.guard)
                lines += [
                    wrap_line(f"{opening} ({condition}) {{", INDENT * 2, INDENT * 2),
                    wrap_line(f"/* {transition.why} */", INDENT * 3, " * "),
                    *self._format_taken(number, transition),
                ]
            lines += [f"{INDENT * 2}}} else {{", f"{INDENT * 3}/* the drive stays */", f"{INDENT * 2}}}"]
        first = self.machine.modes[0].name
        return [
            *lines,
            f"{INDENT}}} else {{",
            f"{INDENT * 2}go(s, PMSM_{first}); /* no mode at all: a memory that has changed by itself */",
            f"{INDENT}}}",
        ]

    def _told(self) -> list[str]:
        return [column for column in TOLD if column in self.places.own]

    def format_told(self) -> list[str]:
        """What a mode allows."""
        lines = []
        for column in self._told():
            *others, last = [f"s->mode == PMSM_{m.name}" for m in self.machine.modes if getattr(m, column)]
            modes = " || ".join(f"({mode})" for mode in (*others, last)) if others else last
            lines += [
                f"{INDENT}s->{column} = 0;",
                wrap_line(f"if ({modes}) {{", INDENT, INDENT * 2),
                f"{INDENT * 2}s->{column} = 1;",
                f"{INDENT}}}",
            ]
        return lines


class ModesPython(PythonPrinter):
    """Prints a machine as NumPy: ``s`` the machine, ``f`` the filter, masks in place of branches."""

    NOT = "np.logical_not"

    def __init__(self, machine: Supervisor, layout: CovarianceLayout) -> None:
        super().__init__()
        self.machine, self.places = machine, Places(machine, layout)
        self.covariance = layout.field
        #: Arrays that the function at hand changes, as lists of its own.
        self._open: frozenset[str] = frozenset()
        self._masks = 0

    # --- spelling

    def _array(self, name: str) -> str:
        if name in self._open:
            return name
        if name in self.places.own:
            return f"s.{name}"
        return f"f.{name}" if name in self.places.filter else name

    def format_entry(self, entry: Entry) -> str:
        """Spell a field, or an entry of an array, which is a list while a function changes it.

        Parameters
        ----------
        entry : Entry
        """
        if entry.name.startswith(RIVAL) and entry.name not in self.places.own:
            own = Entry(entry.name.removeprefix(RIVAL), entry.place)
            return self.format_entry(own).replace("f.", "s.rival.", 1)
        entry = self.places.entry(entry)
        return self._array(entry.name) + ("" if entry.place is None else f"[{entry.place}]")

    @staticmethod
    def _assign(target: str, value: str) -> str:
        line = f"{INDENT}{target} = {value}"
        return line if len(line) <= WIDTH else wrap_line(f"{unbroken(target + ' = (')}{value})", INDENT, INDENT)

    def _set(self, target: str, value: str, where: str) -> str:
        return self._assign(target, f"np.where({where}, {value}, {target})[()]" if where else value)

    def _format_node(self, node: Node | CopyFilter | ExchangeFilters, where: str) -> list[str]:
        if isinstance(node, CopyFilter):
            return [f"{INDENT}_take(s.rival, f, {where})"]
        if isinstance(node, ExchangeFilters):
            return [f"{INDENT}_exchange(f, s.rival, {where})"]
        if isinstance(node, Set):
            return [self._set(self.format_entry(node.target), self.format_value(node.value), where)]
        if isinstance(node, Wrap):
            angle = self.format_entry(node.angle)
            return [self._set(angle, self.format_wrap(angle), where)]
        if isinstance(node, Count):
            counter = f"s.{node.counter}"
            more = f"{counter} < {node.most}"
            return [
                self._assign(
                    counter, f"np.where({f'{where} & ' if where else ''}({more}), {counter} + 1, {counter})[()]"
                )
            ]
        if isinstance(node, Restart):
            words = self.covariance
            return [f"{INDENT}x, {words} = _reset(f, x, {words}, {where}, math)"]
        if isinstance(node, If):
            return self._format_if(node, where)
        assert isinstance(node, Call)
        return self._format_masked(node.block, where)

    def _format_if(self, node: If, where: str) -> list[str]:
        """Both masks first: what one branch does must not change where the other is taken."""
        self._masks += 1
        hit, miss = f"hit_{self._masks}", f"miss_{self._masks}"
        condition = self.format_condition(node.condition)
        lines = [self._assign(hit, f"{where} & ({condition})" if where else condition)]
        if node.otherwise:
            lines.append(self._assign(miss, (f"{where} & " if where else "") + f"np.logical_not({condition})"))
        lines += self.format_program(node.then, hit)
        return [*lines, *(self.format_program(node.otherwise, miss) if node.otherwise else [])]

    def _format_masked(self, block: Block, where: str) -> list[str]:
        """A block in all lanes, kept where the mask is; arrays on the stack are nobody else's."""
        local = {port.name for port in block.outputs} - set(self.places.own)
        arguments = ", ".join([*(self._array(port.name) for port in block.inputs), "math"])
        names = [port.name if port.name in local else f"{port.name}_new" for port in block.outputs]
        lines = [self._assign(", ".join(names), f"{block.name}({arguments})")]
        for port in block.outputs:
            if port.name not in local:
                lines.append(f"{INDENT}{port.name} = list(_select({where}, {port.name}_new, {port.name}))")
        return lines

    # --- functions

    def _function(self, head: str, note: str, body: Body, where: str) -> str:
        changed = [name for name in self.places.changed(body) if name not in self.places.local(body)]
        numbers = {SCORE, *(name for name, field in self.places.own.items() if field.whole)}
        exchanged = any(isinstance(node, ExchangeFilters) for node in body)
        arrays = [] if exchanged else [name for name in changed if name not in numbers]
        homes = {name: self._array(name) for name in arrays}
        self._masks, self._open = 0, frozenset(arrays)
        lines = [f"def {head}:", f'{INDENT}"""{note}"""']
        lines += [f"{INDENT}{name} = list({home})" for name, home in homes.items()]
        lines += self.format_program(body, where)  # type: ignore[arg-type]
        lines += [f"{INDENT}{home} = tuple({name})" for name, home in homes.items()]
        self._open = frozenset()
        return "\n".join(lines)

    def format_watch(self) -> str:
        """What is counted before the table is asked."""
        note = "Counts, in every mode, and of the step that ran."
        return self._function("_watch(s, f, status, phase, reference, math)", note, self.machine.watch, "")

    def format_action(self, action: Action) -> str:
        """An action, in the lanes of a mask.

        Parameters
        ----------
        action : Action
        """
        return self._function(f"_{action.name}(s, f, phase, where, math)", action.meaning, action.body, "where")

    def format_table(self) -> list[str]:
        """The number of the transition that is taken, 0 for none, then one after the other."""
        lines = [f"{INDENT}taken = 0"]
        for mode in reversed(self.machine.modes):
            lines += self._chain(mode.name, self.machine.leaving(mode.name))
        lines.append(self._assign("lost", self._no_mode()))
        for number, transition in enumerate(self.machine.transitions, start=1):
            lines += self._format_taken(number, transition)
        return lines

    def _chain(self, mode: str, leaving: list[tuple[int, Transition]]) -> list[str]:
        """From the last transition of a mode to the first, which has the last word."""
        lines = [f"{INDENT}found = 0"]
        for number, transition in reversed(leaving):
            guard = self.format_condition(transition.guard)
            lines.append(self._assign("found", f"np.where({guard}, {number}, found)"))
        return [*lines, f"{INDENT}taken = np.where(s.mode == {mode}, found, taken)[()]"]

    def _no_mode(self) -> str:
        parts = " | ".join(f"(s.mode == {mode.name})" for mode in self.machine.modes)
        return f"np.logical_not({parts})"

    def _format_taken(self, number: int, transition: Transition) -> list[str]:
        pad = INDENT * 2
        lines = [
            wrap_line(f"# {transition.source}: {transition.why}.", INDENT, "# "),
            f"{INDENT}where = taken == {number}",
        ]
        lines.append(f"{INDENT}if np.any(where):")
        for action in transition.actions:
            name, given = (action, "f") if isinstance(action, str) else (action.name, "s.rival")
            lines.append(f"{pad}_{name}(s, {given}, phase, where, math)")
        if transition.reason:
            lines.append(f"{pad}s.reason = np.where(where, REASON_{transition.reason}, s.reason)[()]")
        if transition.target:
            lines.append(f"{pad}_go(s, {transition.target}, where)")
        return lines

    def _told(self) -> list[str]:
        return [column for column in TOLD if column in self.places.own]

    def format_told(self) -> list[str]:
        """What a mode allows."""
        lines = []
        for column in self._told():
            modes = " | ".join(f"(s.mode == {m.name})" for m in self.machine.modes if getattr(m, column))
            lines.append(self._assign(f"s.{column}", f"np.where({modes}, 1, 0)[()]"))
        return lines
