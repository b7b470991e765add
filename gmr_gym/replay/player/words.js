// Counts and numbers in words.

/** So many of a thing: 1 gate, 2 gates, 2 hypotheses. */
function plural(n, word) {
  const many = word.endsWith("is") ? word.replace(/is$/, "es") : `${word}s`;
  return `${n} ${n === 1 ? word : many}`;
}

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
    return `${plural(now.all, "hypothesis")}, each with a detection in its gate or a missed one`;
  if (stage === "prune")
    return `${plural(now.all, "hypothesis")}: ${now.pruned || "none"} pruned`;
  return reductionInWords(now);
}

function figures(value, unit = "") {
  if (!Number.isFinite(value)) return "unknown";
  const digits = Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2;
  return value.toFixed(digits) + unit;
}

function share(w) {
  if (!Number.isFinite(w)) return "unknown";
  return w >= 0.0995 ? w.toFixed(2) : w >= 0.001 ? w.toFixed(3) : w.toExponential(0);
}

const modeName = ({ modes }, k) => modes[k] || `model ${k + 1}`;
