// What the reader sets of the tactile image: its view, its contrast, and the cell whose value is told below it.

import { COLUMNS, ROWS } from "./array.js";
import { get } from "./dom.js";

const MOVES = { ArrowUp: COLUMNS, ArrowDown: -COLUMNS, ArrowLeft: -1, ArrowRight: 1 };

export function startImageTools(image) {
  const { canvas } = image;

  function choose(cell) {
    if (cell === image.cell) return;
    image.cell = cell;
    image.draw();
  }

  function contrast() {
    const high = get("high").valueAsNumber;
    const low = Math.min(get("low").valueAsNumber, high - 5);
    get("low-text").textContent = `${low} %`;
    get("high-text").textContent = `${high} %`;
    image.contrast = { low: low / 100, high: high / 100 };
    image.draw();
  }

  canvas.addEventListener("pointermove", ({ offsetX, offsetY }) => choose(image.cellAt(offsetX, offsetY)));
  canvas.addEventListener("pointerleave", () => choose(null));
  canvas.addEventListener("blur", () => choose(null));
  canvas.addEventListener("keydown", (event) => {
    const by = MOVES[event.key];
    if (!by || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const from = image.cell ?? COLUMNS * Math.floor(ROWS / 2) + Math.floor(COLUMNS / 2);
    const to = image.cell === null ? from : from + by;
    const wraps = Math.abs(by) === 1 && Math.floor(to / COLUMNS) !== Math.floor(from / COLUMNS);
    if (to >= 0 && to < ROWS * COLUMNS && !wraps) choose(to);
    get("cell").textContent = image.reading();
  });
  get("view").addEventListener("change", () => {
    image.wanted = get("view").value;
    image.draw();
  });
  get("colors").addEventListener("change", () => {
    image.name = get("colors").value;
    image.draw();
  });
  for (const id of ["low", "high"]) get(id).addEventListener("input", contrast);
  get("contrast-reset").addEventListener("click", () => {
    get("low").value = 0;
    get("high").value = 100;
    contrast();
  });
}
