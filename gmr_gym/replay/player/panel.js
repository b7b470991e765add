// One tracker of those side by side.

/** A tracker's canvas with its name, its numbers in words, and what has become of its target. */
class Panel {
  constructor(episode, tracker, number) {
    Object.assign(this, { episode, tracker });
    this.canvas = make("canvas", { role: "img" });
    this.plane = new Plane(this.canvas);
    this.words = make("span", { class: "gmr-words" });
    this.banner = make("div", { class: "gmr-banner" });
    this.note = make("div", { class: "gmr-note" });
    const swatch = make("i", { class: "gmr-swatch" });
    swatch.style.background = `var(--gmr-tracker${number})`;
    this.node = make(
      "figure", { class: "gmr-panel" },
      make("figcaption", {}, make("strong", {}, swatch, tracker.name), this.words),
      make(
        "div", { class: "gmr-stage" }, this.canvas,
        make("div", { class: "gmr-over" }, this.banner, this.note),
      ),
    );
    this.where = { x: 0, y: 0, scale: 1 };
  }

  draw(show, camera, ink, calm) {
    const { plane, where } = this;
    this.ink = ink;
    camera.look(where, this.tracker, show.t, calm ? 1 : show.way);
    plane.look(where.x, where.y, where.scale);
    plane.ctx.clearRect(0, 0, plane.width, plane.height);
    drawGround(plane, ink, this.episode.radar);
    if (this.episode.many) drawManyScan(this, show);
    else {
      drawScan(this, show);
      drawOverview(this, show);
    }
    plane.ctx.globalAlpha = 1;
  }

  /** Put scan and stage in words. */
  say(t, stage) {
    const { tracker } = this;
    const words = tracker.declared ? this.declaredInWords(t)
      : tracker.full ? stageInWords(tracker, t, stage) : reductionInWords(counts(tracker, t));
    const lost = tracker.lost >= 0 && t >= tracker.lost;
    this.words.textContent = words;
    this.banner.textContent = lost ? `target lost at scan ${tracker.lost + 1}` : "";
    this.note.textContent = this.notes(t);
    this.node.classList.toggle("gmr-lost", lost);
    const said = [words, this.banner.textContent, this.note.textContent].filter(Boolean).join("; ");
    this.canvas.setAttribute("aria-label", `${tracker.name}, scan ${t + 1}: ${said}`);
  }

  notes(t) {
    const { alive, estimate } = this.tracker;
    if (alive && !alive[t]) return "given up: the tracker only predicts";
    if (estimate && !Number.isFinite(estimate[2 * t])) return "no estimate at this scan";
    return "";
  }

  declaredInWords(t) {
    const { declared, kept, expected } = this.tracker;
    if (this.episode.filed) return `${plural(size(declared, t), "track")}, ${figures(expected[t])} expected`;
    const targets = plural(size(declared, t), "target"), components = plural(size(kept, t), "component");
    return `${targets} declared, ${figures(expected[t])} expected; ${components}`;
  }
}
