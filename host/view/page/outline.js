// A lump's outline, as far as it is known: its length along the stroke with its interval, and across the stroke its width,
// or only the columns that felt it, or nothing. Where its middle is known across, a line from end to end of that interval goes
// through it. Lengths in mm: across from the middle of the face, along as the encoder counts.

import { COLUMNS, PITCH_MM } from "./array.js";
import { decimal } from "./dom.js";

export const HALF_FACE_MM = (COLUMNS * PITCH_MM) / 2; // across
const LIGHT = "#fff";
const CASING = "rgb(0 0 0 / 60%)"; // round white lines, so that they are seen on the brightest colours too
const SOFT = "rgb(255 255 255 / 30%)";

const halves = ([value, low, high]) => ({ value: value / 2, low: low / 2, high: high / 2 });

/**
 * The shape of a lump as the viewer program tells it. `ring`: length, width and place are known. `strip`: these columns felt it,
 * and how wide it is there is not known. `band`: all columns felt it alike, or nobody knows which.
 */
export function outline({ along_mm, d_mm, columns_mm, across_mm, width_mm, sure }) {
  const [left, right] = columns_mm ?? [-HALF_FACE_MM, HALF_FACE_MM];
  const closed = Boolean(width_mm && across_mm);
  const kind = closed ? "ring" : columns_mm ? "strip" : "band";
  const across = across_mm ? across_mm[0] : (left + right) / 2;
  const wide = closed ? halves(width_mm) : null;
  const reach = wide ? [across - wide.value, across + wide.value] : [left, right];
  const between = closed ? [across_mm[1], across_mm[2]] : null;
  return { kind, along: along_mm, across, between, left: reach[0], right: reach[1], long: halves(d_mm), wide, sure };
}

/** The same in words, in parts that may stand on lines of their own. */
export function words({ d_mm, columns_mm, across_mm, width_mm, sure }) {
  const long = `${decimal(d_mm[0])} mm along (${decimal(d_mm[1])} to ${decimal(d_mm[2])})`;
  const wide = width_mm
    ? `${decimal(width_mm[0])} mm across (${decimal(width_mm[1])} to ${decimal(width_mm[2])})`
    : columns_mm
      ? `width not known, felt from ${decimal(columns_mm[0])} to ${decimal(columns_mm[1])} mm`
      : "width not known";
  const parts = [long, wide];
  if (across_mm) {
    parts.push(`middle at ${decimal(across_mm[0])} mm across (${decimal(across_mm[1])} to ${decimal(across_mm[2])})`);
  }
  return sure ? parts : [...parts, "do not rely on it"];
}

/** Where an outline and its interval begin and end on the canvas, along the stroke. */
export const clearOf = ({ along, long }, toY) => ({ top: toY(along + long.high), bottom: toY(along - long.high) });

/** Draw an outline. toX and toY turn mm across and mm along into places on the canvas. */
export function drawOutline(c, shape, toX, toY, line = 1.75) {
  const { sure } = shape;
  c.save();
  if (sure) {
    c.fillStyle = SOFT;
    c.fill(between(shape, toX, toY), "evenodd");
  }
  const dash = sure ? [] : [6, 4];
  for (const [path, dashes] of strokes(shape, dash, toX, toY)) {
    c.setLineDash(dashes);
    for (const [paint, width] of [[CASING, line + 2], [LIGHT, line]]) {
      c.strokeStyle = paint;
      c.lineWidth = width;
      c.stroke(path);
    }
  }
  c.restore();
}

/** What lies between the ends of the intervals. */
function between({ kind, along, across, left, right, long, wide }, toX, toY) {
  const path = new Path2D();
  if (kind === "ring") {
    ellipse(path, across, along, wide.high, long.high, toX, toY);
    ellipse(path, across, along, wide.low, long.low, toX, toY);
    return path;
  }
  for (const side of [-1, 1]) {
    const [a, b] = [toY(along + side * long.low), toY(along + side * long.high)];
    path.rect(toX(left), Math.min(a, b), toX(right) - toX(left), Math.abs(b - a));
  }
  return path;
}

/** The lines of an outline, each with its dashes: where the sides are is not known of a strip, and of a band there are none. */
function strokes({ kind, along, across, between, left, right, long, wide }, dash, toX, toY) {
  const path = new Path2D();
  if (kind === "ring") {
    ellipse(path, across, along, wide.value, long.value, toX, toY);
    const place = new Path2D();
    place.moveTo(toX(between[0]), toY(along));
    place.lineTo(toX(between[1]), toY(along));
    return [[path, dash], [place, [2, 4]]];
  }
  for (const side of [-1, 1]) {
    path.moveTo(toX(left), toY(along + side * long.value));
    path.lineTo(toX(right), toY(along + side * long.value));
  }
  if (kind === "band") return [[path, dash]];
  const sides = new Path2D();
  for (const x of [left, right]) {
    sides.moveTo(toX(x), toY(along - long.value));
    sides.lineTo(toX(x), toY(along + long.value));
  }
  return [[path, dash], [sides, [2, 4]]];
}

function ellipse(path, across, along, wide, long, toX, toY) {
  const [rx, ry] = [Math.abs(toX(across + wide) - toX(across)), Math.abs(toY(along + long) - toY(along))];
  path.moveTo(toX(across) + rx, toY(along));
  path.ellipse(toX(across), toY(along), rx, ry, 0, 0, 2 * Math.PI);
}
