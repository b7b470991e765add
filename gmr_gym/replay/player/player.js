// The player: what is shown, and how it changes in time and by hand.

const SLOW = 2; // scans a second up to which the reduction is animated

/** One recording in one element. `show` is what the panels draw: scan t, the phase of its transition (1 after
    the reduction), the share of the way that the view has gone from the scan before, what is turned on, and
    what is selected. */
class Player extends Frame {
  constructor(root, episode) {
    super(root);
    Object.assign(this, { episode, speed: episode.traced ? 0.5 : 5 });
    this.show = {
      t: 0, phase: 1, way: 1, chosen: null,
      truth: true, origin: false, lines: false, merges: episode.traced,
    };
    this.camera = new Camera(episode);
    this.panels = episode.trackers.map((tracker, i) => new Panel(episode, tracker, i));
    this.strips = chartsOf(episode, (t) => this.go(t));
    this.pieces = build(this);
    this.open(actionsOf);
  }

  // ---- look of the page

  resize() {
    const { plane } = this.panels[0];
    this.layOut();
    const side = Math.min(plane.width, plane.height), first = !this.camera.side;
    if (!side) return; // hidden
    this.camera.resize(side);
    if (first) this.look(this.episode.many ? "whole" : "both", true);
    this.dye();
  }

  escape() {
    this.pieces.help.hidden = true;
    this.choose(null);
  }

  // ---- view

  look(mode, atOnce = false) {
    const { camera, show, episode } = this, [{ plane, tracker, where }] = this.panels;
    const change = () => {
      const box = boxOf(episode, tracker, mode, show.t);
      if (box) return camera.fit(box, plane.width, plane.height);
      if (mode === "free") camera.stay(where);
      else if (camera.mode === "free") camera.scale = closeScale(tracker, camera.side);
      camera.mode = mode;
    };
    camera.glide(change, tracker, show.t, atOnce || this.calm.matches);
    this.pieces.views.value = mode;
    this.wake();
  }

  zoom(factor, { plane } = this.panels[0], X = plane.width / 2, Y = plane.height / 2) {
    const { camera } = this, { where } = this.panels[0];
    // a view that has widened by itself would widen again
    if (camera.mode === "both" && where.scale < 0.99 * camera.scale) this.free(this.panels[0]);
    camera.zoom(factor, X - plane.width / 2, Y - plane.height / 2);
    this.wake();
  }

  pan(panel, dX, dY) {
    if (this.camera.mode !== "free") this.free(panel);
    this.camera.pan(dX, dY);
    this.pieces.views.value = "free";
    this.wake();
  }

  /** Follow nothing: look where this panel looks. */
  free({ where }) {
    this.camera.stay(where);
    this.pieces.views.value = "free";
  }

  /** Turn something on or off. */
  turn(key) {
    this.show[key] = !this.show[key];
    this.pieces.switches[key].setAttribute("aria-pressed", this.show[key]);
    if (key === "merges") Object.assign(this.show, { phase: 1, way: 1 });
    this.wake();
  }

  // ---- selection

  pick(panel, X, Y) {
    const found = hit(panel, this.show, X, Y);
    this.choose(found && selection(panel, this.show.t, found));
  }

  /** Select the heaviest hypothesis kept, or the next lighter one than that selected. */
  selectNext() {
    const { chosen, t } = this.show, panel = chosen ? chosen.panel : this.panels[0];
    const rows = rowsWhere(panel.tracker.kept, t, () => true);
    const i = rows[(chosen && chosen.kind === "kept" ? rows.indexOf(chosen.i) + 1 : 0) % rows.length];
    if (rows.length) this.choose(selection(panel, t, { kind: "kept", i }));
  }

  choose(chosen) {
    const go = (t, i) => {
      this.go(t);
      this.choose(selection(chosen.panel, t, { kind: "kept", i }));
    };
    this.show.chosen = chosen;
    this.tell(chosen ? describe(this.episode, chosen, go) : [], chosen && chosen.panel);
    this.wake();
  }

  /** What is selected belongs to a scan, and ends with it. */
  leave() {
    if (this.show.chosen && this.show.chosen.t !== this.show.t) this.choose(null);
  }

  // ---- time

  /** Show scan t after its reduction. */
  go(t) {
    this.pause();
    Object.assign(this.show, { t: Math.max(0, Math.min(this.episode.last, t)), phase: 1, way: 1 });
    this.leave();
    this.wake();
  }

  /** Show this scan at a phase of its transition. */
  stand(phase) {
    this.pause();
    Object.assign(this.show, { phase, way: during(phase, 0, STAGES[0].until) });
    this.wake();
  }

  /** Go to the end of the next stage, or of the one before. */
  stageStep(by) {
    const { t, phase } = this.show, stage = stageAt(phase) + by;
    if (!this.episode.traced || stage < 0) return this.go(t + by);
    if (stage < STAGES.length) return this.stand(STAGES[stage].until);
    if (t === this.episode.last) return;
    this.go(t + 1);
    this.stand(STAGES[0].until);
  }

  toggle() {
    if (this.playing) return this.pause();
    // the end of a scan is the beginning of the next
    if (this.show.t === this.episode.last && this.show.phase === 1) this.show.t = -1;
    this.play(true);
  }

  pause() {
    if (!this.playing) return;
    this.play(false);
    if (!this.animated()) this.show.way = 1;
  }

  animated() {
    return this.show.merges && this.speed <= SLOW && !this.calm.matches;
  }

  /** Go on by `scans`: through the phases where they are animated, else from scan to scan. */
  advance(scans) {
    const { show, episode } = this, animated = this.animated();
    let u = (animated ? show.phase : show.way) + scans;
    while (u >= 1 && show.t < episode.last) {
      show.t += 1;
      u -= 1;
    }
    if (u >= 1) this.play(false);
    u = Math.min(u, 1);
    show.phase = animated ? u : 1;
    show.way = animated ? during(u, 0, STAGES[0].until) : u;
    this.leave();
  }

  // ---- frames

  move(seconds) {
    if (this.playing) this.advance(seconds * this.speed);
    return this.camera.settle(seconds) || this.playing;
  }

  draw() {
    if (!this.ink) return; // hidden since the start
    const { show, pieces } = this, stage = stageAt(show.phase);
    for (const panel of this.panels) panel.draw(show, this.camera, this.ink, this.calm.matches);
    for (const strip of this.strips) strip.draw(show.t);
    if (pieces.stage) pieces.stage.value = 1000 * show.phase;
    if (stage !== this.saidStage || show.t !== this.saidScan) this.say(show.t, stage);
  }

  /** Put scan and stage in words and numbers. */
  say(t, stage) {
    const { pieces, episode } = this;
    Object.assign(this, { saidScan: t, saidStage: stage });
    this.root.dataset.scan = t + 1;
    pieces.clock.firstChild.textContent = `scan ${t + 1} of ${episode.scans}`;
    pieces.clock.lastChild.textContent = `, ${+((t + 1) * episode.period).toFixed(2)} s`;
    pieces.time.value = t + 1;
    this.panels.forEach((panel) => panel.say(t, STAGES[stage].name));
    this.strips.forEach((strip) => strip.say(t));
    if (pieces.stage) pieces.stage.setAttribute("aria-valuetext", STAGES[stage].name);
    (pieces.stageNames || []).forEach((node, i) => node.classList.toggle("gmr-now", i === stage));
  }
}
