// Where the panels look.

const WIDEST = 4; // how far the view widens to keep target and estimate in it

/** Where all panels look: a scale they share, and a centre that is free, or goes with the target, with each
    tracker's own estimate, or with both. What changes at once is shown gliding: `slip` is the way left. */
class Camera {
  constructor(episode) {
    this.episode = episode;
    this.scale = 1;
    this.side = 0; // px, of a panel; 0 until one is in sight
    this.x = this.y = 0;
    this.slip = { x: 0, y: 0, zoom: 0 };
    this.mode = "free";
  }

  /** Centre and scale for a tracker's panel into `out`, at scan t, `u` of the way from the last one. */
  look(out, tracker, t, u) {
    const before = Math.max(t - 1, 0);
    const scale = this.mode === "both" ? mix(this.wide(before), this.wide(t), u) : this.scale;
    const goes = this.mode !== "free";
    const x = goes ? mix(this.at(tracker, before, 0, scale), this.at(tracker, t, 0, scale), u) : this.x;
    const y = goes ? mix(this.at(tracker, before, 1, scale), this.at(tracker, t, 1, scale), u) : this.y;
    out.scale = scale * Math.exp(this.slip.zoom);
    out.x = x + this.slip.x;
    out.y = y + this.slip.y;
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
    const { trackers, truth } = this.episode;
    let far = 1e-9;
    for (const { estimate } of trackers) far = Math.max(far, distance(truth, estimate, t) || 0);
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

  /** From here on look where a panel looks. */
  stay({ x, y, scale }) {
    Object.assign(this, { mode: "free", x, y, scale });
  }

  /** Zoom about a place dX, dY pixels from the middle, where the view is free. */
  zoom(factor, dX, dY) {
    const scale = Math.min(1e4, Math.max(1e-5, this.scale * factor));
    this.slip.x = this.slip.y = this.slip.zoom = 0;
    this.x += dX * (1 / this.scale - 1 / scale);
    this.y -= dY * (1 / this.scale - 1 / scale);
    this.scale = scale;
  }

  pan(dX, dY) {
    this.x -= dX / this.scale;
    this.y += dY / this.scale;
  }

  fit([left, low, right, high], width, height) {
    const scale = 0.86 * Math.min(width / Math.max(right - left, 1), height / Math.max(high - low, 1));
    Object.assign(this, { mode: "free", scale, x: (left + right) / 2, y: (low + high) / 2 });
  }

  /** Panels are so large now: what was in view stays in view. */
  resize(side) {
    if (this.side) this.scale *= side / this.side;
    this.side = side;
  }
}

const distance = (a, b, t) => Math.hypot(a[2 * t] - b[2 * t], a[2 * t + 1] - b[2 * t + 1]);

/** Latest row up to t with a value; t where there is none. */
function seenUntil(points, t) {
  for (let i = t; i >= 0; i--) if (Number.isFinite(points[2 * i])) return i;
  return t;
}

/** What a view of that name shows, as left, low, right, high; null where it goes with something. */
function boxOf({ truth, targets, many, box }, { z }, name, t) {
  if (name === "whole") return many ? boundsOf(truth, z.m) : box;
  if (name === "radar") return boundsOf(truth, [0, 0]);
  if (name !== "scan") return null;
  const seen = z.m.subarray(2 * z.start[t], 2 * z.start[t + 1]);
  const now = boundsOf(seen, truth.subarray(2 * t * targets, 2 * (t + 1) * targets));
  return Number.isFinite(now[0]) ? now : box;
}

/** Pixels to the metre at which gates, or hypotheses, fill a good part of a panel of that many pixels. */
function closeScale({ gates, kept }, side) {
  const set = gates && gates.m.length ? gates : kept, reach = [];
  for (let i = 0; i < set.m.length / 2; i++) reach.push(Math.sqrt(set.P[3 * i] + set.P[3 * i + 2]) || 0);
  reach.sort((a, b) => a - b);
  const typical = reach[reach.length >> 1] || 1;
  return side / (3.4 * (set === gates ? 1 : SIGMAS) * typical);
}
