// What is selected, in words.

/** Nodes that say what is selected; `go(t, i)` shows row i of the mixture kept at scan t. */
function describe(episode, chosen, go) {
  const describers = { kept: describeKept, full: describeFull, detection: describeDetection };
  return describers[chosen.kind](episode, chosen, go);
}

const associationName = (detection) => (detection < 0 ? "missed" : `detection ${detection + 1}`);

function describeKept(episode, { panel, t, i, rows }, go) {
  const { tracker } = panel, { kept, full } = tracker;
  const [what, weight] = tracker.declared ? ["Component", "Expected number"] : ["Hypothesis", "Weight"];
  const nodes = [
    heading(`${what} ${i - kept.start[t] + 1} of ${size(kept, t)}`, `${tracker.name}, scan ${t + 1}`),
    line(`${weight} ${share(kept.w[i])}`),
  ];
  if (!full) return nodes;
  nodes[1].append(kept.from[i] > 1 ? `, merged from ${kept.from[i]} hypotheses` : ", not merged");
  nodes.push(bars("Associations", sums(rows, full.w, (row) => associationName(full.detection[row]))));
  if (t > 0) nodes.push(parentLine(tracker, t, rows, go));
  if (tracker.mode_p)
    nodes.push(bars("Motion models", sums(rows, full.w, (row) => modeName(episode, full.mode[row]))));
  return nodes;
}

function describeFull(episode, { panel, t, i }, go) {
  const { tracker } = panel, { full } = tracker, into = full.into[i], all = counts(tracker, t).all;
  const nodes = [
    heading(`One of ${plural(all, "hypothesis")}`, `${tracker.name}, scan ${t + 1}, before the reduction`),
    line(`Weight ${share(full.w[i])}, ${associationName(full.detection[i])}`),
  ];
  if (tracker.mode_p) nodes.push(line(`Motion model: ${modeName(episode, full.mode[i])}`));
  if (t > 0) nodes.push(parentLine(tracker, t, [i], go));
  const kept = tracker.kept.start[t] + into;
  const toKept = link(`hypothesis ${into + 1}`, () => go(t, kept));
  nodes.push(into < 0 ? line("Pruned") : line("Went into ", toKept));
  return nodes;
}

function describeDetection(episode, { panel, t, i, rows }, go) {
  const { tracker } = panel, { full, kept, z } = tracker;
  const name = `Detection ${i - z.start[t] + 1} of ${size(z, t)}`;
  const nodes = [heading(name, `${tracker.name}, scan ${t + 1}`)];
  if (!full) return nodes;
  const sum = rows.reduce((total, row) => total + full.w[row], 0);
  if (!rows.length) return [...nodes, line("Used by no hypothesis that is drawn")];
  const drawn = counts(tracker, t).all === size(full, t), used = drawn ? "Used by" : "Used by at least";
  nodes.push(line(`${used} ${plural(rows.length, "hypothesis")}, summed weight ${share(sum)}`));
  const into = (row) => (full.into[row] < 0 ? "pruned" : `hypothesis ${full.into[row] + 1}`);
  nodes.push(bars("Where they went", sums(rows, full.w, into)));
  const heavy = rows.find((row) => full.into[row] >= 0);
  if (heavy !== undefined)
    nodes.push(line(link("show the heaviest", () => go(t, kept.start[t] + full.into[heavy]))));
  return nodes;
}

function parentLine({ full, kept }, t, rows, go) {
  const parents = new Set(rows.map((row) => full.parent[row]));
  const first = rows.length ? full.parent[rows[0]] : -1;
  if (first < 0) return line("");
  const show = () => go(t - 1, kept.start[t - 1] + first);
  const node = line("Parent: ", link(`hypothesis ${first + 1} of scan ${t}`, show));
  if (parents.size > 1) node.append(", and others");
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
