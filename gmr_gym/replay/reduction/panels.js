// A panel for every method, and the charts of what they cost.

const LATEST = 3; // steps that are listed

/** One method's canvas, with its numbers in words and its latest steps. */
class MethodPanel {
  constructor(view, method, axes) {
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
    const Scene = axes.length === 1 ? DensityScene : EllipseScene;
    this.scene = new Scene(this, componentsOf(method, 0), axes);
  }

  draw(where, show, ink) {
    const { plane } = this;
    this.ink = ink;
    plane.look(where.x, where.y, where.scale);
    plane.ctx.clearRect(0, 0, plane.width, plane.height);
    const chosen = show.chosen && show.chosen.panel === this && show.u >= 1 ? show.chosen.j : null;
    this.scene.draw({ ...show, chosen });
    plane.ctx.globalAlpha = 1;
  }

  /** Put step k in words. */
  say(k) {
    const { method } = this, now = method.steps[k], step = stepInWords(method, k);
    this.words.textContent = `${plural(now.kept.length, "component")}, ${costInWords(now)}`;
    const rows = [];
    for (let i = k; i > 0 && rows.length < LATEST; i--) rows.push(this.row(i, i === k));
    this.list.replaceChildren(...(rows.length ? rows : [make("li", {}, step)]));
    this.canvas.setAttribute("aria-label", `${method.name}: ${this.words.textContent}. ${step}`);
  }

  row(k, now) {
    const { method, view } = this, step = method.steps[k];
    const text = `${stepInWords(method, k)}; ${now ? `ISE now ${brief(step.ise)}` : costInWords(step)}`;
    const attributes = { type: "button", title: text, onclick: () => view.go(k) };
    const count = make("b", {}, String(step.kept.length));
    const node = make("button", attributes, count, make("span", {}, text));
    return make("li", now ? { class: "gmr-now" } : {}, node);
  }
}

/** A cost of all methods against the number of components. */
class CostStrip extends LineStrip {
  constructor(title, key, view) {
    const series = view.methods.map(({ name, colour, steps }) => ({
      name, colour, lost: -1, values: steps.map((step) => step[key] ?? NaN),
    }));
    const scans = { last: view.last, trackers: view.methods };
    super({ title, unit: " ", series }, scans, (k) => view.go(k, true));
    this.canvas.setAttribute("aria-label", `${title} against the number of components`);
  }

  /** As far down as the least cost, which is not zero but for rounding. */
  range() {
    super.range();
    const costs = this.series.flatMap(({ values }) => values.filter((value) => value > 1e-9 * this.high));
    this.low = Math.min(this.high / 2, ...costs);
  }

  label(value) {
    const rounded = +value.toPrecision(3);
    return value < 1e-3 || value >= 1e4 ? rounded.toExponential() : String(rounded);
  }

  say(k) {
    this.series.forEach(({ values }, i) => { this.values[i].lastChild.textContent = brief(values[k]); });
  }
}
