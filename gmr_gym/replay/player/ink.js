// Colours and type, from the style sheet, for the canvases.

const COLOURS = [
  "ink", "faint", "grid", "detections", "truth", "estimate", "hypotheses", "gates", "dropped", "paper",
  "tracker0", "tracker1", "tracker2", "tracker3",
];

/** The style sheet's colours under their names, and those of labels and motion models. */
function inkOf(root) {
  const style = getComputedStyle(root), labels = new Map();
  const variable = (name) => style.getPropertyValue(`--gmr-${name}`).trim();
  const ink = Object.fromEntries(COLOURS.map((name) => [name, variable(name)]));
  const dark = root.dataset.theme === "dark";
  ink.label = (label) => {
    if (!labels.has(label)) labels.set(label, labelColour(label, dark));
    return labels.get(label);
  };
  ink.band = (k) => `hsl(${(212 + 137.5 * k) % 360} 34% ${dark ? 46 : 70}%)`;
  ink.small = `11px ${style.fontFamily}`;
  ink.text = `12px ${style.fontFamily}`;
  return ink;
}

/** Colour of a label, the same in every panel and every page: hues a golden angle apart. */
function labelColour(label, dark) {
  const hue = (Math.imul(label + 1, 2654435761) >>> 0) / 2 ** 32 * 360;
  return `hsl(${hue.toFixed(0)} ${dark ? "70% 68%" : "75% 38%"})`;
}
