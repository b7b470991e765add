// The reductions of the data, and what of them is in sight at any time between two steps.

/** A method's reductions: step k is the mixture reduced to k components less. */
function methodOf({ name, components, steps }, i) {
  return { name, components, steps, colour: `tracker${i}`, inputs: steps.map(inputsOf) };
}

/** Rows of the original mixture that went into each component of a step. */
function inputsOf({ kept, origin }) {
  const inputs = kept.map(() => []);
  origin.forEach((j, i) => { if (j >= 0) inputs[j].push(i); });
  return inputs;
}

/** Component j of step k: { w, m, P }. */
function componentOf({ components: { w, m, P }, steps }, k, j) {
  const row = steps[k].kept[j];
  return { w: w[row], m: m[row], P: P[row] };
}

const componentsOf = (method, k) => method.steps[k].kept.map((_, j) => componentOf(method, k, j));

/** Rows of the step before that went into each component of step k; null where the step is no merging. */
function partsOf({ steps }, k) {
  const { into, kept } = steps[k];
  if (k === 0 || !into) return null;
  const parts = kept.map(() => []);
  into.forEach((j, i) => { if (j >= 0) parts[j].push(i); });
  return parts;
}

/** What is in sight `u` of the way from step k - 1 to step k: components with their strength, and what is
    happening to them: "merged", "dropped" or nothing. */
function inSight(method, k, u) {
  const parts = partsOf(method, k), now = componentsOf(method, k);
  const changed = now.map((_, j) => Boolean(parts) && parts[j].length > 1);
  const arrived = (j) => ({ ...now[j], j, strength: 1, fate: changed[j] ? "merged" : "" });
  if (u >= 1 || k === 0) return now.map((_, j) => arrived(j));
  const before = componentsOf(method, k - 1);
  if (!parts) {
    const going = before.map((one) => ({ ...one, strength: 1 - u, fate: "" }));
    return [...going, ...now.map((one, j) => ({ ...one, j, strength: u, fate: "" }))];
  }
  return before.map((one, i) => {
    const j = method.steps[k].into[i];
    if (j < 0) return { ...one, strength: 1 - u, fate: "dropped" };
    const sum = parts[j].reduce((total, row) => total + before[row].w, 0);
    return { ...onItsWay(one, now[j], sum, u), j, strength: 1, fate: changed[j] ? "merged" : "" };
  });
}

/** Components of the step before that step k dropped. */
function droppedIn(method, k) {
  const into = k > 0 && method.steps[k].into;
  return into ? componentsOf(method, k - 1).filter((_, i) => into[i] < 0) : [];
}

/** A component `u` of the way to the one that it goes into with others, of summed weight `sum`. */
function onItsWay(from, to, sum, u) {
  const each = (a, b) => a.map((value, r) => mix(value, b[r], u));
  return { w: mix(from.w, (from.w / sum) * to.w, u), m: each(from.m, to.m), P: each(from.P, to.P) };
}

const MOST_NAMES = 3;

/** A component's name: the numbers, from 1, of the inputs that went into it. */
function nameOf(inputs) {
  const numbers = inputs.map((i) => i + 1);
  if (numbers.length <= MOST_NAMES) return numbers.join("+");
  return `${numbers.slice(0, MOST_NAMES - 1).join("+")}+… (${numbers.length})`;
}

/** What happened in step k, in words. */
function stepInWords(method, k) {
  const { steps, inputs } = method, left = steps[k].kept.length;
  if (k === 0) return `${plural(left, "component")}, none merged`;
  const parts = partsOf(method, k);
  if (!parts) return `${plural(left, "group")} formed anew`;
  const named = (i) => `${nameOf(inputs[k - 1][i])} (${share(componentOf(method, k - 1, i).w)})`;
  const said = parts.filter((rows) => rows.length > 1).map((rows) => `${listed(rows.map(named))} into one`);
  const dropped = steps[k].into.flatMap((j, i) => (j < 0 ? [named(i)] : []));
  if (dropped.length) said.push(`${listed(dropped)} dropped`);
  return said.join("; ") || "nothing changed";
}

const listed = (names) => [names.slice(0, -1).join(", "), ...names.slice(-1)].filter(Boolean).join(" and ");

/** A number with three digits, as short as it can be. */
function brief(value) {
  if (!Number.isFinite(value)) return "none";
  if (value !== 0 && (Math.abs(value) < 1e-4 || Math.abs(value) >= 1e5)) return value.toExponential(2);
  return String(+value.toPrecision(3));
}

function costInWords({ ise, cost }) {
  return `ISE ${brief(ise)}${cost === null ? "" : `, B ${brief(cost)}`}`;
}
