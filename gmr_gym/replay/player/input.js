// Fingers, mouse and keys.

const ZOOM = 1.4; // of a key or a button
const STILL = 4; // px that a finger may move in a click

/** On a panel a drag moves, two fingers and the wheel zoom, a click selects. */
function listen(player, panel) {
  const { canvas } = panel, fingers = new Map();
  let moved = 0;
  const down = (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (fingers.size === 0) moved = 0;
    fingers.set(event.pointerId, placeOf(event, canvas));
  };
  const move = (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = [...fingers.values()], old = fingers.get(event.pointerId), now = placeOf(event, canvas);
    fingers.set(event.pointerId, now);
    moved += gap(now, old);
    if (fingers.size === 2) pinch(player, panel, before, [...fingers.values()]);
    else if (moved > STILL) player.pan(panel, now[0] - old[0], now[1] - old[1]);
  };
  const up = (event) => {
    const clicked = fingers.delete(event.pointerId) && event.type === "pointerup" && moved <= STILL;
    if (clicked) player.pick(panel, ...placeOf(event, canvas));
  };
  const wheel = (event) => {
    event.preventDefault();
    const notch = Math.max(-60, Math.min(60, event.deltaY));
    player.zoom(Math.exp(-notch / 250), panel, ...placeOf(event, canvas));
  };
  canvas.addEventListener("pointerdown", down);
  canvas.addEventListener("pointermove", move);
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("wheel", wheel, { passive: false });
}

function placeOf(event, canvas) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

const gap = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

function pinch(player, panel, [a, b], [c, d]) {
  const X = (c[0] + d[0]) / 2, Y = (c[1] + d[1]) / 2;
  if (player.camera.mode === "free") player.pan(panel, X - (a[0] + b[0]) / 2, Y - (a[1] + b[1]) / 2);
  player.zoom(gap(c, d) / Math.max(gap(a, b), 1), panel, X, Y);
}

/** Keys, each with what it does, go to the player that has the focus, or to the first of the page where nothing
    has. */
function listenToKeys(player, actionsOf) {
  const { root } = player;
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    const free = target === document.body && document.querySelector(".gmr") === root;
    if (!(root.contains(target) || free) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (target.closest("input, select") && /^(Arrow|Home|End)/.test(key)) return;
    if (target.closest("button") && (key === " " || key === "Enter")) return;
    const act = actionsOf(player)[key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

function actionsOf(player) {
  const { t } = player.show;
  return {
    " ": () => player.toggle(),
    ArrowLeft: () => player.go(t - 1),
    ArrowRight: () => player.go(t + 1),
    Home: () => player.go(0),
    End: () => player.go(player.episode.last),
    ",": () => player.stageStep(-1),
    ".": () => player.stageStep(1),
    "+": () => player.zoom(ZOOM),
    "=": () => player.zoom(ZOOM),
    "-": () => player.zoom(1 / ZOOM),
    f: () => player.look("whole"),
    t: () => player.turn("truth"),
    o: () => player.turn("origin"),
    ...(player.episode.traced && { m: () => player.turn("merges"), l: () => player.turn("lines") }),
    n: () => player.selectNext(),
    "?": () => player.toggleHelp(),
    Escape: () => player.escape(),
  };
}
