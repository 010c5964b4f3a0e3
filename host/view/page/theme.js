// Light and dark, and the style sheet's colours for the canvases.

let cache = {};
const probe = document.head.appendChild(document.createElement("i")); // a canvas knows no light-dark(), an element does

/** A colour of the style sheet by name, such as "accent". */
export function color(name) {
  if (!cache[name]) {
    probe.style.color = `var(--${name})`;
    cache[name] = getComputedStyle(probe).color;
  }
  return cache[name];
}

export function startTheme(redraw) {
  const system = matchMedia("(prefers-color-scheme: light)");
  const theme = () => localStorage.getItem("palpate-theme") ?? (system.matches ? "light" : "dark");
  const apply = () => {
    document.documentElement.style.colorScheme = theme();
    cache = {};
    redraw();
  };
  apply();
  system.addEventListener("change", apply);
  return () => {
    localStorage.setItem("palpate-theme", theme() === "light" ? "dark" : "light");
    apply();
  };
}
