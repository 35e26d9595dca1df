"""Figures as small SVG text that takes the colours of the page around it."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from markupsafe import Markup

_SVG, _XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
ElementTree.register_namespace("", _SVG)

#: The typefaces of figures: the one that matplotlib measures text by, then one of the same widths.
_FONTS = "DejaVu Sans,Verdana,sans-serif"

#: A figure's colour -> the name that ``style.html.j2`` knows it by, where dark paper needs another shade of it.
THEMED = {
    "#000000": "ink", "#444444": "ink", "#2b3440": "ink", "#7c8794": "dim", "#666666": "dim",
    "#3b6ea8": "blue", "#c8553d": "red", "#5a9e6f": "green", "#e0a030": "yellow", "#8a6bb1": "violet",
    "#4a6a8a": "onward", "#a8614f": "lost",
    "#edf2f8": "fill-on", "#edf4ee": "fill-run", "#f4f5f6": "fill-off", "#f4f4f4": "fill-off", "#a9c4df": "fill-some",
}  # fmt: skip

_DECIMAL = r"-?\d+\.\d+(?:e-?\d+)?"
#: Attributes that are styles.
_STYLES = ("fill", "stroke", "stroke-width", "font-size", "font-weight", "text-anchor", "stroke-dasharray")


def compact_svg(text: str) -> str:
    """The same picture in fewer letters: tenths of a point, relative paths, nothing that is not drawn.

    Parameters
    ----------
    text : str
        SVG as matplotlib writes it.
    """
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in (f"{{{_SVG}}}metadata", f"{{{_SVG}}}style"):
                parent.remove(child)
    _splice(root)
    used = set(re.findall(r"#([\w-]+)", ElementTree.tostring(root, encoding="unicode")))
    for element in root.iter():
        _shorten(element, used)
    root.attrib |= {"font-family": _FONTS, "stroke-linejoin": "round", "role": "img"}
    root.attrib.pop("version", None)
    return re.sub(r">\s+<", "><", ElementTree.tostring(root, encoding="unicode", short_empty_elements=True))


def _splice(element: ElementTree.Element) -> None:
    """Groups that only have a name are dissolved, empty ones dropped."""
    children: list[ElementTree.Element] = []
    for child in element:
        _splice(child)
        plain = child.tag == f"{{{_SVG}}}g" and not child.attrib.keys() - {"id"}
        hollow = child.tag in (f"{{{_SVG}}}g", f"{{{_SVG}}}defs") and not len(child)
        children += list(child) if plain else [] if hollow else [child]
    element[:] = children


def _shorten(element: ElementTree.Element, used: set[str]) -> None:
    attributes = element.attrib
    if attributes.get("id", "") not in used:
        attributes.pop("id", None)
    if f"{{{_XLINK}}}href" in attributes:
        attributes["href"] = attributes.pop(f"{{{_XLINK}}}href")
    if "d" in attributes:
        attributes["d"] = compact_path(attributes["d"])
    for key in ("x", "y", "transform", "width", "height"):
        if key in attributes and element.tag != f"{{{_SVG}}}image":
            attributes[key] = re.sub(
                r"-?\d+\.\d+(?:e-?\d+)?", lambda m: _tenths(round(10 * float(m[0]))), attributes[key]
            )
    if re.fullmatch(r"rotate\(-?0[ \d.-]*\)", attributes.get("transform", "")):
        del attributes["transform"]
    if "style" in attributes:
        style = re.sub(r"; font-family: [^;]*|font-family: [^;]*; ", "", attributes["style"])
        attributes["style"] = re.sub(r"([:;]) ", r"\1", style)


def compact_path(d: str) -> str:
    """A path's data with relative coordinates in tenths; a curve other than of lines keeps its own.

    >>> compact_path("M 10.04 20 L 12.26 19.5 L 12.26 19.5 L 13 30 z")
    'M10 20l2.3-.5 .7 10.5z'
    """
    words = re.findall(r"[A-Za-z]|-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", d)
    if set(re.findall("[A-Za-z]", d.replace("e", ""))) - set("MLz"):
        return " ".join(word if word.isalpha() else _tenths(round(10 * float(word))) for word in words)
    parts, x, y, command, k = [], 0, 0, "", 0
    while k < len(words):
        if words[k].isalpha():
            command, k = words[k], k + 1
            if command == "z":
                parts.append("z")
            continue
        to = round(10 * float(words[k])), round(10 * float(words[k + 1]))
        if command == "M":
            parts.append(f"M{_pair(*to)}")
        elif to != (x, y):
            began = parts[-1][0] in "Mz"
            parts.append(("l" if began else " ") + _pair(to[0] - x, to[1] - y))
        (x, y), k = to, k + 2
    return "".join(parts).replace(" -", "-")


def _pair(a: int, b: int) -> str:
    return f"{_tenths(a)} {_tenths(b)}"


def _tenths(value: int) -> str:
    """Spell a number of tenths.

    >>> _tenths(-5), _tenths(120), _tenths(123)
    ('-.5', '12', '12.3')
    """
    text = f"{value / 10:.1f}".removesuffix(".0")
    return re.sub(r"^(-?)0\.", r"\1.", text) if text != "-0" else "0"


def with_shared_styles(page: str) -> str:
    """A page whose figures have each style once, in its head, in the place of once a stroke.

    Parameters
    ----------
    page : str
        HTML with a ``</head>``.
    """
    names: dict[str, str] = {}

    def named(found: re.Match[str]) -> str:
        style = f"{found[1] or ''}{';' if found[1] and found[2] else ''}{found[2] or ''}"
        return f' class="{names.setdefault(style, f"c{len(names)}")}"'

    def styled(element: re.Match[str]) -> str:
        words = [(key, value) for key, value in re.findall(r' ([\w-]+)="([^"]*)"', element[2]) if key in _STYLES]
        if not words or "style=" in element[2]:
            return element[0]
        rest = re.sub(rf' (?:{"|".join(_STYLES)})="[^"]*"', "", element[2])
        style = ";".join(f"{key}:{value}{'px' if key == 'font-size' else ''}" for key, value in words)
        return f'<{element[1]}{rest} style="{style}"{element[3]}>'

    def shared(figure: re.Match[str]) -> str:
        text = re.sub(r"<(path|text|rect|circle)((?: [\w-]+=\"[^\"]*\")+)( ?/?)>", styled, figure[0])
        return re.sub(r'(?: clip-path="(url\([^"]*)")? style="([^"]*)"', named, text)

    text = re.sub(r"<svg .*?</svg>", shared, page, flags=re.DOTALL)
    rules = "".join(f".{name}{{{style.replace('url(', 'clip-path:url(')}}}" for style, name in names.items())
    return text.replace("</head>", f"<style>{rules}</style></head>", 1) if rules else text


def themed(svg: str) -> Markup:
    """A figure for a page: on the page's own paper, in its colours.

    Parameters
    ----------
    svg : str
    """
    bare = re.sub(r'<(path|rect)(?: (?:d|width|height|rx)="[^"]*")+ (?:style="fill:|fill=")#ffffff"\s?/>', "", svg)
    bare = re.sub('(fill|stroke)="#ffffff"', r'\1="var(--paper)"', bare)
    names = re.sub("#[0-9a-f]{6}", lambda m: f"var(--{THEMED[m[0]]})" if m[0] in THEMED else m[0], bare)
    return Markup(f'<div class="figure">{names}</div>')
