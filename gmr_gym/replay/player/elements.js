// Pieces of the page.

/** An element; names and titles enter as text, never as markup. */
function make(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else node.setAttribute(key, value);
  }
  node.append(...children);
  return node;
}

const line = (...children) => make("p", {}, ...children);
const heading = (text, more) => make("h3", {}, text, make("small", {}, more));
const link = (text, onclick) => make("button", { class: "gmr-link", type: "button", onclick }, text);

const MOST_BARS = 7;

function bars(title, rows) {
  const list = make("ul", { class: "gmr-bars", "aria-label": title });
  for (const [name, part] of rows.slice(0, MOST_BARS)) {
    const bar = make("i");
    bar.style.width = `${100 * part}%`;
    list.append(make("li", {}, make("span", {}, name), make("b", {}, bar), make("span", {}, share(part))));
  }
  const more = rows.length - MOST_BARS;
  if (more > 0) list.append(make("li", {}, make("span", {}, `and ${more} more`)));
  return make("div", {}, make("h4", {}, title), list);
}

const ICONS = {
  play: "M4 2v12l10-6z",
  pause: "M4 2h3v12H4zM9 2h3v12H9z",
  back: "M13 2v12L5 8zM3 2h2v12H3z",
  forward: "M3 2v12l8-6zM11 2h2v12h-2z",
  plus: "M7 3h2v4h4v2H9v4H7V9H3V7h4z",
  minus: "M3 7h10v2H3z",
  theme: "M8 1a7 7 0 1 0 0 14A7 7 0 0 0 8 1zm0 2v10A5 5 0 0 1 8 3z",
};

function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

function button(name, title, onclick, ...children) {
  const attributes = { type: "button", class: `gmr-${name}`, title, "aria-label": title, onclick };
  return make("button", attributes, ...children);
}

function choice(text, options, value, onchange) {
  const select = make("select", { "aria-label": text, title: text, onchange: () => onchange(select.value) });
  for (const [key, name] of options) select.append(make("option", { value: key }, name));
  select.value = value;
  return select;
}
