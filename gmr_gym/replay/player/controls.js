// The page of a player: head, panels, controls, charts, what is selected, what the marks mean.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 40]; // scans a second
const KEYS = [
  ["space", "play or pause"],
  ["← →", "scan back, forward"],
  [", .", "stage back, forward within a scan"],
  ["home end", "first, last scan"],
  ["+ −", "zoom"],
  ["f", "fit the whole path"],
  ["t", "true path"],
  ["o", "the target's own detection"],
  ["m", "animate the reduction"],
  ["l", "lines to the parents"],
  ["n", "select the next hypothesis or component by weight"],
  ["esc", "end a selection"],
  ["?", "this help"],
];
const OF_TRACES = [", .", "m", "l"]; // keys that act where there are hypotheses before the reduction
const keysOf = ({ traced }) => KEYS.filter(([key]) => traced || !OF_TRACES.includes(key));
const gesturesOf = ({ traced, many }) =>
  "Drag to move, wheel or two fingers to zoom. Drag on a chart to go through the scans. " +
  `Click a ${many ? "component" : "hypothesis"} or a detection to see ` +
  (traced ? "where it came from and where it went." : "its numbers.");

/** Fill the player's element; the pieces that change, by name. */
function build(player) {
  const { root, episode, strips } = player, { title, environment, seed } = episode;
  const pieces = {
    time: timeSlider(player),
    chosen: make("div", { class: "gmr-chosen", "aria-live": "polite" }),
    help: helpBox(player, keysOf(player.episode), gesturesOf(player.episode)),
    ...transport(player),
  };
  pieces.charts = make("div", { class: "gmr-strips" }, pieces.time, ...strips.map(({ node }) => node));
  pieces.aside = make("aside", {}, pieces.chosen, keyOf(episode));
  root.classList.add("gmr");
  root.tabIndex = -1; // a click gives it the keys
  root.replaceChildren(
    header(player, title || environment, `${environment} seed ${seed}`.trim()),
    panelsOf(player),
    pieces.transport,
    make("div", { class: "gmr-below" }, pieces.charts, pieces.aside),
    pieces.help,
  );
  return pieces;
}

function timeSlider(player) {
  const slider = make("input", {
    type: "range", min: 1, max: player.episode.scans, value: 1, class: "gmr-time", "aria-label": "Scan",
    oninput: () => player.go(Number(slider.value) - 1),
  });
  return slider;
}

/** The row of controls, and those of its pieces that change. */
function transport(player) {
  const pieces = {
    play: button("play", "Play", () => player.toggle(), icon("play")),
    clock: make("span", { class: "gmr-clock" }, make("span"), make("span")),
    switches: switchesOf(player),
    views: choice("View", viewsOf(player.episode), "whole", (value) => player.look(value)),
    ...(player.episode.traced && stageSlider(player)),
  };
  pieces.bar = make(
    "div", { class: "gmr-bar" },
    button("step", "Scan back", () => player.go(player.show.t - 1), icon("back")), pieces.play,
    button("step", "Scan forward", () => player.go(player.show.t + 1), icon("forward")), pieces.clock,
    speedChoice(player, SPEEDS, "scan"),
  );
  pieces.transport = make(
    "div", { class: "gmr-transport", role: "group", "aria-label": "Playback and view" },
    pieces.bar, ...(pieces.stages ? [pieces.stages] : []), make("div", {}, ...Object.values(pieces.switches)),
    make(
      "div", {}, pieces.views, button("toggle", "Fit the whole path", () => player.look("whole"), "fit"),
      ...zoomButtons(player),
    ),
  );
  return pieces;
}

function stageSlider(player) {
  const stage = make("input", {
    type: "range", min: 0, max: 1000, value: 1000, "aria-label": "Stage within the scan",
    oninput: () => player.stand(Number(stage.value) / 1000),
  });
  const stageNames = STAGES.map(({ name, until }, i) => {
    const node = make("span", {}, name);
    node.style.flexGrow = Math.round(1000 * (until - (i ? STAGES[i - 1].until : 0)));
    return node;
  });
  const names = make("div", { "aria-hidden": "true" }, ...stageNames);
  return { stage, stageNames, stages: make("div", { class: "gmr-stages" }, stage, names) };
}

function switchesOf(player) {
  const ofTraces = { merges: `Animate the reduction, up to ${SLOW} scans/s`, lines: "Lines to the parents" };
  const titles = {
    truth: "The true path",
    origin: "Ring the target's own detection",
    ...(player.episode.traced && ofTraces),
  };
  const nodes = Object.entries(titles).map(([key, title]) => {
    const node = button("toggle", title, () => player.turn(key), key);
    node.setAttribute("aria-pressed", player.show[key]);
    return [key, node];
  });
  return Object.fromEntries(nodes);
}

const viewsOf = ({ many, radar }) => [
  ...(many ? [] : [["both", "follow both"], ["target", "follow target"], ["estimate", "follow estimate"]]),
  ["whole", many ? "whole area" : "whole path"],
  ["scan", "this scan"],
  ...(radar ? [["radar", "from the radar"]] : []),
  ["free", "free view"],
];

/** What the marks of the panels mean. */
function keyOf({ many, traced }) {
  const weight = `${SIGMAS}σ; weight as opacity`;
  const one = [
    ["ellipse gate", "gates"],
    ["ellipse hypothesis", `hypotheses, ${weight}`],
    ...(traced ? [["ellipse dropped", "pruned"]] : []),
    ["ellipse estimate", `estimate, ${SIGMAS}σ, and its path`],
  ];
  const several = [
    ["ellipse hypothesis", `intensity, ${weight}`],
    ["cross", "declared, by label; existence as opacity"],
    ["ellipse clutter", "true clutter, 95 %"],
    ["ellipse guess", "clutter assumed or learned"],
  ];
  return keyList([["detection", "detections"], ["path truth", "true path"], ...(many ? several : one)]);
}
