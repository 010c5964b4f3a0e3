// The map of a visit on a canvas: the strips in colours, the lumps' outlines with their estimates, axes and colour bar.

import { HALF_FACE_MM, drawOutline } from "./outline.js";
import { font, scaleBar, textScale, ticks, upright } from "./plot.js";
import { color } from "./theme.js";
import { arranged, blend, extent, label, onMap, placed, scaleTop, told, without } from "./visit_map.js";

/**
 * Draw the strokes' map on a context of this size. strokes: those of the visit, each with its strip; byLanes: those whose lanes
 * are told, each in its lane, else the newest of all in their order; table: the colour map; next_mm: where the next stroke goes,
 * or null; running: {lane_mm} of the stroke that runs, or null.
 * Returns where things stand: {strips, top, shapes, labels, words}, strips as boxes in pixels with their strokes' numbers, labels
 * and words as boxes; null where there is nothing to draw.
 */
export function drawVisit(c, width, height, { strokes: all, byLanes, table, picked = null, next_mm = null, running = null }) {
  const k = textScale();
  const edge = { left: 40 * k, right: 62 * k, top: 18 * k, bottom: 34 * k };
  const strokes = byLanes ? told(all) : arranged(all, (width - edge.left - edge.right) / (height - edge.top - edge.bottom));
  const box = extent(strokes);
  if (!box) return null;
  const ahead = byLanes ? [[running?.lane_mm, "now"], [running ? null : next_mm, "next"]].filter(([at]) => Number.isFinite(at)) : [];
  const shown = widened(box, ahead.map(([at]) => at));
  const scale = Math.min((width - edge.left - edge.right) / (shown.right - shown.left), (height - edge.top - edge.bottom) / (shown.top - shown.bottom));
  if (!(scale > 0)) return null;
  const [w, h] = [scale * (shown.right - shown.left), scale * (shown.top - shown.bottom)];
  const x0 = edge.left + (width - edge.left - edge.right - w) / 2;
  const y0 = edge.top + (height - edge.top - edge.bottom - h) / 2;
  const toX = (v) => x0 + (v - shown.left) * scale;
  const toY = (v) => y0 + h - (v - shown.bottom) * scale;
  const map = blend(strokes, box);
  const top = scaleTop(map);
  c.font = font();
  if (byLanes) axes(c, shown, { x0, y0, w, h, toX, toY, k });
  else measure(c, x0, y0 + h + 10 * k, scale, k);
  c.imageSmoothingEnabled = true;
  c.drawImage(picture(map, top, table), toX(box.left), toY(box.bottom + map.height), map.width * scale, map.height * scale);
  const { strips, words } = lanes(c, strokes, { toX, toY, picked, k });
  for (const [at, word] of ahead) coming(c, at, word, shown, toX, toY, k);
  bar(c, table, top, x0 + w + 12 * k, y0, h, k);
  const { shapes, labels } = lumps(c, strokes, { toX, toY, picked, scale, k, words, strips, room: { left: x0, right: x0 + w, top: y0, bottom: y0 + h } });
  return { strips, top, shapes, labels, words };
}

/** The box, wide enough for these lanes too. */
function widened(box, known) {
  const left = Math.min(box.left, ...known.map((v) => v - HALF_FACE_MM));
  return { ...box, left, right: Math.max(box.right, ...known.map((v) => v + HALF_FACE_MM)) };
}

/** One pixel a square, the lowest row last. */
function picture({ width, height, rise }, top, table) {
  const pixels = new ImageData(width, height);
  rise.forEach((v, n) => {
    if (Number.isNaN(v)) return;
    const entry = 3 * Math.max(0, Math.min(255, Math.round((v / top) * 255)));
    const at = 4 * ((height - 1 - Math.floor(n / width)) * width + (n % width));
    pixels.data.set([table[entry], table[entry + 1], table[entry + 2], 255], at);
  });
  const small = new OffscreenCanvas(width, height);
  small.getContext("2d").putImageData(pixels, 0, 0);
  return small;
}

function axes(c, shown, { x0, y0, w, h, toX, toY, k }) {
  c.fillStyle = color("soft");
  c.textAlign = "center";
  c.textBaseline = "top";
  for (const v of ticks(shown.left, shown.right, Math.max(1, Math.min(9, w / (44 * k))))) {
    if (toX(v) <= x0 + w + 1) c.fillText(`${v}`, toX(v), y0 + h + 4 * k);
  }
  c.fillText("across (mm)", x0 + w / 2, y0 + h + 18 * k);
  c.textAlign = "right";
  c.textBaseline = "middle";
  for (const v of ticks(shown.bottom, shown.top, Math.max(1, Math.min(7, h / (30 * k))))) {
    if (toY(v) >= y0 - 1) c.fillText(`${v}`, x0 - 5 * k, toY(v));
  }
  upright(c, "along (mm)", x0 - 32 * k, y0 + h / 2);
}

/** How long 20 mm are, where there are no axes. */
function measure(c, x, y, scale, k) {
  c.strokeStyle = c.fillStyle = color("soft");
  c.lineWidth = 2;
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x + 20 * scale, y);
  c.stroke();
  c.textAlign = "left";
  c.textBaseline = "middle";
  c.fillText("20 mm", x + 20 * scale + 6 * k, y);
}

/**
 * A frame round each strip, with the numbers of its strokes over it; where there is no lump it says why. Returns the strips' boxes,
 * and those of these words.
 */
function lanes(c, strokes, { toX, toY, picked, k }) {
  const strips = [];
  const over = new Map();
  for (const stroke of strokes) {
    const { lane_mm, strip, number } = stroke;
    if (!strip?.places) continue;
    const [left, right] = [toX(lane_mm - HALF_FACE_MM), toX(lane_mm + HALF_FACE_MM)];
    const [bottom, top] = [toY(strip.from_mm - 0.5), toY(strip.from_mm + strip.places - 0.5)];
    c.strokeStyle = color(number === picked ? "accent" : "line");
    c.lineWidth = number === picked ? 2.5 : 1;
    c.strokeRect(left, top, right - left, bottom - top);
    strips.push({ number, left, right, top, bottom });
    const place = `${lane_mm} ${strip.row ?? 0}`;
    const here = over.get(place) ?? { x: toX(lane_mm), strokes: [], top, bottom };
    here.strokes.push(stroke);
    here.top = Math.min(here.top, top);
    over.set(place, here);
  }
  const words = [];
  for (const { x, strokes: here, top, bottom } of over.values()) {
    c.fillStyle = color("text");
    c.textAlign = "center";
    c.textBaseline = "bottom";
    const numbers = here.length > 3 ? `${here.length} strokes` : here.map((s) => s.number).join(", ");
    c.fillText(numbers, x, top - 3 * k);
    const wide = c.measureText(numbers).width;
    words.push({ x: x - wide / 2, y: top - 16 * k, width: wide, height: 14 * k });
    if (here.some((s) => s.lump)) continue;
    const why = without(here);
    const size = sized(c, why, k);
    const place = { x: x - size.width / 2, y: bottom - size.height - 5 * k, ...size };
    if (!strips.some(({ left, right }) => left > x && left < x + size.width / 2 || right < x && right > x - size.width / 2)) {
      words.push(place);
      box(c, why, place.x, place.y, k);
    }
  }
  return { strips, words };
}

/** Where the stroke that runs, or the next one, has its lane. */
function coming(c, lane_mm, word, shown, toX, toY, k) {
  const [left, right] = [toX(lane_mm - HALF_FACE_MM), toX(lane_mm + HALF_FACE_MM)];
  const [top, bottom] = [toY(shown.top), toY(shown.bottom)];
  c.save();
  c.strokeStyle = c.fillStyle = color("accent");
  c.lineWidth = 1.5;
  c.setLineDash([5, 4]);
  c.strokeRect(left, top, right - left, bottom - top);
  c.restore();
  c.fillStyle = color("accent");
  c.textAlign = "center";
  c.textBaseline = "bottom";
  c.fillText(word, toX(lane_mm), top - 3 * k);
}

function bar(c, table, top, x, y, h, k) {
  scaleBar(c, table, x, y, h, k);
  for (const v of ticks(0, 100 * top, Math.max(1, Math.min(5, h / (30 * k))))) {
    if (v <= 100 * top) c.fillText(`${v} %`, x + 15 * k, y + h - (v / (100 * top)) * h);
  }
  c.textBaseline = "top";
  c.fillText("over base", x - 10 * k, y + h + 6 * k);
}

/** Outlines, and their labels where there is room: that of the picked stroke first, then those of the newest. */
function lumps(c, strokes, { toX, toY, picked, scale, k, words, strips, room }) {
  const found = strokes.flatMap((stroke) => (stroke.lump && stroke.strip?.places ? [{ stroke, shape: onMap(stroke) }] : []));
  const order = [...found].sort((a, b) => (b.stroke.number === picked) - (a.stroke.number === picked) || b.stroke.number - a.stroke.number);
  for (const { stroke, shape } of [...order].reverse()) drawOutline(c, shape, toX, toY, stroke.number === picked ? 2.75 : 1.5);
  const labels = order.map(({ stroke, shape }) => {
    const lines = label(stroke);
    const short = [lines[0].split(",")[0]];
    const reach = { x: (scale * (shape.right - shape.left)) / 2, y: scale * shape.long.high };
    const own = strips.find(({ number }) => number === stroke.number);
    const texts = [lines, short];
    return { x: toX((shape.left + shape.right) / 2), y: toY(shape.along), reach, own, texts, sizes: texts.map((text) => sized(c, text, k)) };
  });
  const taken = found.filter(({ shape }) => shape.kind !== "band").map(({ shape }) => around(shape, toX, toY));
  const places = placed(labels, room, [...words, ...taken], strips);
  places.forEach((place, n) => place && box(c, labels[n].texts[place.size], place.x, place.y, k));
  return { shapes: found.map(({ stroke, shape }) => ({ number: stroke.number, ...shape })), labels: places };
}

/** An outline's box on the canvas, a little less than it is: its own label stands beside it. */
function around({ left, right, along, long }, toX, toY) {
  const [x, y] = [toX(left), toY(along + long.value)];
  return { x, y, width: toX(right) - x, height: toY(along - long.value) - y };
}

const sized = (c, lines, k) => ({
  width: Math.max(...lines.map((line) => c.measureText(line).width)) + 8 * k,
  height: (14 * lines.length + 3) * k,
});

/** Lines of text on a ground of their own: they are read on any colour. */
function box(c, lines, x, y, k) {
  const { width, height } = sized(c, lines, k);
  c.save();
  c.globalAlpha = 0.86;
  c.fillStyle = color("panel");
  c.beginPath();
  c.roundRect(x, y, width, height, 4 * k);
  c.fill();
  c.restore();
  c.fillStyle = color("text");
  c.textAlign = "left";
  c.textBaseline = "top";
  lines.forEach((line, n) => c.fillText(line, x + 4 * k, y + (3 + 14 * n) * k));
}
