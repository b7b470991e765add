// The pieces of the page of a reduction, and what is selected in words.

const POINT = "Point at a component, or step through them with ↑ and ↓, for its weight, mean and inputs.";

/** Fill the element; the pieces that change, by name. */
function build(view) {
  const { root, strips, count, last } = view, { title, methods } = view.data;
  const pieces = {
    time: make("input", {
      type: "range", min: 0, max: last, value: 0, class: "gmr-time", "aria-label": "Number of components",
      oninput: () => view.go(Number(pieces.time.value), true),
    }),
    chosen: make("div", { class: "gmr-chosen", "aria-live": "polite" }, line(POINT)),
    help: helpBox(view, KEYS, GESTURES),
    play: button("play", "Play", () => view.toggle(), icon("play")),
    clock: make("span", { class: "gmr-clock" }, make("span"), make("span", {}, " components")),
  };
  const ends = [plural(count, "component"), String(count - last)].map((text) => make("span", {}, text));
  const axis = make("div", { class: "gmr-ends", "aria-hidden": "true" }, ...ends);
  pieces.charts = make("div", { class: "gmr-strips" }, pieces.time, axis, ...strips.map(({ node }) => node));
  pieces.aside = make("aside", {}, pieces.chosen, keyOf(view.data.axes.length));
  root.classList.add("gmr", "gmr-reduction");
  root.tabIndex = -1; // a click gives it the keys
  root.replaceChildren(
    header(view, title, `reduced by ${listed(methods.map(({ name }) => name))}`),
    panelsOf(view),
    transport(view, pieces),
    make("div", { class: "gmr-below" }, pieces.charts, pieces.aside),
    pieces.help,
  );
  return pieces;
}

function transport(view, pieces) {
  pieces.bar = make(
    "div", { class: "gmr-bar" },
    button("step", "One component more", () => view.go(view.to - 1), icon("back")), pieces.play,
    button("step", "One component less", () => view.go(view.to + 1), icon("forward")), pieces.clock,
    speedChoice(view, SPEEDS, "step"),
  );
  return make(
    "div", { class: "gmr-transport", role: "group", "aria-label": "Playback and view" }, pieces.bar,
    make(
      "div", {}, button("toggle", "Fit the whole mixture", () => view.fit(), "fit"),
      ...zoomButtons(view),
    ),
  );
}

/** What the marks of the panels mean. */
function keyOf(axes) {
  const rows = axes === 1
    ? [
      ["path full", "the full mixture"], ["path reduced", "the reduced mixture"],
      ["ellipse hypothesis", "its components"], ["ellipse estimate", "merged last"],
      ["ellipse dropped", "dropped last"], ["path branch", "who merged into whom, upwards"],
    ]
    : [
      ["ellipse clutter", `the full mixture, ${SIGMAS}σ`],
      ["ellipse hypothesis", `components, ${SIGMAS}σ; weight as opacity`],
      ["ellipse estimate", "merged last"], ["ellipse dropped", "dropped last"],
      ["path branch", "who merged into whom"],
    ];
  return keyList(rows);
}

/** Nodes that say what component is selected. */
function describe({ panel: { method }, j }, k, axes) {
  const one = componentOf(method, k, j), inputs = method.inputs[k][j];
  const full = (i) => componentOf(method, 0, i).w;
  const sum = inputs.reduce((total, i) => total + full(i), 0);
  const parts = inputs.map((i) => [`component ${i + 1}`, full(i) / sum]).sort((a, b) => b[1] - a[1]);
  return [
    heading(`Component ${nameOf(inputs)}`, `${method.name}, ${j + 1} of ${method.steps[k].kept.length}`),
    line(`Weight ${brief(one.w)}`),
    line(`Mean ${one.m.map(brief).join(", ")}`),
    line(spreadInWords(one.P, axes)),
    ...(inputs.length > 1 ? [bars("Inputs, by share of the weight", parts)] : []),
  ];
}

function spreadInWords(P, axes) {
  if (axes.length === 1) return `Variance ${brief(P[0])}, deviation ${brief(Math.sqrt(P[0]))}`;
  const [xx, xy, yy] = P, deviations = `${brief(Math.sqrt(xx))}, ${brief(Math.sqrt(yy))}`;
  const names = `x${axes[0] + 1}, x${axes[1] + 1}`;
  return `Deviations ${deviations} of ${names}; correlation ${brief(xy / Math.sqrt(xx * yy))}`;
}
