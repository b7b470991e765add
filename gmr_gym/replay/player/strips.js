// The charts below the panels.

/** The charts below the panels, as { title, unit, series: [{ name, values, colour, lost }], kind }. */
function chartsOf(episode) {
  const { trackers, many } = episode;
  const series = (key) =>
    trackers.flatMap((tracker, i) =>
      tracker[key] ? [{ name: tracker.name, values: tracker[key], colour: `tracker${i}`, lost: tracker.lost, tracker }] : [],
    );
  const charts = many ? manyCharts(trackers, series) : oneCharts(series);
  if (!many)
    trackers.forEach((tracker) => {
      if (tracker.mode_p) charts.push({ title: "Motion models", of: tracker.name, bands: tracker.mode_p, series: [] });
    });
  return charts.filter(({ series, bands }) => series.length || bands);
}

function oneCharts(series) {
  return [
    { title: "Error", unit: " m", series: series("error"), scales: true },
    {
      title: "Hypotheses", unit: "", integers: true,
      series: series("count").map((one) => ({ ...one, before: sizesBefore(one.tracker, one.values.length) })),
    },
  ];
}

/** Number of hypotheses before the reduction of every scan; null where that is not known. */
const sizesBefore = (tracker, scans) =>
  tracker.full && Float32Array.from({ length: scans }, (_, t) => counts(tracker, t).all);

function manyCharts(trackers, series) {
  const present = trackers[0].present;
  const truth = present ? [{ name: "true number", values: present, colour: "truth", lost: -1 }] : [];
  return [
    { title: "GOSPA", unit: " m", series: series("gospa"), scales: true },
    { title: "Expected number of targets", unit: "", series: [...truth, ...series("expected")] },
  ];
}

/** One chart over all scans: drawn once, then copied under its cursor. */
class Strip {
  constructor(chart, episode, scrub) {
    Object.assign(this, chart);
    this.episode = episode;
    this.back = document.createElement("canvas");
    this.canvas = make("canvas", { role: "img", "aria-label": `${chart.title} over scans` });
    this.values = this.series.map(({ name, colour }) => this.legend(name, colour));
    this.said = make("span");
    this.bandValues = this.bands && this.bands.length / episode.scans <= 5 ? this.bandLegends() : [];
    this.log = Boolean(this.scales) && spread(this.series) > 40;
    const head = make("div", { class: "gmr-strip-head" }, make("strong", {}, this.title), this.of || "", ...this.values, ...this.bandValues, this.said);
    if (this.scales) head.append(this.scaleButton());
    this.node = make("div", { class: "gmr-strip" }, head, this.canvas);
    listenToScrub(this.canvas, (X) => scrub(this.scanAt(X)));
  }

  legend(name, colour) {
    const swatch = make("i", { class: "gmr-swatch" });
    swatch.style.background = `var(--gmr-${colour})`;
    return make("span", { class: "gmr-value" }, swatch, this.episode.trackers.length > 1 || colour === "truth" ? `${name} ` : "", make("b"));
  }

  bandLegends() {
    return Array.from({ length: this.bands.length / this.episode.scans }, (_, k) =>
      make("span", { class: "gmr-value" }, make("i", { class: "gmr-swatch" }), `${modeName(this.episode, k)} `, make("b")));
  }

  scaleButton() {
    const toggle = () => {
      this.log = !this.log;
      node.setAttribute("aria-pressed", this.log);
      this.paint(this.ink);
      this.draw(this.shown);
    };
    const node = button("toggle", "Logarithmic scale", toggle, "log");
    node.setAttribute("aria-pressed", this.log);
    return node;
  }

  scanAt(X) {
    return Math.max(0, Math.min(this.episode.last, Math.round(((X - GUTTER) / (this.width - GUTTER - INSET)) * this.episode.last)));
  }

  X(t) { return GUTTER + (t / Math.max(1, this.episode.last)) * (this.width - GUTTER - INSET); }

  Y(value) {
    const u = this.log ? Math.log(Math.max(value, this.low) / this.low) / Math.log(this.high / this.low) : value / this.high;
    return this.height - 5 - u * (this.height - 12);
  }

  /** Draw all but the cursor. */
  paint(ink) {
    const dots = window.devicePixelRatio || 1;
    this.ink = ink;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    for (const canvas of [this.canvas, this.back]) {
      canvas.width = Math.round(this.width * dots);
      canvas.height = Math.round(this.height * dots);
      canvas.getContext("2d").setTransform(dots, 0, 0, dots, 0, 0);
    }
    const ctx = this.back.getContext("2d");
    this.range();
    if (this.bands) this.paintBands(ctx);
    else this.paintLines(ctx);
  }

  range() {
    let high = 0, low = Infinity;
    for (const { values, before } of this.series)
      for (const list of before ? [values, before] : [values])
        for (const value of list) {
          if (value > high) high = value;
          if (value > 0 && value < low) low = value;
        }
    this.high = (this.log ? 1.1 : 1.05) * (high || 1);
    this.low = Math.max(low, this.high / 1e5);
  }

  ticks() {
    if (!this.log) return [niceStep(this.high / 2.01), 2 * niceStep(this.high / 2.01)].filter((value) => value < this.high);
    const ticks = [];
    const lowest = Math.ceil(Math.log10(this.low)), highest = Math.floor(Math.log10(this.high));
    const every = Math.ceil((highest - lowest + 1) / 3);
    for (let power = highest; power >= lowest; power -= every) ticks.push(10 ** power);
    return ticks;
  }

  paintLines(ctx) {
    ctx.font = this.ink.small;
    ctx.lineWidth = 1;
    ctx.textBaseline = "middle";
    for (const value of [...this.ticks(), ...(this.log ? [] : [0])]) {
      const Y = Math.round(this.Y(value)) + 0.5;
      ctx.strokeStyle = value === 0 ? this.ink.gates : this.ink.grid;
      stroke(ctx, GUTTER, Y, this.width - INSET, Y);
      ctx.fillStyle = this.ink.faint;
      ctx.textAlign = "right";
      if (value && Y > 6) ctx.fillText(this.unit ? metres(value, value) : String(+value.toPrecision(3)), GUTTER - 6, Y);
      ctx.textAlign = "left";
    }
    this.series.forEach((one, i) => this.paintSeries(ctx, one, i));
  }

  paintSeries(ctx, { values, before, colour, lost }, i) {
    ctx.strokeStyle = ctx.fillStyle = this.ink[colour];
    ctx.lineWidth = 1;
    ctx.globalAlpha = 0.45;
    if (before) this.paintLine(ctx, before);
    ctx.lineWidth = 1.5;
    ctx.globalAlpha = 1;
    this.paintLine(ctx, values);
    if (lost >= 0 && this.scales) this.paintLost(ctx, lost, i);
  }

  paintLine(ctx, values) {
    ctx.beginPath();
    let down = false;
    for (let t = 0; t < values.length; t++) {
      const there = Number.isFinite(values[t]);
      if (there && down) ctx.lineTo(this.X(t), this.Y(values[t]));
      else if (there) ctx.moveTo(this.X(t), this.Y(values[t]));
      down = there;
    }
    ctx.stroke();
  }

  paintLost(ctx, lost, i) {
    const X = Math.round(this.X(lost)) + 0.5, right = X > this.width - 60;
    ctx.lineWidth = 1;
    ctx.setLineDash([3, 3]);
    stroke(ctx, X, 0, X, this.height);
    ctx.setLineDash([]);
    ctx.textAlign = right ? "right" : "left";
    ctx.fillText("lost", X + (right ? -4 : 4), 13 + 11 * (i % 3));
    ctx.textAlign = "left";
  }

  /** Probabilities stacked to one. */
  paintBands(ctx) {
    const r = this.bands.length / this.episode.scans, base = new Float32Array(this.episode.scans);
    this.high = 1;
    for (let k = 0; k < r; k++) {
      ctx.fillStyle = this.ink.band(k);
      if (this.bandValues[k]) this.bandValues[k].firstChild.style.background = ctx.fillStyle;
      ctx.beginPath();
      for (let t = 0; t < base.length; t++) ctx.lineTo(this.X(t), this.Y(base[t]));
      for (let t = 0; t < base.length; t++) base[t] += this.bands[t * r + k] || 0;
      for (let t = base.length - 1; t >= 0; t--) ctx.lineTo(this.X(t), this.Y(base[t]));
      ctx.fill();
    }
  }

  /** Copy the chart, with the cursor at scan t. */
  draw(t) {
    const ctx = this.canvas.getContext("2d");
    this.shown = t;
    ctx.clearRect(0, 0, this.width, this.height);
    if (!this.width) return; // hidden
    ctx.drawImage(this.back, 0, 0, this.width, this.height);
    ctx.fillStyle = this.ink.ink;
    ctx.fillRect(Math.round(this.X(t)), 0, 1, this.height);
    for (const { values, colour } of this.series) {
      if (!Number.isFinite(values[t])) continue;
      ctx.fillStyle = this.ink[colour];
      ctx.beginPath();
      ctx.arc(this.X(t), this.Y(values[t]), 3, 0, 2 * Math.PI);
      ctx.fill();
    }
  }

  /** Say the numbers of scan t. */
  say(t) {
    this.series.forEach(({ values, before }, i) => {
      this.values[i].lastChild.textContent = this.integers ? countInWords(values[t], before && before[t]) : figures(values[t], this.unit);
    });
    if (!this.bands) return;
    const r = this.bands.length / this.episode.scans, now = this.bands.slice(t * r, (t + 1) * r);
    this.bandValues.forEach((node, k) => { node.lastChild.textContent = figures(now[k]); });
    const best = now.indexOf(Math.max(...now));
    if (!this.bandValues.length) this.said.textContent = best < 0 ? "none" : `${modeName(this.episode, best)} ${figures(now[best])}`;
  }
}

const GUTTER = 46, INSET = 8; // px left and right of a strip's scans; the style sheet has them too

const modeName = ({ modes }, k) => modes[k] || `model ${k + 1}`;
const countInWords = (kept, before) => (before ? `${kept} of ${before}` : String(kept));

/** Ratio of the greatest value of a chart to one that a quarter of them do not reach. */
function spread(series) {
  const values = series.flatMap(({ values }) => [...values]).filter((value) => value > 0).sort((a, b) => a - b);
  return values.length ? values[values.length - 1] / values[values.length >> 2] : 1;
}

function listenToScrub(canvas, scrub) {
  const to = (event) => scrub(event.clientX - canvas.getBoundingClientRect().left);
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    to(event);
  });
  canvas.addEventListener("pointermove", (event) => canvas.hasPointerCapture(event.pointerId) && to(event));
}
