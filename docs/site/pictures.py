"""The pictures of docs/how_it_works.md: ``python docs/site/pictures.py`` writes them to docs/pictures."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from runtime import load
from runtime.drive.experiment import simulate
from runtime.drive.figures import COLOURS
from runtime.style.figures import pyplot, svg_text

FOLDER = Path(__file__).parents[1] / "pictures"
BLUE, RED, GREEN, DARK = COLOURS["ckf"], COLOURS["ickf"], COLOURS["ekf"], COLOURS["truth"]


def arrow(axis: Any, tip: Any, label: str, colour: str, start: Any = (0.0, 0.0), place: float = 1.12) -> None:
    """A vector with its name at the tip."""
    axis.annotate("", tip, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
    middle = np.asarray(start) + place * (np.asarray(tip) - np.asarray(start))
    axis.text(*middle, label, color=colour, ha="center", va="center")


def back_emf() -> Any:
    """Where the rotor stands, and the voltage by which it shows; and the same voltage by another rotor."""
    figure, axes = pyplot().subplots(1, 2, figsize=(7.0, 3.1))
    for axis, theta, sign, title in zip(
        axes,
        (np.radians(35), np.radians(215)),
        (1, -1),
        ("the rotor, turning forwards", "half a turn on, turning backwards:\nthe same voltage"),
        strict=True,
    ):
        magnet = np.array([np.cos(theta), np.sin(theta)])
        voltage = sign * 0.8 * np.array([-np.sin(theta), np.cos(theta)])
        for tip, name in (((1.25, 0), "alpha"), ((0, 1.25), "beta")):
            arrow(axis, tip, name, "#999999")
        arrow(axis, magnet, "magnets, d", RED, place=1.2)
        arrow(axis, voltage, "back-EMF", BLUE, place=1.25)
        turn = theta + sign * np.linspace(0.15, 0.75, 30)
        axis.plot(0.6 * np.cos(turn), 0.6 * np.sin(turn), color=DARK, lw=1)
        ends = [0.6 * np.array([np.cos(a), np.sin(a)]) for a in (turn[-2], turn[-1])]
        axis.annotate("", ends[1], ends[0], arrowprops={"arrowstyle": "-|>", "color": DARK, "lw": 1})
        axis.set(xlim=(-1.5, 1.5), ylim=(-1.15, 1.4), aspect="equal", title=title)
        axis.title.set_fontsize(9)
        axis.axis("off")
    return figure


def weighing() -> Any:
    """A prediction, a measurement, and what both say together."""
    figure, axis = pyplot().subplots(figsize=(7.0, 2.4))
    i = np.linspace(3.0, 7.0, 121)
    predicted, measured = (4.6, 0.5), (5.4, 0.3)
    gain = predicted[1] ** 2 / (predicted[1] ** 2 + measured[1] ** 2)
    both = (predicted[0] + gain * (measured[0] - predicted[0]), np.sqrt((1 - gain) * predicted[1] ** 2))
    for (mean, sigma), colour, name in (
        (predicted, BLUE, "predicted from the model"),
        (measured, GREEN, "measured"),
        (both, RED, "estimate"),
    ):
        bell = np.exp(-0.5 * ((i - mean) / sigma) ** 2) / sigma / np.sqrt(2 * np.pi)
        axis.plot(i, bell, color=colour, label=f"{name}: {mean:.2f} A, sigma {sigma:.2f} A")
        axis.fill_between(i, bell, color=colour, alpha=0.12, lw=0)
    axis.set(xlabel="current, A", ylabel="likely", yticks=[], ylim=(0, None))
    axis.legend(fontsize=8, loc="upper left")
    return figure


def found_again() -> Any:
    """A filter that begins 60 degrees off, on a run of the shipped drive: angle error and what P says of it."""
    (run,) = simulate("spmsm_load_torque", "no_load", ("ckf",), task={"speed": 20.0})
    turning = run.t >= 0.2
    u, i, theta = run.u[turning], run.i[turning], run.theta[turning]
    f = load("spmsm_load_torque", filter="ckf", dtype="float64")
    f.reset([*i[0], 0.9 * run.omega[turning][0], theta[0] - np.radians(60), 0.0], [0.01, 0.01, 1.0, 0.5, 0.01])
    trace = f.run(u[1:], i[1:])
    off = np.degrees(np.angle(np.exp(1j * (trace.x[:, 3] - theta[1:]))))
    sigma = np.degrees(np.sqrt(trace.P[:, 3, 3]))
    off, sigma = np.concatenate([[-60.0], off]), np.concatenate([[np.degrees(np.sqrt(0.5))], sigma])
    time, first = 1e3 * (run.t[turning] - run.t[turning][0]), slice(0, 61)
    figure, axis = pyplot().subplots(figsize=(7.0, 2.6))
    band = 2 * sigma[first]
    axis.fill_between(time[first], -band, band, color=BLUE, alpha=0.15, lw=0, label="2 sigma of P")
    axis.plot(time[first], off[first], ".-", color=BLUE, lw=1.0, ms=3, label="angle of the filter less the rotor's")
    axis.set(xlabel="time, ms", ylabel="degrees electrical", ylim=(-90, 90))
    axis.legend(fontsize=8, loc="upper right")
    return figure


def points() -> Any:
    """Two uncertain numbers, four points that stand for them, and where a curved function takes these."""
    rng = np.random.default_rng(1)
    mean, P = np.array([1.0, 0.7]), np.array([[0.006, 0.01], [0.01, 0.16]])  # length, angle
    S = np.linalg.cholesky(P)
    spread = np.sqrt(2) * np.hstack([S, -S])
    chosen, drawn = mean[:, None] + spread, mean[:, None] + S @ rng.normal(size=(2, 300))
    ring = mean[:, None] + S @ np.array([np.cos(np.linspace(0, 2 * np.pi, 61)), np.sin(np.linspace(0, 2 * np.pi, 61))])

    def bent(x: Any) -> Any:
        return np.array([x[0] * np.cos(x[1]), x[0] * np.sin(x[1])])

    figure, axes = pyplot().subplots(1, 2, figsize=(7.0, 3.0))
    axes[0].plot(np.degrees(drawn[1]), drawn[0], ".", ms=1, color="#bbbbbb", zorder=0)
    axes[0].plot(np.degrees(ring[1]), ring[0], color=BLUE, lw=1)
    axes[0].plot(np.degrees(chosen[1]), chosen[0], "o", color=RED, ms=5)
    axes[0].set(xlabel="angle, degrees", ylabel="length", title="before: mean, P, and 2 n points")
    axes[1].plot(*bent(drawn), ".", ms=1, color="#bbbbbb", zorder=0)
    axes[1].plot(*bent(ring), color=BLUE, lw=1)
    axes[1].plot(*bent(chosen), "o", color=RED, ms=5, label="the same points")
    axes[1].plot(*bent(chosen).mean(axis=1), "P", color=RED, ms=8, label="their mean")
    axes[1].plot(*bent(drawn).mean(axis=1), "x", color=DARK, ms=8, mew=2, label="mean of the 300 dots")
    axes[1].plot(*bent(mean), "D", color=GREEN, ms=5, label="the mean, taken through alone")
    axes[1].set(xlabel="alpha", ylabel="beta", title="after", xlim=(-0.1, 1.35))
    axes[1].legend(fontsize=7, loc="lower left")
    for axis in axes:
        axis.title.set_fontsize(9)
    return figure


def bent_mean() -> Any:
    """The mean of cos(theta) where theta is uncertain: the truth, one point, and the cubature points of n states."""
    sigma = np.radians(np.linspace(0, 60, 61))
    figure, axis = pyplot().subplots(figsize=(7.0, 2.6))
    degrees = np.degrees(sigma)
    axis.plot(degrees, np.exp(-(sigma**2) / 2), color=DARK, lw=2.2, label="truth")
    axis.plot(degrees, np.ones_like(sigma), color=GREEN, ls="-.", label="tangent at the mean (EKF)")
    n = 4
    cubature = 1 - (1 - np.cos(np.sqrt(n) * sigma)) / n
    axis.plot(degrees, cubature, color=BLUE, ls="--", label="2 n points, n = 4")
    axis.set(xlabel="sigma of the angle, degrees", ylabel="mean of cos(theta)\nabout theta = 0", ylim=(0.5, 1.05))
    axis.legend(fontsize=8, loc="lower left")
    return figure


def iterations() -> Any:
    """What is minimised (eq. 27) over the angle, for one axis of flux linkages as states, and where each pass ends."""
    psi_m, L, sigma, noise = 0.175, 0.000835 * 8, np.radians(35), 0.6
    theta_pred, truth = np.radians(40), np.radians(88)
    psi = psi_m * np.cos(truth)

    def h(theta: Any) -> Any:
        return (psi - psi_m * np.cos(theta)) / L

    theta = np.radians(np.linspace(20, 130, 111))
    cost = ((theta - theta_pred) / sigma) ** 2 + (h(theta) / noise) ** 2
    passes = [theta_pred]
    for _ in range(3):
        slope = psi_m * np.sin(passes[-1]) / L
        gain = sigma**2 * slope / (slope**2 * sigma**2 + noise**2)
        passes.append(theta_pred + gain * (0.0 - h(passes[-1]) - slope * (theta_pred - passes[-1])))
    figure, axis = pyplot().subplots(figsize=(7.0, 2.6))
    axis.plot(np.degrees(theta), cost, color=DARK, lw=1.2)
    at = [((x - theta_pred) / sigma) ** 2 + (h(x) / noise) ** 2 for x in passes]
    axis.plot(np.degrees(passes), at, "o-", color=RED, lw=0.9)
    for k, (x, y) in enumerate(zip(passes, at, strict=True)):
        name = ("predicted", "after pass 1", "", "after passes 2 and 3")[k]
        axis.annotate(name, (np.degrees(x), y), textcoords="offset points", xytext=(8, 4), color=RED)
    axis.set(xlabel="angle, degrees", ylabel="eq. 27", yscale="log")
    return figure


PICTURES: dict[str, Callable[[], Any]] = {
    function.__name__: function for function in (back_emf, weighing, found_again, points, bent_mean, iterations)
}


def drawn_by() -> str:
    """The end of a committed figure: the matplotlib that laid it out."""
    return f"\n<!-- Matplotlib v{version('matplotlib')} -->\n"


def main() -> None:
    """Write every picture."""
    for name, draw in PICTURES.items():
        (FOLDER / f"{name}.svg").write_text(svg_text(draw()) + drawn_by(), encoding="utf-8")


if __name__ == "__main__":
    main()
