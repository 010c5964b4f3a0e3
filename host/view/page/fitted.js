// The fitted stroke over the measured one, and what the fit leaves: means of the face's rows along the stroke.

import { element } from "./dom.js";
import { Plot, extent } from "./plot.js";

const SHOWN = 4; // rows of the face with curves of their own
const PAINTS = ["points", "fit", "accent", "hard"];

export class Fitted {
  /** box: an element with two canvases, curves and residual, and a paragraph. */
  constructor(box) {
    const [curves, residual] = box.querySelectorAll("canvas");
    this.box = box;
    this.curves = new Plot(curves, { yLabel: "kPa", yTicks: 4 });
    this.residual = new Plot(residual, { xLabel: "position (mm)", yLabel: "row", yTicks: 3 });
    this.laid = null;
  }

  /** laid: {position_mm, measured_kPa, fitted_kPa}, pressures row by row; null: there is none. */
  show(laid) {
    this.laid = laid;
    this.box.hidden = !laid;
    if (!laid) return;
    const rows = laid.measured_kPa.length;
    this.rows = Array.from({ length: Math.min(SHOWN, rows) }, (_, i) => Math.round((i * (rows - 1)) / (SHOWN - 1)));
    this.left = laid.measured_kPa.map((row, r) => row.map((v, n) => v - laid.fitted_kPa[r][n]));
    this.top = Math.max(...this.left.flat().map(Math.abs), 1e-3);
    const names = this.rows.map((row, i) => {
      const mark = element("i");
      mark.style.color = `var(--${PAINTS[i]})`;
      return element("span", {}, mark, `row ${row + 1} `);
    });
    const text = `measured (points) and fitted (lines); below, measured less fitted, up to ${this.top.toFixed(2)} kPa`;
    this.box.querySelector("p").replaceChildren(...names, text);
    this.draw();
  }

  draw() {
    if (!this.laid) return;
    const { position_mm: x, measured_kPa: measured, fitted_kPa: fitted } = this.laid;
    const along = extent([x], [-40, 40], 0.02);
    const kPa = extent(this.rows.flatMap((row) => [measured[row], fitted[row]]), [0, 8]);
    const layers = this.rows.flatMap((row, i) => [
      { kind: "line", x, y: fitted[row], color: PAINTS[i], width: 1.4 },
      { kind: "points", x, y: measured[row], color: PAINTS[i], radius: 1.8 },
    ]);
    this.curves.draw(layers, along, kPa);
    this.residual.draw([{ kind: "cells", x, values: this.left, top: this.top }], along, [0.5, measured.length + 0.5]);
  }
}
