// What lies below a scan: lines of metres, or the ranges and bearings of a radar.

/** Lines of metres, or range rings and bearings of a radar, with labels at the edges. */
function drawGround(plane, ink, radar) {
  const { ctx } = plane;
  ctx.globalAlpha = 1;
  ctx.lineWidth = 1;
  ctx.strokeStyle = ink.grid;
  ctx.fillStyle = ink.faint;
  ctx.font = ink.small;
  ctx.textAlign = "left";
  ctx.textBaseline = "bottom";
  if (radar) drawRings(plane, ink);
  else drawGrid(plane);
}

/** A length in words, exact to the step. */
function metres(value, step) {
  if (value === 0) return "0";
  if (step >= 1000) return `${+(value / 1000).toFixed(3)} km`;
  return `${+value.toFixed(Math.max(0, -Math.floor(Math.log10(step))))} m`;
}

function drawGrid(plane) {
  const { ctx, width, height } = plane;
  const step = niceStep(90 / plane.scale);
  for (let i = Math.ceil(plane.x(0) / step); i * step < plane.x(width); i++) {
    const X = Math.round(plane.X(i * step)) + 0.5;
    stroke(ctx, X, 0, X, height);
    if (X > 44 && X < width - 44) ctx.fillText(metres(i * step, step), X + 3, height - 2);
  }
  for (let i = Math.ceil(plane.y(height) / step); i * step < plane.y(0); i++) {
    const Y = Math.round(plane.Y(i * step)) + 0.5;
    stroke(ctx, 0, Y, width, Y);
    if (Y > 20 && Y < height - 20) ctx.fillText(metres(i * step, step), 4, Y - 2);
  }
}

function stroke(ctx, X0, Y0, X1, Y1) {
  ctx.beginPath();
  ctx.moveTo(X0, Y0);
  ctx.lineTo(X1, Y1);
  ctx.stroke();
}

const RADIANS = Math.PI / 180;

/** The part of the radar's range and bearing in view, cut into rings and rays: exact at any zoom. */
function drawRings(plane, ink) {
  const { ctx } = plane;
  const box = polarBox(plane);
  const step = niceStep(90 / plane.scale);
  for (let i = Math.max(1, Math.ceil(box.near / step)); i * step <= box.far; i++) {
    arc(plane, i * step, box.from, box.to);
    labelRing(plane, i * step, box);
  }
  const turn = box.near ? niceAngle(90 / plane.scale / box.far / RADIANS) : 30;
  for (let i = Math.ceil(box.from / RADIANS / turn); i * turn * RADIANS < box.to; i++) {
    const angle = i * turn * RADIANS, x = Math.cos(angle), y = Math.sin(angle);
    plane.line(box.near * x, box.near * y, box.far * x, box.far * y);
    ctx.stroke();
    labelRay(plane, angle, `${+(i * turn).toFixed(3)}°`);
  }
  ctx.fillStyle = ink.ink;
  plane.dot(0, 0, 4);
  ctx.fill();
  if (box.near === 0) ctx.fillText("radar", plane.X(0) + 7, plane.Y(0) + 4);
}

const niceAngle = (least) => [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45].find((step) => step >= least) || 90;

/** Ranges and bearings (radians) between which all that is in view lies. */
function polarBox(plane) {
  const { width, height } = plane;
  const X = plane.X(0), Y = plane.Y(0);
  let far = 0, from = Infinity, to = -Infinity;
  const centre = Math.atan2(plane.y(height / 2), plane.x(width / 2));
  for (const [cornerX, cornerY] of [[0, 0], [width, 0], [0, height], [width, height]]) {
    const x = plane.x(cornerX), y = plane.y(cornerY);
    far = Math.max(far, Math.hypot(x, y));
    const off = Math.atan2(Math.sin(Math.atan2(y, x) - centre), Math.cos(Math.atan2(y, x) - centre));
    from = Math.min(from, centre + off);
    to = Math.max(to, centre + off);
  }
  const outX = Math.max(-X, X - width, 0), outY = Math.max(-Y, Y - height, 0);
  const near = Math.hypot(outX, outY) / plane.scale;
  return near > 0 ? { near, far, from, to } : { near, far, from: -Math.PI, to: Math.PI };
}

function arc(plane, radius, from, to) {
  plane.ctx.beginPath();
  for (let i = 0; i <= 96; i++) {
    const angle = mix(from, to, i / 96);
    plane.ctx.lineTo(plane.X(radius * Math.cos(angle)), plane.Y(radius * Math.sin(angle)));
  }
  plane.ctx.stroke();
}

const inView = ({ width, height }, X, Y) => X > 4 && X < width - 44 && Y > 40 && Y < height - 6;

/** A ring's range beside it, off the middle of the view where it can be. */
function labelRing(plane, radius, { from, to }) {
  for (const part of [0.25, 0.75, 0.35, 0.65, 0.5]) {
    const angle = mix(from, to, part);
    const X = plane.X(radius * Math.cos(angle)), Y = plane.Y(radius * Math.sin(angle));
    if (inView(plane, X, Y)) return plane.ctx.fillText(metres(radius, radius), X + 4, Y);
  }
}

/** A bearing where its ray leaves the view. */
function labelRay(plane, angle, text) {
  const { width, height } = plane, X = plane.X(0), Y = plane.Y(0);
  const dX = Math.cos(angle), dY = -Math.sin(angle);
  const far = Math.min(((dX > 0 ? width - 34 : 6) - X) / dX, ((dY > 0 ? height - 4 : 18) - Y) / dY);
  if (far > 0) plane.ctx.fillText(text, X + far * dX + 3, Y + far * dY);
}

const OVERVIEW = 84; // px, the longer side of the small map of the whole path

/** The whole path in a corner, with what is in view framed, where that is a small part of it. */
function drawOverview({ plane, ink, episode, tracker }, { t, truth }) {
  const [left, low, right, high] = episode.box, { ctx, width, height } = plane;
  const across = right - left, up = high - low;
  if (plane.scale < 1.5 * Math.min(width / across, height / up) || height < 260) return;
  const small = OVERVIEW / Math.max(across, up), X = width - 12 - across * small, Y = 12;
  const corner = { x: plane.x(0), y: plane.y(0) }, part = small / plane.scale;
  const before = { left: plane.left, top: plane.top, scale: plane.scale };
  ctx.save();
  paper(plane, ink, X - 8, Y - 8, across * small + 16, up * small + 16);
  Object.assign(plane, { left: X - left * small, top: Y + high * small, scale: small });
  ctx.strokeStyle = truth ? ink.truth : ink.estimate;
  if (truth) plane.path(episode.truth, episode.last);
  ctx.globalAlpha = 0.35;
  if (truth) ctx.stroke();
  ctx.globalAlpha = 1;
  plane.path(truth ? episode.truth : tracker.estimate, t);
  ctx.stroke();
  ctx.strokeStyle = ink.ink;
  ctx.strokeRect(plane.X(corner.x), plane.Y(corner.y), width * part, height * part);
  ctx.restore();
  Object.assign(plane, before);
}

/** A clear rectangle with a thin edge, out of which nothing is drawn. */
function paper({ ctx }, ink, X, Y, width, height) {
  ctx.beginPath();
  ctx.rect(X, Y, width, height);
  ctx.globalAlpha = 0.85;
  ctx.fillStyle = ink.paper;
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.lineWidth = 1;
  ctx.strokeStyle = ink.gates;
  ctx.stroke();
  ctx.clip();
}
