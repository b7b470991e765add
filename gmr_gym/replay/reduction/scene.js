// What both kinds of panel have in common: an axis, opacity by weight, the box that holds the mixture.

const FAINTEST = 0.14; // opacity of a component of no weight

const opacityOf = (w, most) => FAINTEST + (1 - FAINTEST) * Math.sqrt(Math.min(1, w / most));

/** Colour of a component by what happens to it. */
function colourOf(ink, fate) {
  return fate === "merged" ? ink.estimate : fate === "dropped" ? ink.dropped : ink.hypotheses;
}

/** A tick's label, exact to the step. */
function tick(value, step) {
  if (value === 0) return "0";
  if (step >= 1e5 || step < 1e-4) return value.toExponential(1);
  return String(+value.toFixed(Math.max(0, -Math.floor(Math.log10(step)))));
}

/** Upright lines of the first coordinate down to `height`, with labels above `below`. */
function drawUprights({ plane, ink }, height, below) {
  const { ctx, width } = plane, step = niceStep(80 / plane.scale);
  startAxes(ctx, ink);
  for (let i = Math.ceil(plane.x(0) / step); i * step < plane.x(width); i++) {
    const X = Math.round(plane.X(i * step)) + 0.5;
    stroke(ctx, X, 0, X, height);
    if (X > 24 && X < width - 50) ctx.fillText(tick(i * step, step), X + 3, below);
  }
}

/** Level lines, with labels left, of a coordinate drawn `stretch` times as long. */
function drawLevels({ plane, ink }, stretch) {
  const { ctx, width, height } = plane, step = niceStep(70 / plane.scale / stretch);
  startAxes(ctx, ink);
  for (let i = Math.ceil(plane.y(height) / stretch / step); i * step * stretch < plane.y(0); i++) {
    const Y = Math.round(plane.Y(i * step * stretch)) + 0.5;
    stroke(ctx, 0, Y, width, Y);
    if (Y > 20 && Y < height - 20) ctx.fillText(tick(i * step, step), 4, Y - 2);
  }
}

function startAxes(ctx, ink) {
  Object.assign(ctx, {
    globalAlpha: 1, lineWidth: 1, strokeStyle: ink.grid, fillStyle: ink.faint, font: ink.small,
    textAlign: "left", textBaseline: "bottom",
  });
}

/** Lowest and highest of coordinate `axis` within `reach` deviations of the components; its variance is entry
    `at` of what is kept of the covariance. */
function extentOf(components, axis, at, reach) {
  const ends = (sign) => components.map(({ m, P }) => m[axis] + sign * reach * Math.sqrt(P[at]));
  return [Math.min(...ends(-1)), Math.max(...ends(1))];
}
