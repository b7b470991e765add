// One scan of many targets.

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
