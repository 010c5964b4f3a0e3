// The map of a visit: strokes side by side, across by their lanes and along by the encoder; what rises over the base of its
// stroke stands out. Pure: lengths in mm, the rise as a share of the base.

import { PITCH_MM } from "./array.js";
import { HALF_FACE_MM, outline } from "./outline.js";

const TAPER_MM = 9; // over the outer columns of a strip another that lies there too counts more and more
const LEAST = 0.05; // and its own last column counts this much still
const TOPS = [0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.5, 2, 3, 5];
const LOWEST_TOP = 0.2; // what rises by a few per cent may be the hand
const GAP_MM = 4;
const HEAD_MM = 16; // over each row of strips, for their numbers
export const MOST_ARRANGED = 24;

/** Those of which the operator has said where they lie. */
export const told = (strokes) => strokes.filter((s) => s.lane_mm !== null);

/**
 * Strokes that nobody has told the lanes of, one beside the other in their order, the newest of them, in rows so that they come
 * out large in a picture of this shape (width over height).
 */
export function arranged(strokes, shape) {
  const shown = strokes.filter((s) => s.strip?.places).slice(-MOST_ARRANGED);
  if (!shown.length) return [];
  const [wide, high] = [2 * HALF_FACE_MM + GAP_MM, Math.max(...shown.map((s) => s.strip.places)) + HEAD_MM];
  const size = (n) => Math.min(shape / (n * wide), 1 / (Math.ceil(shown.length / n) * high));
  let many = 1;
  for (let n = 2; n <= shown.length; n++) if (size(n) > size(many)) many = n;
  return shown.map((stroke, i) => {
    const down = Math.floor(i / many) * high + stroke.strip.from_mm; // each begins at the bottom of its row
    const lump = stroke.lump && { ...stroke.lump, along_mm: stroke.lump.along_mm - down };
    return { ...stroke, lane_mm: (i % many) * wide, lump, strip: { ...stroke.strip, from_mm: stroke.strip.from_mm - down, row: Math.floor(i / many) } };
  });
}

/** What the strips and the lumps of these strokes cover: {left, right, bottom, top}; null where there is nothing. */
export function extent(strokes) {
  const box = { left: Infinity, right: -Infinity, bottom: Infinity, top: -Infinity };
  for (const { lane_mm, strip } of strokes) {
    if (!strip?.places) continue;
    box.left = Math.min(box.left, lane_mm - HALF_FACE_MM);
    box.right = Math.max(box.right, lane_mm + HALF_FACE_MM);
    box.bottom = Math.min(box.bottom, strip.from_mm - 0.5);
    box.top = Math.max(box.top, strip.from_mm + strip.places - 0.5);
  }
  return box.left < box.right ? box : null;
}

/** How much a strip counts so far from its middle line. */
export const weight = (off_mm) => Math.min(1, Math.max(LEAST, (HALF_FACE_MM - Math.abs(off_mm)) / TAPER_MM));

/** A strip's rise at `row` places from its first and `off_mm` from its middle line: linear between columns. */
function riseAt({ rise_permille: rise, columns }, row, off_mm) {
  const at = Math.min(Math.max(off_mm / PITCH_MM + (columns - 1) / 2, 0), columns - 1);
  const left = Math.min(Math.floor(at), columns - 2);
  const [a, b] = [rise[row * columns + left], rise[row * columns + left + 1]];
  return (a + (at - left) * (b - a)) / 1000;
}

/**
 * The strips as one picture of 1 mm squares: {width, height, rise}, row by row from the bottom, NaN where no probe was. Where
 * lanes overlap each counts by its weight.
 */
export function blend(strokes, box) {
  const width = Math.ceil(box.right - box.left);
  const height = Math.ceil(box.top - box.bottom);
  const sum = new Float32Array(width * height);
  const weights = new Float32Array(width * height);
  for (const { lane_mm, strip } of strokes) {
    if (!strip?.places) continue;
    for (let i = 0; i < width; i++) {
      const off = box.left + i + 0.5 - lane_mm;
      if (Math.abs(off) > HALF_FACE_MM) continue;
      const w = weight(off);
      for (let row = 0; row < strip.places; row++) {
        const j = Math.round(strip.from_mm - 0.5 - box.bottom) + row;
        sum[j * width + i] += w * riseAt(strip, row, off);
        weights[j * width + i] += w;
      }
    }
  }
  return { width, height, rise: sum.map((s, n) => (weights[n] ? s / weights[n] : NaN)) };
}

/** The end of the colour scale: round, and the same for small changes. */
export function scaleTop({ rise }) {
  let most = LOWEST_TOP;
  for (const v of rise) if (v > most) most = v;
  return TOPS.find((top) => top >= most) ?? most;
}

/** A stroke's lump on the map, its outline with the lane added; null where it has none. */
export function onMap({ lump, lane_mm }) {
  if (!lump) return null;
  const shape = outline(lump);
  const between = shape.between?.map((v) => v + lane_mm) ?? null;
  return { ...shape, across: shape.across + lane_mm, between, left: shape.left + lane_mm, right: shape.right + lane_mm };
}

const row = (card, key) => card.rows.find((r) => r.key === key);

const WITHOUT = {
  none: "no lump", force_low: "force too low", force_high: "force too high", force: "force out of range", unread: "not read",
  no_model: "no model", uncalibrated: "calibration lost", missing: "no answer",
};

/** What stands in a lane of whose strokes none has a lump to draw. */
export const without = (strokes) => [...new Set(strokes.map(({ card }) => WITHOUT[card.kind] ?? "place not told"))];

/** What stands beside a lump on the map, in two lines; the second may be left out. */
export function label({ card }) {
  const [d, depth] = [row(card, "d_mm"), row(card, "depth_mm")];
  const first = d ? `${d.value.toFixed(1)} mm${card.hardness ? `, ${card.hardness}` : ""}` : "lump";
  return depth ? [first, `${depth.value.toFixed(1)} mm deep`] : [first];
}

const signed = (v) => `${v < 0 ? "\u2212" : ""}${+Math.abs(v).toFixed(1)}`;

/** A stroke of the map in words. */
export function described({ number, lane_mm, lump, card }) {
  const who = lane_mm === null ? `${number}` : `${number}, lane ${signed(lane_mm)} mm`;
  const [d, depth] = [row(card, "d_mm"), row(card, "depth_mm")];
  if (!d || (card.kind !== "lump" && card.kind !== "outside")) return `${who}: ${card.title.toLowerCase()}`;
  const parts = [`${d.value.toFixed(1)} mm (${d.low.toFixed(1)} to ${d.high.toFixed(1)})`];
  if (depth) parts.push(`${depth.value.toFixed(1)} mm deep`);
  if (card.hardness) parts.push(card.hardness);
  const wide = row(card, "width_mm");
  if (wide) parts.push(`${wide.value.toFixed(1)} mm across`);
  else if (lump) parts.push("width not known");
  if (card.kind === "outside") parts.push("do not rely on it");
  return `${who}: ${parts.join(", ")}`;
}

const within = (a, { left, right, top, bottom }) => a.x >= left && a.x + a.width <= right && a.y >= top && a.y + a.height <= bottom;
const meets = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;

/**
 * Where labels go: each {x, y, reach, own, sizes} stands beside its lump (reach: how far that goes from x, y) in one of its
 * sizes ({width, height}, the first that has room), and over no other, nor over what is taken; within its own strip or beside
 * all strips. Returns a place, with the index of its size, for each; null where there is no room.
 */
export function placed(labels, room, taken = [], strips = []) {
  const used = [...taken];
  const free = (a, own) =>
    within(a, room) && !used.some((b) => meets(a, b)) &&
    ((own && within(a, own)) || !strips.some((s) => meets(a, { x: s.left, y: s.top, width: s.right - s.left, height: s.bottom - s.top })));
  return labels.map(({ x, y, reach, own, sizes }) => {
    const [w, h] = [reach.x + 4, reach.y + 4];
    const around = ({ width, height }, size) => {
      const middle = Math.min(Math.max(x - width / 2, own?.left ?? -Infinity), (own?.right ?? Infinity) - width);
      return [[x + w, y - height / 2], [x - w - width, y - height / 2], [middle, y - h - height], [middle, y + h]]
        .map(([a, b]) => ({ x: a, y: b, width, height, size }));
    };
    const found = sizes.flatMap(around).find((place) => free(place, own));
    if (found) used.push(found);
    return found ?? null;
  });
}
