// The charts of a stroke: tactile map with its fit; its press, force against displacement; displacement and force along it. The
// stroke before is a shadow.

import { PITCH_MM, ROWS } from "./array.js";
import { get } from "./dom.js";
import { Held, Plot, extent, nearest } from "./plot.js";

const FACE_HALF_MM = (ROWS * PITCH_MM) / 2; // along
const DRAGGED_PX = 8;
const FARTHEST_MM = 60; // half of what is shown along the stroke: beyond it zoom ends
const MOVED_MM = 0.5; // so far from its first place a probe strokes: until then it presses
const LEAST_MM = 0.4; // of displacement along a stroke: the dip over a lump is .2 to .3

export class StrokeCharts {
  /** moved(mm): the pointer is there along a chart, null: it has left them; or they have to be drawn anew. */
  constructor(moved) {
    this.map = new Plot(get("map"), { xLabel: "place on the tissue (mm)", yLabel: "kPa", yTicks: 6 });
    this.press = new Plot(get("press"), { xLabel: "mm", yLabel: "N/m" });
    this.displacement = new Plot(get("displacement"), { xLabel: "position (mm)", yLabel: "mm" });
    this.force = new Plot(get("force"), { xLabel: "position (mm)", yLabel: "N/m" });
    this.legend = get("map-legend");
    this.shadow = null;
    this.stroke = null;
    this.axes = new Held();
    this.moved = moved;
    this.cursor = null; // mm, one for all charts along the stroke
    this.zoom = null; // [from, to] in mm, or all
    for (const plot of [this.map, this.displacement, this.force]) this.listen(plot);
  }

  /** The pointer over a chart: a line through all of them, and zoom where it is dragged; a double click shows all again. */
  listen(plot) {
    const { canvas } = plot;
    let from = null;
    const at = ({ offsetX }) => (plot.place ? plot.place.fromX(offsetX) : null);
    const move = (event) => {
      this.cursor = at(event);
      this.moved(this.cursor);
    };
    canvas.addEventListener("pointermove", move);
    canvas.addEventListener("pointerdown", (event) => {
      from = event;
      move(event);
    });
    canvas.addEventListener("pointerup", (event) => {
      if (from && event.pointerType === "mouse" && Math.abs(event.offsetX - from.offsetX) > DRAGGED_PX) this.zoom = [at(from), at(event)].sort((a, b) => a - b);
      from = null;
      this.moved(this.cursor);
    });
    canvas.addEventListener("dblclick", () => this.zoomBy(Infinity));
    canvas.addEventListener("pointerleave", () => {
      from = this.cursor = null;
      this.moved(null);
    });
  }

  /** Show so much of what is shown along the stroke, about the cursor. */
  zoomBy(by) {
    const [low, high] = this.zoom ?? this.map.place?.x ?? [0, 0];
    const middle = this.cursor ?? (low + high) / 2;
    const half = (by * (high - low)) / 2;
    this.zoom = half > 0 && half < FARTHEST_MM ? [middle - half, middle + half] : null;
    this.moved(this.cursor);
  }

  /** Show a stroke, running or finished; a new one leaves the last as a shadow. */
  show(stroke) {
    if (this.stroke && stroke && stroke.number !== this.stroke.number) this.shadow = this.stroke;
    this.stroke = stroke;
  }

  /** Another viewer program answers now. */
  forget() {
    this.stroke = null;
    this.shadow = null;
    this.axes.forget();
  }

  /** The visit's axis that takes these values in. */
  range(name, lists, fallback, margin, least) {
    const wanted = extent(lists, fallback, margin, least);
    return this.stroke ? this.axes.range(this.stroke.visit, name, wanted) : fallback;
  }

  /** position_mm: where the probe is now, or where along a finished stroke the reader looks; or null. */
  draw(position_mm) {
    const stroke = this.stroke;
    const map = stroke?.map ?? { x_mm: [], pressure_kPa: [] };
    const old = this.shadow?.map ?? { x_mm: [], pressure_kPa: [] };
    const fit = stroke?.fit;
    const x = this.range("map x", [map.x_mm, old.x_mm], [-40, 40], 0.02, 20);
    const y = this.range("map y", [map.pressure_kPa, old.pressure_kPa], [0, 8], 0.08, 1);
    const curve = fit && gaussian(fit, Math.max(x[0], map.x_mm[0]), Math.min(x[1], map.x_mm.at(-1)));
    this.map.draw(
      [
        position_mm !== null && { kind: "span", from: position_mm - FACE_HALF_MM, to: position_mm + FACE_HALF_MM },
        { kind: "line", x: old.x_mm, y: old.pressure_kPa, color: "ghost", width: 1.5 },
        fit && { kind: "level", at: fit.base_kPa, color: "fit" },
        curve && { kind: "line", ...curve, color: "fit", width: 2.5 },
        { kind: "points", x: map.x_mm, y: map.pressure_kPa, color: "points", read: 2 },
      ],
      this.zoom ?? x,
      y,
      this.cursor,
    );
    this.map.canvas.dataset.y = y.join(" ");
    const [now, before] = [parted(stroke?.traces), parted(this.shadow?.traces)];
    this.trace(this.displacement, "displacement_mm", [2, 3], LEAST_MM, position_mm, now.along, before.along);
    this.trace(this.force, "force_N_per_m", [0, 120], 20, position_mm, now.along, before.along);
    this.pressed(now.press, before.press);
    this.describe(fit, map.by);
  }

  /** The press: how deep, and how hard it was for that. */
  pressed(now, old) {
    const x = this.range("press", [now?.displacement_mm, old?.displacement_mm, [0]], [0, 4], 0.02, 1);
    const y = this.range("pressed", [now?.force_N_per_m, old?.force_N_per_m, [0]], [0, 120], 0.02, 20);
    const curve = (one, paint, width) => one && { kind: "line", x: one.displacement_mm, y: one.force_N_per_m, color: paint, width };
    this.press.draw([curve(old, "ghost", 1.2), curve(now, "points", 1.8)], x, y);
  }

  trace(plot, key, fallback, least, position_mm, now, old) {
    const x = this.range("x", [now?.position_mm, old?.position_mm], [-30, 30], 0.01, 10);
    const y = this.range(key, [now?.[key], old?.[key]], fallback, 0.1, least);
    const at = now && position_mm !== null ? nearest(now.position_mm, position_mm) : -1;
    plot.draw(
      [
        old && { kind: "line", x: old.position_mm, y: old[key], color: "ghost", width: 1.2 },
        now && { kind: "line", x: now.position_mm, y: now[key], color: "points", width: 1.8, read: key === "force_N_per_m" ? 0 : 2 },
        at >= 0 && { kind: "points", x: [now.position_mm[at]], y: [now[key][at]], color: "accent", radius: 4 },
      ],
      this.zoom ?? x,
      y,
      this.cursor,
    );
    plot.canvas.dataset.y = y.join(" ");
  }

  describe(fit, by) {
    const text = fit
      ? `<span><i style="color:var(--points)"></i>map</span> ` +
        `<span><i style="color:var(--fit)"></i>fit by the ${by === "probe" ? "probe" : "viewer"}:</span> ` +
        `<span>Base ${fit.base_kPa.toFixed(2)},</span> <span>Amp ${fit.amp_kPa.toFixed(2)} kPa,</span> ` +
        `<span>Stdev ${fit.stdev_mm.toFixed(1)} mm</span>`
      : this.stroke
        ? `<span><i style="color:var(--points)"></i>map,</span> no bump to fit${this.stroke.card ? "" : " yet"}`
        : "grows as the probe strokes";
    if (text !== this.described) {
      this.legend.innerHTML = text;
      this.described = text;
    }
  }
}

/** The traces of the press, before the probe has moved, and of the stroke after it. */
function parted(traces) {
  if (!traces) return {};
  const { position_mm: at } = traces;
  const moved = at.findIndex((v) => Math.abs(v - at[0]) > MOVED_MM);
  const part = (from, to) => Object.fromEntries(Object.entries(traces).map(([key, values]) => [key, values.slice(from, to)]));
  return moved < 0 ? { press: traces } : { press: part(0, moved), along: part(moved) };
}

function gaussian({ base_kPa, amp_kPa, centre_mm, stdev_mm }, from, to) {
  const x = Array.from({ length: 161 }, (_, i) => from + ((to - from) * i) / 160);
  return { x, y: x.map((v) => base_kPa + amp_kPa * Math.exp(-0.5 * ((v - centre_mm) / stdev_mm) ** 2)) };
}
