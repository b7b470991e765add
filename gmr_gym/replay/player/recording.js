// An episode and its trackers.
//
// Lengths are metres, covariances xx, xy, yy. Rows of scan t of a ragged set are start[t] to start[t + 1].
// Scans count from 0 here and from 1 on the screen.

/** What the panels draw: the columns under names of their own, and what follows from them. */
function recording(data, column) {
  const trackers = data.trackers.map(({ name }, i) => trackerOf(data, (key) => column(`${i}/${key}`), name));
  const truth = column("truth"), targets = truth.length / data.scans / 2, times = column("time");
  return {
    ...data, truth, targets, trackers,
    last: data.scans - 1,
    filed: data.seed === null, // detections of a file, no episode
    timeOf: (t) => (times ? times[t] : (t + 1) * data.period),
    box: targets ? boundsOf(truth) : boundsOf(...trackers.map(({ z }) => z.m)),
    lives: livesOf(truth, targets, data.scans),
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
    name,
    z: cloud(column, "z"),
    origin: column("origin"),
    kept: cloud(column, "kept"),
    full: fullOf(column),
    lost: (column("lost_at") || [-1])[0],
  };
  const ofOne = ["target", "estimate", "estimate_P", "error", "count", "alive", "mode_p"];
  const ofMany = ["expected", "gospa", "present"];
  for (const key of [...ofOne, ...ofMany]) tracker[key] = column(key);
  tracker.kept.from = column("full_per_kept");
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
