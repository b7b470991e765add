// A panel in two coordinates: ellipses.

const TOO_FLAT = 4; // ratio of the extents of the coordinates from which one is stretched

/** Two coordinates, drawn in a panel. */
class EllipseScene {
  constructor(panel, full, axes) {
    Object.assign(this, { panel, full, axes });
    const [x0, x1] = extentOf(full, axes[0], 0, SIGMAS), [y0, y1] = extentOf(full, axes[1], 2, SIGMAS);
    const ratio = (x1 - x0) / (y1 - y0);
    this.stretch = ratio > TOO_FLAT || ratio < 1 / TOO_FLAT ? ratio : 1;
    this.box = [x0, y0 * this.stretch, x1, y1 * this.stretch];
    this.most = Math.max(...this.full.map(({ w }) => w));
  }

  fit({ width, height }) {
    const [x0, y0, x1, y1] = this.box;
    const scale = Math.min((width - 60) / (x1 - x0), (height - 50) / (y1 - y0));
    return { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale };
  }

  place({ m }) {
    return [m[this.axes[0]], m[this.axes[1]] * this.stretch];
  }

  ellipse(one) {
    const [x, y] = this.place(one), [xx, xy, yy] = one.P, s = this.stretch;
    return this.panel.plane.ellipse(x, y, xx, xy * s, yy * s * s, SIGMAS);
  }

  draw({ k, u, chosen }) {
    const { panel } = this, { plane, ink, method } = panel, { ctx } = plane;
    drawUprights(panel, plane.height, plane.height - 2);
    drawLevels(panel, this.stretch);
    ctx.fillText(`x${this.axes[0] + 1}`, plane.width - 18, plane.height - 2);
    ctx.fillText(`x${this.axes[1] + 1}`, 4, 16);
    this.outline(this.full, ink.detections, 0.8);
    const shown = inSight(method, k, u);
    const most = Math.max(this.most, ...shown.map(({ w }) => w));
    this.links(shown, k);
    for (const one of shown) this.drawOne(one, most);
    this.outline(droppedIn(method, k), ink.dropped, 1.3);
    if (chosen === null) return;
    const inputs = method.inputs[k][chosen].map((i) => this.full[i]);
    this.outline(inputs, ink.ink, 1);
    this.outline([componentOf(method, k, chosen)], ink.ink, 2.4);
  }

  outline(components, colour, width) {
    const { ctx } = this.panel.plane;
    Object.assign(ctx, { strokeStyle: colour, lineWidth: width });
    for (const one of components) {
      ctx.globalAlpha = mix(0.35, 0.8, opacityOf(one.w, this.most));
      if (this.ellipse(one)) ctx.stroke();
    }
  }

  drawOne(one, most) {
    const { plane: { ctx }, ink } = this.panel, colour = colourOf(ink, one.fate);
    const alpha = one.strength * Math.max(one.fate ? 0.6 : 0, opacityOf(one.w, most));
    if (!this.ellipse(one)) return;
    Object.assign(ctx, { fillStyle: colour, globalAlpha: 0.1 * alpha });
    ctx.fill();
    const lineWidth = one.fate === "merged" ? 2 : 1.3;
    Object.assign(ctx, { strokeStyle: colour, globalAlpha: alpha, lineWidth });
    ctx.stroke();
  }

  /** From every input of a merged component to where that is now. */
  links(shown, k) {
    const { plane, ink, method } = this.panel, { ctx } = plane;
    ctx.lineWidth = 0.9;
    const drawn = new Map(shown.filter(({ j }) => j !== undefined).map((one) => [one.j, one]));
    for (const [j, one] of drawn) {
      const inputs = method.inputs[k][j], [x, y] = this.place(componentOf(method, k, j));
      if (inputs.length < 2) continue;
      for (const i of inputs) {
        ctx.strokeStyle = colourOf(ink, one.fate);
        ctx.globalAlpha = one.strength * (one.fate ? 0.75 : 0.4);
        plane.line(...this.place(this.full[i]), x, y);
        ctx.stroke();
        plane.dot(...this.place(this.full[i]), 1.6);
        ctx.fillStyle = ctx.strokeStyle;
        ctx.fill();
      }
    }
  }

  /** The component whose ellipse holds the point most centrally; null for none. */
  hit(k, X, Y) {
    const { method, plane } = this.panel, s = this.stretch;
    let found = null, least = SIGMAS * SIGMAS;
    componentsOf(method, k).forEach((one, j) => {
      const [x, y] = this.place(one), dx = plane.x(X) - x, dy = plane.y(Y) - y;
      const xx = one.P[0], xy = one.P[1] * s, yy = one.P[2] * s * s;
      const d2 = (dx * dx * yy - 2 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy);
      const near = Math.hypot(dx, dy) * plane.scale < 8 ? 0 : d2;
      if (Math.min(d2, near) < least) [found, least] = [j, Math.min(d2, near)];
    });
    return found;
  }
}
