// The web socket to the viewer program: comes back by itself, answers commands with promises.

import { CELLS } from "./array.js";

export class Connection {
  /** handlers: {message(object), frame(ArrayBuffer), closed()} */
  constructor(handlers) {
    this.handlers = handlers;
    this.waiting = new Map();
    this.nextId = 1;
    this.delay = 250;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/ws`);
    this.socket.binaryType = "arraybuffer";
    this.greeted = new Promise((go) => (this.greet = go));
    this.socket.onopen = () => {
      this.delay = 250;
    };
    this.socket.onmessage = ({ data }) => {
      if (data instanceof ArrayBuffer) return this.handlers.frame(data);
      const message = JSON.parse(data);
      if (message.type === "answer") return this.settle(message);
      this.handlers.message(message);
      if (message.type === "hello") this.greet();
    };
    this.socket.onclose = () => {
      this.greet();
      for (const { reject } of this.waiting.values()) reject(new Error("The viewer program does not answer."));
      this.waiting.clear();
      this.handlers.closed();
      setTimeout(() => this.open(), this.delay);
      this.delay = Math.min(this.delay * 2, 3000);
    };
  }

  settle(answer) {
    const waiting = this.waiting.get(answer.id);
    if (!waiting) return;
    this.waiting.delete(answer.id);
    if (answer.ok) waiting.resolve(answer);
    else waiting.reject(new Error(answer.text));
  }

  /** Tell the server that this frame is on the screen, so that it sends the next. */
  drawn(seq) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(`{"drawn":${seq}}`);
  }

  /**
   * Run one command; resolves with the answer, rejects with a sentence. One asked while the page connects waits until the
   * server has said how things stand (`greeted` resolves then, or when there is no connection).
   */
  async ask(command, options = {}) {
    const { greeted, socket } = this;
    await greeted;
    if (socket.readyState !== WebSocket.OPEN) throw new Error("The viewer program does not answer.");
    const id = this.nextId++;
    socket.send(JSON.stringify({ ...options, do: command, id }));
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }
}

/** A frame as the server packs it (session.py, pack_frame). */
export function unpackFrame(buffer) {
  const view = new DataView(buffer);
  return {
    seq: view.getUint32(4, true),
    time_s: view.getFloat64(8, true),
    position_mm: view.getFloat32(24, true),
    displacement_mm: view.getFloat32(28, true),
    force: view.getFloat32(32, true),
    peak_kPa: view.getFloat32(36, true),
    pressure: new Float32Array(buffer, 40, CELLS),
  };
}
