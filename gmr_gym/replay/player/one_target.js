// One scan of one target.

const FAINTEST = 0.08; // opacity of a hypothesis of next to no weight
const opacity = (w, most) => Math.max(FAINTEST, Math.min(1, Math.sqrt(w / most)));

function heaviest(set, t) {
  let most = 1e-300;
  for (let i = set.start[t]; i < set.start[t + 1]; i++) if (set.w[i] > most) most = set.w[i];
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
  if (whole && show.lines && panel.tracker.full) drawLines(panel, t, 1, 1, 1);
  if (show.truth) drawTruth(panel, t, whole ? 1 : during(phase, 0, 0.22));
  drawEstimate(panel, t, whole ? 1 : during(phase, 0.86, 1));
  drawChosen(panel, show, whole);
}

function drawGates({ plane, ink, tracker }, t, alpha) {
  const { gates } = tracker, { ctx } = plane;
  if (!gates) return;
  ctx.strokeStyle = ink.gates;
  ctx.lineWidth = 1;
  ctx.globalAlpha = alpha * Math.min(1, 3.2 / Math.sqrt(size(gates, t))); // many stay in the background
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
  pointTo(plane, x, y, `estimate, ${figures(tracker.error[t], " m")} off`, ink.estimate);
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
