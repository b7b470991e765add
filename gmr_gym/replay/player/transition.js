// How the mixture of one scan becomes that of the next: predicted, updated, pruned, merged.

// the stages of a scan, each up to its share of the scan's time
const STAGES = [
  { name: "predict", until: 0.22 },
  { name: "update", until: 0.5 },
  { name: "prune", until: 0.64 },
  { name: "merge", until: 0.88 },
  { name: "kept", until: 1 },
];
const stageAt = (phase) => STAGES.findIndex(({ until }) => phase <= until + 1e-9);

/** From the mixture of the scan before to that of this one: every hypothesis leaves the gate of its parent,
    the pruned ones fade, and the others move into the component that they are merged into. */
function drawTransition(panel, show) {
  const { t, phase } = show;
  const born = during(phase, 0.22, 0.42), gone = during(phase, 0.52, 0.64);
  const moved = during(phase, 0.66, 0.86), settled = during(phase, 0.84, 0.94);
  if (born < 1 && t > 0) drawPredicted(panel, t, during(phase, 0, 0.2), 1 - born);
  if (born > 0 && settled < 1) {
    if (show.lines) drawLines(panel, t, born, moved, gone);
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

/** The full posterior: what is pruned is coloured as `marked` goes to 1, and fades as `gone` does. */
function drawFull({ plane, ink, tracker }, t, born, marked, gone, moved, alpha) {
  const { full } = tracker, { ctx } = plane, most = heaviest(full, t);
  ctx.lineWidth = 1.2;
  for (let i = full.start[t]; i < full.start[t + 1]; i++) {
    const pruned = full.into[i] < 0;
    const strength = opacity(full.w[i], most);
    ctx.strokeStyle = pruned && marked > 0 ? ink.dropped : ink.hypotheses;
    // what is pruned weighs little: it is drawn stronger while it goes, so that it is seen to go
    const seen = pruned ? mix(strength, Math.max(strength, 0.45), marked) * (1 - gone) : strength;
    ctx.globalAlpha = alpha * born * seen;
    if (ctx.globalAlpha < 0.004) continue;
    if (ellipseOnItsWay(plane, tracker, t, i, born, pruned ? 0 : moved)) ctx.stroke();
  }
}

/** Begin the path of a hypothesis that is `born` of the way from its parent, and `moved` of that to what it
    is merged into; false where none of it is in view. */
function ellipseOnItsWay(plane, tracker, t, i, born, moved) {
  const { m, P, into } = tracker.full, { kept } = tracker;
  const x = mix(originOf(tracker, t, i, 0), m[2 * i], born);
  const y = mix(originOf(tracker, t, i, 1), m[2 * i + 1], born);
  if (moved === 0) return plane.ellipse(x, y, P[3 * i], P[3 * i + 1], P[3 * i + 2], SIGMAS);
  const j = kept.start[t] + into[i];
  return plane.ellipse(
    mix(x, kept.m[2 * j], moved), mix(y, kept.m[2 * j + 1], moved), mix(P[3 * i], kept.P[3 * j], moved),
    mix(P[3 * i + 1], kept.P[3 * j + 1], moved), mix(P[3 * i + 2], kept.P[3 * j + 2], moved), SIGMAS,
  );
}

/** Row of the gate of a hypothesis' parent; -1 where gates are not one for each parent. */
function gateOf({ full, gates, kept }, t, i) {
  if (!gates || (t > 0 && size(gates, t) !== size(kept, t - 1))) return -1;
  const parent = full.parent[i];
  return parent >= 0 && parent < size(gates, t) ? gates.start[t] + parent : -1;
}

/** Coordinate `axis` of the place that a hypothesis comes from: its parent's gate, else its parent. */
function originOf(tracker, t, i, axis) {
  const { full, gates, kept } = tracker, gate = gateOf(tracker, t, i);
  if (gate >= 0) return gates.m[2 * gate + axis];
  const parent = t > 0 ? full.parent[i] : -1;
  return parent >= 0 ? kept.m[2 * (kept.start[t - 1] + parent) + axis] : full.m[2 * i + axis];
}

/** From each hypothesis, `moved` of the way to what it is merged into, back to its parent before the scan. */
function drawLines({ plane, ink, tracker }, t, born, moved, gone) {
  const { full, kept } = tracker, { ctx } = plane, most = heaviest(full, t);
  if (t === 0) return;
  ctx.strokeStyle = ink.hypotheses;
  ctx.lineWidth = 0.8;
  for (let i = full.start[t]; i < full.start[t + 1]; i++) {
    if (full.parent[i] < 0) continue;
    const from = kept.start[t - 1] + full.parent[i], pruned = full.into[i] < 0;
    const j = kept.start[t] + full.into[i], u = pruned ? 0 : moved;
    const x = u > 0 ? mix(full.m[2 * i], kept.m[2 * j], u) : full.m[2 * i];
    const y = u > 0 ? mix(full.m[2 * i + 1], kept.m[2 * j + 1], u) : full.m[2 * i + 1];
    ctx.globalAlpha = 0.7 * born * (pruned ? 1 - gone : 1) * opacity(full.w[i], most);
    plane.line(kept.m[2 * from], kept.m[2 * from + 1], x, y);
    ctx.stroke();
  }
}
