// The page of a reduction: panels side by side, a number of components they share, the costs of all methods.

const SPEEDS = [0.25, 0.5, 1, 2, 5]; // steps a second
const HURRY = 0.3; // s in which the panels go to another step
const KEYS = [
  ["space", "play or pause"],
  ["← →", "one component more, less"],
  ["home end", "all components, the fewest"],
  ["↑ ↓", "select the component before, after"],
  ["+ −", "zoom"],
  ["f", "fit the whole mixture"],
  ["esc", "end the selection"],
  ["?", "this help"],
];
const GESTURES =
  "Drag to move, wheel or two fingers to zoom. Point at a component for its numbers, click to keep them. " +
  "Drag on a chart to go through the numbers of components.";

/** One method's canvas, with its numbers in words and its latest steps. */
class MethodPanel {
  constructor(view, method, data) {
    Object.assign(this, { view, method });
    this.canvas = make("canvas", { role: "img" });
    this.plane = new Plane(this.canvas);
    this.words = make("span", { class: "gmr-words" });
    this.list = make("ol", { class: "gmr-merges", "aria-label": `Latest steps of ${method.name}` });
    const swatch = make("i", { class: "gmr-swatch" });
    swatch.style.background = `var(--gmr-${method.colour})`;
    this.node = make(
      "figure", { class: "gmr-panel" },
      make("figcaption", {}, make("strong", {}, swatch, method.name), this.words),
      make("div", { class: "gmr-stage" }, this.canvas),
      this.list,
    );
    this.scene = data.axes.length === 1 ? new DensityScene(this, view.methods) : new EllipseScene(this, view.methods, data.axes);
  }

  draw(where, show, ink) {
    const { plane, view } = this;
    this.ink = ink;
    plane.look(where.x, where.y, where.scale);
    plane.ctx.clearRect(0, 0, plane.width, plane.height);
    const chosen = show.chosen && show.chosen.panel === this && show.u >= 1 ? show.chosen.j : null;
    this.scene.draw({ ...show, chosen });
    plane.ctx.globalAlpha = 1;
    view.root.dataset.moving = show.u < 1;
  }

  /** Put step k in words. */
  say(k) {
    const { method, view } = this, step = method.steps[k];
    this.words.textContent = `${plural(step.kept.length, "component")}, ${costInWords(step)}`;
    const rows = [];
    for (let step = k; step > 0 && rows.length < LATEST; step--) rows.push(this.row(step, step === k));
    this.list.replaceChildren(...(rows.length ? rows : [make("li", {}, stepInWords(method, 0))]));
    this.canvas.setAttribute("aria-label", `${method.name}: ${this.words.textContent}. ${stepInWords(method, k)}`);
    view.root.dataset.components = view.count - k;
  }

  row(k, now) {
    const { method, view } = this;
    const text = `${stepInWords(method, k)}; ${now ? `ISE now ${brief(method.steps[k].ise)}` : costInWords(method.steps[k])}`;
    const number = make("b", {}, String(method.steps[k].kept.length));
    const node = make("button", { type: "button", title: text, onclick: () => view.go(k) }, number, make("span", {}, text));
    return make("li", now ? { class: "gmr-now" } : {}, node);
  }
}

const LATEST = 3; // steps that are listed

/** A cost of all methods against the number of components. */
class CostStrip extends LineStrip {
  constructor(title, key, view) {
    const series = view.methods.map(({ name, colour, steps }) => ({
      name, colour, lost: -1, values: steps.map((step) => step[key] ?? NaN),
    }));
    super({ title, unit: " ", series }, { last: view.last, trackers: view.methods }, (k) => view.go(k, true));
    this.canvas.setAttribute("aria-label", `${title} against the number of components`);
  }

  /** As far down as the least cost, which is not zero but for rounding. */
  range() {
    super.range();
    const costs = this.series.flatMap(({ values }) => values).filter((value) => value > 1e-9 * this.high);
    this.low = Math.min(this.high / 2, ...costs);
  }

  label(value) {
    return value < 1e-3 ? value.toExponential() : String(value);
  }

  say(k) {
    this.series.forEach(({ values }, i) => { this.values[i].lastChild.textContent = brief(values[k]); });
  }
}

/** Methods side by side in one element. `at` is where the panels are, between steps; `to`, where they go. */
class View {
  constructor(root, data) {
    Object.assign(this, { root, data, at: 0, to: 0, playing: false, speed: 0.5, chosen: null, pinned: false });
    this.methods = data.methods.map(methodOf);
    this.count = this.methods[0].steps[0].kept.length;
    this.last = this.methods[0].steps.length - 1;
    this.calm = window.matchMedia("(prefers-reduced-motion: reduce)");
    this.panels = this.methods.map((method) => new MethodPanel(this, method, data));
    this.strips = [
      new CostStrip("Integral squared error", "ise", this),
      new CostStrip("Runnalls' B of the last merge", "cost", this),
    ].filter(({ series }) => series.some(({ values }) => values.some(Number.isFinite)));
    this.pieces = build(this);
    this.tick = this.tick.bind(this);
    this.followTheme();
    this.resize();
    this.panels.forEach((panel) => listen(this, panel));
    this.panels.forEach((panel) => this.listenToPointer(panel));
    listenToKeys(this, keysOf);
    new ResizeObserver(() => this.resize()).observe(root);
  }

  // ---- look of the page

  resize() {
    const { bar, charts, time } = this.pieces;
    // on a phone the slider stays in sight with the buttons; else it lies over the charts
    const home = this.root.clientWidth < 760 ? bar : charts;
    if (time.parentNode !== home) home.prepend(time);
    for (const { plane } of this.panels) plane.resize();
    if (!this.moved) this.where = this.panels[0].scene.fit(this.panels[0].plane);
    this.dye();
  }

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

  escape() {
    this.pieces.help.hidden = true;
    this.pinned = false;
    this.choose(null);
  }

  // ---- view

  fit() {
    this.moved = false;
    this.resize();
  }

  zoom(factor, { plane } = this.panels[0], X = plane.width / 2, Y = plane.height / 2) {
    const { where } = this, left = (1 - 1 / factor) / where.scale;
    this.moved = true;
    where.x += (X - plane.width / 2) * left;
    where.y -= (Y - plane.height / 2) * left;
    where.scale *= factor;
    this.wake();
  }

  pan(panel, dX, dY) {
    this.moved = true;
    this.where.x -= dX / this.where.scale;
    this.where.y += dY / this.where.scale;
    this.wake();
  }

  // ---- selection

  listenToPointer(panel) {
    const { canvas } = panel;
    canvas.addEventListener("pointermove", (event) => {
      if (this.pinned || event.buttons || event.pointerType === "touch") return;
      const j = panel.scene.hit(this.to, ...placeOf(event, canvas));
      this.choose(j === null ? null : { panel, j });
    });
    canvas.addEventListener("pointerleave", () => this.pinned || this.choose(null));
  }

  pick(panel, X, Y) {
    const j = panel.scene.hit(this.to, X, Y);
    this.pinned = j !== null;
    this.choose(j === null ? null : { panel, j });
  }

  /** Select the next component, or the one before. */
  turnTo(by) {
    const { panel = this.panels[0], j = by > 0 ? -1 : 0 } = this.chosen || {};
    const count = panel.method.steps[this.to].kept.length;
    this.pinned = true;
    this.choose({ panel, j: (j + by + count) % count });
  }

  choose(chosen) {
    const same = chosen && this.chosen && chosen.panel === this.chosen.panel && chosen.j === this.chosen.j;
    if (same || (!chosen && !this.chosen)) return;
    this.chosen = chosen;
    this.pieces.chosen.replaceChildren(...(chosen ? describe(chosen, this.to, this.data.axes) : [line(POINT)]));
    this.wake();
  }

  // ---- steps

  /** Go to step k, at once or on the way that the panels show. */
  go(k, atOnce = false) {
    this.play(false);
    this.head(Math.max(0, Math.min(this.last, k)));
    if (atOnce || this.calm.matches) this.at = this.to;
    else if (Math.abs(this.to - this.at) > 1) this.at = this.to - Math.sign(this.to - this.at);
    this.wake();
  }

  /** What is selected belongs to a step, and ends with it. */
  head(k) {
    if (k === this.to) return;
    this.to = k;
    this.pinned = false;
    this.choose(null);
  }

  toggle() {
    if (!this.playing && this.at === this.last) this.at = this.to = 0;
    this.play(!this.playing);
  }

  play(playing) {
    const { play } = this.pieces, name = playing ? "Pause" : "Play";
    if (playing === this.playing) return;
    this.playing = playing;
    play.replaceChildren(icon(playing ? "pause" : "play"));
    play.setAttribute("aria-label", name);
    play.title = name;
    this.wake();
  }

  advance(seconds) {
    if (!this.playing) {
      const way = seconds / HURRY, left = this.to - this.at;
      this.at = Math.abs(left) <= way ? this.to : this.at + Math.sign(left) * way;
      return;
    }
    this.at = Math.min(this.last, this.at + seconds * this.speed);
    this.head(Math.ceil(this.at));
    if (this.at === this.last) this.play(false);
  }

  // ---- frames

  wake() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(this.tick);
  }

  tick(now) {
    const seconds = this.before ? Math.min(0.1, (now - this.before) / 1000) : 1 / 60;
    this.asked = false;
    this.advance(seconds);
    const moving = this.playing || this.at !== this.to;
    this.before = moving ? now : 0;
    this.draw();
    if (moving) this.wake();
  }

  draw() {
    const k = Math.ceil(this.at), phase = this.at === k ? 1 : this.at - (k - 1);
    // played, a step is shown done for a while before the next begins
    const u = this.calm.matches ? 1 : during(phase, 0, this.playing ? 0.6 : 1);
    const show = { k, u, chosen: this.chosen };
    for (const panel of this.panels) panel.draw(this.where, show, this.ink);
    for (const strip of this.strips) strip.draw(this.to);
    if (this.said !== this.to) this.say(this.to);
  }

  say(k) {
    const { pieces } = this;
    this.said = k;
    const now = `${this.count - k} of ${this.count}`;
    pieces.clock.replaceChildren(make("span", {}, now), make("span", {}, " components"));
    pieces.time.value = k;
    pieces.time.setAttribute("aria-valuetext", pieces.clock.textContent);
    for (const part of [...this.panels, ...this.strips]) part.say(k);
  }
}

function keysOf(view) {
  return {
    " ": () => view.toggle(),
    ArrowLeft: () => view.go(view.to - 1),
    ArrowRight: () => view.go(view.to + 1),
    ArrowUp: () => view.turnTo(-1),
    ArrowDown: () => view.turnTo(1),
    Home: () => view.go(0),
    End: () => view.go(view.last),
    "+": () => view.zoom(ZOOM),
    "=": () => view.zoom(ZOOM),
    "-": () => view.zoom(1 / ZOOM),
    f: () => view.fit(),
    "?": () => view.toggleHelp(),
    Escape: () => view.escape(),
  };
}

/** Fill the element with the reductions of the data. */
function start(element, data) {
  return new View(element, data);
}
