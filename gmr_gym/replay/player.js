/* The player of a recorded episode: panels of trackers side by side, and strips of numbers below them.

   GmrPlayer.start(element, data) fills `element`; `data` is what the page holds as JSON. In it metres are
   metres, covariances are xx, xy, yy, and rows of ragged columns are found by NAME_start. Scans count from 0
   here and from 1 on the screen. */
var GmrPlayer = (function () {
  "use strict";

  const SIGMAS = 2; // of the ellipses of hypotheses and estimates
  const SLOW = 2; // scans a second up to which the reduction is animated
  const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 40];
  const WIDEST = 4; // how far the view widens to keep target and estimate in it
  const HIT = 10; // px within which a click finds a point
  // the parts of a scan's transition, each up to its share of the scan's time
  const STAGES = [
    { name: "predict", until: 0.22 },
    { name: "update", until: 0.5 },
    { name: "prune", until: 0.64 },
    { name: "merge", until: 0.88 },
    { name: "kept", until: 1 },
  ];

  // ------------------------------------------------------------------------------------------ columns

  const TYPES = {
    u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array,
    u4: Uint32Array, i4: Int32Array, f4: Float32Array,
  };

  /** The columns of the data by name, each decoded when first asked for; null for one that is not there. */
  async function unpack(data) {
    const packed = Uint8Array.from(atob(data.blob), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const raw = await new Response(stream).arrayBuffer();
    const done = new Map();
    return function column(name) {
      const entry = data.columns[name];
      if (!entry) return null;
      if (entry.same) return column(entry.same);
      if (!done.has(name)) done.set(name, decoded(entry, raw));
      return done.get(name);
    };
  }

  function decoded({ dtype, shape, at, low = 0, step = 1, nan = false }, raw) {
    const Kind = TYPES[dtype];
    const count = shape.reduce((product, side) => product * side, 1);
    const stored = new Kind(raw.slice(at, at + count * Kind.BYTES_PER_ELEMENT));
    if (dtype === "f4") return stored;
    const integers = step === 1 && Number.isInteger(low) && !nan;
    const values = integers ? new Int32Array(count) : new Float32Array(count);
    const missing = nan ? 256 ** Kind.BYTES_PER_ELEMENT - 1 : NaN;
    for (let i = 0; i < count; i++) values[i] = stored[i] === missing ? NaN : low + step * stored[i];
    return values;
  }

  // ---------------------------------------------------------------------------------------- recording

  /** What the panels draw: the columns under names of their own, and what follows from them. */
  function recording(data, column) {
    const trackers = data.trackers.map(({ name }, i) => trackerOf(data, (key) => column(`${i}/${key}`), name));
    const truth = column("truth");
    return {
      ...data, truth, trackers,
      last: data.scans - 1,
      targets: truth.length / data.scans / 2,
      many: data.kind === "many",
      traced: trackers.some((tracker) => tracker.full),
      clutter: cloud(column, "clutter"),
    };
  }

  /** A ragged set of weighted ellipses; null where there is none. */
  function cloud(column, name) {
    const start = column(`${name}_start`);
    return start && { start, w: column(`${name}_w`), m: column(name), P: column(`${name}_P`) };
  }

  function trackerOf(data, column, name) {
    const tracker = {
      name, column,
      z: cloud(column, "z"),
      origin: column("origin"),
      kept: cloud(column, "kept"),
      full: fullOf(column),
      lost: (column("lost_at") || [-1])[0],
    };
    for (const key of ["target", "estimate", "estimate_P", "error", "count", "alive", "mode_p"])
      tracker[key] = column(key);
    for (const key of ["expected", "gospa", "present"]) tracker[key] = column(key);
    const gate = column("gate_start");
    tracker.gates = gate && { start: gate, m: column("gate"), P: column("gate_shape") };
    tracker.guess = cloud(column, "guess");
    tracker.declared = cloud(column, "declared");
    if (tracker.declared) {
      tracker.existence = column("existence");
      tracker.label = column("label");
      tracker.tracks = tracksOf(tracker, data.scans);
    }
    return tracker;
  }

  function fullOf(column) {
    const full = cloud(column, "full");
    if (!full) return null;
    for (const key of ["parent", "detection", "into", "mode"]) full[key] = column(`full_${key}`);
    // of negligible weight: counted, not kept
    full.restPruned = column("full_rest_count");
    full.restMerged = column("full_rest_merged");
    return full;
  }

  /** Positions of every declared label, scan by scan. */
  function tracksOf({ declared, label }, scans) {
    const tracks = new Map();
    for (let t = 0; t < scans; t++)
      for (let i = declared.start[t]; i < declared.start[t + 1]; i++) {
        if (label[i] < 0) continue;
        if (!tracks.has(label[i])) tracks.set(label[i], { label: label[i], scans: [], rows: [] });
        tracks.get(label[i]).scans.push(t);
        tracks.get(label[i]).rows.push(i);
      }
    return [...tracks.values()];
  }

  const size = (set, t) => set.start[t + 1] - set.start[t];

  /** Numbers of hypotheses of scan t: before the reduction, pruned, merged, kept. */
  function counts(tracker, t) {
    const { full, kept } = tracker;
    const left = size(kept, t);
    if (!full) return { kept: left };
    let pruned = full.restPruned ? full.restPruned[t] : 0;
    const all = size(full, t) + pruned + (full.restMerged ? full.restMerged[t] : 0);
    for (let i = full.start[t]; i < full.start[t + 1]; i++) pruned += full.into[i] < 0;
    return { all, pruned, merged: all - pruned, kept: left };
  }

  // --------------------------------------------------------------------------------------------- words

  const plural = (n, word, many = word.replace(/is$/, "es")) =>
    `${n} ${n === 1 ? word : many === word ? `${word}s` : many}`;

  function reductionInWords({ all, pruned, merged, kept }) {
    if (all === undefined || all === kept) return plural(kept, "hypothesis");
    const parts = [merged > kept ? `${merged} merged into ${kept}` : `${kept} kept`];
    if (pruned) parts.unshift(`${pruned} pruned`);
    return `${plural(all, "hypothesis")}: ${parts.join(", ")}`;
  }

  function stageInWords(tracker, t, stage) {
    const now = counts(tracker, t);
    const gates = tracker.gates ? size(tracker.gates, t) : 0;
    if (stage === "predict")
      return `Predicted: ${plural(gates, "gate")}, ${plural(size(tracker.z, t), "detection")}`;
    if (stage === "update")
      return `${plural(now.all, "hypothesis")}: each one missed, and with each detection in its gate`;
    if (stage === "prune") return `${plural(now.all, "hypothesis")}: ${now.pruned || "none"} pruned for low weight`;
    return reductionInWords(now);
  }

  function figures(value, unit = "") {
    if (!Number.isFinite(value)) return "none";
    const digits = Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2;
    return value.toFixed(digits) + unit;
  }

  const share = (w) => (w >= 0.0995 ? w.toFixed(2) : w >= 0.001 ? w.toFixed(3) : w.toExponential(0));

  // ------------------------------------------------------------------------------------------ geometry

  /** How far `phase` has gone from `from` to `to`, in [0, 1], slow at both ends. */
  function during(phase, from, to) {
    const u = Math.min(1, Math.max(0, (phase - from) / (to - from)));
    return u * u * (3 - 2 * u);
  }

  const mix = (a, b, u) => a + (b - a) * u;

  /** The step of 1, 2 or 5 times a power of ten that is next above `least`. */
  function niceStep(least) {
    const power = 10 ** Math.floor(Math.log10(least));
    return power * ([1, 2, 5].find((factor) => factor * power >= least) || 10);
  }

  /** Smallest box about the finite points of flat arrays x0, y0, x1, ... */
  function boundsOf(...lists) {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const points of lists)
      for (let i = 0; i + 1 < points.length; i += 2) {
        if (!Number.isFinite(points[i])) continue;
        box[0] = Math.min(box[0], points[i]);
        box[1] = Math.min(box[1], points[i + 1]);
        box[2] = Math.max(box[2], points[i]);
        box[3] = Math.max(box[3], points[i + 1]);
      }
    return box;
  }

  /** The canvas of a panel, with metres on it: y upwards, lines as thick at every scale. */
  class Plane {
    constructor(canvas) {
      this.canvas = canvas;
      this.ctx = canvas.getContext("2d");
    }

    resize() {
      const dots = window.devicePixelRatio || 1;
      this.width = this.canvas.clientWidth;
      this.height = this.canvas.clientHeight;
      this.canvas.width = Math.round(this.width * dots);
      this.canvas.height = Math.round(this.height * dots);
      this.ctx.setTransform(dots, 0, 0, dots, 0, 0);
    }

    look(x, y, scale) {
      this.scale = scale;
      this.left = this.width / 2 - x * scale;
      this.top = this.height / 2 + y * scale;
    }

    X(x) { return this.left + x * this.scale; }
    Y(y) { return this.top - y * this.scale; }
    x(X) { return (X - this.left) / this.scale; }
    y(Y) { return (this.top - Y) / this.scale; }

    /** Begin the path of (z - m)' P^-1 (z - m) = k^2; false where none of it is in view. */
    ellipse(x, y, xx, xy, yy, k) {
      const middle = (xx + yy) / 2, half = (xx - yy) / 2;
      const root = Math.sqrt(half * half + xy * xy);
      const a = Math.max(k * this.scale * Math.sqrt(middle + root), 1.5);
      const X = this.X(x), Y = this.Y(y);
      if (!(X + a > 0 && X - a < this.width && Y + a > 0 && Y - a < this.height)) return false;
      const b = Math.max(k * this.scale * Math.sqrt(Math.max(middle - root, 0)), 1.5);
      this.ctx.beginPath();
      this.ctx.ellipse(X, Y, a, b, -Math.atan2(xy, half) / 2, 0, 2 * Math.PI);
      return true;
    }

    dot(x, y, radius) {
      this.ctx.beginPath();
      this.ctx.arc(this.X(x), this.Y(y), radius, 0, 2 * Math.PI);
    }

    cross(x, y, arm) {
      const X = this.X(x), Y = this.Y(y), ctx = this.ctx;
      ctx.beginPath();
      ctx.moveTo(X - arm, Y - arm);
      ctx.lineTo(X + arm, Y + arm);
      ctx.moveTo(X - arm, Y + arm);
      ctx.lineTo(X + arm, Y - arm);
    }

    line(x0, y0, x1, y1) {
      this.ctx.beginPath();
      this.ctx.moveTo(this.X(x0), this.Y(y0));
      this.ctx.lineTo(this.X(x1), this.Y(y1));
    }

    /** Path through rows first, first + stride, ... of flat points up to row `last`; missing ones break it. */
    path(points, last, first = 0, stride = 1) {
      let down = false;
      this.ctx.beginPath();
      for (let i = first; i <= last; i += stride) {
        const x = points[2 * i];
        if (Number.isNaN(x)) down = false;
        else if (down) this.ctx.lineTo(this.X(x), this.Y(points[2 * i + 1]));
        else this.ctx.moveTo(this.X(x), this.Y(points[2 * i + 1]));
        down = !Number.isNaN(x);
      }
    }
  }

  // -------------------------------------------------------------------------------------------- camera

  /** Where all panels look: a scale they share, and a centre that is free, or goes with the target, with each
      tracker's own estimate, or with both. What changes at once is shown gliding: `slip` is the way left. */
  class Camera {
    constructor(episode) {
      this.episode = episode;
      this.scale = this.side = 1;
      this.x = this.y = 0;
      this.slip = { x: 0, y: 0, zoom: 0 };
      this.mode = "free";
    }

    /** Centre and scale for a tracker's panel into `out`, at scan t with the share `u` of the way from the last. */
    look(out, tracker, t, u) {
      const before = Math.max(t - 1, 0);
      const scale = this.mode === "both" ? mix(this.wide(before), this.wide(t), u) : this.scale;
      out.x = this.mode === "free" ? this.x : mix(this.at(tracker, before, 0, scale), this.at(tracker, t, 0, scale), u);
      out.y = this.mode === "free" ? this.y : mix(this.at(tracker, before, 1, scale), this.at(tracker, t, 1, scale), u);
      out.scale = scale * Math.exp(this.slip.zoom);
      out.x += this.slip.x;
      out.y += this.slip.y;
    }

    /** Coordinate `axis` of what is followed at scan t. */
    at(tracker, t, axis, scale) {
      const { truth } = this.episode, { estimate } = tracker;
      const target = truth[2 * seenUntil(truth, t) + axis], own = estimate[2 * seenUntil(estimate, t) + axis];
      if (this.mode === "target" || !Number.isFinite(own)) return target;
      if (this.mode === "estimate") return own;
      const far = distance(truth, estimate, t);
      return target + (own - target) * Math.min(0.5, (0.36 * this.side) / scale / Math.max(far, 1e-9));
    }

    /** The scale at which target and estimates are in view, within a limit. */
    wide(t) {
      let far = 1e-9;
      for (const { estimate } of this.episode.trackers) far = Math.max(far, distance(this.episode.truth, estimate, t) || 0);
      return Math.max(this.scale / WIDEST, Math.min(this.scale, (0.64 * this.side) / far));
    }

    /** Glide to what `change` makes of the view, from where it is now. */
    glide(change, tracker, t, calm) {
      const old = {}, now = {};
      this.look(old, tracker, t, 1);
      change();
      this.slip.x = this.slip.y = this.slip.zoom = 0;
      if (calm) return;
      this.look(now, tracker, t, 1);
      this.slip.x = old.x - now.x;
      this.slip.y = old.y - now.y;
      this.slip.zoom = Math.log(old.scale / now.scale);
    }

    /** Let the slip die away over `seconds`; false once it is gone. */
    settle(seconds) {
      const slip = this.slip, left = Math.exp(-seconds / 0.09);
      slip.x *= left;
      slip.y *= left;
      slip.zoom *= left;
      if ((Math.abs(slip.x) + Math.abs(slip.y)) * this.scale + 300 * Math.abs(slip.zoom) > 0.5) return true;
      slip.x = slip.y = slip.zoom = 0;
      return false;
    }

    fit(box, width, height) {
      const across = Math.max(box[2] - box[0], 1e-6), up = Math.max(box[3] - box[1], 1e-6);
      this.mode = "free";
      this.scale = 0.86 * Math.min(width / across, height / up);
      this.x = (box[0] + box[2]) / 2;
      this.y = (box[1] + box[3]) / 2;
    }
  }

  const distance = (a, b, t) => Math.hypot(a[2 * t] - b[2 * t], a[2 * t + 1] - b[2 * t + 1]);

  /** Latest row up to t with a value; t where there is none. */
  function seenUntil(points, t) {
    for (let i = t; i >= 0; i--) if (Number.isFinite(points[2 * i])) return i;
    return t;
  }

  // ------------------------------------------------------------------------------- drawing: the ground

  /** Lines of metres, or range rings and bearings of a radar, with labels at the edges. */
  function drawGround(plane, ink, radar) {
    const { ctx } = plane;
    ctx.globalAlpha = 1;
    ctx.lineWidth = 1;
    ctx.strokeStyle = ink.grid;
    ctx.fillStyle = ink.faint;
    ctx.font = ink.small;
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    if (radar) drawRings(plane, ink);
    else drawGrid(plane);
  }

  const metres = (value, step) =>
    value === 0 ? "0" : step >= 1000 ? `${+(value / 1000).toFixed(3)} km` : `${+value.toFixed(Math.max(0, -Math.floor(Math.log10(step))))} m`;

  function drawGrid(plane) {
    const { ctx, width, height } = plane;
    const step = niceStep(90 / plane.scale);
    for (let i = Math.ceil(plane.x(0) / step); i * step < plane.x(width); i++) {
      const X = Math.round(plane.X(i * step)) + 0.5;
      stroke(ctx, X, 0, X, height);
      if (X > 44 && X < width - 44) ctx.fillText(metres(i * step, step), X + 3, height - 2);
    }
    for (let i = Math.ceil(plane.y(height) / step); i * step < plane.y(0); i++) {
      const Y = Math.round(plane.Y(i * step)) + 0.5;
      stroke(ctx, 0, Y, width, Y);
      if (Y > 20 && Y < height - 20) ctx.fillText(metres(i * step, step), 4, Y - 2);
    }
  }

  function stroke(ctx, X0, Y0, X1, Y1) {
    ctx.beginPath();
    ctx.moveTo(X0, Y0);
    ctx.lineTo(X1, Y1);
    ctx.stroke();
  }

  const RADIANS = Math.PI / 180;

  /** The part of the radar's range and bearing in view, cut into rings and rays: exact at any zoom. */
  function drawRings(plane, ink) {
    const { ctx } = plane;
    const box = polarBox(plane);
    const step = niceStep(90 / plane.scale);
    for (let i = Math.max(1, Math.ceil(box.near / step)); i * step <= box.far; i++) {
      arc(plane, i * step, box.from, box.to);
      labelRing(plane, i * step, box);
    }
    const turn = box.near ? niceAngle(90 / plane.scale / box.far / RADIANS) : 30;
    for (let i = Math.ceil(box.from / RADIANS / turn); i * turn * RADIANS < box.to; i++) {
      const angle = i * turn * RADIANS, x = Math.cos(angle), y = Math.sin(angle);
      plane.line(box.near * x, box.near * y, box.far * x, box.far * y);
      ctx.stroke();
      labelRay(plane, angle, `${+(i * turn).toFixed(3)}°`);
    }
    ctx.fillStyle = ink.ink;
    plane.dot(0, 0, 4);
    ctx.fill();
    if (box.near === 0) ctx.fillText("radar", plane.X(0) + 7, plane.Y(0) + 4);
  }

  const niceAngle = (least) => [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45].find((step) => step >= least) || 90;

  /** Ranges and bearings (radians) between which all that is in view lies. */
  function polarBox(plane) {
    const { width, height } = plane;
    const X = plane.X(0), Y = plane.Y(0);
    let far = 0, from = Infinity, to = -Infinity;
    const centre = Math.atan2(plane.y(height / 2), plane.x(width / 2));
    for (const [cornerX, cornerY] of [[0, 0], [width, 0], [0, height], [width, height]]) {
      const x = plane.x(cornerX), y = plane.y(cornerY);
      far = Math.max(far, Math.hypot(x, y));
      const off = Math.atan2(Math.sin(Math.atan2(y, x) - centre), Math.cos(Math.atan2(y, x) - centre));
      from = Math.min(from, centre + off);
      to = Math.max(to, centre + off);
    }
    const outX = Math.max(-X, X - width, 0), outY = Math.max(-Y, Y - height, 0);
    const near = Math.hypot(outX, outY) / plane.scale;
    return near > 0 ? { near, far, from, to, middle: centre } : { near, far, from: -Math.PI, to: Math.PI, middle: 0.6 };
  }

  function arc(plane, radius, from, to) {
    plane.ctx.beginPath();
    for (let i = 0; i <= 96; i++) {
      const angle = mix(from, to, i / 96);
      plane.ctx.lineTo(plane.X(radius * Math.cos(angle)), plane.Y(radius * Math.sin(angle)));
    }
    plane.ctx.stroke();
  }

  const inView = ({ width, height }, X, Y) => X > 4 && X < width - 44 && Y > 40 && Y < height - 6;

  /** A ring's range beside it, off the middle of the view where it can be. */
  function labelRing(plane, radius, { from, to }) {
    for (const part of [0.25, 0.75, 0.35, 0.65, 0.5]) {
      const angle = mix(from, to, part);
      const X = plane.X(radius * Math.cos(angle)), Y = plane.Y(radius * Math.sin(angle));
      if (inView(plane, X, Y)) return plane.ctx.fillText(metres(radius, radius), X + 4, Y);
    }
  }

  /** A bearing where its ray leaves the view. */
  function labelRay(plane, angle, text) {
    const { width, height } = plane, X = plane.X(0), Y = plane.Y(0);
    const dX = Math.cos(angle), dY = -Math.sin(angle);
    const far = Math.min(((dX > 0 ? width - 34 : 6) - X) / dX, ((dY > 0 ? height - 4 : 18) - Y) / dY);
    if (far > 0) plane.ctx.fillText(text, X + far * dX + 3, Y + far * dY);
  }

  const OVERVIEW = 84; // px, the longer side of the small map of the whole path

  /** The whole path in a corner, with what is in view framed, where that is a small part of it. */
  function drawOverview({ plane, ink, episode, tracker }, { t, truth }) {
    const [left, low, right, high] = episode.box, { ctx, width } = plane;
    const scale = OVERVIEW / Math.max(right - left, high - low, 1e-9);
    if (plane.scale < 3 * Math.min(width / (right - left), plane.height / (high - low)) / 2 || plane.height < 260) return;
    const X = width - 12 - (right - left) * scale, Y = 12;
    const look = { left: plane.left, top: plane.top, scale: plane.scale };
    Object.assign(plane, { left: X - left * scale, top: Y + high * scale, scale });
    ctx.globalAlpha = 0.85;
    ctx.fillStyle = ink.paper;
    ctx.fillRect(X - 8, Y - 8, (right - left) * scale + 16, (high - low) * scale + 16);
    ctx.globalAlpha = 1;
    ctx.lineWidth = 1;
    ctx.strokeStyle = ink.gates;
    ctx.strokeRect(X - 8, Y - 8, (right - left) * scale + 16, (high - low) * scale + 16);
    ctx.strokeStyle = truth ? ink.truth : ink.estimate;
    plane.path(truth ? episode.truth : tracker.estimate, truth ? episode.last : t);
    ctx.globalAlpha = 0.35;
    ctx.stroke();
    ctx.globalAlpha = 1;
    plane.path(truth ? episode.truth : tracker.estimate, t);
    ctx.stroke();
    ctx.strokeStyle = ink.ink;
    ctx.strokeRect(plane.X(-look.left / look.scale), plane.Y(look.top / look.scale), (width / look.scale) * scale, (plane.height / look.scale) * scale);
    Object.assign(plane, look);
  }

  // ---------------------------------------------------------------------------- drawing: one target

  const faintest = 0.08;
  const opacity = (w, most) => Math.max(faintest, Math.min(1, Math.sqrt(w / most)));

  function heaviest(set, t) {
    let most = 1e-300;
    for (let i = set.start[t]; i < set.start[t + 1]; i++) most = Math.max(most, set.w[i]);
    return most;
  }

  /** One scan of a tracker of one target, at `phase` of its transition (1: after the reduction). */
  function drawScan(panel, show) {
    const { t, phase } = show;
    const whole = phase >= 1 || !panel.tracker.full;
    drawGates(panel, t, whole ? 1 : during(phase, 0, 0.16));
    drawEstimatePath(panel, whole ? t : t - 1);
    drawDetections(panel, show, whole ? 1 : during(phase, 0.1, 0.2));
    if (whole) drawKept(panel, t, 1);
    else drawTransition(panel, show);
    if (show.truth) drawTruth(panel, t, whole ? 1 : during(phase, 0, 0.22));
    drawEstimate(panel, t, whole ? 1 : during(phase, 0.86, 1));
    drawChosen(panel, show, whole);
  }

  function drawGates({ plane, ink, tracker }, t, alpha) {
    const { gates } = tracker, { ctx } = plane;
    if (!gates) return;
    ctx.strokeStyle = ink.gates;
    ctx.lineWidth = 1;
    ctx.globalAlpha = alpha * Math.min(1, 3.2 / Math.sqrt(size(gates, t))); // many of them stay in the background
    for (let i = gates.start[t]; i < gates.start[t + 1]; i++)
      if (ellipseOf(plane, gates, i, 1)) ctx.stroke();
  }

  const ellipseOf = (plane, { m, P }, i, k) =>
    plane.ellipse(m[2 * i], m[2 * i + 1], P[3 * i], P[3 * i + 1], P[3 * i + 2], k);

  function drawTruth({ plane, ink, episode }, t, u) {
    const { ctx } = plane, { truth } = episode;
    ctx.strokeStyle = ctx.fillStyle = ink.truth;
    ctx.globalAlpha = 0.9;
    ctx.lineWidth = 1.6;
    plane.path(truth, u < 1 ? t - 1 : t);
    const before = Math.max(t - 1, 0);
    const x = mix(truth[2 * before], truth[2 * t], u), y = mix(truth[2 * before + 1], truth[2 * t + 1], u);
    if (Number.isFinite(x)) ctx.lineTo(plane.X(x), plane.Y(y));
    ctx.stroke();
    ctx.globalAlpha = 1;
    plane.dot(x, y, 3.5);
    if (Number.isFinite(x)) ctx.fill();
  }

  function drawDetections({ plane, ink, tracker }, show, alpha) {
    const { ctx } = plane, { z, target, origin } = tracker, from = z.start[show.t];
    ctx.fillStyle = ink.detections;
    ctx.globalAlpha = alpha;
    for (let i = from; i < z.start[show.t + 1]; i++) {
      plane.dot(z.m[2 * i], z.m[2 * i + 1], 2.4);
      ctx.fill();
    }
    if (!show.origin) return;
    ctx.strokeStyle = ink.truth;
    ctx.lineWidth = 1.4;
    for (let i = from; i < z.start[show.t + 1]; i++) {
      if (target ? i - from !== target[show.t] : origin[i] < 0) continue;
      plane.dot(z.m[2 * i], z.m[2 * i + 1], 5.5);
      ctx.stroke();
    }
  }

  /** The mixture after the reduction: the few of its hypotheses filled, so that weight is seen as colour. */
  function drawKept({ plane, ink, tracker }, t, alpha) {
    const { kept } = tracker, { ctx } = plane;
    const most = tracker.declared ? 1 : heaviest(kept, t), filled = size(kept, t) <= 60;
    ctx.strokeStyle = ctx.fillStyle = ink.hypotheses;
    ctx.lineWidth = 1.4;
    for (let i = kept.start[t]; i < kept.start[t + 1]; i++) {
      if (!ellipseOf(plane, kept, i, SIGMAS)) continue;
      const strength = alpha * opacity(kept.w[i], most);
      ctx.globalAlpha = strength;
      ctx.stroke();
      if (!filled) continue;
      ctx.globalAlpha = 0.14 * strength;
      ctx.fill();
    }
  }

  /** From the mixture of the scan before to that of this one: every hypothesis leaves the gate of its parent,
      the pruned ones fade, and the others move into the component that they are merged into. */
  function drawTransition(panel, show) {
    const { t, phase } = show;
    const born = during(phase, 0.22, 0.42), gone = during(phase, 0.52, 0.64);
    const moved = during(phase, 0.66, 0.86), settled = during(phase, 0.84, 0.94);
    if (born < 1 && t > 0) drawPredicted(panel, t, during(phase, 0, 0.2), 1 - born);
    if (born > 0 && settled < 1) {
      if (show.lines) drawLines(panel, t, born * (1 - moved));
      drawFull(panel, t, born, during(phase, 0.46, 0.54), gone, moved, 1 - settled);
    }
    if (settled > 0) drawKept(panel, t, settled);
  }

  /** The kept mixture of scan t - 1 on its way to the gates, where there is one gate for each. */
  function drawPredicted({ plane, ink, tracker }, t, u, alpha) {
    const { kept, gates } = tracker, { ctx } = plane, n = size(kept, t - 1);
    const follows = gates && size(gates, t) === n;
    const most = heaviest(kept, t - 1);
    ctx.strokeStyle = ink.hypotheses;
    ctx.lineWidth = 1.4;
    for (let k = 0; k < n; k++) {
      const i = kept.start[t - 1] + k, to = follows ? gates.start[t] + k : 0;
      const x = follows ? mix(kept.m[2 * i], gates.m[2 * to], u) : kept.m[2 * i];
      const y = follows ? mix(kept.m[2 * i + 1], gates.m[2 * to + 1], u) : kept.m[2 * i + 1];
      ctx.globalAlpha = alpha * opacity(kept.w[i], most);
      if (plane.ellipse(x, y, kept.P[3 * i], kept.P[3 * i + 1], kept.P[3 * i + 2], SIGMAS)) ctx.stroke();
    }
  }

  function drawFull({ plane, ink, tracker }, t, born, marked, gone, moved, alpha) {
    const { full, kept } = tracker, { ctx } = plane, most = heaviest(full, t);
    ctx.lineWidth = 1.2;
    for (let i = full.start[t]; i < full.start[t + 1]; i++) {
      const pruned = full.into[i] < 0;
      const strength = opacity(full.w[i], most);
      ctx.strokeStyle = pruned && marked > 0 ? ink.dropped : ink.hypotheses;
      // what is pruned weighs little: it is drawn stronger while it goes, so that it is seen to go
      ctx.globalAlpha = alpha * born * (pruned ? mix(strength, Math.max(strength, 0.45), marked) * (1 - gone) : strength);
      if (ctx.globalAlpha < 0.004) continue;
      if (traceFull(plane, full, kept, t, i, born, pruned ? 0 : moved, originOf(tracker, t, i, 0), originOf(tracker, t, i, 1)))
        ctx.stroke();
    }
  }

  function traceFull(plane, { m, P, into }, kept, t, i, born, moved, x0, y0) {
    const x = mix(x0, m[2 * i], born), y = mix(y0, m[2 * i + 1], born);
    if (moved === 0) return plane.ellipse(x, y, P[3 * i], P[3 * i + 1], P[3 * i + 2], SIGMAS);
    const j = kept.start[t] + into[i];
    return plane.ellipse(
      mix(x, kept.m[2 * j], moved), mix(y, kept.m[2 * j + 1], moved), mix(P[3 * i], kept.P[3 * j], moved),
      mix(P[3 * i + 1], kept.P[3 * j + 1], moved), mix(P[3 * i + 2], kept.P[3 * j + 2], moved), SIGMAS,
    );
  }

  /** Row of the gate of a hypothesis' parent; -1 where gates are not one for each parent. */
  function gateOf({ full, gates, kept }, t, i) {
    const parents = t > 0 ? size(kept, t - 1) : 1;
    return gates && size(gates, t) === parents ? gates.start[t] + full.parent[i] : -1;
  }

  /** Coordinate `axis` of the place that a hypothesis comes from: its parent's gate, else its parent. */
  function originOf(tracker, t, i, axis) {
    const { full, gates, kept } = tracker, gate = gateOf(tracker, t, i);
    if (gate >= 0) return gates.m[2 * gate + axis];
    return t > 0 ? kept.m[2 * (kept.start[t - 1] + full.parent[i]) + axis] : full.m[2 * i + axis];
  }

  /** From each hypothesis back to its parent before the scan. */
  function drawLines({ plane, ink, tracker }, t, alpha) {
    const { full, kept } = tracker, { ctx } = plane, most = heaviest(full, t);
    if (t === 0) return;
    ctx.strokeStyle = ink.hypotheses;
    ctx.lineWidth = 0.8;
    for (let i = full.start[t]; i < full.start[t + 1]; i++) {
      const from = kept.start[t - 1] + full.parent[i];
      ctx.globalAlpha = 0.6 * alpha * opacity(full.w[i], most);
      plane.line(kept.m[2 * from], kept.m[2 * from + 1], full.m[2 * i], full.m[2 * i + 1]);
      ctx.stroke();
    }
  }

  function drawEstimatePath({ plane, ink, tracker }, t) {
    const { ctx } = plane;
    ctx.strokeStyle = ink.estimate;
    ctx.globalAlpha = 0.85;
    ctx.lineWidth = 1.4;
    plane.path(tracker.estimate, t);
    ctx.stroke();
  }

  function drawEstimate({ plane, ink, tracker }, t, alpha) {
    const { estimate, estimate_P: P } = tracker, { ctx } = plane;
    const x = estimate[2 * t], y = estimate[2 * t + 1];
    if (!Number.isFinite(x)) return;
    ctx.strokeStyle = ink.estimate;
    ctx.globalAlpha = alpha;
    ctx.lineWidth = 1.6;
    if (P && plane.ellipse(x, y, P[3 * t], P[3 * t + 1], P[3 * t + 2], SIGMAS)) ctx.stroke();
    ctx.lineWidth = 2;
    plane.cross(x, y, 4);
    ctx.stroke();
    pointTo(plane, x, y, `estimate, ${metres(tracker.error[t], niceStep(tracker.error[t] / 20))} off`, ink.estimate);
  }

  /** A mark at the edge that points to what lies out of view. */
  function pointTo(plane, x, y, text, colour) {
    const { ctx, width, height } = plane, margin = 14;
    const X = plane.X(x), Y = plane.Y(y);
    if (X >= 0 && X <= width && Y >= 0 && Y <= height) return;
    const dX = X - width / 2, dY = Y - height / 2;
    const u = Math.min((width / 2 - margin) / Math.abs(dX), (height / 2 - margin) / Math.abs(dY));
    const atX = width / 2 + u * dX, atY = height / 2 + u * dY, angle = Math.atan2(dY, dX);
    ctx.globalAlpha = 1;
    ctx.fillStyle = colour;
    ctx.beginPath();
    for (const turn of [0, 2.5, -2.5])
      ctx.lineTo(atX + 8 * Math.cos(angle + turn), atY + 8 * Math.sin(angle + turn));
    ctx.fill();
    ctx.textAlign = dX > 0 ? "right" : "left";
    ctx.fillText(text, atX - 14 * Math.sign(dX), atY + (dY > 0 ? -8 : 12));
    ctx.textAlign = "left";
  }

  // --------------------------------------------------------------------------- drawing: many targets

  /** One scan of a tracker of many targets. */
  function drawManyScan(panel, show) {
    const { episode, tracker, plane, ink } = panel, { t } = show;
    drawClutter(plane, episode.clutter, t, ink.detections, []);
    drawClutter(plane, tracker.guess, t, ink.ink, [2, 4]);
    drawDetections(panel, show, 1);
    drawKept(panel, t, 1);
    if (show.truth) drawTruths(panel, t);
    drawTracks(panel, t);
    drawDeclared(panel, t);
    drawChosen(panel, show, true);
  }

  function drawClutter(plane, set, t, colour, dashes) {
    if (!set) return;
    const { ctx } = plane;
    ctx.strokeStyle = colour;
    ctx.globalAlpha = 0.8;
    ctx.lineWidth = 1;
    ctx.setLineDash(dashes);
    for (let i = set.start[t]; i < set.start[t + 1]; i++) if (ellipseOf(plane, set, i, 1)) ctx.stroke();
    ctx.setLineDash([]);
  }

  /** True paths so far: a ring where each appears, a cross where it disappears. */
  function drawTruths({ plane, ink, episode }, t) {
    const { ctx } = plane, { truth, targets } = episode;
    ctx.strokeStyle = ctx.fillStyle = ink.truth;
    for (let k = 0; k < targets; k++) {
      ctx.globalAlpha = 0.9;
      ctx.lineWidth = 1.6;
      plane.path(truth, t * targets + k, k, targets);
      ctx.stroke();
      const [first, last] = episode.lives[k];
      if (first < 0 || first > t) continue;
      mark(plane, truth, first * targets + k, "ring");
      if (last < t) mark(plane, truth, last * targets + k, "cross");
      else if (Number.isFinite(truth[2 * (t * targets + k)])) mark(plane, truth, t * targets + k, "dot");
    }
  }

  function mark(plane, points, i, kind) {
    const x = points[2 * i], y = points[2 * i + 1];
    if (kind === "cross") plane.cross(x, y, 4);
    else plane.dot(x, y, kind === "dot" ? 3.2 : 5);
    if (kind === "dot") plane.ctx.fill();
    else plane.ctx.stroke();
  }

  /** First and last scan of every true target; -1 for one that never is. */
  function livesOf(truth, targets, scans) {
    const lives = Array.from({ length: targets }, () => [-1, -1]);
    for (let t = 0; t < scans; t++)
      for (let k = 0; k < targets; k++) {
        if (!Number.isFinite(truth[2 * (t * targets + k)])) continue;
        if (lives[k][0] < 0) lives[k][0] = t;
        lives[k][1] = t;
      }
    return lives;
  }

  const AFTERGLOW = 12; // scans that a track stays in sight after its end

  function drawTracks({ plane, ink, tracker }, t) {
    const { ctx } = plane, { m } = tracker.declared;
    for (const { label, scans, rows } of tracker.tracks) {
      const end = scans[scans.length - 1], age = t - end;
      if (scans[0] > t || age > AFTERGLOW) continue;
      ctx.strokeStyle = ink.label(label);
      ctx.lineWidth = 1.6;
      ctx.globalAlpha = age > 0 ? 0.8 * (1 - age / AFTERGLOW) : 0.8;
      ctx.beginPath();
      for (let k = 0; k < rows.length && scans[k] <= t; k++) {
        const X = plane.X(m[2 * rows[k]]), Y = plane.Y(m[2 * rows[k] + 1]);
        if (k && scans[k] === scans[k - 1] + 1) ctx.lineTo(X, Y);
        else ctx.moveTo(X, Y);
      }
      ctx.stroke();
      mark(plane, m, rows[0], "ring");
      if (age > 0) mark(plane, m, rows[rows.length - 1], "cross");
    }
  }

  /** Declared targets, existence as opacity, each with its label beside it. */
  function drawDeclared({ plane, ink, tracker }, t) {
    const { declared, existence, label } = tracker, { ctx } = plane;
    ctx.font = ink.text;
    ctx.textBaseline = "middle";
    ctx.lineWidth = 2;
    for (let i = declared.start[t]; i < declared.start[t + 1]; i++) {
      ctx.strokeStyle = ctx.fillStyle = label[i] < 0 ? ink.estimate : ink.label(label[i]);
      ctx.globalAlpha = existence ? Math.max(0.25, Math.min(1, existence[i])) : 1;
      if (declared.P && ellipseOf(plane, declared, i, SIGMAS)) ctx.stroke();
      plane.cross(declared.m[2 * i], declared.m[2 * i + 1], 5);
      ctx.stroke();
      if (label[i] >= 0)
        ctx.fillText(String(label[i]), plane.X(declared.m[2 * i]) + 9, plane.Y(declared.m[2 * i + 1]) - 9);
    }
  }

  /** Colour of a label, the same in every panel and every page: hues a golden angle apart. */
  function labelColour(label, dark) {
    const hue = (Math.imul(label + 1, 2654435761) >>> 0) / 2 ** 32 * 360;
    return `hsl(${hue.toFixed(0)} ${dark ? "70% 68%" : "75% 38%"})`;
  }

  // --------------------------------------------------------------------------------------- selection

  /** What lies under a click, as { kind, i }: a detection, or the nearest hypothesis drawn; null for neither. */
  function hit(panel, show, X, Y) {
    const { plane, tracker } = panel, { t, phase } = show;
    const detection = nearest(plane, tracker.z, t, X, Y, HIT);
    if (detection >= 0) return { kind: "detection", i: detection };
    const before = tracker.full && phase < 0.76;
    const i = innermost(plane, before ? tracker.full : tracker.kept, t, X, Y);
    return i < 0 ? null : { kind: before ? "full" : "kept", i };
  }

  function nearest(plane, { start, m }, t, X, Y, least) {
    let found = -1;
    for (let i = start[t]; i < start[t + 1]; i++) {
      const far = Math.hypot(plane.X(m[2 * i]) - X, plane.Y(m[2 * i + 1]) - Y);
      if (far < least) [least, found] = [far, i];
    }
    return found;
  }

  /** The hypothesis whose ellipse holds the point most centrally; else the nearest one. */
  function innermost(plane, set, t, X, Y) {
    let found = -1, least = SIGMAS * SIGMAS;
    for (let i = set.start[t]; i < set.start[t + 1]; i++) {
      const dx = plane.x(X) - set.m[2 * i], dy = plane.y(Y) - set.m[2 * i + 1];
      const xx = set.P[3 * i], xy = set.P[3 * i + 1], yy = set.P[3 * i + 2];
      const d2 = (dx * dx * yy - 2 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy);
      if (d2 < least) [least, found] = [d2, i];
    }
    return found < 0 ? nearest(plane, set, t, X, Y, 1.5 * HIT) : found;
  }

  /** Rows of the full posterior that went into row i of the kept mixture, heaviest first. */
  function membersOf({ full, kept }, t, i) {
    const rows = [];
    for (let k = full.start[t]; k < full.start[t + 1]; k++) if (full.into[k] === i - kept.start[t]) rows.push(k);
    return rows.sort((a, b) => full.w[b] - full.w[a]);
  }

  /** Rows of the full posterior (of the kept mixture where there is none) that a selection is about. */
  function rowsOf(tracker, { t, kind, i }) {
    const { full, z } = tracker;
    if (!full) return [];
    if (kind === "kept") return membersOf(tracker, t, i);
    if (kind === "full") return [i];
    const rows = [];
    for (let k = full.start[t]; k < full.start[t + 1]; k++) if (full.detection[k] === i - z.start[t]) rows.push(k);
    return rows.sort((a, b) => full.w[b] - full.w[a]);
  }

  /** Points of the heaviest line of descent of row i of the mixture kept at scan t, the latest first. */
  function ancestry(tracker, t, i) {
    const points = [];
    for (; t >= 0; t--) {
      points.push(tracker.kept.m[2 * i], tracker.kept.m[2 * i + 1]);
      const [heaviestMember] = t > 0 ? membersOf(tracker, t, i) : [];
      if (heaviestMember === undefined) break;
      i = tracker.kept.start[t - 1] + tracker.full.parent[heaviestMember];
    }
    return points;
  }

  /** Rows that a selection needs while it is drawn, found once. */
  function selection(panel, t, { kind, i }) {
    const { tracker } = panel;
    const chosen = { panel, t, kind, i, line: [] };
    chosen.rows = rowsOf(tracker, chosen);
    if (tracker.full && kind === "kept") chosen.line = ancestry(tracker, t, i);
    return chosen;
  }

  function drawChosen(panel, show, whole) {
    const { chosen } = show;
    if (!chosen || chosen.panel !== panel || chosen.t !== show.t) return;
    const { plane, ink, tracker } = panel, { ctx } = plane;
    ctx.strokeStyle = ink.ink;
    ctx.lineWidth = 0.9;
    ctx.globalAlpha = 0.55;
    drawRows(panel, chosen);
    if (whole && chosen.line.length) {
      plane.path(chosen.line, chosen.line.length / 2 - 1);
      ctx.stroke();
    }
    ctx.globalAlpha = 1;
    ctx.lineWidth = 2.2;
    const set = { detection: tracker.z, kept: tracker.kept, full: tracker.full }[chosen.kind];
    if (chosen.kind === "detection") plane.dot(set.m[2 * chosen.i], set.m[2 * chosen.i + 1], 7);
    else if (!ellipseOf(plane, set, chosen.i, SIGMAS)) return;
    ctx.stroke();
  }

  /** The hypotheses of a selection, and what joins them to their detections. */
  function drawRows({ plane, tracker }, { t, rows, kind }) {
    const { full, z } = tracker, { ctx } = plane;
    for (const row of rows) {
      if (kind !== "full" && ellipseOf(plane, full, row, SIGMAS)) ctx.stroke();
      if (full.detection[row] < 0) continue;
      const seen = z.start[t] + full.detection[row];
      plane.line(full.m[2 * row], full.m[2 * row + 1], z.m[2 * seen], z.m[2 * seen + 1]);
      ctx.stroke();
    }
  }

  // ------------------------------------------------------------------------------ selection in words

  /** Nodes that say what is selected; `go(t, i)` shows row i of the mixture kept at scan t. */
  function describe(episode, chosen, go) {
    return { kept: describeKept, full: describeFull, detection: describeDetection }[chosen.kind](episode, chosen, go);
  }

  const associationName = (detection) => (detection < 0 ? "missed" : `detection ${detection + 1}`);

  function describeKept(episode, { panel, t, i, rows }, go) {
    const { tracker } = panel, { kept, full } = tracker;
    const nodes = [
      heading(`Hypothesis ${i - kept.start[t] + 1} of ${size(kept, t)}`, `${tracker.name}, scan ${t + 1}`),
      line(`${tracker.declared ? "Expected number" : "Weight"} ${share(kept.w[i])}`),
    ];
    if (!full) return nodes;
    nodes[1].append(rows.length > 1 ? `, merged from ${rows.length} hypotheses` : ", not merged");
    nodes.push(bars("Associations", sums(rows, full.w, (row) => associationName(full.detection[row]))));
    if (t > 0) nodes.push(parentLine(tracker, t, rows, go));
    if (episode.modes.length > 1)
      nodes.push(bars("Motion models", sums(rows, full.w, (row) => modeName(episode, full.mode[row]))));
    return nodes;
  }

  function describeFull(episode, { panel, t, i }, go) {
    const { tracker } = panel, { full } = tracker, into = full.into[i];
    const nodes = [
      heading(`Hypothesis ${i - full.start[t] + 1} of ${counts(tracker, t).all}`, `before the reduction of scan ${t + 1}`),
      line(`Weight ${share(full.w[i])}, ${associationName(full.detection[i])}`),
    ];
    if (episode.modes.length > 1) nodes.push(line(`Motion model: ${modeName(episode, full.mode[i])}`));
    if (t > 0) nodes.push(parentLine(tracker, t, [i], go));
    const kept = tracker.kept.start[t] + into;
    nodes.push(into < 0 ? line("Pruned") : line("Went into ", link(`hypothesis ${into + 1}`, () => go(t, kept))));
    return nodes;
  }

  function describeDetection(episode, { panel, t, i, rows }, go) {
    const { tracker } = panel, { full, kept, z } = tracker;
    const nodes = [heading(`Detection ${i - z.start[t] + 1} of ${size(z, t)}`, `${tracker.name}, scan ${t + 1}`)];
    if (!full) return nodes;
    const sum = rows.reduce((total, row) => total + full.w[row], 0);
    nodes.push(
      line(rows.length ? `Used by ${plural(rows.length, "hypothesis")}, summed weight ${share(sum)}` : "In no gate, or of no weight"),
    );
    if (!rows.length) return nodes;
    const into = (row) => (full.into[row] < 0 ? "pruned" : `into hypothesis ${full.into[row] + 1}`);
    nodes.push(bars("Where they went", sums(rows, full.w, into)));
    const heavy = rows.find((row) => full.into[row] >= 0);
    if (heavy !== undefined)
      nodes.push(line(link("show the heaviest", () => go(t, kept.start[t] + full.into[heavy]))));
    return nodes;
  }

  function parentLine({ full, kept }, t, rows, go) {
    const parents = new Set(rows.map((row) => full.parent[row]));
    if (!rows.length) return line("");
    const first = full.parent[rows[0]];
    const node = line("Parent: ", link(`hypothesis ${first + 1} of scan ${t}`, () => go(t - 1, kept.start[t - 1] + first)));
    if (parents.size > 1) node.append(`, and ${parents.size - 1} more`);
    return node;
  }

  /** [name, share of the summed weight] of the rows by what `name` calls them, largest first. */
  function sums(rows, w, name) {
    const found = new Map();
    let total = 0;
    for (const row of rows) {
      found.set(name(row), (found.get(name(row)) || 0) + w[row]);
      total += w[row];
    }
    return [...found].map(([key, value]) => [key, value / total]).sort((a, b) => b[1] - a[1]);
  }

  // -------------------------------------------------------------------------------------- page pieces

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
    if (rows.length > MOST_BARS) list.append(make("li", {}, make("span", {}, `and ${rows.length - MOST_BARS} more`)));
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

  const button = (name, text, onclick, ...children) =>
    make("button", { type: "button", "aria-label": text, title: text, onclick, class: `gmr-${name}` }, ...children);

  function choice(text, options, value, onchange) {
    const select = make("select", { "aria-label": text, title: text, onchange: () => onchange(select.value) });
    for (const [key, name] of options) select.append(make("option", { value: key }, name));
    select.value = value;
    return select;
  }

  // ------------------------------------------------------------------------------------------- strips

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

  // ------------------------------------------------------------------------------------------- panels

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
        make("div", { class: "gmr-stage" }, this.canvas, make("div", { class: "gmr-over" }, this.banner, this.note)),
      );
      this.where = { x: 0, y: 0, scale: 1 };
    }

    draw(show, camera, ink) {
      const { plane, where } = this;
      this.ink = ink;
      camera.look(where, this.tracker, show.t, show.way);
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
      this.canvas.setAttribute("aria-label", `${tracker.name}, scan ${t + 1}: ${words}. ${this.banner.textContent} ${this.note.textContent}`);
    }

    notes(t) {
      const { alive, estimate } = this.tracker;
      if (alive && !alive[t]) return "given up: the tracker only predicts";
      if (estimate && !Number.isFinite(estimate[2 * t])) return "no estimate at this scan";
      return "";
    }

    declaredInWords(t) {
      const { declared, kept, expected } = this.tracker;
      return `${plural(size(declared, t), "target")} declared, ${figures(expected[t])} expected; ${plural(size(kept, t), "component")}`;
    }
  }

  // ------------------------------------------------------------------------------------------- player

  const KEYS = [
    ["space", "play or pause"], ["← →", "scan back, forward"], [", .", "stage back, forward within a scan"],
    ["home end", "first, last scan"], ["+ −", "zoom"], ["f", "fit the view"], ["t", "true path"], ["o", "ring the target's own detection"], ["m", "animate the merges"],
    ["l", "lines to the parents"], ["esc", "end a selection"], ["?", "this help"],
  ];

  /** Wires one recording to one element. */
  class Player {
    constructor(root, episode) {
      Object.assign(this, { root, episode });
      this.calm = window.matchMedia("(prefers-reduced-motion: reduce)");
      this.dark = window.matchMedia("(prefers-color-scheme: dark)");
      this.show = { t: 0, phase: 1, way: 1, truth: true, origin: false, lines: false, merges: episode.traced, chosen: null };
      this.speed = episode.traced ? 0.5 : 5;
      this.playing = false;
      this.camera = new Camera(episode);
      this.panels = episode.trackers.map((tracker, i) => new Panel(episode, tracker, i));
      this.strips = chartsOf(episode).map((chart) => new Strip(chart, episode, (t) => this.go(t)));
      this.tick = this.tick.bind(this);
      this.build();
      this.panels.forEach((panel) => this.listen(panel));
      this.dark.addEventListener("change", () => this.dye());
      document.addEventListener("keydown", (event) => this.key(event));
      new ResizeObserver(() => this.resize()).observe(root);
      this.resize();
      this.look(episode.many ? "whole" : "both", true);
    }

    // -- page

    build() {
      const { episode, root } = this;
      root.classList.add("gmr");
      root.tabIndex = -1; // a click gives it the keys
      const panels = make("div", { class: "gmr-panels", "data-count": this.panels.length }, ...this.panels.map((panel) => panel.node));
      this.time = this.slider();
      this.aside = make("div", { class: "gmr-chosen", "aria-live": "polite" });
      this.charts = make("div", { class: "gmr-strips" }, this.time, ...this.strips.map((strip) => strip.node));
      root.replaceChildren(
        this.header(), panels, this.transport(),
        make("div", { class: "gmr-below" }, this.charts, make("aside", {}, this.aside, keyOf(episode))),
        this.help(),
      );
    }

    header() {
      const { title, environment, seed } = this.episode;
      const about = title && environment && title.includes(environment) ? "" : `${environment}, seed ${seed}`;
      return make(
        "header", {}, make("div", {}, make("h2", {}, title || environment || ""), make("span", {}, about)),
        button("plain", "Light or dark", () => this.theme(), icon("theme")),
        button("plain", "Keys and help", () => this.toggleHelp(), "?"),
      );
    }

    slider() {
      const slide = make("input", {
        type: "range", min: 1, max: this.episode.scans, step: 1, value: 1, class: "gmr-time", "aria-label": "Scan",
        oninput: () => this.go(Number(slide.value) - 1),
      });
      return slide;
    }

    transport() {
      this.playButton = button("play", "Play", () => this.toggle(), icon("play"));
      this.clock = make("span", { class: "gmr-clock" });
      const speeds = SPEEDS.map((speed) => [speed, `${speed} scan${speed === 1 ? "" : "s"}/s`]);
      this.bar = make(
        "div", { class: "gmr-bar" }, button("step", "Scan back", () => this.go(this.show.t - 1), icon("back")), this.playButton,
        button("step", "Scan forward", () => this.go(this.show.t + 1), icon("forward")), this.clock,
        choice("Speed", speeds, this.speed, (value) => { this.speed = Number(value); }),
      );
      return make(
        "div", { class: "gmr-transport", role: "group", "aria-label": "Playback and view" }, this.bar,
        ...(this.episode.traced ? [this.stages()] : []),
        this.toggles(), this.viewControls(),
      );
    }

    stages() {
      this.stage = make("input", {
        type: "range", min: 0, max: 1000, value: 1000, "aria-label": "Stage within the scan",
        oninput: () => this.stand(Number(this.stage.value) / 1000),
      });
      this.stageNames = STAGES.map(({ name, until }, i) => {
        const node = make("span", {}, name);
        node.style.flexGrow = Math.round(1000 * (until - (i ? STAGES[i - 1].until : 0)));
        return node;
      });
      return make("div", { class: "gmr-stages" }, this.stage, make("div", { "aria-hidden": "true" }, ...this.stageNames));
    }

    toggles() {
      const traced = this.episode.traced;
      this.switches = {};
      const titles = {
        truth: "The true path", origin: "Ring the target's own detection",
        ...(traced && { merges: "Animate the reduction", lines: "Lines to the parents" }),
      };
      const nodes = Object.entries(titles).map(([key, title]) => {
        this.switches[key] = button("toggle", title, () => this.turn(key), key);
        this.switches[key].setAttribute("aria-pressed", this.show[key]);
        return this.switches[key];
      });
      return make("div", {}, ...nodes);
    }

    viewControls() {
      const { many, radar } = this.episode;
      const views = [
        ...(many ? [] : [["both", "follow both"], ["target", "follow target"], ["estimate", "follow estimate"]]),
        ["whole", many ? "whole area" : "whole path"], ["scan", "this scan"],
        ...(radar ? [["radar", "from the radar"]] : []), ["free", "free view"],
      ];
      this.views = choice("View", views, "whole", (value) => this.look(value));
      return make(
        "div", {}, this.views, button("toggle", "Fit the view", () => this.look("whole"), "fit"), button("plain", "Zoom out", () => this.zoom(1 / 1.4), icon("minus")),
        button("plain", "Zoom in", () => this.zoom(1.4), icon("plus")),
      );
    }

    help() {
      const rows = KEYS.map(([key, what]) => make("div", {}, make("kbd", {}, key), what));
      this.helpNode = make(
        "div", { class: "gmr-help", hidden: "", role: "dialog", "aria-label": "Keys and help" },
        make("h3", {}, "Keys"), ...rows,
        make("p", {}, "Drag to move, wheel or two fingers to zoom, drag on a chart to go through the scans. Click a hypothesis or a detection to see where it came from."),
        button("close", "Close the help", () => this.toggleHelp(), "close"),
      );
      return this.helpNode;
    }

    toggleHelp() { this.helpNode.hidden = !this.helpNode.hidden; }

    theme() {
      const dark = (this.root.dataset.theme || (this.dark.matches ? "dark" : "light")) === "dark";
      this.root.dataset.theme = dark ? "light" : "dark";
      this.dye();
    }

    /** Read the colours of the style sheet. */
    dye() {
      const style = getComputedStyle(this.root);
      const colour = (name) => style.getPropertyValue(`--gmr-${name}`).trim();
      const names = ["ink", "faint", "grid", "detections", "truth", "estimate", "hypotheses", "gates", "dropped", "paper"];
      const ink = Object.fromEntries(names.map((name) => [name, colour(name)]));
      for (let i = 0; i < 4; i++) ink[`tracker${i}`] = colour(`tracker${i}`);
      const dark = colour("scheme") === "dark", labels = new Map();
      ink.label = (label) => {
        if (!labels.has(label)) labels.set(label, labelColour(label, dark));
        return labels.get(label);
      };
      ink.band = (k) => `hsl(${(212 + 137.5 * k) % 360} 34% ${dark ? 46 : 70}%)`;
      ink.small = `11px ${style.fontFamily}`;
      ink.text = `12px ${style.fontFamily}`;
      this.ink = ink;
      this.strips.forEach((strip) => strip.paint(ink));
      this.wake();
    }

    resize() {
      const { plane } = this.panels[0];
      // on a phone the slider stays in sight with the buttons; else it lies over the charts
      const bar = this.root.clientWidth < 760 ? this.bar : this.charts;
      if (this.time.parentNode !== bar) bar.prepend(this.time);
      this.panels.forEach(({ plane: each }) => each.resize());
      this.camera.side = Math.min(plane.width, plane.height);
      this.dye();
    }

    // -- view

    look(mode, atOnce = false) {
      const { camera, show, panels, episode } = this, { plane, tracker } = panels[0];
      const z = tracker.z, now = z.m.subarray(2 * z.start[show.t], 2 * z.start[show.t + 1]);
      const boxes = {
        whole: () => (episode.many ? boundsOf(episode.truth, z.m) : boundsOf(episode.truth)),
        scan: () => boundsOf(now, episode.truth.subarray(2 * show.t * episode.targets, 2 * (show.t + 1) * episode.targets)),
        radar: () => boundsOf(episode.truth, [0, 0]),
      };
      const change = () => {
        if (boxes[mode]) return camera.fit(boxes[mode](), plane.width, plane.height);
        if (mode !== "free" && camera.mode === "free") camera.scale = closeScale(tracker, plane);
        if (mode === "free") this.stay(panels[0]);
        camera.mode = mode;
      };
      if (atOnce) camera.scale = closeScale(tracker, plane);
      camera.glide(change, tracker, show.t, atOnce || this.calm.matches);
      this.views.value = mode;
      this.wake();
    }

    zoom(factor, panel = this.panels[0], X = panel.plane.width / 2, Y = panel.plane.height / 2) {
      const { camera } = this, { plane } = panel;
      camera.slip.x = camera.slip.y = camera.slip.zoom = 0;
      const scale = Math.min(1e4, Math.max(1e-5, camera.scale * factor));
      if (camera.mode === "free") {
        camera.x += (X - plane.width / 2) * (1 / camera.scale - 1 / scale);
        camera.y -= (Y - plane.height / 2) * (1 / camera.scale - 1 / scale);
      }
      camera.scale = scale;
      this.wake();
    }

    pan(panel, dX, dY) {
      const { camera } = this;
      if (camera.mode !== "free") this.stay(panel);
      camera.x -= dX / camera.scale;
      camera.y += dY / camera.scale;
      this.views.value = "free";
      this.wake();
    }

    /** From here on look where this panel looks. */
    stay({ where }) {
      Object.assign(this.camera, { mode: "free", ...where });
    }

    /** Drag moves, two fingers and the wheel zoom, a click selects. */
    listen(panel) {
      const { canvas } = panel, fingers = new Map();
      let moved = 0;
      const at = (event) => {
        const box = canvas.getBoundingClientRect();
        return [event.clientX - box.left, event.clientY - box.top];
      };
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        if (fingers.size === 0) moved = 0;
        fingers.set(event.pointerId, at(event));
      });
      canvas.addEventListener("pointermove", (event) => {
        if (!fingers.has(event.pointerId)) return;
        const before = [...fingers.values()], old = fingers.get(event.pointerId), now = at(event);
        fingers.set(event.pointerId, now);
        moved += Math.hypot(now[0] - old[0], now[1] - old[1]);
        if (fingers.size === 2) this.pinch(panel, before, [...fingers.values()]);
        else if (moved > 4) this.pan(panel, now[0] - old[0], now[1] - old[1]);
      });
      const up = (event) => {
        if (fingers.delete(event.pointerId) && event.type === "pointerup" && moved <= 4) this.pick(panel, ...at(event));
      };
      canvas.addEventListener("pointerup", up);
      canvas.addEventListener("pointercancel", up);
      canvas.addEventListener("wheel", (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-Math.max(-60, Math.min(60, event.deltaY)) / 250), panel, ...at(event));
      }, { passive: false });
    }

    pinch(panel, [a, b], [c, d]) {
      const gap = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]);
      const X = (c[0] + d[0]) / 2, Y = (c[1] + d[1]) / 2;
      this.pan(panel, X - (a[0] + b[0]) / 2, Y - (a[1] + b[1]) / 2);
      this.zoom(gap(c, d) / Math.max(gap(a, b), 1), panel, X, Y);
    }

    // -- selection

    pick(panel, X, Y) {
      const found = hit(panel, this.show, X, Y);
      this.choose(found && selection(panel, this.show.t, found));
    }

    choose(chosen) {
      this.show.chosen = chosen;
      const go = (t, i) => {
        this.go(t);
        this.choose(selection(chosen.panel, t, { kind: "kept", i }));
      };
      this.aside.replaceChildren(...(chosen ? describe(this.episode, chosen, go) : []));
      this.wake();
    }

    // -- time

    /** Show scan t after its reduction. */
    go(t) {
      this.pause();
      const to = Math.max(0, Math.min(this.episode.last, t));
      Object.assign(this.show, { t: to, phase: 1, way: 1 });
      this.left();
      this.wake();
    }

    /** Show this scan at a phase of its transition. */
    stand(phase) {
      this.pause();
      this.show.phase = phase;
      this.show.way = during(phase, 0, STAGES[0].until);
      this.wake();
    }

    stageStep(by) {
      const { t, phase } = this.show;
      const now = STAGES.findIndex(({ until }) => phase <= until + 1e-9) + by;
      if (!this.episode.traced) return this.go(t + by);
      if (now >= STAGES.length && t < this.episode.last) {
        this.go(t + 1);
        return this.stand(STAGES[0].until);
      }
      if (now < 0) return this.go(t - 1);
      this.stand(STAGES[Math.min(now, STAGES.length - 1)].until);
    }

    /** What is selected belongs to a scan, and ends with it. */
    left() {
      if (this.show.chosen && this.show.chosen.t !== this.show.t) this.choose(null);
    }

    toggle() {
      if (this.playing) return this.pause();
      if (this.show.t === this.episode.last && this.show.phase >= 1) this.show.t = -1;
      this.playing = true;
      this.before = 0;
      if (this.show.phase >= 1 && this.show.t < this.episode.last) this.advance(1);
      this.playIcon();
      this.wake();
    }

    pause() {
      if (!this.playing) return;
      this.playing = false;
      if (!this.animated()) this.show.way = 1;
      this.playIcon();
    }

    playIcon() {
      this.playButton.replaceChildren(icon(this.playing ? "pause" : "play"));
      this.playButton.setAttribute("aria-label", this.playing ? "Pause" : "Play");
      this.playButton.title = this.playing ? "Pause" : "Play";
    }

    animated() {
      return this.show.merges && this.episode.traced && this.speed <= SLOW && !this.calm.matches;
    }

    /** Go on by `scans`: through the phases where they are animated, else from scan to scan. */
    advance(scans) {
      const { show, episode } = this;
      const animated = this.animated();
      let u = (animated ? show.phase : show.way) + scans;
      while (u >= 1 && show.t < episode.last) {
        show.t += 1;
        u -= 1;
      }
      if (u >= 1) this.pause();
      u = Math.min(u, 1);
      show.phase = animated ? u : 1;
      show.way = this.calm.matches ? 1 : animated ? during(u, 0, STAGES[0].until) : u;
      this.left();
    }

    /** Ask for one frame; a frame asks for the next only while something moves. */
    wake() {
      if (this.asked) return;
      this.asked = true;
      requestAnimationFrame(this.tick);
    }

    tick(now) {
      this.asked = false;
      const seconds = this.before ? Math.min(0.1, (now - this.before) / 1000) : 1 / 60;
      if (this.playing) this.advance(seconds * this.speed);
      const gliding = this.camera.settle(seconds);
      this.before = this.playing || gliding ? now : 0;
      this.draw();
      if (this.playing || gliding) this.wake();
    }

    draw() {
      const { show } = this;
      for (const panel of this.panels) panel.draw(show, this.camera, this.ink);
      for (const strip of this.strips) strip.draw(show.t);
      if (this.stage) this.stage.value = 1000 * show.phase;
      const stage = STAGES.findIndex(({ until }) => show.phase <= until + 1e-9);
      if (stage !== this.saidStage || show.t !== this.saidScan) this.say(show.t, stage);
    }

    say(t, stage) {
      const { period, scans } = this.episode;
      this.saidStage = stage;
      this.saidScan = t;
      this.root.dataset.scan = t + 1;
      this.clock.textContent = `scan ${t + 1} of ${scans}, ${+((t + 1) * period).toFixed(2)} s`;
      this.time.value = t + 1;
      this.panels.forEach((panel) => panel.say(t, STAGES[stage].name));
      this.strips.forEach((strip) => strip.say(t));
      if (this.stageNames) this.stageNames.forEach((node, i) => node.classList.toggle("gmr-now", i === stage));
    }

    turn(key) {
      this.show[key] = !this.show[key];
      this.switches[key].setAttribute("aria-pressed", this.show[key]);
      if (key === "merges") Object.assign(this.show, { phase: 1, way: 1 });
      this.wake();
    }

    // -- keys

    /** Keys go to the player that has the focus, or to the first of the page where nothing has. */
    key(event) {
      const { target } = event;
      const mine = this.root.contains(target) || (target === document.body && document.querySelector(".gmr") === this.root);
      if (!mine || event.ctrlKey || event.metaKey || event.altKey) return;
      const field = target.closest("input, select"), pressed = target.closest("button");
      if (field && /^(Arrow|Home|End)/.test(event.key)) return;
      if (pressed && (event.key === " " || event.key === "Enter")) return;
      const act = this.actions()[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    }

    actions() {
      const { t } = this.show;
      return {
        " ": () => this.toggle(), ArrowLeft: () => this.go(t - 1), ArrowRight: () => this.go(t + 1),
        Home: () => this.go(0), End: () => this.go(this.episode.last),
        ",": () => this.stageStep(-1), ".": () => this.stageStep(1),
        "+": () => this.zoom(1.4), "=": () => this.zoom(1.4), "-": () => this.zoom(1 / 1.4),
        f: () => this.look("whole"), t: () => this.turn("truth"), o: () => this.turn("origin"), "?": () => this.toggleHelp(),
        ...(this.episode.traced && { m: () => this.turn("merges"), l: () => this.turn("lines") }),
        Escape: () => { this.helpNode.hidden = true; this.choose(null); },
      };
    }
  }

  /** Pixels to the metre at which gates, or hypotheses, fill a good part of a panel. */
  function closeScale({ gates, kept }, plane) {
    const set = gates && gates.m.length ? gates : kept, reach = [];
    for (let i = 0; i < set.m.length / 2; i++) reach.push(Math.sqrt(set.P[3 * i] + set.P[3 * i + 2]));
    reach.sort((a, b) => a - b);
    const typical = reach.length ? reach[reach.length >> 1] : 1;
    return Math.min(plane.width, plane.height) / (3.4 * (set === gates ? 1 : SIGMAS) * typical);
  }

  /** What the marks of the panels mean. */
  function keyOf({ many, traced }) {
    const rows = [
      ["detection", "detections"],
      ["path truth", "true path"],
      ...(many ? [] : [["ellipse gate", "gates"]]),
      ["ellipse hypothesis", many ? `intensity, ${SIGMAS}σ; weight as opacity` : `hypotheses, ${SIGMAS}σ; weight as opacity`],
      ...(traced ? [["ellipse dropped", "pruned"]] : []),
      many ? ["cross", "declared, by label; existence as opacity"] : ["ellipse estimate", `estimate, ${SIGMAS}σ, and its path`],
      ...(many ? [["ellipse clutter", "true clutter, 95 %"], ["ellipse guess", "clutter assumed or learned"]] : []),
    ];
    return make("ul", { class: "gmr-key" }, ...rows.map(([kind, text]) => make("li", {}, make("i", { class: `gmr-mark ${kind}` }), text)));
  }

  /** Fill the element with a player of the data; a promise of the player. */
  async function start(element, data) {
    try {
      const episode = recording(data, await unpack(data));
      episode.box = boundsOf(episode.truth);
      episode.lives = livesOf(episode.truth, episode.targets, data.scans);
      return new Player(element, episode);
    } catch (error) {
      element.textContent = `The episode cannot be shown: ${error.message}`;
      throw error;
    }
  }

  return { start };
})();
