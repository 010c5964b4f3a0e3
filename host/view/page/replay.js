// Play, pause, seek and speed of a recording. What is asked for is shown at once; a state that the viewer program told before
// it had applied the command (`commands_applied` counts) does not undo it.

import { element, get } from "./dom.js";

const clock = (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")}`;

export class Replay {
  constructor(ask) {
    this.ask = ask;
    this.state = null;
    this.dragging = false;
    this.asked = 0; // counts what this page asked for
    this.current = 0; // from this count of `commands_applied` on, what is told is what this page asked for
    get("play").addEventListener("click", () => this.toggle());
    get("speed").addEventListener("change", () => this.setSpeed());
    const seek = get("seek");
    seek.addEventListener("input", () => {
      this.dragging = true;
      get("play-time").textContent = clock(Number(seek.value));
    });
    const drop = () => {
      if (this.dragging) this.seek(Number(seek.value));
    };
    for (const end of ["change", "pointerup", "pointercancel", "blur"]) seek.addEventListener(end, drop);
  }

  /** Another viewer program answers now: it has applied no command yet. */
  forget() {
    this.asked += 1;
    this.current = 0;
  }

  /** The state of the replay, from the viewer program; null: nothing is replayed. */
  set(playback) {
    get("transport").hidden = !playback;
    const before = this.state;
    this.state = playback;
    if (!playback) return;
    if (before && playback.commands_applied < this.current) {
      const { position_s, playing, speed } = before;
      this.state = { ...playback, position_s, playing, speed };
    }
    this.show();
    if (before?.strokes_s.length !== playback.strokes_s.length || before?.marks.length !== playback.marks.length) this.ticks();
  }

  show() {
    const { state } = this;
    get("play").classList.toggle("playing", state.playing);
    get("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
    get("play-length").textContent = clock(state.length_s);
    const options = [...get("speed").options].map((o) => Number(o.value));
    if (options.includes(state.speed)) get("speed").value = state.speed;
    if (this.dragging) return;
    get("seek").max = state.length_s;
    get("seek").value = state.position_s;
    get("play-time").textContent = clock(state.position_s);
  }

  ticks() {
    const { length_s: length, strokes_s: strokes, marks } = this.state;
    const tick = (at, name, title) => {
      const node = element("i", { class: name, title });
      node.style.left = `${(100 * at) / Math.max(length, 1e-6)}%`;
      return node;
    };
    get("ticks").replaceChildren(
      ...strokes.map((s, i) => tick(s, "stroke", `Stroke ${i + 1}`)),
      ...marks.map((m) => tick(m.time_s, "mark", m.text)),
    );
  }

  /** Show what is asked for, and ask for it. */
  async control(command, options, now) {
    if (!this.state) return;
    const mine = ++this.asked;
    this.current = Infinity;
    Object.assign(this.state, now);
    this.show();
    const answer = await this.ask(command, options);
    if (mine === this.asked) this.current = answer?.commands_applied ?? 0;
  }

  toggle() {
    const playing = !this.state?.playing;
    this.control(playing ? "play" : "pause", {}, { playing });
  }

  seek(position_s) {
    this.dragging = false;
    const target = Math.min(Math.max(position_s, 0), this.state?.length_s ?? 0);
    this.control("seek", { position_s: target }, { position_s: target });
  }

  step(seconds) {
    if (this.state) this.seek(this.state.position_s + seconds);
  }

  faster(by) {
    const select = get("speed");
    select.selectedIndex = Math.min(Math.max(select.selectedIndex + by, 0), select.options.length - 1);
    this.setSpeed();
  }

  setSpeed() {
    const speed = Number(get("speed").value);
    this.control("speed", { speed }, { speed });
  }
}
