// What every page has that plays: light and dark, help, a play button, frames.

const NARROW = 760; // px; the style sheet has it too

/** A page in one element. What extends it has panels, strips and pieces, and says how it moves and draws. */
class Frame {
  constructor(root) {
    Object.assign(this, { root, playing: false, tick: this.tick.bind(this) });
    this.calm = window.matchMedia("(prefers-reduced-motion: reduce)");
  }

  /** Begin, once all pieces are there. */
  open(actionsOf) {
    this.followTheme();
    this.resize();
    this.panels.forEach((panel) => listen(this, panel));
    listenToKeys(this, actionsOf);
    new ResizeObserver(() => this.resize()).observe(this.root);
  }

  /** Fit slider and panels to the width. */
  layOut() {
    const { bar, charts, time } = this.pieces;
    this.narrow = this.root.clientWidth < NARROW;
    // on a phone the slider stays in sight with the buttons; else it lies over the charts
    const home = this.narrow ? bar : charts;
    if (time.parentNode !== home) home.prepend(time);
    for (const { plane } of this.panels) plane.resize();
  }

  /** Say what is selected: beside the charts, on a phone below its panel. */
  tell(nodes, panel) {
    const { aside, chosen } = this.pieces;
    chosen.replaceChildren(...nodes);
    if (this.narrow && panel) panel.node.append(chosen);
    else aside.prepend(chosen);
  }

  /** Take the colours of the style sheet. */
  dye() {
    this.ink = inkOf(this.root);
    this.strips.forEach((strip) => strip.paint(this.ink));
    this.wake();
  }

  /** Light or dark as the reader's system is, also when that changes. */
  followTheme() {
    const system = window.matchMedia("(prefers-color-scheme: dark)");
    system.addEventListener("change", () => this.shade(system.matches));
    this.shade(system.matches);
  }

  shade(dark) {
    this.root.dataset.theme = dark ? "dark" : "light";
    this.dye();
  }

  toggleHelp() {
    this.pieces.help.hidden = !this.pieces.help.hidden;
  }

  play(playing) {
    const { play } = this.pieces, name = playing ? "Pause" : "Play";
    this.playing = playing;
    play.replaceChildren(icon(playing ? "pause" : "play"));
    play.setAttribute("aria-label", name);
    play.title = name;
    this.wake();
  }

  /** Ask for one frame; a frame asks for the next only while something moves. */
  wake() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(this.tick);
  }

  tick(now) {
    const seconds = this.before ? Math.min(0.1, (now - this.before) / 1000) : 1 / 60;
    this.asked = false;
    const moving = this.move(seconds);
    this.before = moving ? now : 0;
    this.draw();
    if (moving) this.wake();
  }
}

function header(frame, title, about) {
  const shade = () => frame.shade(frame.root.dataset.theme === "light");
  return make(
    "header", {},
    make("div", {}, make("h2", {}, title), make("span", {}, about)),
    button("plain", "Light or dark", shade, icon("theme")),
    button("plain", "Keys and help", () => frame.toggleHelp(), "?"),
  );
}

const panelsOf = ({ panels }) =>
  make("div", { class: "gmr-panels", "data-count": panels.length }, ...panels.map(({ node }) => node));

function speedChoice(frame, speeds, what) {
  const options = speeds.map((speed) => [speed, `${plural(speed, what)}/s`]);
  return choice("Speed", options, frame.speed, (value) => { frame.speed = Number(value); });
}

const zoomButtons = (frame) => [
  button("plain", "Zoom out", () => frame.zoom(1 / ZOOM), icon("minus")),
  button("plain", "Zoom in", () => frame.zoom(ZOOM), icon("plus")),
];

function helpBox(frame, keys, gestures) {
  const rows = keys.map(([key, what]) => make("div", {}, make("kbd", {}, key), what));
  return make(
    "div", { class: "gmr-help", hidden: "", role: "dialog", "aria-label": "Keys and help" },
    make("h3", {}, "Keys"), ...rows, make("p", {}, gestures),
    button("close", "Close the help", () => frame.toggleHelp(), "close"),
  );
}

/** What the marks of the panels mean: [kind, text] each. */
function keyList(rows) {
  const item = ([kind, text]) => make("li", {}, make("i", { class: `gmr-mark ${kind}` }), text);
  return make("ul", { class: "gmr-key" }, ...rows.map(item));
}
