"""Draws how pulses of the motor move the robot: `python benchmarks/gait_map.py`.

Swings, torque = amplitude sin(2 pi t / period) - 0.5 sin(mass - center), are mapped by amplitude,
period and center; whirls, a constant torque, by that torque. Drift and yaw rate are means over
the last 2.5 of 3 s. Writes docs/images/gait_map.png.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tune_heuristics import COARSE, Robots

from jbench.task_specs import CONTROL_TIMESTEP
from jbench.tasks.jitterbug import geometry

Array = NDArray[np.float64]

SPRING = 0.5  # share of the full torque that pulls the mass to the center of its swing
STEPS = 300  # control steps of a robot
SETTLING = 50  # first control steps, which are not counted
AMPLITUDES = (0.4, 0.6, 0.8, 1.0)  # share of the full torque
PERIODS = np.arange(0.06, 0.221, 0.02)  # s
CENTERS = np.radians(np.arange(0, 181, 15))  # 0 forward, 90 degrees to the left
WHIRLS = np.arange(0.2, 1.001, 0.05)  # share of the full torque
BEST = (0.8, 0.12)  # amplitude and period of the swings that are mapped by their center
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # Okabe and Ito's, for color-blind eyes
MARKERS = "os^D"
BELOW: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.15), "frameon": False}


def simulate(
    amplitude: Array, period: Array, center: Array, episodes: int
) -> tuple[NDArray[Any], Array]:
    """Returns drift (m/s; forward + 1j left) and yaw rate (rad/s), each (points, episodes).

    Args:
        amplitude: (points,) of the swings, or the whirls' torque where the period is infinite.
        period: (points,) s.
        center: (points,) rad.
        episodes: robots for each point.
    """
    swings, period, center = (
        np.repeat(values, episodes)
        for values in (np.isfinite(period), np.where(np.isfinite(period), period, 1.0), center)
    )
    torque = np.repeat(amplitude, episodes)
    seeds = np.tile(np.arange(episodes), len(amplitude))
    robots = Robots("move_from_origin", seeds.tolist(), COARSE)
    drift, yaw = np.zeros(len(seeds), dtype=complex), np.zeros(len(seeds))
    for step in range(STEPS):
        state = robots.state()
        phase = 2 * np.pi * step * CONTROL_TIMESTEP / period
        swing = torque * np.sin(phase) - SPRING * np.sin(state.motor_position - center)
        robots.step(np.clip(np.where(swings, swing, torque), -1, 1))
        if step >= SETTLING:
            velocity = state.torso_velocity[:, 0] + 1j * state.torso_velocity[:, 1]
            drift += velocity * np.exp(-1j * geometry.heading(state)) / (STEPS - SETTLING)
            yaw += state.velocity[:, 5] / (STEPS - SETTLING)
    return drift.reshape(-1, episodes), yaw.reshape(-1, episodes)


def draw_periods(axes: Any, episodes: int) -> None:
    """Draws drift against the period of swings forwards, for each amplitude."""
    grid = np.array([(a, p) for a in AMPLITUDES for p in PERIODS])
    drift, _ = simulate(grid[:, 0], grid[:, 1], np.zeros(len(grid)), episodes)
    rows = np.median(drift.real, 1).reshape(len(AMPLITUDES), -1)
    for amplitude, row, color, marker in zip(AMPLITUDES, rows, COLORS, MARKERS, strict=True):
        axes.plot(PERIODS * 1000, 100 * row, color=color, marker=marker, label=f"{amplitude:.1f}")
    axes.set(title="Swings about the front", xlabel="period (ms)", ylabel="drift forwards (cm/s)")
    axes.legend(title="amplitude (of full torque)", ncols=4, **BELOW)


def draw_centers(axes: Any, episodes: int) -> None:
    """Draws drift and yaw rate against the center of the best swings."""
    points = np.ones(len(CENTERS))
    drift, yaw = simulate(BEST[0] * points, BEST[1] * points, CENTERS, episodes)
    drift *= np.exp(-1j * CENTERS)[:, None]
    curves = (
        (100 * drift.real, "towards the center (cm/s)"),
        (100 * drift.imag, "to its left (cm/s)"),
        (yaw, "yaw rate (rad/s)"),
    )
    for (values, label), color, marker in zip(curves, COLORS, MARKERS, strict=False):
        low, median, high = np.percentile(values, [10, 50, 90], axis=1)
        axes.plot(np.degrees(CENTERS), median, color=color, marker=marker, label=label)
        axes.fill_between(np.degrees(CENTERS), low, high, color=color, alpha=0.15, linewidth=0)
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set(
        title=f"Swings of amplitude {BEST[0]:.1f}, period {1000 * BEST[1]:.0f} ms",
        xlabel="center of the swing (degrees; 0 forward, 90 left)",
        ylabel="drift (cm/s), yaw rate (rad/s)",
    )
    axes.set_xticks(np.arange(0, 181, 45))
    axes.legend(ncols=2, **BELOW)


def draw_whirls(axes: Any, episodes: int) -> None:
    """Draws yaw rate and drift against a constant torque."""
    points = np.ones(len(WHIRLS))
    drift, yaw = simulate(WHIRLS, np.inf * points, 0 * points, episodes)
    curves = ((yaw, "yaw rate (rad/s)"), (10 * np.abs(drift), "drift (0.1 m/s)"))
    for (values, label), color, marker in zip(curves, COLORS, MARKERS, strict=False):
        low, median, high = np.percentile(values, [10, 50, 90], axis=1)
        axes.plot(WHIRLS, median, color=color, marker=marker, label=label)
        axes.fill_between(WHIRLS, low, high, color=color, alpha=0.15, linewidth=0)
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set(
        title="Whirls",
        xlabel="constant torque (of full torque)",
        ylabel="yaw rate (rad/s), drift (0.1 m/s)",
    )
    axes.legend(ncols=2, **BELOW)


def main() -> None:
    """Writes the figure."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    image = Path(__file__).parents[1] / "docs" / "images" / "gait_map.png"
    parser.add_argument("--output", type=Path, default=image)
    parser.add_argument("--episodes", type=int, default=6, help="robots for each point of the map")
    args = parser.parse_args()
    figure = Figure(figsize=(13, 4.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    panels = {"periods": draw_periods, "centers": draw_centers, "whirls": draw_whirls}
    for axes, (name, draw) in zip((left, middle, right), panels.items(), strict=True):
        print(f"simulating {name}", file=sys.stderr, flush=True)
        draw(axes, args.episodes)
    for axes in (left, middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(args.output, dpi=150)
    print(f"wrote {args.output}")


if __name__ == "__main__":
    main()
