// Keyboard. Letters do nothing while somebody types into a field or a dialog is open.

export function startKeys({ get, history, page, replay, selected, toggleTheme, tools }) {
  const hold = () => {
    if (document.body.dataset.mode === "replay") return replay.toggle();
    page.held = !page.held;
    tools.toast(page.held ? "The picture is held. Space goes on." : "Live again.");
    if (!page.held) selected.showLast();
    return undefined;
  };
  const keys = {
    " ": hold,
    ArrowUp: () => selected.pick(history.neighbour(1)),
    ArrowDown: () => selected.pick(history.neighbour(-1)),
    ArrowLeft: (event) => replay.step(event.shiftKey ? -10 : -1),
    ArrowRight: (event) => replay.step(event.shiftKey ? 10 : 1),
    "[": () => replay.state && replay.faster(-1),
    "]": () => replay.state && replay.faster(1),
    Escape: () => {
      if (get("export").open) get("export").open = false;
      else selected.back();
    },
    r: () => tools.record(),
    m: () => tools.mark(),
    v: () => tools.visit(),
    e: () => {
      get("export").open = !get("export").open;
    },
    t: toggleTheme,
    "?": () => get("dialog-help").showModal(),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    // A dialog that has just closed keeps the focus until the next picture; a key pressed meanwhile is for the page.
    const inField = event.target.closest("input, select, textarea") && !event.target.closest("dialog:not([open])");
    const onButton = event.target.closest("button, summary, a");
    if (inField || (onButton && (event.key === " " || event.key === "Enter"))) return;
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  });
}
