// Light and dark, and the style sheet's colours for the canvases.

let cache = {};

/** A colour of the style sheet by name, such as "accent". */
export function color(name) {
  cache[name] ??= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  return cache[name];
}

export function startTheme(redraw) {
  const root = document.documentElement;
  const system = matchMedia("(prefers-color-scheme: light)");
  const apply = (theme) => {
    if (theme) root.dataset.theme = theme;
    cache = {};
    redraw();
  };
  apply(localStorage.getItem("palpate-theme") ?? (system.matches ? "light" : "dark"));
  system.addEventListener("change", () => {
    if (!localStorage.getItem("palpate-theme")) apply(system.matches ? "light" : "dark");
  });
  return () => {
    const theme = root.dataset.theme === "light" ? "dark" : "light";
    localStorage.setItem("palpate-theme", theme);
    apply(theme);
  };
}
