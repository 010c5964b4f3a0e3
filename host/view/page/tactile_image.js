// The tactile image: rows along the stroke (upwards), columns across, with a colour bar in kPa. It shows the pressure, or by
// how much that rises over the stroke's base. Each view's scale fits the last strokes of the visit.

import { COLUMNS, PITCH_MM, ROWS } from "./array.js";
import { clearOf, drawOutline, outline, words } from "./outline.js";
import { font, prepare, scaleBar, textScale, ticks, upright } from "./plot.js";
import { color } from "./theme.js";

const SCALES = [0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 15, 20, 25, 40, 60, 100];
const LEAST = { pressure: 2, rise: 0.3 }; // kPa: less is noise
const STROKES = 5; // the last ones of a visit, which the scale fits
const NOW = 0; // the key of what has been felt since the last of them
const STANDS_OUT = 1.15; // the peak against the image's mean, before it is marked
const FELT_KPA = { mean: 0.1, pressure: 0.3, rise: 0.15 }; // less touches nothing; a lower peak is not marked
const MOVES = 1.03; // a new place of the peak against the marked one, before the mark moves: noise must not make it dance

const mean = (values) => values.reduce((sum, v) => sum + v, 0) / values.length;

export class TactileImage {
  constructor(canvas) {
    this.canvas = canvas;
    this.small = new OffscreenCanvas(COLUMNS, ROWS);
    this.pixels = new ImageData(COLUMNS, ROWS);
    this.tables = {};
    this.name = "viridis";
    this.wanted = "auto"; // or the view that the reader has asked for
    this.contrast = { low: 0, high: 1 }; // of the scale: where the colours begin and end
    this.peaks = { pressure: new Map(), rise: new Map() }; // by stroke, kPa
    this.base = null; // of the stroke shown: each cell's share of the mean pressure
    this.cell = null; // the one that the reader asks for
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

  /** What is shown: the rise where a lump may be, unless the reader wants it otherwise. */
  get view() {
    const over = this.base && !this.alone && (this.wanted === "rise" || this.seen || (this.stroking && !this.picked));
    return over && this.wanted !== "pressure" ? "rise" : "pressure";
  }

  /** The lump's outline on the face, where it lies under it; null: none does. */
  get seen() {
    if (!this.lump) return null;
    const shape = outline(this.lump.lump);
    const along = shape.along - this.lump.position_mm;
    return Math.abs(along) - shape.long.value < (ROWS * PITCH_MM) / 2 ? { ...shape, along } : null;
  }

  /** Value at the upper end of the automatic scale. */
  get top() {
    const peaks = this.peaks[this.view];
    const last = [...peaks].filter(([number]) => number !== NOW).slice(-STROKES).map(([, peak]) => peak);
    const most = Math.max(LEAST[this.view], peaks.get(NOW) ?? 0, ...last);
    return SCALES.find((s) => s >= most) ?? most;
  }

  /** The strokes of the visit that is under way, each with its peak. */
  visit(strokes) {
    const { pressure, rise } = this.peaks;
    pressure.clear();
    for (const { number, peak_kPa } of strokes) pressure.set(number, peak_kPa);
    for (const number of rise.keys()) if (!pressure.has(number)) rise.delete(number);
    this.draw();
  }

  /** Another image than what was felt is shown, or that is again: it has a scale of its own. */
  turn() {
    for (const peaks of Object.values(this.peaks)) peaks.delete(NOW);
  }

  /** A stroke's peak belongs to the scale; what was felt before it does no longer. */
  ended({ number, peak_kPa }) {
    const { pressure, rise } = this.peaks;
    if (rise.has(NOW)) rise.set(number, rise.get(NOW));
    pressure.set(number, peak_kPa);
    this.turn();
  }

  /** By how much each cell rises over the base of its stroke, were that pressed as hard as this image; kPa. */
  rise() {
    const pressed = mean(this.pressure);
    return this.pressure.map((v, n) => v - pressed * this.base[n]);
  }

  /** The mean over 3 x 3 cells, and its highest: what is one cell's noise is no peak. */
  findPeak(values) {
    let best = -1;
    let sum = 0;
    for (let row = 1; row < ROWS - 1; row++) {
      for (let column = 1; column < COLUMNS - 1; column++) {
        const i = row * COLUMNS + column;
        let nine = 0;
        for (let r = -COLUMNS; r <= COLUMNS; r += COLUMNS) nine += values[i + r - 1] + values[i + r] + values[i + r + 1];
        this.smooth[i] = nine / 9;
        sum += nine / 9;
        if (best < 0 || this.smooth[i] > this.smooth[best]) best = i;
      }
    }
    const peak = this.smooth[best];
    const flat = sum / ((ROWS - 2) * (COLUMNS - 2));
    if (peak < FELT_KPA[this.view] || peak < STANDS_OUT * flat) this.at = -1;
    else if (this.at < 0 || peak > MOVES * this.smooth[this.at]) this.at = best;
    return peak;
  }

  draw(pressure) {
    if (pressure) this.pressure = pressure;
    const table = this.tables[this.name];
    const { context: c, width, height } = prepare(this.canvas);
    if (!table || width < 80) return;
    this.alone = this.resting && !this.picked && !(this.pressure && mean(this.pressure) > FELT_KPA.mean);
    const { peaks, view } = this;
    this.values = this.pressure && (view === "rise" ? this.rise() : this.pressure);
    const peak = this.values ? this.findPeak(this.values) : 0;
    if (peak > (peaks[view].get(NOW) ?? 0)) peaks[view].set(NOW, peak);
    this.range = { low: this.contrast.low * this.top, high: this.contrast.high * this.top };
    const { x0, y0, cell, h, w } = this.still(width, height, table);
    c.drawImage(this.frame, 0, 0, width, height);
    if (!this.pressure) return;
    this.fill(table);
    c.imageSmoothingEnabled = false;
    c.globalAlpha = this.alone ? 0.2 : 1;
    c.drawImage(this.small, x0, y0, w, h);
    c.globalAlpha = 1;
    Object.assign(this.canvas.dataset, { resting: this.alone, view });
    if (this.alone) this.say(c, "no contact", x0 + w / 2, y0 + h / 2);
    this.pointer(c, x0 + w + 14 * textScale(), y0 + h - this.share(peak) * h);
    for (const [at, size] of [[this.at, 3], [this.cell ?? -1, 1]]) {
      if (at >= 0) this.cross(c, x0 + ((at % COLUMNS) + 0.5) * cell, y0 + (ROWS - 0.5 - Math.floor(at / COLUMNS)) * cell, size * cell);
    }
    this.overlay(c);
    c.font = font();
    c.fillStyle = color(this.cell === null ? "soft" : "text");
    c.textAlign = "center";
    c.textBaseline = "top";
    c.fillText(this.reading() || "across (mm)", x0 + w / 2, y0 + h + 18 * textScale());
    this.peak_kPa = peak;
  }

  /** Where a value lies between the ends of the colours, from 0 to 1. */
  share(value) {
    const { low, high } = this.range;
    return Math.min(Math.max((value - low) / (high - low), 0), 1);
  }

  /** The cell under a place on the canvas; null outside. */
  cellAt(x, y) {
    const { x0, y0, cell, w, h } = this.place ?? {};
    if (!(x >= x0 && x < x0 + w && y >= y0 && y < y0 + h)) return null;
    return (ROWS - 1 - Math.floor((y - y0) / cell)) * COLUMNS + Math.floor((x - x0) / cell);
  }

  /** The cell asked for in words: its place on the face, its pressure and, where the base is known, its rise; "": none is. */
  reading() {
    const { base, cell, pressure } = this;
    if (cell === null || !pressure) return "";
    const mm = (n, of) => +((n - (of - 1) / 2) * PITCH_MM).toFixed(1);
    const rise = base ? this.rise()[cell] : null;
    const more = rise === null ? "" : `, ${rise < 0 ? "" : "+"}${rise.toFixed(2)} over base`;
    const [across, along] = [mm(cell % COLUMNS, COLUMNS), mm(Math.floor(cell / COLUMNS), ROWS)];
    return `at ${across}, ${along} mm: ${pressure[cell].toFixed(2)} kPa${more}`.replaceAll("-", "\u2212");
  }

  /** The lump's outline, and what is known of it. */
  overlay(c) {
    const { x0, y0, cell, w, h } = this.place;
    const { seen } = this;
    this.outlined = seen ? words(this.lump.lump) : [];
    if (seen) this.canvas.dataset.outline = JSON.stringify(seen);
    else delete this.canvas.dataset.outline;
    if (!seen) return;
    const perMm = cell / PITCH_MM;
    const [toX, toY] = [(v) => x0 + w / 2 + v * perMm, (v) => y0 + h / 2 - v * perMm];
    c.save();
    c.beginPath();
    c.rect(x0, y0, w, h);
    c.clip();
    drawOutline(c, seen, toX, toY);
    c.restore();
    this.tell(c, clearOf(seen, toY), { left: x0 + 5, right: x0 + w - 5, top: y0 + 3, bottom: y0 + h - 3 });
  }

  /** The outline in words above or below the lump, light on dark, to be read on any colour; what has no room is left out:
   *  the card and the image's own name say it too. */
  tell(c, lump, { left, right, top, bottom }) {
    c.font = font();
    c.textAlign = "left";
    c.textBaseline = "bottom";
    const step = 14 * textScale();
    const wide = (line) => c.measureText(line).width;
    const broken = this.outlined.flatMap((line) => (wide(line) > right - left ? line.split(/(?<=,) /) : [line]));
    const [below, above] = [bottom - Math.max(lump.bottom, top), Math.min(lump.top, bottom) - top];
    const room = Math.floor(Math.max(below, above) / step);
    const lines = broken.slice(0, room).map((line, n) => (n + 1 === room ? line.replace(/,$/, "") : line));
    this.canvas.dataset.said = lines.join("; ");
    if (!lines.length) return;
    const foot = below >= above ? bottom : top + step * lines.length;
    c.fillStyle = "rgb(0 0 0 / 65%)";
    c.beginPath();
    c.roundRect(left - 3, foot - step * lines.length - 1, Math.max(...lines.map(wide)) + 7, step * lines.length + 3, 3);
    c.fill();
    c.fillStyle = "#fff";
    lines.forEach((line, n) => c.fillText(line, left, foot - step * (lines.length - 1 - n)));
  }

  /** Frame, axes and colour bar, redrawn only when size, scale, colours or theme change. */
  still(width, height, table) {
    const { low, high } = this.range;
    const key = [this.canvas.width, this.canvas.height, low, high, this.name, color("text")].join();
    if (key === this.stillKey) return this.place;
    this.stillKey = key;
    Object.assign(this.canvas.dataset, { topKpa: this.top, highKpa: high });
    const k = textScale();
    const bar = 56 * k;
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
        const entry = 3 * Math.round(this.share(this.values[row * COLUMNS + column]) * 255);
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
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const v of [-outer(ROWS), 0, outer(ROWS)]) c.fillText(`${v}`, x0 - 5, y0 + h / 2 - v * perMm);
    upright(c, "along (mm)", x0 - 28 * k, y0 + h / 2);
  }

  bar(c, table, x, y, h, k) {
    scaleBar(c, table, x, y, h, k);
    const { low, high } = this.range;
    const inside = ticks(low, high, Math.min(5, h / (30 * k))).filter((v) => (high - v) * h > 14 * k * (high - low));
    for (const v of [...inside, high]) c.fillText(`${+v.toPrecision(3)}`, x + 16 * k, y + h - this.share(v) * h);
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
