// Play, pause, seek and speed of a recording.

const clock = (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")}`;

export class Replay {
  constructor(get, ask) {
    this.get = get;
    this.ask = ask;
    this.state = null;
    this.dragging = false;
    get("play").addEventListener("click", () => this.toggle());
    get("speed").addEventListener("change", () => ask("speed", { speed: Number(get("speed").value) }));
    const seek = get("seek");
    seek.addEventListener("input", () => {
      this.dragging = true;
      get("play-time").textContent = clock(Number(seek.value));
    });
    seek.addEventListener("change", () => {
      this.dragging = false;
      this.seek(Number(seek.value));
    });
  }

  set(playback) {
    this.get("transport").hidden = !playback;
    const before = this.state;
    this.state = playback;
    if (!playback) return;
    const { get } = this;
    get("play").textContent = playback.playing ? "❚❚" : "▶";
    get("play").setAttribute("aria-label", playback.playing ? "Pause" : "Play");
    get("play-length").textContent = clock(playback.length_s);
    const options = [...get("speed").options].map((o) => Number(o.value));
    if (options.includes(playback.speed)) get("speed").value = playback.speed;
    if (!this.dragging) {
      get("seek").max = playback.length_s;
      get("seek").value = playback.position_s;
      get("play-time").textContent = clock(playback.position_s);
    }
    if (before?.strokes_s.length !== playback.strokes_s.length || before?.marks.length !== playback.marks.length) this.ticks();
  }

  ticks() {
    const { length_s: length, strokes_s: strokes, marks } = this.state;
    const tick = (at, name, title) => {
      const node = document.createElement("i");
      node.className = name;
      node.style.left = `${(100 * at) / Math.max(length, 1e-6)}%`;
      node.title = title;
      return node;
    };
    this.get("ticks").replaceChildren(
      ...strokes.map((s, i) => tick(s, "stroke", `Stroke ${i + 1}`)),
      ...marks.map((m) => tick(m.time_s, "mark", m.text)),
    );
  }

  toggle() {
    if (this.state) this.ask(this.state.playing ? "pause" : "play");
  }

  seek(position_s) {
    const target = Math.min(Math.max(position_s, 0), this.state.length_s);
    this.state.position_s = target; // two quick steps add up, whenever the answer comes
    this.ask("seek", { position_s: target });
  }

  step(seconds) {
    if (this.state) this.seek(this.state.position_s + seconds);
  }

  faster(by) {
    const select = this.get("speed");
    const next = Math.min(Math.max(select.selectedIndex + by, 0), select.options.length - 1);
    select.selectedIndex = next;
    this.ask("speed", { speed: Number(select.value) });
  }
}
