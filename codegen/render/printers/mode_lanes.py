"""A supervisor for many drives at once: counts and guards as loops over lanes, actions in one lane.

What happens at every interrupt, the counting and the guards, is a loop over lanes whose body is the scalar text on
variables of its own: no call and no store within a branch, so a compiler puts it into vector registers. A transition is
seldom: its actions are the scalar text, carried out in the lane that takes it.
"""

from __future__ import annotations

from collections.abc import Iterable

from codegen.ir.covariance import CovarianceLayout
from codegen.ir.layout import Listing
from codegen.render.printers.c import INDENT
from codegen.render.printers.expression import unbroken, wrap_line
from codegen.render.printers.modes import RIVAL, ModesC
from codegen.render.printers.places import SCORE, Body
from codegen.targets.numbers import NumberFormat
from model.filters.conditions import Entry
from model.filters.program import Call, Count, If, Node, Restart, Set, nodes
from model.supervisor.words import Action, CopyFilter, ExchangeFilters, Supervisor, Transition

#: The two phase currents, of all lanes.
PHASES = "phase"
#: What the guards find where a mode is none.
LOST = "LOST"


class ModesLanes(ModesC):
    """Prints a machine for the host; ``s`` is its struct, ``f`` the filter's, of all lanes."""

    AND, OR = "&", "|"  # of comparisons, which are 1 or 0: a compiler sees no branch

    #: Names that the function at hand has as variables of its own.
    _held: frozenset[str] = frozenset()

    def __init__(self, machine: Supervisor, layout: CovarianceLayout, prefix: str, numbers: NumberFormat) -> None:
        super().__init__(machine, layout, prefix, numbers)
        #: Variables that the counting needs beside, and their lengths.
        self._beside: dict[str, int] = {}

    # --- spelling

    def format_entry(self, entry: Entry) -> str:
        """Spell an entry of an array or a field, in a lane.

        Parameters
        ----------
        entry : Entry
        """
        if entry.name in self._held:
            return entry.name if entry.place is None else f"{entry.name}[{entry.place}]"
        if entry.name.startswith(RIVAL) and entry.name not in self.places.own:
            return super().format_entry(entry)  # which asks here for the filter's
        if entry.name == PHASES:
            return f"currents[{entry.place}].of[lane]"
        text = super().format_entry(entry)
        if entry.name == SCORE:
            return f"{text}[0].of[lane]"
        if not text.startswith(("s->", "f->")):
            return text
        return f"{text}[lane]" if entry.place is None else f"{text}.of[lane]"

    def format_counter(self, counter: str) -> str:
        """Spell a field that counts, in a lane.

        Parameters
        ----------
        counter : str
        """
        return counter if counter in self._held else f"s->{counter}[lane]"

    def format_status(self) -> str:
        """Spell the status bits of a lane's step."""
        return "status[lane]"

    def _lives_in_lanes(self, name: str) -> bool:
        return name == PHASES or name in self.places.own or name in self.places.filter

    def _size(self, name: str) -> int:
        """Length of an array that a block reads or a count needs; 0 for an integer."""
        if name == PHASES:
            return 2
        return self.places.own[name].size if name in self.places.own else len(self.places.layout.states)

    def _homes(self, name: str, size: int) -> list[tuple[str, str]]:
        """A variable of a function, and where in the lane it lives."""
        if size == 0:
            return [(name, self.format_counter(name))]
        return [(f"{name}[{k}]", self.format_entry(Entry(name, k))) for k in range(size)]

    @staticmethod
    def _declared(sizes: dict[str, int]) -> list[str]:
        return [f"float32 {name}[{size}];" if size else f"int {name};" for name, size in sizes.items()]

    def _format_call(self, node: Call, pad: str) -> list[str]:
        """A block between variables: those that live in the lane are fetched before it and put back after it."""

        def lines(ports: Iterable[str], fetched: bool) -> list[str]:
            homes = [
                home
                for name in ports
                if name not in self._held and self._lives_in_lanes(name)
                for home in self._homes(name, sizes[name])
            ]
            return [f"{pad}{a} = {b};" if fetched else f"{pad}{b} = {a};" for a, b in homes]

        inputs, outputs = ([port.name for port in ports] for ports in (node.block.inputs, node.block.outputs))
        sizes = {port.name: len(port.entries) for port in (*node.block.inputs, *node.block.outputs)}
        call = wrap_line(f"{node.block.name}({', '.join([*inputs, *outputs])});", pad, INDENT)
        return [*lines(dict.fromkeys(inputs), True), call, *lines(outputs, False)]

    def _format_node(self, node: Node | CopyFilter | ExchangeFilters, depth: int) -> list[str]:
        pad = INDENT * depth
        if isinstance(node, Restart):
            return [f"{pad}reset(f, lane);"]
        if isinstance(node, CopyFilter):
            return [f"{pad}copy_lane(&s->rival, f, sizeof(s->rival), lane);"]
        if isinstance(node, ExchangeFilters):
            return [f"{pad}exchange_lane(f, &s->rival, sizeof(s->rival), lane);"]
        return super()._format_node(node, depth)

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block of one lane; what a loop over lanes calls must become a part of it.

        Parameters
        ----------
        listing : Listing
        """
        watched = {node.block.name for node in nodes(self.machine.watch) if isinstance(node, Call)}
        text = super().format_block(listing)
        return text.replace("static ", "INLINE ", 1) if listing.block.name in watched else text

    def format_watch(self) -> str:
        """What is counted before the guards are asked, as a loop over lanes."""
        body = self.machine.watch
        sizes = {name: self._size(name) for name in self.places.read(body) if self._lives_in_lanes(name)}
        homes = [home for name, size in sizes.items() for home in self._homes(name, size)]
        changed = {
            variable
            for name in self.places.changed(body)
            if name in self.places.own
            for variable, _ in self._homes(name, sizes[name])
        }
        self._held, self._beside, pad = frozenset(sizes), {}, INDENT * 2
        counted = self._format_masked(body, "")
        self._held = frozenset()
        types = f"{self.prefix}_supervisor_lanes_t *__restrict s, const {self.prefix}_lanes_t *__restrict f"
        given = ("const int *__restrict status", *(f"const lanes *__restrict {x}" for x in ("currents", "references")))
        head = ", ".join(map(unbroken, (*types.split(", "), *given)))
        return "\n".join(
            [
                "/* Counts, in every mode, and of the step that ran. */",
                wrap_line(f"static void watch({head})", "", INDENT),
                "{",
                f"{INDENT}int lane;",
                f"{INDENT}for (lane = 0; lane < LANES; lane++) {{",
                f"{pad}const float32 reference = references[0].of[lane];",
                *(pad + line for line in self._declared(sizes | self._beside)),
                *(f"{pad}{variable} = {home};" for variable, home in homes),
                *(wrap_line(line, pad, INDENT) for line in counted),
                *(f"{pad}{home} = {variable};" for variable, home in homes if variable in changed),
                f"{INDENT}}}",
                "}",
            ]
        )

    def _format_masked(self, body: tuple[Node, ...], where: str) -> list[str]:
        """Nodes by masks in place of branches, kept where ``where`` is 1; what they need beside is declared later."""
        lines: list[str] = []
        for node in body:
            if isinstance(node, If):
                lines += self._format_masks(node, where)
            elif isinstance(node, Count):
                counter = self.format_counter(node.counter)
                more = f"({counter} < {node.most})"
                lines.append(f"{counter} += ({f'{where} & ' if where else ''}{more}) ? 1 : 0;")
            elif isinstance(node, Set):
                lines.append(self._kept(self.format_entry(node.target), self.format_value(node.value), where))
            else:
                assert isinstance(node, Call)
                lines += self._format_masked_call(node, where)
        return lines

    @staticmethod
    def _kept(target: str, value: str, where: str) -> str:
        return f"{target} = ({where} != 0) ? {value} : {target};" if where else f"{target} = {value};"

    def _format_masks(self, node: If, where: str) -> list[str]:
        """Both masks first: what one branch does must not change where the other is taken."""
        number, given = 1 + sum(name.startswith("hit") for name in self._beside), f"{where} & " if where else ""
        hit, miss = f"hit_{number}", f"miss_{number}"
        self._beside[hit] = 0
        lines = [f"{hit} = {given}({self.format_condition(node.condition)});"]
        if node.otherwise:
            self._beside[miss] = 0
            lines.append(f"{miss} = {given}!({self.format_condition(node.condition)});")
        return [*lines, *self._format_masked(node.then, hit), *self._format_masked(node.otherwise, miss)]

    def _format_masked_call(self, node: Call, where: str) -> list[str]:
        """A block in all lanes, kept where the mask is."""
        outputs = {port.name: len(port.entries) for port in node.block.outputs}
        self._beside |= {f"{name}_new": size for name, size in outputs.items()}
        given = [*(port.name for port in node.block.inputs), *(f"{name}_new" for name in outputs)]
        return [
            f"{node.block.name}({', '.join(given)});",
            *(
                self._kept(f"{name}[{k}]", f"{name}_new[{k}]", where)
                for name, size in outputs.items()
                for k in range(size)
            ),
        ]

    def _function(self, note: str, head: str, body: Body) -> str:
        """An action: its variables are what blocks make and read."""
        calls = [node for node in nodes(body) if isinstance(node, Call)]  # type: ignore[arg-type]
        sizes = {p.name: len(p.entries) for call in calls for p in (*call.block.inputs, *call.block.outputs)}
        return "\n".join(
            [
                wrap_line(f"/* {note} */", "", " * "),
                wrap_line(f"static void {head}", "", INDENT),
                "{",
                *(INDENT + line for line in self._declared(sizes)),
                *self.format_program(body),  # type: ignore[arg-type]
                "}",
            ]
        )

    def _takes(self, action: Action) -> dict[str, str]:
        """The arguments of an action's function, and how they are declared."""
        own = super()._takes(action)
        const = "const " if own.get("f", "").startswith("const") else ""
        types = {
            "s": ("s", f"{self.prefix}_supervisor_lanes_t *s"),
            "f": ("f", f"{const}{self.prefix}_lanes_t *f"),
            PHASES: ("currents", "const lanes *currents"),
        }
        return {**dict(types[name] for name in own), "lane": "int lane"}

    # --- the table

    def format_guards(self) -> list[str]:
        """The number of the transition that a lane takes, 0 for none: of each mode the first has the last word."""
        pad, lines = INDENT * 2, [f"{INDENT * 2}int next = {LOST};"]
        for k, mode in enumerate(self.machine.modes):
            lines.append(f"{pad}int of_{k} = 0; /* {mode.name} */")
        for k, mode in enumerate(self.machine.modes):
            for number, transition in reversed(self.machine.leaving(mode.name)):
                guard = self.format_condition(transition.guard)
                lines.append(wrap_line(f"of_{k} = ({guard}) ? {number} : of_{k};", pad, INDENT))
            lines.append(f"{pad}next = (s->mode[lane] == PMSM_{mode.name}) ? of_{k} : next;")
        return lines

    def format_cases(self) -> list[str]:
        """What each transition does, a case each."""
        lines: list[str] = []
        for number, transition in enumerate(self.machine.transitions, start=1):
            lines += [
                f"{INDENT}case {number}:",
                wrap_line(f"/* {transition.source}: {transition.why} */", INDENT * 2, " * "),
                *self._format_taken(number, transition),
                f"{INDENT * 2}break;",
            ]
        first = self.machine.modes[0].name
        return [
            *lines,
            f"{INDENT}default:",
            f"{INDENT * 2}go(s, PMSM_{first}, lane); /* no mode at all: a memory that has changed by itself */",
            f"{INDENT * 2}break;",
        ]

    def _format_taken(self, number: int, transition: Transition) -> list[str]:
        calls = [self._format_action_call(action) for action in transition.actions]
        kept = [f"s->reason[lane] = PMSM_REASON_{transition.reason};"] if transition.reason else []
        goes = [f"go(s, PMSM_{transition.target}, lane);"] if transition.target else []
        return [INDENT * 2 + line for line in (*calls, *kept, *goes)]

    def format_told(self) -> list[str]:
        """What a mode allows, in a lane."""
        lines = []
        for column in self._told():
            modes = [f"(s->mode[lane] == PMSM_{m.name})" for m in self.machine.modes if getattr(m, column)]
            lines.append(wrap_line(f"s->{column}[lane] = ({' | '.join(modes)}) ? 1 : 0;", INDENT * 2, INDENT))
        return lines
