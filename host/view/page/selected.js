// Which stroke the page shows: the running one (or the last), or one that was picked from the list.

import { drawCard } from "./card.js";

export class Selected {
  constructor(get, { image, charts, history, page, redraw }) {
    Object.assign(this, { get, image, charts, history, page, redraw });
    this.picked = null;
    this.last = null;
    this.place = null;
    get("back-live").addEventListener("click", () => this.back());
    get("scrub-range").addEventListener("input", () => this.scrub(Number(get("scrub-range").value)));
    const map = get("map");
    map.addEventListener("pointermove", (event) => this.hover(event.offsetX));
    map.addEventListener("pointerdown", (event) => this.hover(event.offsetX));
  }

  /** The number of the stroke that exports should take: the shown one. */
  get number() {
    return this.picked?.number ?? this.last?.number ?? null;
  }

  async start(number) {
    if (number !== null && !this.picked) {
      this.last = await this.fetch(number);
      if (this.last && !this.picked) this.showLast();
    }
  }

  /** A stroke has just ended. */
  finished(stroke) {
    this.last = stroke;
    if (!this.picked && !this.page.held) this.showLast();
  }

  showLast() {
    if (!this.page.running) this.charts.show(this.last);
    this.card(this.last);
    this.redraw();
  }

  async pick(number) {
    if (number === null) return;
    const stroke = await this.fetch(number);
    if (!stroke) return;
    this.picked = stroke;
    this.history.mark(number);
    this.get("back-live").hidden = false;
    this.charts.show(stroke);
    this.card(stroke);
    this.images = unpackImages(stroke.images);
    const range = this.get("scrub-range");
    range.max = Math.max(this.images.length - 1, 0);
    this.get("scrub").hidden = this.images.length < 2;
    if (this.images.length) this.scrub(this.images.reduce((best, i, n) => (i.peak > this.images[best].peak ? n : best), 0));
    this.redraw();
  }

  back() {
    if (!this.picked) return false;
    this.picked = null;
    this.place = null;
    this.get("back-live").hidden = true;
    this.get("scrub").hidden = true;
    this.get("image-note").textContent = "16 × 26 sensors, 1.5 mm apart";
    this.history.mark(null);
    this.charts.show(this.page.running ?? this.last);
    if (this.last) this.card(this.last);
    if (this.page.frame) this.image.draw(this.page.frame.pressure);
    this.redraw();
    return true;
  }

  scrub(index) {
    const shown = this.images[index];
    if (!shown) return;
    this.get("scrub-range").value = index;
    this.get("scrub-text").textContent = `At ${shown.position_mm.toFixed(1)} mm`;
    this.get("image-note").textContent = `stroke ${this.picked.number}, probe at ${shown.position_mm.toFixed(1)} mm`;
    this.place = shown.position_mm;
    this.image.draw(shown.pressure);
    this.page.chartsNew = true;
  }

  /** The pointer over the map moves along the picked stroke. */
  hover(offsetX) {
    if (!this.picked || !this.images.length || !this.charts.map.place) return;
    const { box, x } = this.charts.map.place;
    const at = x[0] + ((offsetX - box.left) / (box.right - box.left)) * (x[1] - x[0]);
    const far = (n) => Math.abs(this.images[n].position_mm - at);
    this.scrub(this.images.reduce((best, _, n) => (far(n) < far(best) ? n : best), 0));
  }

  card(stroke) {
    drawCard(this.get("card"), stroke.card, this.page.link === "gone");
    const time = new Date(stroke.wall_time * 1000).toLocaleTimeString([], { hour12: false });
    const lost = stroke.gaps ? `, ${stroke.gaps} frames lost` : "";
    this.get("estimate-which").textContent = `stroke ${stroke.number}, ${time}${lost}`;
  }

  async fetch(number) {
    try {
      const answer = await fetch(`/api/stroke-${number}.json`);
      return answer.ok ? await answer.json() : null;
    } catch {
      return null;
    }
  }
}

function unpackImages({ position_mm: positions, step_kPa: step, uint16 }) {
  const bytes = Uint8Array.from(atob(uint16), (ch) => ch.charCodeAt(0));
  const all = new Uint16Array(bytes.buffer);
  return positions.map((position_mm, n) => {
    const pressure = Float32Array.from(all.subarray(n * 416, (n + 1) * 416), (v) => v * step);
    return { position_mm, pressure, peak: Math.max(...pressure) };
  });
}
