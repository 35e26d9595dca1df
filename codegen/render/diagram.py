"""supervisor.svg: the modes as boxes in a column, the transitions as arcs with their numbers.

What leads down the column is drawn on its right, what leads back up on its left. Ends of arcs stand on a box's side in
the order in which arcs that lead to or from one box lie in each other, so that those never cross.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from model.supervisor.words import Mode, Supervisor, Transition

#: The column from above; STARTING and ALIGNING, of which no drive has both, are the last by their number.
ORDER = ("RESTING", "PROBING", "WAITING", "CATCHING", "STARTING", "ALIGNING", "RUNNING", "FAULT")
#: What a mode allows: a field of it, and the word in its box.
ALLOWED = (("inverter", "inverter"), ("runs", "filter"), ("torque", "torque"), ("rivals", "rival"), ("aligns", "axis"))

#: Pixels: a box and the space below it; between ends of arcs, lanes, numbers; about everything; of a corner, a number.
WIDTH, LEAST_HEIGHT, SPACE = 330, 92, 30
PORT, LANE, PITCH, MARGIN, CORNER, RADIUS = 14, 30, 19, 24, 9, 8.5
#: Letters in a line of a mode's meaning.
LETTERS = 52
HEAD = 74
FOOT = 58

INK, DIM, LINE, PAPER = "#2b3440", "#7c8794", "#c9d0d8", "#ffffff"
#: Colours of an arc: on the way, and where something went wrong.
ONWARD, LOST = "#4a6a8a", "#a8614f"


@dataclass
class Arc:
    """Transitions from one mode to another, ``numbers`` of them; filled in as it is laid out: pixels."""

    source: str
    target: str
    numbers: list[tuple[int, Transition]]
    right: bool
    start: float = 0.0
    end: float = 0.0
    lane: int = 0
    places: list[float] = field(default_factory=list)

    @property
    def loop(self) -> bool:
        """It leads from a mode to itself."""
        return self.source == self.target

    @property
    def colour(self) -> str:
        """By whether something went wrong."""
        return LOST if any(t.reason or t.target == "FAULT" for _, t in self.numbers) else ONWARD

    @property
    def stays(self) -> bool:
        """The time in the mode goes on."""
        return all(transition.target is None for _, transition in self.numbers)

    @property
    def span(self) -> tuple[float, float]:
        """From where to where it goes, from above."""
        return min(self.start, self.end), max(self.start, self.end)


@dataclass
class Box:
    """A mode's place in the column."""

    mode: Mode
    top: float
    height: float


def arcs_of(machine: Supervisor, order: Sequence[str]) -> list[Arc]:
    """One arc for all transitions from a mode to a mode, and one for those that stay.

    Parameters
    ----------
    machine : Supervisor
    order : sequence of str
        Names of its modes, from above.
    """
    found: dict[tuple[str, str | None], Arc] = {}
    for number, transition in enumerate(machine.transitions, start=1):
        source, target = transition.source, transition.target or transition.source
        right = order.index(target) >= order.index(source)
        arc = found.setdefault((source, transition.target), Arc(source, target, [], right))
        arc.numbers.append((number, transition))
    return list(found.values())


def _ends(arcs: list[Arc], mode: str, order: Sequence[str], right: bool) -> list[tuple[Arc, str]]:
    """The ends of arcs on one side of a box, from above; of a loop both."""

    def far(arc: Arc) -> int:
        return abs(order.index(arc.source) - order.index(arc.target))

    side = [arc for arc in arcs if arc.right == right]
    into = sorted((arc for arc in side if arc.target == mode and not arc.loop), key=far, reverse=not right)
    out = sorted((arc for arc in side if arc.source == mode and not arc.loop), key=far, reverse=right)
    loops = [(arc, end) for arc in side if arc.loop and arc.source == mode for end in ("start", "end")]
    ends = [(arc, "end") for arc in into], [(arc, "start") for arc in out]
    return [*ends[0], *loops, *ends[1]] if right else [*ends[1], *loops, *ends[0]]


def _height(ends: list[tuple[Arc, str]]) -> float:
    loops = sum(PITCH * len(arc.numbers) + 2 * CORNER - PORT for arc, end in ends if arc.loop and end == "end")
    return PORT * (len(ends) + 1) + loops


def lay_out(machine: Supervisor) -> tuple[list[Box], list[Arc]]:
    """Boxes and arcs, placed.

    Parameters
    ----------
    machine : Supervisor
    """
    names = [mode.name for mode in machine.modes]
    order = [name for name in ORDER if name in names] + [name for name in names if name not in ORDER]
    arcs, boxes, top = arcs_of(machine, order), [], float(HEAD)
    for name in order:
        sides = [_ends(arcs, name, order, right) for right in (False, True)]
        box = Box(machine.modes[names.index(name)], top, max(LEAST_HEIGHT, *map(_height, sides)))
        for ends in sides:
            y = top + 0.5 * (box.height - _height(ends))
            for arc, end in ends:
                y += PITCH * len(arc.numbers) + 2 * CORNER if arc.loop and end == "end" else PORT
                setattr(arc, end, y)
        boxes.append(box)
        top += box.height + SPACE
    for right in (False, True):
        _choose_lanes([arc for arc in arcs if arc.right == right])
        _place_numbers([arc for arc in arcs if arc.right == right])
    return boxes, arcs


def _choose_lanes(arcs: list[Arc]) -> None:
    """The shortest first, each in the lane next to the column in which there is room for it."""
    taken: list[Arc] = []
    for arc in sorted(arcs, key=lambda arc: (arc.span[1] - arc.span[0], arc.span)):
        over = [other.lane for other in taken if other.span[0] <= arc.span[1] and arc.span[0] <= other.span[1]]
        arc.lane = 1 + max(over, default=0)
        taken.append(arc)


def _place_numbers(arcs: list[Arc]) -> None:
    """Along the arc's lane, near the mode that is left, and where no other arc comes across."""
    for arc in arcs:
        low, high = arc.span
        across = [y for other in arcs if other.lane > arc.lane for y in (other.start, other.end) if low < y < high]
        room = RADIUS + CORNER + 5
        size = PITCH * (len(arc.numbers) - 1)
        first = low + room if arc.start < arc.end else high - room - size
        if high - low < size + 2 * room or arc.loop:
            first = 0.5 * (low + high - size)
        step = 1.0 if arc.start < arc.end else -1.0
        while any(first - RADIUS - 4 < y < first + size + RADIUS + 4 for y in across):
            first += step
        arc.places = [first + PITCH * k for k in range(len(arc.numbers))]


def render_diagram(machine: Supervisor, drive: str, stays: dict[str, str]) -> str:
    """The picture.

    Parameters
    ----------
    machine : Supervisor
    drive : str
        The drive's name.
    stays : dict of str to str
        How long a mode may last, by its name.
    """
    boxes, arcs = lay_out(machine)
    lanes = [max(arc.lane for arc in arcs if arc.right == right) for right in (False, True)]
    left = MARGIN + LANE * lanes[0] + RADIUS
    width = left + WIDTH + LANE * lanes[1] + RADIUS + MARGIN
    bottom = boxes[-1].top + boxes[-1].height
    allowed = [item for item in ALLOWED if getattr(machine, item[0], True)]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_n(width)} {_n(bottom + FOOT)}" '
        f'width="{_n(width)}" height="{_n(bottom + FOOT)}" font-family="Helvetica, Arial, sans-serif" '
        f'font-size="12" fill="{INK}" role="img">',
        f"<title>{escape(drive, quote=False)}: modes of the drive</title>",
        f'<rect width="100%" height="100%" rx="8" fill="{PAPER}"/>',
        _text(MARGIN, 32, f"{drive}: modes of the drive", 'font-size="14" font-weight="bold"'),
        *_power_up(left + WIDTH - 76),
        *(line for arc in sorted(arcs, key=lambda arc: -arc.lane) for line in _draw_line(arc, left)),
        *(line for box in boxes for line in _draw_box(box, left, stays.get(box.mode.name, ""), allowed)),
        *(line for arc in arcs for line in _draw_numbers(arc, left)),
        *_legend(left, bottom + 26),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _n(value: float) -> str:
    return f"{value:.1f}".rstrip("0").rstrip(".")


def _text(x: float, y: float, words: str, style: str = "") -> str:
    return f'<text x="{_n(x)}" y="{_n(y)}"{" " + style if style else ""}>{escape(words, quote=False)}</text>'


def _power_up(x: float) -> list[str]:
    """From where the drive comes into its first mode."""
    return [
        f'<circle cx="{_n(x)}" cy="{HEAD - 23}" r="3.5" fill="{ONWARD}"/>',
        f'<path d="M{_n(x)} {HEAD - 23}V{HEAD - 6}" stroke="{ONWARD}" stroke-width="1.3"/>',
        f'<path d="M{_n(x)} {HEAD - 1.5}L{_n(x - 4)} {HEAD - 9}H{_n(x + 4)}Z" fill="{ONWARD}"/>',
        _text(x + 9, HEAD - 19, "power-up", f'font-size="11" fill="{DIM}"'),
    ]


def _lane(arc: Arc, left: float) -> tuple[float, float, float]:
    """Edge of the column, the arc's lane, and which way it lies."""
    way = 1.0 if arc.right else -1.0
    edge = left + WIDTH if arc.right else left
    return edge, edge + way * LANE * arc.lane, way


def _draw_line(arc: Arc, left: float) -> list[str]:
    edge, x, way = _lane(arc, left)
    down = CORNER if arc.end > arc.start else -CORNER
    bend = x - way * CORNER
    path = (
        f"M{_n(edge)} {_n(arc.start)}H{_n(bend)}Q{_n(x)} {_n(arc.start)} {_n(x)} {_n(arc.start + down)}"
        f"V{_n(arc.end - down)}Q{_n(x)} {_n(arc.end)} {_n(bend)} {_n(arc.end)}H{_n(edge + way * 6)}"
    )
    tip, tail = edge + way * 1.5, edge + way * 9
    dashes = ' stroke-dasharray="4 3"' if arc.stays else ""
    return [
        f'<path d="{path}" fill="none" stroke="{PAPER}" stroke-width="5"/>',
        f'<path d="{path}" fill="none" stroke="{arc.colour}" stroke-width="1.3"{dashes}/>',
        f'<path d="M{_n(tip)} {_n(arc.end)}L{_n(tail)} {_n(arc.end - 4)}V{_n(arc.end + 4)}Z" fill="{arc.colour}"/>',
    ]


def _draw_numbers(arc: Arc, left: float) -> list[str]:
    _, x, _ = _lane(arc, left)
    parts = []
    for (number, transition), y in zip(arc.numbers, arc.places, strict=True):
        where = transition.target or "stays"
        parts += [
            f"<g><title>{number}: {transition.source}, {where}: {escape(transition.why, quote=False)}</title>",
            f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{RADIUS}" fill="{PAPER}" stroke="{arc.colour}"/>',
            _text(x, y + 3.5, str(number), f'font-size="10" text-anchor="middle" fill="{arc.colour}"') + "</g>",
        ]
    return parts


def _tint(mode: Mode) -> tuple[str, str]:
    """Fill and frame of a box: the inverter is off, on, or makes torque."""
    if mode.torque:
        return "#edf4ee", "#86a78c"
    return ("#edf2f8", "#8aa3c0") if mode.inverter else ("#f4f5f6", "#a9b1ba")


def _balanced(words: str) -> list[str]:
    """In as few lines as there must be, about alike in length."""
    found = textwrap.wrap(words, LETTERS, break_on_hyphens=False)
    for letters in range(LETTERS - 1, 0, -1):
        shorter = textwrap.wrap(words, letters, break_on_hyphens=False)
        if len(shorter) > len(found):
            break
        found = shorter
    return found


def _draw_box(box: Box, left: float, stay: str, allowed: Sequence[tuple[str, str]]) -> list[str]:
    mode, (fill, frame) = box.mode, _tint(box.mode)
    lines = _balanced(mode.meaning)
    y = box.top + 0.5 * (box.height - (40 + 15 * len(lines))) + 11
    parts = [
        f'<rect x="{_n(left)}" y="{_n(box.top)}" width="{WIDTH}" height="{_n(box.height)}" rx="7" fill="{fill}" '
        f'stroke="{frame}"/>',
        _text(left + 16, y, mode.name, 'font-weight="bold"'),
        _text(left + WIDTH - 16, y, stay, f'font-size="11" text-anchor="end" fill="{DIM}"'),
        *(_text(left + 16, y + 17 + 15 * k, line, 'font-size="11.5"') for k, line in enumerate(lines)),
    ]
    x, below = left + 16, y + 10 + 15 * len(lines)
    for name, word in allowed:
        wide = 16 + 6 * len(word)
        has = getattr(mode, name)
        style = f'fill="{frame}"' if has else f'fill="none" stroke="{LINE}"'
        ink = PAPER if has else DIM
        parts += [
            f'<rect x="{_n(x)}" y="{_n(below)}" width="{wide}" height="17" rx="8.5" {style}/>',
            _text(x + 0.5 * wide, below + 12, word, f'font-size="10.5" text-anchor="middle" fill="{ink}"'),
        ]
        x += wide + 7
    return parts


def _legend(left: float, y: float) -> list[str]:
    style = f'font-size="11" fill="{DIM}"'
    return [
        _text(left, y, "On the right onward, on the left back. Filled words are what a mode allows.", style),
        _text(left, y + 16, "Red: something went wrong. Dashed: the drive stays. Numbers: see REPORT.md.", style),
    ]
