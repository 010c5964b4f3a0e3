// Record, mark, new visit, export, and short notices.

export function startTools(get, { ask, image, page }) {
  let recording = null;
  let turning = Promise.resolve(); // the start or stop that has been asked for; a second press waits for it

  function toast(text) {
    const note = document.createElement("p");
    note.textContent = text;
    get("toasts").append(note);
    setTimeout(() => note.remove(), 5000);
  }

  const run = (command, options) => ask(command, options).catch((error) => toast(error.message));

  function showRecording(now) {
    recording = now;
    get("record").classList.toggle("on", Boolean(now));
    get("record").setAttribute("aria-pressed", Boolean(now));
    tick();
  }

  function tick() {
    const seconds = recording ? Math.max(0, Date.now() / 1000 - recording.since) : 0;
    const clock = `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
    get("record-text").textContent = recording ? `Stop ${clock}` : "Record";
  }

  function record() {
    if (document.body.dataset.mode === "live") turning = turning.then(turn);
    return turning;
  }

  async function turn() {
    const was = recording;
    const answer = await run(was ? "stop-recording" : "record");
    if (answer) toast(was ? `Saved as ${answer.file}.` : `Recording to ${answer.file}.`);
  }

  function text(title, value) {
    const dialog = get("dialog-text");
    get("text-title").textContent = title;
    get("text-value").value = value;
    dialog.returnValue = "cancel";
    dialog.showModal();
    get("text-value").select();
    return new Promise((resolve) => {
      dialog.addEventListener("close", () => resolve(dialog.returnValue === "ok" ? get("text-value").value : null), { once: true });
    });
  }

  async function mark() {
    if (document.body.dataset.mode !== "live") return;
    await turning;
    if (!recording) return toast("Marks go into a recording. Press R to record.");
    const note = text("Mark this moment", "");
    turning = turning.then(async () => {
      if ((await note) !== null) await run("mark", { text: await note });
    }); // a stop that is asked for right after it comes after it
  }

  async function visit() {
    const name = await text("Name of the new visit", "");
    if (name === null) return;
    if (await run("new-visit", name.trim() ? { name } : {})) toast("A new visit has begun; strokes go there from now on.");
  }

  function saveImage() {
    image.canvas.toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `tactile-image-${page.frame?.seq ?? 0}.png`;
      link.click();
      URL.revokeObjectURL(link.href);
    });
    get("export").open = false;
  }

  get("record").addEventListener("click", record);
  get("mark").addEventListener("click", mark);
  get("new-visit").addEventListener("click", visit);
  get("export-image").addEventListener("click", saveImage);
  get("help").addEventListener("click", () => get("dialog-help").showModal());
  get("scale").addEventListener("change", () => {
    image.scale = get("scale").value;
    image.draw();
  });
  get("colors").addEventListener("change", () => {
    image.name = get("colors").value;
    image.draw();
  });
  document.addEventListener("click", (event) => {
    if (!get("export").contains(event.target) || event.target.closest(".menu-items a")) get("export").open = false;
  });
  setInterval(tick, 500);

  return { toast, recording: showRecording, record, mark, visit };
}
