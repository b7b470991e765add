// The pieces of the page of a reduction, and what is selected in words.

const POINT = "Point at a component, or step through them with ↑ and ↓, for its weight, mean and inputs.";

/** Fill the element; the pieces that change, by name. */
function build(view) {
  const { root, panels, strips, count, last } = view;
  const pieces = {
    time: make("input", {
      type: "range", min: 0, max: last, value: 0, class: "gmr-time", "aria-label": "Number of components",
      oninput: () => view.go(Number(pieces.time.value), true),
    }),
    chosen: make("div", { class: "gmr-chosen", "aria-live": "polite" }, line(POINT)),
    help: helpBox(view),
    play: button("play", "Play", () => view.toggle(), icon("play")),
    clock: make("span", { class: "gmr-clock" }),
  };
  const ends = [plural(count, "component"), String(count - last)].map((text) => make("span", {}, text));
  const axis = make("div", { class: "gmr-ends", "aria-hidden": "true" }, ...ends);
  pieces.charts = make("div", { class: "gmr-strips" }, pieces.time, axis, ...strips.map(({ node }) => node));
  root.classList.add("gmr", "gmr-reduction");
  root.tabIndex = -1; // a click gives it the keys
  root.replaceChildren(
    header(view),
    make("div", { class: "gmr-panels", "data-count": panels.length }, ...panels.map(({ node }) => node)),
    transport(view, pieces),
    make("div", { class: "gmr-below" }, pieces.charts, make("aside", {}, pieces.chosen, keyOf(view.data.axes.length))),
    pieces.help,
  );
  return pieces;
}

function header(view) {
  const { title, methods } = view.data, about = `reduced by ${listed(methods.map(({ name }) => name))}`;
  const shade = () => view.shade(view.root.dataset.theme === "light");
  return make(
    "header", {},
    make("div", {}, make("h2", {}, title), make("span", {}, about)),
    button("plain", "Light or dark", shade, icon("theme")),
    button("plain", "Keys and help", () => view.toggleHelp(), "?"),
  );
}

function transport(view, pieces) {
  const speeds = SPEEDS.map((speed) => [speed, `${speed} step${speed === 1 ? "" : "s"}/s`]);
  pieces.bar = make(
    "div", { class: "gmr-bar" },
    button("step", "One component more", () => view.go(view.to - 1), icon("back")), pieces.play,
    button("step", "One component less", () => view.go(view.to + 1), icon("forward")), pieces.clock,
    choice("Speed", speeds, view.speed, (value) => { view.speed = Number(value); }),
  );
  return make(
    "div", { class: "gmr-transport", role: "group", "aria-label": "Playback and view" }, pieces.bar,
    make(
      "div", {}, button("toggle", "Fit the whole mixture", () => view.fit(), "fit"),
      button("plain", "Zoom out", () => view.zoom(1 / ZOOM), icon("minus")),
      button("plain", "Zoom in", () => view.zoom(ZOOM), icon("plus")),
    ),
  );
}

function helpBox(view) {
  const rows = KEYS.map(([key, what]) => make("div", {}, make("kbd", {}, key), what));
  return make(
    "div", { class: "gmr-help", hidden: "", role: "dialog", "aria-label": "Keys and help" },
    make("h3", {}, "Keys"), ...rows, make("p", {}, GESTURES),
    button("close", "Close the help", () => view.toggleHelp(), "close"),
  );
}

/** What the marks of the panels mean. */
function keyOf(axes) {
  const rows = axes === 1
    ? [
      ["path full", "the full mixture"], ["path reduced", "the reduced mixture"],
      ["ellipse hypothesis", "its components"], ["ellipse estimate", "merged last"],
      ["ellipse dropped", "dropped"], ["path branch", "who merged into whom, upwards"],
    ]
    : [
      ["ellipse clutter", `the full mixture, ${SIGMAS}σ`], ["ellipse hypothesis", `components, ${SIGMAS}σ; weight as opacity`],
      ["ellipse estimate", "merged last"], ["ellipse dropped", "dropped"], ["path branch", "who merged into whom"],
    ];
  const item = ([kind, text]) => make("li", {}, make("i", { class: `gmr-mark ${kind}` }), text);
  return make("ul", { class: "gmr-key" }, ...rows.map(item));
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
  const deviations = `${brief(Math.sqrt(P[0]))}, ${brief(Math.sqrt(P[2]))}`;
  return `Deviations ${deviations} of x${axes[0] + 1}, x${axes[1] + 1}; correlation ${brief(P[1] / Math.sqrt(P[0] * P[2]))}`;
}
