// A chart over all scans: painted once, then copied under its cursor.

const GUTTER = 46, INSET = 8; // px left and right of the scans; the style sheet has them too
const LOG_FROM = 40; // spread of lengths from which their scale is logarithmic at first

/** What lines and bands have in common: a head with names and numbers, and a canvas to scrub on. */
class Strip {
  constructor(title, episode, scrub, ...head) {
    this.episode = episode;
    this.back = document.createElement("canvas");
    this.canvas = make("canvas", { role: "img", "aria-label": `${title} over the scans` });
    this.node = make(
      "div", { class: "gmr-strip" },
      make("div", { class: "gmr-strip-head" }, make("strong", {}, title), ...head), this.canvas,
    );
    listenToScrub(this.canvas, (X) => scrub(this.scanAt(X)));
  }

  scanAt(X) {
    const u = (X - GUTTER) / (this.width - GUTTER - INSET);
    return Math.round(Math.max(0, Math.min(1, u)) * this.episode.last);
  }

  X(t) {
    return GUTTER + (t / Math.max(1, this.episode.last)) * (this.width - GUTTER - INSET);
  }

  /** Height of a share of the scale. */
  Y(u) {
    return this.height - 5 - u * (this.height - 12);
  }

  /** Draw all but the cursor. */
  paint(ink) {
    this.ink = ink;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    for (const canvas of [this.canvas, this.back]) sizeTo(canvas, this.width, this.height);
    this.paintChart(this.back.getContext("2d"));
  }

  /** Copy the chart, with the cursor at scan t. */
  draw(t) {
    const ctx = this.canvas.getContext("2d");
    this.shown = t;
    if (!this.width) return; // hidden
    ctx.clearRect(0, 0, this.width, this.height);
    ctx.drawImage(this.back, 0, 0, this.width, this.height);
    ctx.fillStyle = this.ink.ink;
    ctx.fillRect(Math.round(this.X(t)), 0, 1, this.height);
    this.drawMarks(ctx, t);
  }

  drawMarks() {}
}

/** A name beside its colour, and a number to come. */
function legend(name, colour) {
  const swatch = make("i", { class: "gmr-swatch" });
  if (colour) swatch.style.background = `var(--gmr-${colour})`;
  return make("span", {}, swatch, name ? `${name} ` : "", make("b"));
}

function listenToScrub(canvas, scrub) {
  const to = (event) => scrub(event.clientX - canvas.getBoundingClientRect().left);
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    to(event);
  });
  canvas.addEventListener("pointermove", (event) => canvas.hasPointerCapture(event.pointerId) && to(event));
}

/** Lines of one quantity, of every tracker. */
class LineStrip extends Strip {
  constructor({ title, unit, series }, episode, scrub) {
    const values = series.map(({ name, colour }) => legend(name, colour));
    const scale = unit ? button("toggle", "Logarithmic scale", () => this.turnLog(), "log") : "";
    super(title, episode, scrub, ...values, scale);
    Object.assign(this, { unit, series, values, scale });
    this.setLog(Boolean(unit) && spread(series) > LOG_FROM);
  }

  setLog(log) {
    this.log = log;
    if (this.scale) this.scale.setAttribute("aria-pressed", log);
  }

  turnLog() {
    this.setLog(!this.log);
    this.paint(this.ink);
    this.draw(this.shown);
  }

  height01(value) {
    if (!this.log) return value / this.high;
    return Math.log(Math.max(value, this.low) / this.low) / Math.log(this.high / this.low);
  }

  paintChart(ctx) {
    this.range();
    ctx.font = this.ink.small;
    ctx.textBaseline = "middle";
    for (const value of this.ticks()) this.paintTick(ctx, value);
    this.series.forEach((one, i) => this.paintSeries(ctx, one, i));
  }

  range() {
    let high = 0, low = Infinity;
    for (const { values, before } of this.series)
      for (const list of before ? [values, before] : [values])
        for (const value of list) {
          if (value > high) high = value;
          if (value > 0 && value < low) low = value;
        }
    this.high = 1.05 * (high || 1);
    this.low = Math.max(Math.min(low, this.high / 2), this.high / 1e5);
  }

  ticks() {
    if (!this.log) {
      const step = Math.max(niceStep(this.high / 3.2), this.unit ? 0 : 1);
      return [0, 1, 2, 3].map((k) => k * step).filter((value) => value < this.high);
    }
    const lowest = Math.ceil(Math.log10(this.low)), highest = Math.floor(Math.log10(this.high));
    const every = Math.max(1, Math.ceil((highest - lowest + 1) / 3)), ticks = [];
    for (let power = highest; power >= lowest; power -= every) ticks.push(10 ** power);
    return ticks;
  }

  paintTick(ctx, value) {
    const Y = Math.round(this.Y(this.height01(value))) + 0.5;
    ctx.lineWidth = 1;
    ctx.strokeStyle = value === 0 ? this.ink.gates : this.ink.grid;
    stroke(ctx, GUTTER, Y, this.width - INSET, Y);
    if (value === 0 || Y < 6) return;
    ctx.fillStyle = this.ink.faint;
    ctx.textAlign = "right";
    ctx.fillText(this.label(value), GUTTER - 6, Y);
  }

  label(value) {
    return this.unit ? metres(value, value) : String(value);
  }

  paintSeries(ctx, { values, before, colour, lost }, i) {
    ctx.strokeStyle = ctx.fillStyle = this.ink[colour];
    ctx.lineWidth = 1;
    ctx.globalAlpha = 0.45;
    if (before) this.paintLine(ctx, before);
    ctx.lineWidth = 1.5;
    ctx.globalAlpha = 1;
    this.paintLine(ctx, values);
    if (lost >= 0 && this.unit) this.paintLost(ctx, lost, i);
  }

  paintLine(ctx, values) {
    let down = false;
    ctx.beginPath();
    for (let t = 0; t < values.length; t++) {
      const there = Number.isFinite(values[t]);
      if (there && down) ctx.lineTo(this.X(t), this.Y(this.height01(values[t])));
      else if (there) ctx.moveTo(this.X(t), this.Y(this.height01(values[t])));
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
    ctx.fillText("lost", X + (right ? -4 : 4), this.height - 12 - 11 * (i % 4));
  }

  drawMarks(ctx, t) {
    for (const { values, colour } of this.series) {
      if (!Number.isFinite(values[t])) continue;
      ctx.fillStyle = this.ink[colour];
      ctx.beginPath();
      ctx.arc(this.X(t), this.Y(this.height01(values[t])), 3, 0, 2 * Math.PI);
      ctx.fill();
    }
  }

  /** Say the numbers of scan t. */
  say(t) {
    this.series.forEach(({ values, before }, i) => {
      const whole = Number.isInteger(values[t]) && !this.unit;
      const now = whole ? String(values[t]) : figures(values[t], this.unit);
      this.values[i].lastChild.textContent = before ? `${now} of ${before[t]}` : now;
    });
  }
}

const MOST_NAMED = 5; // motion models named one by one

/** Probabilities of a tracker's motion models, stacked to one. */
class BandStrip extends Strip {
  constructor(tracker, episode, scrub) {
    const r = tracker.mode_p.length / episode.scans;
    const names = Array.from({ length: r }, (_, k) => modeName(episode, k));
    const values = r <= MOST_NAMED ? names.map((name) => legend(name)) : [legend("most probable:")];
    super("Motion models", episode, scrub, episode.trackers.length > 1 ? tracker.name : "", ...values);
    Object.assign(this, { r, names, values, p: tracker.mode_p });
  }

  paintChart(ctx) {
    const base = new Float32Array(this.episode.scans);
    for (let k = 0; k < this.r; k++) {
      ctx.fillStyle = this.ink.band(k);
      ctx.beginPath();
      for (let t = 0; t < base.length; t++) ctx.lineTo(this.X(t), this.Y(base[t]));
      for (let t = 0; t < base.length; t++) base[t] += this.p[t * this.r + k] || 0;
      for (let t = base.length - 1; t >= 0; t--) ctx.lineTo(this.X(t), this.Y(base[t]));
      ctx.fill();
      if (this.r <= MOST_NAMED) this.values[k].firstChild.style.background = ctx.fillStyle;
    }
  }

  /** Say the probabilities of scan t. */
  say(t) {
    const now = Array.from(this.p.subarray(t * this.r, (t + 1) * this.r));
    const best = now.indexOf(Math.max(...now));
    this.values.forEach((node, k) => {
      const one = figures(now[k]), most = `${this.names[best]} ${figures(now[best])}`;
      node.lastChild.textContent = this.r <= MOST_NAMED ? one : most;
    });
    if (this.r > MOST_NAMED) this.values[0].firstChild.style.background = this.ink.band(best);
  }
}
