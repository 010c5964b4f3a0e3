"""The figures and numbers of docs/physics.md: python -m tests.benchmarks.draw_physics [DIR]"""

from __future__ import annotations

import math
import sys
from dataclasses import asdict, replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from palpate.features.map_features import stroke_features, tactile_map
from palpate.sim.tissue import Case, Settings, Stroke, load_curve, simulate
from palpate.sim.tissue.deformation import deformation
from palpate.sim.tissue.probe_shape import ProbeShape
from tests.sim.tissue.blocks import block, press, tissue_of

REFERENCE = Case.from_code("d10h08e10f10")
FORCES = (0.2, 0.4, 0.6, 0.8, 1.0)
FEATURES = ("base_kPa", "amp_kPa", "stdev_mm", "curvature", "D28_mm", "D0_mm")


def draw_mesh(folder: Path) -> None:
    mesh, pressed = deformation(REFERENCE, [-14.0])
    fig, axes = plt.subplots(2, 1, figsize=(9, 6), layout="constrained")
    colours = ["#f7e7c6", "#e9b7a7", "#a24b4b"]
    for axis, nodes, title in zip(axes, (mesh.nodes_mm, pressed[0].nodes_mm), ("At rest", "Probe at -14 mm")):
        for kind in range(3):
            ring = mesh.elements[mesh.material == kind][:, [0, 1, 2, 5, 8, 7, 6, 3]]
            for corners in nodes[ring]:
                axis.fill(*corners.T, facecolor=colours[kind], edgecolor="k", linewidth=0.3)
        axis.set(xlim=(-45, 20), ylim=(-16, 19), aspect="equal", title=title, ylabel="mm")
    axes[1].plot(*pressed[0].face_mm.T, color="tab:blue", linewidth=2, label="probe")
    for name, colour in zip(("fat", "gland", "lump"), colours):
        axes[1].fill([], [], facecolor=colour, edgecolor="k", linewidth=0.3, label=name)
    axes[1].legend(loc="upper right", ncols=4, fontsize=8)
    axes[1].set(xlabel="mm from the lump's middle")
    fig.savefig(folder / "physics-mesh.png", dpi=110)
    plt.close(fig)


def hertz(folder: Path) -> None:
    """Line contact on a deep block against Hertz' ellipse."""
    radius, young, a = 400.0, 10.0, 8.0
    fig, axis = plt.subplots(figsize=(6, 3.6), layout="constrained")
    print("Hertz line contact: hx/a, peak error %, rms error inside .9 a, % of peak")
    for nu, style in ((0.3, "o"), (0.4999, "s")):
        plane = young / (1 - nu**2)
        force = math.pi * a * a * plane / 4 / radius
        peak = 2 * force / math.pi / a
        for hx in (2.0, 1.0, 0.5):
            side = _grow(12.0, 200.0, 1.3 * hx, 1.5)
            x = np.concatenate([-side[::-1], np.arange(-12.0, 12.0 + 1e-9, hx)[1:-1], side])
            tissue = tissue_of(block(x, _grow(0.0, -400.0, 0.8 * hx, 1.45)[::-1]), young, nu)
            s, p, _ = press(tissue, ProbeShape(radius, 1e6, 1.0), force, 0.3)
            exact = peak * np.sqrt(np.maximum(1 - (s / a) ** 2, 0))
            inside = np.abs(s) < 0.9 * a
            rms = np.sqrt(np.mean((p - exact)[inside] ** 2)) / peak
            print(f"  nu {nu}: {hx / a:.4f}  {100 * (np.interp(0, s, p) / peak - 1):+.3f}  {100 * rms:.3f}")
            if hx == 1.0:
                axis.plot(s, p / peak, style, markersize=4, label=f"nu = {nu}")
    fine = np.linspace(-a, a, 200)
    axis.plot(fine, np.sqrt(1 - (fine / a) ** 2), "k-", linewidth=1, label="Hertz")
    axis.set(xlabel="mm from the middle of the contact", ylabel="pressure / peak", xlim=(-11, 11))
    axis.legend(loc="lower center")
    fig.savefig(folder / "physics-hertz.png", dpi=110)
    plt.close(fig)


def _grow(start: float, stop: float, first: float, ratio: float) -> np.ndarray:
    steps = [start]
    while abs(steps[-1]) < abs(stop):
        steps.append(steps[-1] + math.copysign(first, stop))
        first *= ratio
    out = np.array(steps)
    return start + (out - start) * (stop - start) / (out[-1] - start)


def convergence() -> None:
    """All six features with columns alone refined, and with the whole mesh refined."""
    kinds = {
        "columns only: hx = 2, 1, .5": [Settings(), Settings(hx_mm=1.0), Settings(hx_mm=0.5)],
        "every size halved: hx = 2, 1, .5": [Settings(), Settings().refined(2), Settings().refined(4)],
    }
    for title, settings in kinds.items():
        rows = [asdict(stroke_features(simulate(REFERENCE, s))) for s in settings]
        print(f"Mesh convergence, {title}; change to the next in %, observed order")
        for name in FEATURES:
            a, b, c = (row[name] for row in rows)
            order = math.log2(abs((a - b) / (b - c))) if b != c else math.inf
            print(
                f"  {name:10s} {a:9.5f} {b:9.5f} {c:9.5f}   {100 * (a / c - 1):+.3f} {100 * (b / c - 1):+.3f}"
                f"   {order:.1f}"
            )


def observations(folder: Path) -> None:
    strokes = {E: simulate(replace(REFERENCE, E_ratio=E)) for E in (1.0, 2.0, 5.0, 10.0, 50.0, 1000.0)}
    features = {E: stroke_features(s) for E, s in strokes.items()}
    lumps = [2.0, 5.0, 10.0, 50.0, 1000.0]
    amp = np.array([features[E].amp_kPa for E in lumps])
    x = np.array(lumps) ** (-2 / 3)
    print(f"Amplitude against E^-2/3: R2 = {np.corrcoef(x, amp)[0, 1] ** 2:.4f}")
    far = np.array([features[E].D28_mm for E in lumps])
    print(f"Displacement at 28 mm over E = 2..1000: spread {100 * np.ptp(far) / far.mean():.2f} %")
    plain = tactile_map(strokes[1.0])[1]
    print(f"E = 1: the map varies by {np.ptp(plain) / plain.mean():.1e} of its base")

    fig, axes = plt.subplots(2, 2, figsize=(10, 7), layout="constrained")
    colour = {E: f"C{k}" for k, E in enumerate(strokes)}  # the same in every panel
    for E, stroke in strokes.items():
        look = {"color": colour[E], "label": f"E = {E:g}"}
        axes[0, 0].plot(*tactile_map(stroke), **look)
        axes[0, 1].plot(stroke.full().positions_mm, stroke.full().displacement_mm, **look)
    soft = simulate(Case.from_code("d10h08eNLf10"))
    axes[0, 1].plot(soft.full().positions_mm, soft.full().displacement_mm, "k--", label="NL")
    axes[0, 0].set(title="Tactile maps (Method 2)", xlabel="mm from the lump", ylabel="kPa")
    axes[0, 1].set(title="Displacement of the probe", xlabel="position, mm from the lump", ylabel="mm")
    print("Strain-force curves over the lump, F = A S^B: B, R2")
    for E in (1.0, 2.0, 5.0, 10.0, 1000.0, None):
        case = Case.from_code("d10h08eNLf10") if E is None else replace(REFERENCE, E_ratio=E)
        strain = np.array([s.strain[0] for s in load_curve(case, FORCES)])
        slope, level = np.polyfit(np.log(strain), np.log(FORCES), 1)
        rest = np.log(FORCES) - slope * np.log(strain) - level
        name = "NL" if E is None else f"E = {E:g}"
        print(f"  {name:9s} {slope:.3f} {1 - rest.var() / np.log(FORCES).var():.5f}")
        line = {"color": "k", "linestyle": "--"} if E is None else {"color": colour[E]}
        axes[1, 0].plot(strain, FORCES, marker="o", markersize=3, label=name, **line)
    axes[1, 0].set(title="Strain-force curves over the lump", xlabel="nominal strain", ylabel="F")
    near = simulate(Case.from_code("d10h03e10f10")).full()
    axes[1, 1].plot(near.positions_mm, near.peak_mm, ".-")
    axes[1, 1].set(
        title="Place of the peak pressure on the face, h = 0.3", xlabel="position, mm from the lump"
    )
    axes[1, 1].set(ylabel="mm from the face's middle")
    for axis in axes.flat[:3]:
        axis.legend(fontsize=7)
    fig.savefig(folder / "physics-thesis.png", dpi=110)
    plt.close(fig)


def methods(folder: Path) -> None:
    """Method 1 and Method 2 at increments of 1 and 2 mm (thesis, Figure 9)."""
    fig, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained", sharey=True)
    print("Ripple of the map, rms of its third differences, kPa: Method 1, Method 2")
    for axis, step in zip(axes, (2.0, 1.0)):
        stroke: Stroke = simulate(REFERENCE, Settings(hx_mm=step, increment_mm=step))
        rough = []
        for method, style in ((1, "o-"), (2, "-")):
            x, p = tactile_map(stroke, method)
            inner = np.abs(x) <= 14
            axis.plot(x[inner], p[inner], style, markersize=3, label=f"Method {method}")
            rough.append(np.sqrt(np.mean(np.diff(p[inner], 3) ** 2)))
        axis.set(title=f"{step:g} mm increments, 1 mm map", xlabel="mm from the lump")
        axes[0].set(ylabel="kPa")
        axis.legend()
        print(f"  increments of {step:g} mm: {rough[0]:.4f}  {rough[1]:.4f}")
    fig.savefig(folder / "physics-methods.png", dpi=110)
    plt.close(fig)


def beyond(folder: Path) -> None:
    """Friction, stiffening tissue and probe shapes."""
    fig, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for friction in (0.0, 0.1, 0.2, 0.3):
        stroke = simulate(replace(REFERENCE, friction=friction)).full()
        axes[0].plot(stroke.positions_mm, stroke.images_kPa[:, 7:9].mean(1), label=f"mu = {friction:g}")
    axes[0].set(
        title="Friction: trace of the middle sensors", xlabel="position, mm from the lump", ylabel="kPa"
    )
    stiff = replace(REFERENCE, fat_stiffening=6.0, gland_stiffening=16.0)
    ogden = replace(REFERENCE, fat_stiffening=10.2, gland_stiffening=17.7, law="ogden")  # as curved at rest
    for case, name in ((REFERENCE, "linear"), (stiff, "stiffening fat and gland"), (ogden, "by Ogden's law")):
        curve = load_curve(case, (0.1, *FORCES, 1.2), -28.0)
        axes[1].plot(
            [s.strain[0] for s in curve], [s.case.F_rel for s in curve], "-o", markersize=3, label=name
        )
    axes[1].set(title="Strain-force far from the lump", xlabel="nominal strain", ylabel="F")
    axes[1].set(xticks=[0.05, 0.10, 0.15, 0.20])
    for radius in (25.0, 40.0, 100.0, math.inf):
        stroke = simulate(replace(REFERENCE, probe_radius_mm=radius), positions_mm=[-28, 0])
        axes[2].plot(
            stroke.sensors_mm,
            stroke.images_kPa[1],
            ".-",
            label="flat" if math.isinf(radius) else f"R = {radius:g} mm",
        )
    axes[2].set(title="Image over the lump, probe radius", xlabel="mm from the face's middle", ylabel="kPa")
    for axis in axes:
        axis.legend(fontsize=7)
    fig.savefig(folder / "physics-beyond.png", dpi=110)
    plt.close(fig)


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
    folder.mkdir(parents=True, exist_ok=True)
    draw_mesh(folder)
    hertz(folder)
    observations(folder)
    methods(folder)
    beyond(folder)
    convergence()


if __name__ == "__main__":
    main()
