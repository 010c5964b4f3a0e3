// The tactile image: 16 rows along the stroke (upwards), 26 columns across, with a colour bar in kPa.

import { FONT, prepare, ticks } from "./plot.js";
import { color } from "./theme.js";

const ROWS = 16;
const COLUMNS = 26;
const PITCH = 1.5;
const SCALES = [2, 3, 5, 7.5, 10, 15, 20, 25, 40, 60, 100];

export class TactileImage {
  constructor(canvas) {
    this.canvas = canvas;
    this.small = new OffscreenCanvas(COLUMNS, ROWS);
    this.pixels = new ImageData(COLUMNS, ROWS);
    this.tables = {};
    this.name = "viridis";
    this.scale = "auto";
    this.full = 25;
    this.top = 5;
    this.held = 0;
    this.pressure = null;
  }

  /** Ask the server for the colour maps, unless they are here. */
  async loadColors() {
    if (Object.keys(this.tables).length) return;
    const maps = await (await fetch("/api/colormaps.json")).json();
    for (const [name, text] of Object.entries(maps)) {
      this.tables[name] = Uint8Array.from(atob(text), (ch) => ch.charCodeAt(0));
    }
  }

  /** Highest pressure of the colour scale: a round number over the peak of the last seconds. */
  settleScale(peak) {
    if (this.scale === "full") {
      this.top = this.full;
      return;
    }
    this.held = Math.max(peak, this.held * 0.995);
    this.top = SCALES.find((s) => s >= this.held) ?? this.held;
  }

  draw(pressure) {
    if (pressure) this.pressure = pressure;
    const table = this.tables[this.name];
    const { context: c, width, height } = prepare(this.canvas);
    if (!table || width < 80) return;
    let peak = 0;
    let at = 0;
    if (this.pressure) {
      for (let i = 0; i < ROWS * COLUMNS; i++) {
        if (this.pressure[i] > peak) {
          peak = this.pressure[i];
          at = i;
        }
      }
      this.settleScale(peak);
    }
    const { x0, y0, cell, h, w } = this.still(width, height, table);
    c.drawImage(this.frame, 0, 0, width, height);
    if (!this.pressure) return;
    this.fill(table);
    c.imageSmoothingEnabled = false;
    c.drawImage(this.small, x0, y0, w, h);
    this.pointer(c, x0 + w + 14, y0 + h - Math.min(peak / this.top, 1) * h);
    if (peak > 0.3) this.cross(c, x0 + ((at % COLUMNS) + 0.5) * cell, y0 + (ROWS - 0.5 - Math.floor(at / COLUMNS)) * cell, cell);
    this.peak_kPa = peak;
  }

  /** Frame, axes and colour bar, drawn anew only when size, scale, colours or theme change. */
  still(width, height, table) {
    const key = [this.canvas.width, this.canvas.height, this.top, this.name, color("text")].join();
    if (key === this.stillKey) return this.place;
    this.stillKey = key;
    const bar = 52;
    const edge = { left: 34, top: 6, bottom: 30 };
    const cell = Math.min((width - bar - edge.left) / COLUMNS, (height - edge.top - edge.bottom) / ROWS);
    const [w, h] = [cell * COLUMNS, cell * ROWS];
    const x0 = edge.left + (width - bar - edge.left - w) / 2;
    const y0 = edge.top + (height - edge.top - edge.bottom - h) / 2;
    this.place = { x0, y0, cell, w, h };
    this.frame = new OffscreenCanvas(this.canvas.width, this.canvas.height);
    const c = this.frame.getContext("2d");
    c.scale(this.canvas.width / width, this.canvas.height / height);
    c.font = FONT;
    c.strokeStyle = color("line");
    c.lineWidth = 1;
    c.strokeRect(x0 - 0.5, y0 - 0.5, w + 1, h + 1);
    this.axes(c, x0, y0, w, h, cell);
    this.bar(c, table, x0 + w + 14, y0, h);
    return this.place;
  }

  fill(table) {
    const { data } = this.pixels;
    for (let row = 0; row < ROWS; row++) {
      for (let column = 0; column < COLUMNS; column++) {
        const share = this.pressure[row * COLUMNS + column] / this.top;
        const entry = 3 * Math.max(0, Math.min(255, Math.round(share * 255)));
        const pixel = 4 * ((ROWS - 1 - row) * COLUMNS + column);
        data[pixel] = table[entry];
        data[pixel + 1] = table[entry + 1];
        data[pixel + 2] = table[entry + 2];
        data[pixel + 3] = 255;
      }
    }
    this.small.getContext("2d").putImageData(this.pixels, 0, 0);
  }

  axes(c, x0, y0, w, h, cell) {
    c.fillStyle = color("soft");
    c.textAlign = "center";
    c.textBaseline = "top";
    const perMm = cell / PITCH;
    for (const v of [-15, 0, 15]) c.fillText(`${v}`, x0 + w / 2 + v * perMm, y0 + h + 4);
    c.fillText("across (mm)", x0 + w / 2, y0 + h + 17);
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const v of [-10, 0, 10]) c.fillText(`${v}`, x0 - 5, y0 + h / 2 - v * perMm);
    c.save();
    c.translate(x0 - 28, y0 + h / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = "center";
    c.fillText("along (mm)", 0, 0);
    c.restore();
  }

  bar(c, table, x, y, h) {
    const gradient = c.createLinearGradient(0, y + h, 0, y);
    for (let i = 0; i <= 16; i++) {
      const e = 3 * Math.round((i / 16) * 255);
      gradient.addColorStop(i / 16, `rgb(${table[e]},${table[e + 1]},${table[e + 2]})`);
    }
    c.fillStyle = gradient;
    c.fillRect(x, y, 11, h);
    c.fillStyle = color("soft");
    c.textAlign = "left";
    c.textBaseline = "middle";
    for (const v of ticks(0, this.top, Math.min(5, h / 30))) c.fillText(`${v}`, x + 16, y + h - (v / this.top) * h);
    c.textBaseline = "top";
    c.fillText("kPa", x - 2, y + h + 6);
  }

  pointer(c, x, mark) {
    c.fillStyle = color("text");
    c.beginPath();
    c.moveTo(x - 1, mark);
    c.lineTo(x - 7, mark - 4);
    c.lineTo(x - 7, mark + 4);
    c.fill();
  }

  cross(c, x, y, cell) {
    c.strokeStyle = "#fff";
    c.lineWidth = 1.5;
    c.strokeRect(x - cell / 2, y - cell / 2, cell, cell);
  }
}
