// The plane of the targets on a canvas.

const SIGMAS = 2; // of the ellipses of hypotheses and estimates

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

/** Give a canvas as many dots as the screen has for so many pixels, and let it be drawn on in pixels. */
function sizeTo(canvas, width, height) {
  const dots = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * dots);
  canvas.height = Math.round(height * dots);
  canvas.getContext("2d").setTransform(dots, 0, 0, dots, 0, 0);
}

/** The canvas of a panel, with metres on it: y upwards, lines as thick at every scale. */
class Plane {
  constructor(canvas) {
    this.canvas = canvas;
    this.ctx = canvas.getContext("2d");
  }

  resize() {
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    sizeTo(this.canvas, this.width, this.height);
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
      const X = this.X(points[2 * i]), Y = this.Y(points[2 * i + 1]), there = Number.isFinite(X);
      if (there && down) this.ctx.lineTo(X, Y);
      else if (there) this.ctx.moveTo(X, Y);
      down = there;
    }
  }
}
