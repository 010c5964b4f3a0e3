// The tactile image: rows along the stroke (upwards), columns across, with a colour bar in kPa. The scale is held for a
// whole visit: it widens when it must, and never shrinks, so that a colour means a pressure.

import { COLUMNS, FULL_SCALE_KPA, PITCH_MM, ROWS } from "./array.js";
import { drawOutline, outline, words } from "./outline.js";
import { font, prepare, scaleBar, textScale, ticks } from "./plot.js";
import { color } from "./theme.js";

const SCALES = [2, 3, 5, 7.5, 10, 15, 20, 25, 40, 60, 100];
const ROOM = 1.4; // over what is felt when the probe is pressed on, so that the lump stays below the top
const STANDS_OUT = 1.15; // the peak against the image's mean, before it is marked
const FELT_KPA = 0.3; // of the peak, below which nothing touches
const MOVES = 1.03; // a new place of the peak against the marked one, before the mark moves: noise must not make it dance

export class TactileImage {
  constructor(canvas) {
    this.canvas = canvas;
    this.small = new OffscreenCanvas(COLUMNS, ROWS);
    this.pixels = new ImageData(COLUMNS, ROWS);
    this.tables = {};
    this.name = "viridis";
    this.scale = "auto";
    this.full = FULL_SCALE_KPA;
    this.held = SCALES[2];
    this.stroking = false;
    this.resting = false; // the probe says that it touches nothing
    this.picked = false; // an earlier image is shown, and not what is felt now
    this.lump = null; // {lump, position_mm}: what the probe has found, and where it was when it felt this image
    this.pressure = null;
    this.smooth = new Float32Array(ROWS * COLUMNS);
    this.at = -1;
  }

  /** Ask the server for the colour maps, unless they are here. */
  async loadColors() {
    if (Object.keys(this.tables).length) return;
    const maps = await (await fetch("/api/colormaps.json")).json();
    for (const [name, text] of Object.entries(maps)) {
      this.tables[name] = Uint8Array.from(atob(text), (ch) => ch.charCodeAt(0));
    }
  }

  /** Highest pressure of the colour scale. */
  get top() {
    return this.scale === "full" ? this.full : this.held;
  }

  /** Another visit has begun: its scale may be another. */
  visit(key) {
    if (key === this.visitKey) return;
    this.visitKey = key;
    this.held = SCALES[2];
    this.draw();
  }

  /** Something of this visit has this peak. In mid-stroke only what does not fit widens the scale. */
  widen(peak_kPa, room = 1) {
    if (peak_kPa * room > this.held) this.held = SCALES.find((s) => s >= peak_kPa * room) ?? peak_kPa * room;
  }

  /** The mean over 3 x 3 cells, and its highest: what is one cell's noise is no peak. */
  findPeak() {
    let best = -1;
    let sum = 0;
    for (let row = 1; row < ROWS - 1; row++) {
      for (let column = 1; column < COLUMNS - 1; column++) {
        const i = row * COLUMNS + column;
        let nine = 0;
        for (let r = -COLUMNS; r <= COLUMNS; r += COLUMNS) nine += this.pressure[i + r - 1] + this.pressure[i + r] + this.pressure[i + r + 1];
        this.smooth[i] = nine / 9;
        sum += nine / 9;
        if (best < 0 || this.smooth[i] > this.smooth[best]) best = i;
      }
    }
    const peak = this.smooth[best];
    const mean = sum / ((ROWS - 2) * (COLUMNS - 2));
    if (peak < FELT_KPA || peak < STANDS_OUT * mean) this.at = -1;
    else if (this.at < 0 || peak > MOVES * this.smooth[this.at]) this.at = best;
    return peak;
  }

  draw(pressure) {
    if (pressure) this.pressure = pressure;
    const table = this.tables[this.name];
    const { context: c, width, height } = prepare(this.canvas);
    if (!table || width < 80) return;
    const peak = this.pressure ? this.findPeak() : 0;
    this.widen(peak, this.stroking || this.picked ? 1 : ROOM);
    const { x0, y0, cell, h, w } = this.still(width, height, table);
    c.drawImage(this.frame, 0, 0, width, height);
    if (!this.pressure) return;
    this.fill(table);
    const alone = this.resting && !this.picked && peak < FELT_KPA;
    c.imageSmoothingEnabled = false;
    c.globalAlpha = alone ? 0.2 : 1;
    c.drawImage(this.small, x0, y0, w, h);
    c.globalAlpha = 1;
    this.canvas.dataset.resting = alone;
    if (alone) this.say(c, "no contact", x0 + w / 2, y0 + h / 2);
    this.pointer(c, x0 + w + 14 * textScale(), y0 + h - Math.min(peak / this.top, 1) * h);
    const { at } = this;
    if (at >= 0) this.cross(c, x0 + ((at % COLUMNS) + 0.5) * cell, y0 + (ROWS - 0.5 - Math.floor(at / COLUMNS)) * cell, 3 * cell);
    this.overlay(c);
    this.peak_kPa = peak;
  }

  /** The lump's outline where it lies under the face, if it does, and what is known of it. */
  overlay(c) {
    const { x0, y0, cell, w, h } = this.place;
    const shape = this.lump && outline(this.lump.lump);
    const off = shape && shape.along - this.lump.position_mm;
    const seen = shape && Math.abs(off) - shape.long.value < h / cell / 2 * PITCH_MM;
    this.outlined = seen ? words(this.lump.lump) : [];
    if (seen) this.canvas.dataset.outline = JSON.stringify({ ...shape, along: off });
    else delete this.canvas.dataset.outline;
    if (!seen) return;
    const perMm = cell / PITCH_MM;
    c.save();
    c.beginPath();
    c.rect(x0, y0, w, h);
    c.clip();
    drawOutline(c, { ...shape, along: off }, (v) => x0 + w / 2 + v * perMm, (v) => y0 + h / 2 - v * perMm);
    this.tell(c, x0 + 5, y0 + h - 4, w - 10);
    c.restore();
  }

  /** The outline in words, in the corner: light on dark, to be read on any colour. */
  tell(c, x, bottom, room) {
    c.font = font();
    c.textAlign = "left";
    c.textBaseline = "bottom";
    const step = 14 * textScale();
    const lines = this.outlined.flatMap((line) => (c.measureText(line).width > room ? line.split(/(?<=,) /) : [line]));
    const width = Math.max(...lines.map((line) => c.measureText(line).width));
    const height = step * lines.length;
    c.fillStyle = "rgb(0 0 0 / 65%)";
    c.beginPath();
    c.roundRect(x - 3, bottom - height - 1, width + 7, height + 3, 3);
    c.fill();
    c.fillStyle = "#fff";
    lines.forEach((line, n) => c.fillText(line, x, bottom - step * (lines.length - 1 - n)));
  }

  /** Frame, axes and colour bar, redrawn only when size, scale, colours or theme change. */
  still(width, height, table) {
    const key = [this.canvas.width, this.canvas.height, this.top, this.name, color("text")].join();
    if (key === this.stillKey) return this.place;
    this.stillKey = key;
    this.canvas.dataset.topKpa = this.top;
    const k = textScale();
    const bar = 50 * k;
    const edge = { left: 34 * k, top: 7 * k, bottom: 32 * k };
    const cell = Math.min((width - bar - edge.left) / COLUMNS, (height - edge.top - edge.bottom) / ROWS);
    const [w, h] = [cell * COLUMNS, cell * ROWS];
    const x0 = edge.left + (width - bar - edge.left - w) / 2;
    const y0 = edge.top;
    this.place = { x0, y0, cell, w, h };
    this.frame = new OffscreenCanvas(this.canvas.width, this.canvas.height);
    const c = this.frame.getContext("2d");
    c.scale(this.canvas.width / width, this.canvas.height / height);
    c.font = font();
    c.strokeStyle = color("line");
    c.lineWidth = 1;
    c.strokeRect(x0 - 0.5, y0 - 0.5, w + 1, h + 1);
    this.axes(c, x0, y0, w, h, cell, k);
    this.bar(c, table, x0 + w + 14 * k, y0, h, k);
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

  axes(c, x0, y0, w, h, cell, k) {
    c.fillStyle = color("soft");
    c.textAlign = "center";
    c.textBaseline = "top";
    const perMm = cell / PITCH_MM;
    const outer = (n) => 5 * Math.floor((0.45 * n * PITCH_MM) / 5);
    for (const v of [-outer(COLUMNS), 0, outer(COLUMNS)]) c.fillText(`${v}`, x0 + w / 2 + v * perMm, y0 + h + 4);
    c.fillText("across (mm)", x0 + w / 2, y0 + h + 18 * k);
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const v of [-outer(ROWS), 0, outer(ROWS)]) c.fillText(`${v}`, x0 - 5, y0 + h / 2 - v * perMm);
    c.save();
    c.translate(x0 - 28 * k, y0 + h / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = "center";
    c.fillText("along (mm)", 0, 0);
    c.restore();
  }

  bar(c, table, x, y, h, k) {
    scaleBar(c, table, x, y, h, k);
    const inside = ticks(0, this.top, Math.min(5, h / (30 * k))).filter((v) => (this.top - v) * h > 14 * k * this.top);
    for (const v of [...inside, this.top]) c.fillText(`${+v.toFixed(1)}`, x + 16 * k, y + h - (v / this.top) * h);
    c.textBaseline = "top";
    c.fillText("kPa", x - 2 * k, y + h + 6 * k);
  }

  /** A word on the image, where there is little else to see. */
  say(c, word, x, y) {
    c.font = font();
    c.fillStyle = color("text");
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillText(word, x, y);
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
