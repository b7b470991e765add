// What a click selects, and how it is drawn.

const HIT = 10; // px within which a click finds a point

/** What lies under a click, as { kind, i }: a detection, or the nearest hypothesis; null for neither. */
function hit(panel, show, X, Y) {
  const { plane, tracker } = panel, { t, phase } = show;
  const detection = nearest(plane, tracker.z, t, X, Y, HIT);
  if (detection >= 0) return { kind: "detection", i: detection };
  const before = tracker.full && phase < 0.76; // then half of the way to what they are merged into is gone
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
  return rowsWhere(full, t, (row) => full.into[row] === i - kept.start[t]);
}

/** Rows of scan t of a set that pass a test, heaviest first. */
function rowsWhere({ start, w }, t, test) {
  const rows = [];
  for (let row = start[t]; row < start[t + 1]; row++) if (test(row)) rows.push(row);
  return rows.sort((a, b) => w[b] - w[a]);
}

/** Rows of the full posterior that a selection is about; none where it is not known. */
function rowsOf(tracker, { t, kind, i }) {
  const { full, z } = tracker;
  if (!full) return [];
  if (kind === "kept") return membersOf(tracker, t, i);
  if (kind === "full") return [i];
  return rowsWhere(full, t, (row) => full.detection[row] === i - z.start[t]);
}

/** Points of the heaviest line of descent of row i of the mixture kept at scan t, the latest first. */
function ancestry(tracker, t, i) {
  const points = [];
  for (; t >= 0; t--) {
    points.push(tracker.kept.m[2 * i], tracker.kept.m[2 * i + 1]);
    const [heaviestMember] = t > 0 ? membersOf(tracker, t, i) : [];
    if (heaviestMember === undefined || tracker.full.parent[heaviestMember] < 0) break;
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
  drawRows(panel, chosen);
  ctx.globalAlpha = 0.6;
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
    ctx.globalAlpha = 0.7 * opacity(full.w[row], full.w[rows[0]]);
    if (kind !== "full" && ellipseOf(plane, full, row, SIGMAS)) ctx.stroke();
    if (full.detection[row] < 0) continue;
    const seen = z.start[t] + full.detection[row];
    plane.line(full.m[2 * row], full.m[2 * row + 1], z.m[2 * seen], z.m[2 * seen + 1]);
    ctx.stroke();
  }
}
