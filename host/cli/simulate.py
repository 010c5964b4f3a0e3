"""`palpate simulate`: one finite-element stroke."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.cli.numbers import Finite
from palpate.console import json_option, note, plain, print_json, say, table
from palpate.errors import UsageError
from palpate.files import by_suffix, check_writable, whole_file
from palpate.first_time import announce

if TYPE_CHECKING:
    from palpate.sim.tissue import Fields, Stroke


@click.command("simulate")
@click.argument("code")
@click.option("--hx", "hx_mm", type=Finite(), default=2.0, show_default=True, help="Element width, mm.")
@click.option("--increment", "increment_mm", type=Finite(), default=2.0, show_default=True, help="Step, mm.")
@click.option(
    "--start", "start_mm", type=Finite(), default=-28.0, show_default=True, help="First position, mm."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write the stroke: .json, .csv (position by sensor), .png or .svg (the figure).",
)
@click.option(
    "--fields",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write strain, pressure and principal stretches in the tissue. OUT.vtu: the last position, and "
    "beside it OUT.pvd, the whole stroke for ParaView (its times are the positions in mm, its files "
    "OUT_000.vtu ...). OUT.pvd: that alone. .png or .svg: a picture of the last position.",
)
@click.option(
    "--solver",
    default="auto",
    show_default=True,
    metavar="NAME",
    help="What factors the tangent: auto, strip, cholmod or superlu; or reference, the weak form as "
    "scikit-fem assembles it, hundreds of times slower.",
)
@json_option
def command(
    code: str,
    hx_mm: float,
    increment_mm: float,
    start_mm: float,
    out: Path | None,
    fields: Path | None,
    solver: str,
    as_json: bool,
) -> None:
    """Simulate one stroke over a lump: contact finite elements at large strain.

    CODE names the case: d10h08e10f10 is a lump 10 mm wide, 0.8 diameters deep, 10 times stiffer than the fat,
    at 100 N/m. d12.3h0.85e7.4f0.66 writes any number; e1 is no lump, e1K is 1000, eNL stiffens with strain.

    Without more the lump is a cylinder across the stroke (plane strain, a fraction of a second). _ball and
    _ellipsoid8x4 (half-axes across and down, mm) are solid lumps in three dimensions (seconds); _y5 puts
    one 5 mm beside the stroke's line. _t18 gives the fat a thickness of its own: its border to the gland
    need not pass through the lump's middle. _m10_M20 lays a muscle of 10 mm, 20 times as stiff as fat, under
    the gland.

    \b
    Example:
      palpate simulate d10h08e10f10
      palpate simulate d10h08e10f10 --hx 1 --json > stroke.json
      palpate simulate d15h05e50f08 --out stroke.png
      palpate simulate d10h08e10f10 --fields tissue.vtu
      palpate simulate d10h08e10f10_ball_y5 --out ball.png
    """
    from palpate.sim.tissue import Case, Settings, simulate, simulate_fields

    writers = {".json": _write_json, ".csv": _write_csv, ".png": _write_picture, ".svg": _write_picture}
    write = by_suffix(out, writers) if out is not None else None
    if fields is not None:
        by_suffix(fields, dict.fromkeys((".vtu", ".pvd", ".png", ".svg"), _write_fields))
    case = Case.from_code(code)
    if fields is not None and case.solid and fields.suffix.lower() in (".png", ".svg"):
        raise UsageError("fields round a solid lump are written for ParaView only: name a file .vtu or .pvd")
    if out is not None and out == fields:
        raise UsageError(f"--out and --fields both name {out}; give each a file of its own")
    for written in filter(None, (out, fields)):
        check_writable(written)
    settings = Settings(hx_mm=hx_mm, increment_mm=increment_mm, start_mm=start_mm, solver=solver)
    announce()
    if fields is None:
        stroke = simulate(case, settings)
    else:
        stroke, series = simulate_fields(case, settings)
        _write_fields(fields, stroke, series)
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
        Of `palpate.sim.tissue`.
    """
    from dataclasses import asdict

    from palpate.features.map_features import stroke_features, tactile_map

    seen, columns = over_the_lump(stroke)
    x_mm, pressure_kPa = tactile_map(seen)
    record = stroke.to_dict()
    record["map"] = {"x_mm": x_mm.tolist(), "pressure_kPa": pressure_kPa.tolist()}
    record["features"] = asdict(stroke_features(seen))
    if stroke.case.solid:
        record["map"]["columns"] = columns
    return record


def over_the_lump(stroke: Stroke) -> tuple[Stroke, list[int]]:
    """The stroke with one row of sensors, and the columns over a solid lump that it is the mean of.

    These are the columns whose pressure rises at least half as much, from the first position on, as that of
    the column where it rises most.
    """
    from dataclasses import replace

    import numpy as np

    if not stroke.case.solid:
        return stroke, []
    along = stroke.images_kPa.mean(1)
    rise = (along - along[0])[:, 2:-2].max(0)  # the outermost feel the face's edge
    columns = 2 + np.flatnonzero(rise >= 0.5 * rise.max())
    return replace(stroke, images_kPa=stroke.images_kPa[:, :, columns].mean(2)), columns.tolist()


def _print_words(stroke: Stroke, record: dict[str, Any]) -> None:
    case, found = stroke.case, record["features"]
    lump = f"{'lump' if not case.solid else case.shape} {case.d_mm:g} mm wide"
    if case.solid:
        lump += f", {2 * case.half_axes_mm[1]:g} mm across, {case.offset_mm:g} mm beside the line"
    lump += f", {case.depth_mm:g} mm deep (h {case.h:g})"
    lump += f", E = {case.E_ratio:g} ({case.E_ratio * case.fat_kPa:g} kPa)"
    force = f"{case.F_N:g} N" if case.solid else f"{case.F_N_per_m:g} N/m"
    title = f"{stroke.code}: {lump if case.has_lump else 'no lump'}, fat {case.t_mm:g} mm, {force}"
    seen, columns = over_the_lump(stroke)
    middle = seen.images_kPa.shape[1] // 2
    rows = (
        (
            f"{x:.1f}",
            f"{d:.4f}",
            f"{s:.4f}",
            f"{(image[middle - 1] + image[middle]) / 2:.3f}",
            f"{image.max():.3f}",
        )
        for x, d, s, image in zip(seen.positions_mm, seen.displacement_mm, seen.strain, seen.images_kPa)
    )
    table(("position mm", "displacement mm", "strain", "centre kPa", "highest kPa"), rows, title)
    if columns:
        every = stroke.images_kPa.shape[2]
        say(f"pressures: mean of the sensors' columns {columns[0] + 1} to {columns[-1] + 1} of {every}")
    say(
        f"tactile map: base {found['base_kPa']:.3f} kPa, amplitude {found['amp_kPa']:.3f} kPa, "
        f"stdev {found['stdev_mm']:.2f} mm; curvature {found['curvature']:.3f}; "
        f"displacement {found['D28_mm']:.3f} mm far from the lump, {found['D0_mm']:.3f} mm over it"
    )
    say(f"{stroke.nodes} nodes, {int(stroke.iterations.sum())} Newton steps, {stroke.cpu_s:.2f} CPU s")


def _write_fields(path: Path, stroke: Stroke, series: list[Fields]) -> None:
    from palpate.report.tissue_fields import draw_fields, write_fields

    if path.suffix.lower() in (".png", ".svg"):
        with whole_file(path) as temporary:
            draw_fields(series[-1], stroke.code).savefig(temporary, dpi=120)
        note(f"wrote {path}")
        return
    collection, *files = write_fields(path, series)
    last = f"; {path} is the last of them" if path in files else ""
    note(f"wrote {collection}: {len(series)} positions, for ParaView{last}")


def _write_json(path: Path, stroke: Stroke, record: dict[str, Any]) -> None:
    path.write_text(json.dumps(plain(record), allow_nan=False))


def _write_csv(path: Path, stroke: Stroke, record: dict[str, Any]) -> None:
    import pandas as pd

    from palpate.sim.tissue import SolidStroke

    names = [f"pressure_kPa_at_{s:g}mm" for s in stroke.sensors_mm]
    if isinstance(stroke, SolidStroke):
        names = [f"{name}_{z:g}mm_across" for name in names for z in stroke.across_mm]
    frame = pd.DataFrame(stroke.images_kPa.reshape(len(stroke.positions_mm), -1), columns=names)
    frame.insert(0, "position_mm", stroke.positions_mm)
    frame.insert(1, "displacement_mm", stroke.displacement_mm)
    frame.to_csv(path, index=False)


def _write_picture(path: Path, stroke: Stroke, record: dict[str, Any]) -> None:
    from palpate.features.map_features import fit_gaussian
    from palpate.report import stroke_panels, style
    from palpate.sim.tissue import SolidStroke

    with style.look():
        figure = style.new(10, 3.2)
        figure.suptitle(stroke.code, x=0.01, ha="left", weight="bold")
        images, whole, depth = figure.subplots(1, 3)
        s, p, pressures = stroke.sensors_mm, stroke.positions_mm, stroke.images_kPa
        if isinstance(stroke, SolidStroke):
            z, last = stroke.across_mm, pressures[-1]
            edges, title = (z[0], z[-1], s[0], s[-1]), f"Image at {p[-1]:g} mm"
            shown = stroke_panels.tactile_image(images, last, edges, last.max(), title)
        else:
            edges = s[0], s[-1], p[0], p[-1]
            shown = stroke_panels.tactile_image(images, pressures, edges, pressures.max(), "Tactile images")
            images.set(xlabel="along the probe (mm)", ylabel="position of the probe (mm)", aspect="auto")
        figure.colorbar(shown, ax=images, label="kPa")
        x, map_kPa = record["map"]["x_mm"], record["map"]["pressure_kPa"]
        curve = fit_gaussian(x, map_kPa, centre_mm=0.0).curve(x)
        stroke_panels.tactile_map(whole, x, map_kPa, (x, curve))
        stroke_panels.displacement(depth, p, stroke.displacement_mm)
        figure.savefig(path, dpi=120)
