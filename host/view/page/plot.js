// A small plotter on a canvas: axes with round ticks, lines, points, bands and error bars.

import { color } from "./theme.js";

/** How large text is against the usual 16 px: canvases follow the reader's setting as the style sheet does. */
export const textScale = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

/** The style sheet's font on a canvas. */
export const font = () => `${11 * textScale()}px ${getComputedStyle(document.body).fontFamily}`;

/** Rounds outwards to the step of some five ticks. */
export function rounded([low, high]) {
  const marks = ticks(low, high, 5);
  const step = marks.length > 1 ? marks[1] - marks[0] : high - low;
  return [Math.floor(low / step + 1e-9) * step, Math.ceil(high / step - 1e-9) * step];
}

/** Axes that hold: those of one visit only ever widen, so that strokes can be compared with the eye. */
export class Held {
  constructor() {
    this.known = new Map();
  }

  range(visit, name, wanted) {
    const key = `${visit} ${name}`;
    const [low, high] = wanted;
    const [a, b] = this.known.get(key) ?? [Infinity, -Infinity];
    if (low < a || high > b) this.known.set(key, rounded([Math.min(low, a), Math.max(high, b)]));
    return this.known.get(key);
  }

  forget() {
    this.known.clear();
  }
}

/** Round ticks that cover low..high. */
export function ticks(low, high, count = 5) {
  const raw = (high - low) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw) ?? raw;
  const out = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + step * 1e-6; v += step) out.push(Math.abs(v) < step * 1e-6 ? 0 : v);
  return out;
}

/** Lowest and highest finite value of several lists, with a margin; `fallback` if there is none. */
export function extent(lists, fallback, margin = 0.08, least = 0) {
  let low = Infinity;
  let high = -Infinity;
  for (const list of lists) {
    for (const v of list ?? []) {
      if (v === null || !Number.isFinite(v)) continue;
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  if (low > high) return fallback;
  const missing = Math.max(least - (high - low), 0) / 2;
  const pad = Math.max(high - low, least, 1e-9) * margin;
  return [low - pad - missing, high + pad + missing];
}

/** Fit a canvas to its box at the screen's resolution; returns its context in CSS pixels, cleared. */
export function prepare(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 3);
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = font();
  return { context, width, height };
}

/** Which of the values is nearest to `at`; -1 if there are none. */
export function nearest(values, at) {
  let best = -1;
  values.forEach((v, n) => {
    if (best < 0 || Math.abs(v - at) < Math.abs(values[best] - at)) best = n;
  });
  return best;
}

export class Plot {
  /** counts: the x axis counts things and needs no numbers. */
  constructor(canvas, { xLabel, yLabel, yTicks = 4, counts = false }) {
    Object.assign(this, { canvas, xLabel, yLabel, yTicks, counts });
  }

  /** Draw layers over round axes. x and y are [low, high]; at the cursor the value of the layer with `read` decimals is told. */
  draw(layers, x, y, cursor = null) {
    const { context: c, width, height } = prepare(this.canvas);
    if (width < 40 || height < 40) return;
    const k = textScale();
    const { marks, digits } = this.labels(y, height / k);
    const widest = Math.max(...marks.map((v) => c.measureText(v.toFixed(digits)).width), 0);
    const box = { left: widest + 26 * k, right: width - 10 * k, top: 8 * k, bottom: height - (this.xLabel ? 32 : 12) * k };
    const toX = (v) => box.left + ((v - x[0]) / (x[1] - x[0])) * (box.right - box.left);
    const toY = (v) => box.bottom - ((v - y[0]) / (y[1] - y[0])) * (box.bottom - box.top);
    const fromX = (px) => x[0] + ((px - box.left) / (box.right - box.left)) * (x[1] - x[0]);
    this.place = { toX, toY, fromX, box, x, y };
    this.axes(c, box, x, marks, digits, toX, toY, k);
    c.save();
    c.beginPath();
    c.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
    c.clip();
    for (const layer of layers) if (layer) this[layer.kind](c, layer, toX, toY, box);
    c.restore();
    this.canvas.dataset.x = x.join(" ");
    delete this.canvas.dataset.read;
    if (cursor !== null && cursor >= x[0] && cursor <= x[1]) this.read(c, layers, cursor, toX(cursor), box, k);
  }

  /** A line at the cursor, and what is there. */
  read(c, layers, cursor, px, box, k) {
    c.strokeStyle = color("soft");
    c.lineWidth = 1;
    line(c, px, box.top, px, box.bottom);
    const layer = layers.find((one) => one && "read" in one && one.x.length);
    if (!layer) return;
    const n = nearest(layer.x, cursor);
    const text = `${layer.x[n].toFixed(1)} mm: ${layer.y[n].toFixed(layer.read)} ${this.yLabel}`.replaceAll("-", "\u2212");
    this.canvas.dataset.read = text;
    c.textBaseline = "top";
    c.textAlign = "right";
    const wide = c.measureText(text).width + 6 * k;
    c.fillStyle = color("raised");
    c.fillRect(box.right - wide, box.top, wide, 15 * k);
    c.fillStyle = color("text");
    c.fillText(text, box.right - 3 * k, box.top + 2 * k);
  }

  /** Round values beside the y axis, and their decimals. */
  labels(y, height) {
    let marks = [];
    const most = Math.max(2, Math.min(this.yTicks, (height - 40) / 24));
    for (let n = most; marks.length < 3 && n < 12; n++) marks = ticks(y[0], y[1], n);
    const step = marks.length > 1 ? marks[1] - marks[0] : 1;
    const digits = [0, 1, 2, 3].find((n) => Math.abs(step * 10 ** n - Math.round(step * 10 ** n)) < 1e-6) ?? 3;
    return { marks, digits };
  }

  axes(c, box, x, marks, digits, toX, toY, k) {
    c.lineWidth = 1;
    c.strokeStyle = color("grid");
    c.fillStyle = color("soft");
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const v of marks) {
      line(c, box.left, toY(v), box.right, toY(v));
      c.fillText(v.toFixed(digits), box.left - 6, toY(v));
    }
    c.textAlign = "center";
    c.textBaseline = "top";
    if (this.xLabel) {
      for (const v of this.counts ? [] : ticks(x[0], x[1], Math.min(8, (box.right - box.left) / (44 * k)))) {
        line(c, toX(v), box.bottom, toX(v), box.bottom + 4);
        c.fillText(`${+v.toFixed(3)}`, toX(v), box.bottom + 5 * k);
      }
      c.fillText(this.xLabel, (box.left + box.right) / 2, box.bottom + 18 * k);
    }
    upright(c, this.yLabel, 8 * k, (box.top + box.bottom) / 2);
  }

  line(c, { x, y, color: paint, width }, toX, toY) {
    c.strokeStyle = color(paint);
    c.lineWidth = width;
    c.lineJoin = "round";
    c.beginPath();
    let pen = false;
    for (let i = 0; i < x.length; i++) {
      if (y[i] === null || !Number.isFinite(y[i])) pen = false;
      else if (pen) c.lineTo(toX(x[i]), toY(y[i]));
      else {
        c.moveTo(toX(x[i]), toY(y[i]));
        pen = true;
      }
    }
    c.stroke();
  }

  points(c, { x, y, color: paint, radius = 2.6 }, toX, toY) {
    c.fillStyle = color(paint);
    c.beginPath();
    for (let i = 0; i < x.length; i++) {
      if (y[i] === null) continue;
      c.moveTo(toX(x[i]) + radius, toY(y[i]));
      c.arc(toX(x[i]), toY(y[i]), radius, 0, 7);
    }
    c.fill();
  }

  /** An image of signed values, row by row over x: one colour for more, another for less. */
  cells(c, { x, values, top }, toX, toY) {
    const ends = x.map((v, n) => toX(n ? (x[n - 1] + v) / 2 : v - (x[1] - v) / 2));
    ends.push(toX(1.5 * x.at(-1) - 0.5 * x.at(-2)));
    values.forEach((row, r) => {
      const [y, next] = [toY(r + 1.5), toY(r + 0.5)];
      row.forEach((v, n) => {
        c.globalAlpha = Math.min(Math.abs(v) / top, 1);
        c.fillStyle = color(v > 0 ? "fit" : "points");
        c.fillRect(ends[n], y, ends[n + 1] - ends[n], next - y);
      });
    });
    c.globalAlpha = 1;
  }

  span(c, { from, to }, toX, toY, box) {
    c.fillStyle = color("shade");
    c.fillRect(toX(from), box.top, toX(to) - toX(from), box.bottom - box.top);
  }

  belt(c, { from, to }, toX, toY, box) {
    c.fillStyle = color("shade");
    c.fillRect(box.left, toY(to), box.right - box.left, toY(from) - toY(to));
  }

  level(c, { at, color: paint, dash = [4, 4] }, toX, toY, box) {
    c.strokeStyle = color(paint);
    c.lineWidth = 1;
    c.setLineDash(dash);
    line(c, box.left, toY(at), box.right, toY(at));
    c.setLineDash([]);
  }

  bars(c, { items, picked }, toX, toY) {
    for (const { x, value, low, high, paint, key } of items) {
      c.strokeStyle = color(paint);
      c.fillStyle = color(paint);
      c.lineWidth = key === picked ? 4 : 2;
      line(c, toX(x), toY(low), toX(x), toY(high));
      c.beginPath();
      c.arc(toX(x), toY(value), key === picked ? 5.5 : 3.8, 0, 7);
      c.fill();
    }
  }
}

/** A word beside an axis that stands. */
export function upright(c, word, x, y) {
  c.save();
  c.translate(x, y);
  c.rotate(-Math.PI / 2);
  c.textAlign = "center";
  c.textBaseline = "middle";
  c.fillText(word, 0, 0);
  c.restore();
}

function line(c, x0, y0, x1, y1) {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.stroke();
}

/** A bar of the colours in `table` (256 times red, green, blue), its least value at the bottom; then the text
 *  style of the values beside it. */
export function scaleBar(c, table, x, y, h, k) {
  const gradient = c.createLinearGradient(0, y + h, 0, y);
  for (let i = 0; i <= 16; i++) {
    const e = 3 * Math.round((i / 16) * 255);
    gradient.addColorStop(i / 16, `rgb(${table[e]},${table[e + 1]},${table[e + 2]})`);
  }
  c.fillStyle = gradient;
  c.fillRect(x, y, 11 * k, h);
  c.fillStyle = color("soft");
  c.textAlign = "left";
  c.textBaseline = "middle";
}
