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

/** Methods side by side in one element. `at` is where the panels are, between steps; `to`, where they go. */
class View extends Frame {
  constructor(root, data) {
    super(root);
    Object.assign(this, { data, at: 0, to: 0, speed: 0.5, chosen: null, pinned: false });
    this.methods = data.methods.map(methodOf);
    this.count = this.methods[0].steps[0].kept.length;
    this.last = this.methods[0].steps.length - 1;
    this.panels = this.methods.map((method) => new MethodPanel(this, method, data.axes));
    this.strips = [
      new CostStrip("Integral squared error", "ise", this),
      new CostStrip("Runnalls' B of the last merge", "cost", this),
    ].filter(({ series }) => series.some(({ values }) => values.some(Number.isFinite)));
    this.pieces = build(this);
    this.open(keysOf);
    this.panels.forEach((panel) => this.listenToPointer(panel));
  }

  // ---- look of the page

  resize() {
    const [{ plane, scene }] = this.panels;
    this.layOut();
    if (!plane.width) return; // hidden
    if (!this.moved) this.where = scene.fit(plane);
    this.dye();
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
    this.tell(chosen ? describe(chosen, this.to, this.data.axes) : [line(POINT)], chosen && chosen.panel);
    this.wake();
  }

  // ---- steps

  /** Go to step k, at once or on the way that the panels show. */
  go(k, atOnce = false) {
    if (this.playing) this.play(false);
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

  move(seconds) {
    this.advance(seconds);
    return this.playing || this.at !== this.to;
  }

  draw() {
    if (!this.where) return; // hidden since the start
    const k = Math.ceil(this.at), phase = this.at === k ? 1 : this.at - (k - 1);
    // played, a step is shown done for a while before the next begins
    const u = this.calm.matches ? 1 : during(phase, 0, this.playing ? 0.6 : 1);
    const show = { k, u, chosen: this.chosen };
    this.root.dataset.moving = u < 1;
    for (const panel of this.panels) panel.draw(this.where, show, this.ink);
    for (const strip of this.strips) strip.draw(this.to);
    if (this.said !== this.to) this.say(this.to);
  }

  say(k) {
    const { pieces } = this;
    this.said = k;
    this.root.dataset.components = this.count - k;
    const now = `${this.count - k} of ${this.count}`;
    pieces.clock.firstChild.textContent = now;
    pieces.time.value = k;
    pieces.time.setAttribute("aria-valuetext", `${now} components`);
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
