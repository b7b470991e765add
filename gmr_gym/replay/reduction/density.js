// A panel in one dimension: densities, and under them the tree of the merges.

const TREE = 0.36; // share of the panel's height
const ROOT_2PI = Math.sqrt(2 * Math.PI);

const densityOf = ({ w, m, P }, x) =>
  (w * Math.exp((-0.5 * (x - m[0]) ** 2) / P[0])) / (ROOT_2PI * Math.sqrt(P[0]));

/** One dimension, drawn in a panel. */
class DensityScene {
  constructor(panel, full) {
    Object.assign(this, { panel, full });
    const [low, high] = extentOf(this.full, 0, 0, 3.4);
    Object.assign(this, { x: (low + high) / 2, extent: high - low });
    this.high = 1.12 * this.peak(low, high);
  }

  peak(low, high) {
    let peak = 0;
    for (const { m } of this.full) peak = Math.max(peak, this.at(this.full, m[0]));
    for (let i = 0; i <= 400; i++) peak = Math.max(peak, this.at(this.full, mix(low, high, i / 400)));
    return peak;
  }

  at(components, x) {
    return components.reduce((sum, one) => sum + (one.strength ?? 1) * densityOf(one, x), 0);
  }

  fit(plane) {
    return { x: this.x, y: 0, scale: plane.width / this.extent };
  }

  draw({ k, u, chosen }) {
    const { panel } = this, { plane, ink } = panel, { ctx } = plane;
    this.floor = Math.round(plane.height * (1 - TREE));
    const shown = inSight(panel.method, k, u);
    drawUprights(panel, this.floor, this.floor + 14);
    for (const one of shown) this.fill(one, colourOf(ink, one.fate), one.strength);
    for (const one of droppedIn(panel.method, k)) this.line((x) => densityOf(one, x), ink.dropped, 1.3, 0.8);
    this.line((x) => this.at(this.full, x), ink.truth, 4, 0.45);
    this.line((x) => this.at(shown, x), ink.ink, 1.6, 1);
    const one = chosen === null ? null : componentOf(panel.method, k, chosen);
    if (one) this.line((x) => densityOf(one, x), ink.ink, 2.4, 1);
    ctx.globalAlpha = 1;
    ctx.strokeStyle = ink.gates;
    ctx.lineWidth = 1;
    stroke(ctx, 0, this.floor + 0.5, plane.width, this.floor + 0.5);
    this.drawTree(k, u, chosen);
  }

  Y(density) {
    return this.floor - (density / this.high) * (this.floor - 8);
  }

  trace(density) {
    const { plane } = this.panel, { ctx } = plane;
    ctx.beginPath();
    for (let X = 0; X <= plane.width; X += 1.5) ctx.lineTo(X, this.Y(density(plane.x(X))));
  }

  line(density, colour, width, alpha) {
    const { ctx } = this.panel.plane;
    this.trace(density);
    Object.assign(ctx, { strokeStyle: colour, lineWidth: width, globalAlpha: alpha, lineJoin: "round" });
    ctx.stroke();
  }

  fill(one, colour, alpha) {
    const { ctx, width } = this.panel.plane;
    this.line((x) => densityOf(one, x), colour, 1, 0.85 * alpha);
    ctx.lineTo(width, this.floor);
    ctx.lineTo(0, this.floor);
    Object.assign(ctx, { fillStyle: colour, globalAlpha: 0.1 * alpha });
    ctx.fill();
  }

  /** Height of the row of step k in the tree. */
  row(k) {
    const { plane, method } = this.panel, last = Math.max(1, method.steps.length - 1);
    return mix(plane.height - 12, this.floor + 26, k / last);
  }

  drawTree(k, u, chosen) {
    const { panel } = this, { method, plane, ink } = panel, { ctx } = plane;
    const from = this.lastFormed(k), at = k === 0 ? 0 : mix(k - 1, k, u);
    ctx.lineWidth = 1.2;
    if (from > 0) this.branches(from, inputsOf(method.steps[from]), 0, from === k ? u : 1);
    for (let step = from + 1; step <= k; step++)
      this.branches(step, partsOf(method, step), step - 1, step === k ? u : 1, step === k);
    this.dots(componentsOf(method, 0), this.row(0), ink.detections);
    const shown = inSight(method, k, u);
    this.dots(shown, this.row(at), ink.hypotheses);
    if (chosen === null) return;
    Object.assign(ctx, { strokeStyle: ink.ink, lineWidth: 2, globalAlpha: 1 });
    this.dot(componentOf(method, k, chosen), this.row(at));
    ctx.stroke();
  }

  /** The last step up to k that is no merging of the one before, 0 where there is none. */
  lastFormed(k) {
    const { steps } = this.panel.method;
    while (k > 0 && steps[k].into) k--;
    return k;
  }

  /** Lines from the parts of every component of a step, in the row of step `below`, `u` of the way up. */
  branches(step, parts, below, u, latest = false) {
    const { method, plane, ink } = this.panel, { ctx } = plane;
    const low = this.row(below), high = mix(low, this.row(step), u);
    parts.forEach((rows, j) => {
      const end = componentOf(method, step, j).m[0], merged = rows.length > 1;
      ctx.strokeStyle = merged && latest ? ink.estimate : merged ? ink.hypotheses : ink.detections;
      ctx.globalAlpha = merged ? 0.9 : 0.6;
      for (const row of rows) {
        const start = componentOf(method, below, row).m[0];
        stroke(ctx, plane.X(start), low, plane.X(mix(start, end, u)), high);
      }
    });
  }

  dots(components, Y, colour) {
    const { ink, plane: { ctx } } = this.panel;
    for (const one of components) {
      this.dot(one, Y);
      ctx.globalAlpha = one.strength ?? 1;
      ctx.fillStyle = one.fate ? colourOf(ink, one.fate) : colour;
      ctx.fill();
    }
  }

  dot({ w, m }, Y) {
    const { ctx } = this.panel.plane;
    ctx.beginPath();
    ctx.arc(this.panel.plane.X(m[0]), Y, 2 + 7 * Math.sqrt(Math.min(w, 1)), 0, 2 * Math.PI);
  }

  /** The component that is heaviest at a point; null where none is to speak of. */
  hit(k, X) {
    const { method, plane } = this.panel, x = plane.x(X);
    let found = null, most = 1e-3 * this.high;
    componentsOf(method, k).forEach((one, j) => {
      const density = densityOf(one, x);
      if (density > most) [found, most] = [j, density];
    });
    return found;
  }
}
