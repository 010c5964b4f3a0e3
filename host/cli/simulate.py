"""`palpate simulate`: one finite-element stroke."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from host.cli.output import json_option, note, plain, print_json, table
from host.files import by_suffix, whole_file

if TYPE_CHECKING:
    from sim.tissue import Stroke


@click.command("simulate")
@click.argument("code")
@click.option("--hx", "hx_mm", type=float, default=2.0, show_default=True, help="Element width, mm.")
@click.option("--increment", "increment_mm", type=float, default=2.0, show_default=True, help="Step, mm.")
@click.option("--start", "start_mm", type=float, default=-28.0, show_default=True, help="First position, mm.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write the stroke: .json, .csv (position by sensor), .png or .svg (the figure).",
)
@json_option
def command(
    code: str, hx_mm: float, increment_mm: float, start_mm: float, out: Path | None, as_json: bool
) -> None:
    """Simulate one stroke over a lump: contact finite elements at large strain.

    CODE names the case: d10h08e10f10 is a lump 10 mm wide, 0.8 diameters deep, 10 times stiffer than the fat,
    at 100 N/m. d12.3h0.85e7.4f0.66 writes any number; e1 is no lump, e1K is 1000, eNL stiffens with strain.

    \b
    Example:
      palpate simulate d10h08e10f10
      palpate simulate d10h08e10f10 --hx 1 --json > stroke.json
      palpate simulate d15h05e50f08 --out stroke.png
    """
    from sim.tissue import Case, Settings, simulate

    writers = {".json": _write_json, ".csv": _write_csv, ".png": _write_picture, ".svg": _write_picture}
    write = by_suffix(out, writers) if out is not None else None
    settings = Settings(hx_mm=hx_mm, increment_mm=increment_mm, start_mm=start_mm)
    stroke = simulate(Case.from_code(code), settings)
    record = stroke_json(stroke)
    if out is not None and write is not None:
        with whole_file(out) as path:
            write(path, stroke, record)
        note(f"wrote {out}")
    if as_json:
        print_json(record)
    else:
        _print_words(stroke, record)


def stroke_json(stroke: Stroke) -> dict[str, Any]:
    """A stroke as `--json` prints it: the simulation's fields, the tactile map (Method 2) and its features.

    Parameters
    ----------
    stroke : Stroke
        Of `sim.tissue`.
    """
    from dataclasses import asdict

    from host.features import stroke_features, tactile_map

    x_mm, pressure_kPa = tactile_map(stroke)
    record = stroke.to_dict()
    record["map"] = {"x_mm": x_mm.tolist(), "pressure_kPa": pressure_kPa.tolist()}
    record["features"] = asdict(stroke_features(stroke))
    return record


def _print_words(stroke: Stroke, record: dict[str, Any]) -> None:
    case, found = stroke.case, record["features"]
    lump = f"lump {case.d_mm:g} mm wide, {case.depth_mm:g} mm deep, E = {case.E_ratio:g}"
    title = (
        f"{stroke.code}: {lump if case.has_lump else 'no lump'}, fat {case.t_mm:g} mm, {case.F_N_per_m:g} N/m"
    )
    middle = stroke.images_kPa.shape[1] // 2
    rows = (
        (
            f"{x:.1f}",
            f"{d:.4f}",
            f"{s:.4f}",
            f"{(image[middle - 1] + image[middle]) / 2:.3f}",
            f"{image.max():.3f}",
        )
        for x, d, s, image in zip(
            stroke.positions_mm, stroke.displacement_mm, stroke.strain, stroke.images_kPa
        )
    )
    table(("position mm", "displacement mm", "strain", "centre kPa", "highest kPa"), rows, title)
    click.echo(
        f"tactile map: base {found['base_kPa']:.3f} kPa, amplitude {found['amp_kPa']:.3f} kPa, "
        f"stdev {found['stdev_mm']:.2f} mm; curvature {found['curvature']:.3f}; "
        f"displacement {found['D28_mm']:.3f} mm far from the lump, {found['D0_mm']:.3f} mm over it"
    )
    click.echo(f"{stroke.nodes} nodes, {int(stroke.iterations.sum())} Newton steps, {stroke.cpu_s:.2f} CPU s")


def _write_json(path: Path, stroke: Stroke, record: dict[str, Any]) -> None:
    path.write_text(json.dumps(plain(record), allow_nan=False))


def _write_csv(path: Path, stroke: Stroke, record: dict[str, Any]) -> None:
    import pandas as pd

    names = [f"pressure_kPa_at_{s:g}mm" for s in stroke.sensors_mm]
    frame = pd.DataFrame(stroke.images_kPa, columns=names)
    frame.insert(0, "position_mm", stroke.positions_mm)
    frame.insert(1, "displacement_mm", stroke.displacement_mm)
    frame.to_csv(path, index=False)


def _write_picture(path: Path, stroke: Stroke, record: dict[str, Any]) -> None:
    from matplotlib.figure import Figure

    from host.features import fit_gaussian

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    images, whole, depth = figure.subplots(1, 3)
    extent = (stroke.sensors_mm[0], stroke.sensors_mm[-1], stroke.positions_mm[-1], stroke.positions_mm[0])
    shown = images.imshow(stroke.images_kPa, extent=extent, aspect="auto", cmap="cividis")
    figure.colorbar(shown, ax=images, label="pressure, kPa")
    images.set(xlabel="sensor, mm", ylabel="probe position, mm", title="tactile images")
    x, p = record["map"]["x_mm"], record["map"]["pressure_kPa"]
    whole.plot(x, p, label="tactile map")
    whole.plot(x, fit_gaussian(x, p, centre_mm=0.0).curve(x), "--", label="Gaussian fit")
    whole.set(xlabel="place on the tissue, mm", ylabel="pressure, kPa", title=stroke.code)
    whole.legend(frameon=False)
    depth.plot(stroke.positions_mm, stroke.displacement_mm)
    depth.set(xlabel="probe position, mm", ylabel="displacement, mm", title="displacement")
    figure.savefig(path, dpi=120)
