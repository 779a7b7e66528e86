// The pictures: arm and mode, natural frequencies along the motion, steady response by speed; and how it all begins.

const STYLES = ["vertical-bending", "lateral-torsion", "lateral-bending", "vertical-torsion"];
const HEIGHT = 300, SWING = 0.07, SLOW = 0.6;  // pixels; swing of a mode as a share of the arm; cycles a second
let top4 = 0, box = null;

// ---- the arm

function drawArm() {
  if (!here || !box) { for (const id of ["side", "above"]) $(id).replaceChildren(); return; }
  const mode = here.modes[state.mode], style = styleOf(mode.label), rest = arm(here.line);
  const reach = Math.max(...[0, 1].map((i) => box.high[i] - box.low[i])), largest = Math.max(...arm(mode.motion).map((v) => Math.hypot(...v)));
  const phase = playing ? Math.sin(2 * Math.PI * SLOW * clock / 1000) : 1, size = SWING * reach / largest * phase;
  const swung = rest.map((p, i) => add(p, scale(arm(mode.motion)[i], size)));
  const carried = here.line[JOINTS];
  const load = state.mass > 0 ? { at: carried, size: 6 + 10 * state.mass / model.payload.largest } : null;
  const factor = sagFactor(reach);
  const sagging = here.rigid.map((p, i) => add(p, scale(minus(here.line[i], p), factor)));
  armViews([$("side"), $("above")], box, [
    { style: "rigid", points: arm(here.rigid), load },
    ...(factor > 1 ? [{ style: "sag", points: arm(sagging), side: true }] : []),
    { style: `${style} chosen`, points: swung, dots: true },
  ]);
  $("side").setAttribute("aria-label", `The arm from the side, and its mode ${mode.label}`);
  $("above").setAttribute("aria-label", `The arm from above, and its mode ${mode.label}`);
  const words = `${style} ${factor} ${mode.label} ${Boolean(load)}`;
  if ($("arm-key").dataset.words === words) return;
  $("arm-key").dataset.words = words;
  const entries = [["rigid", "the arm with rigid joints"], [`${style} chosen`, `${mode.label}, exaggerated, slowed down`]];
  if (factor > 1) entries.push(["sag", `sag, drawn ${factor} times as large`]);
  if (load) entries.push(["rigid load", model.payload.kind === "payload" ? model.payload.name : `mass at ${model.payload.name}`]);
  key($("arm-key"), entries);
}

// Bushings and end point: the line that is drawn.
const arm = (line) => [...line.slice(0, JOINTS), line[line.length - 1]];

// A round factor by which the first sag is drawn, so that it is seen.
function sagFactor(reach) {
  if (!atFirst) return 1;
  const largest = Math.max(...arm(atFirst.line).map((p, i) => Math.hypot(...minus(p, arm(atFirst.rigid)[i]))));
  const wanted = 0.05 * reach / Math.max(largest, 1e-12), power = 10 ** Math.floor(Math.log10(wanted));
  return wanted > 1 && wanted < 1e6 ? power * [5, 2, 1].find((digit) => digit * power <= wanted * 1.0001) : 1;
}

// The corners of all that the arm reaches along the motion, so that the drawing does not jump.
function boxOf() {
  const points = sweepStates().flatMap(({ q }) => arm(forwardLine(q)));
  if (!model.stroke) points.push(...arm(forwardLine(radians(state.q))));
  const low = [0, 1, 2].map((i) => Math.min(...points.map((p) => p[i]))), high = [0, 1, 2].map((i) => Math.max(...points.map((p) => p[i])));
  const space = 0.09 * Math.max(...minus(high, low));
  const tall = Math.max(high[1] - low[1], high[2] - low[2]) > 0.6 * (high[0] - low[0]);
  $("drawings").className = tall ? "beside" : "";
  widths.clear();
  return { low: low.map((x) => x - space), high: high.map((x) => x + space) };
}

function forwardLine(q) {
  const chain = chainAt(model, q, 0, first.k), at = forwardKinematics(chain, chain.joints.map(() => [0, 0, 0]));
  return [...at.map((body) => body.centre), ...pointPositions(chain, at)];
}

// ---- natural frequencies along the motion

function drawCampbell() {
  if (!top4) {
    if (places.some((place) => !place.first)) return;
    const highest = places.flatMap((place) => (place.first || []).slice(3, 4));
    if (!highest.length) return;
    top4 = 1.25 * Math.max(...highest);
  }
  const ends = [places[0].x, places[PLACES - 1].x];
  const sweptName = model.stroke ? "" : model.joints.filter((joint) => joint.driven)[state.sweep].name;
  const [folded, unfolded] = model.stroke ? strokeEnds(model.stroke) : [];
  const words = model.stroke ? `alpha [deg], ${short(unfolded)} unfolded, ${short(folded)} folded` : `${sweptName} [deg]`;
  const { X, Y, inner, bottom } = chart($("campbell"), HEIGHT, { x: ends, y: [0, top4], labels: [words, "frequency [Hz]"] });
  const count = Math.min(MODES_SHOWN, 3 * JOINTS);
  for (let i = 0; i < count; i++) {
    inner.append(svgNode("path", { class: "before", d: pathOf(places.map((p) => (p.first && p.first[i] ? [X(p.x), Y(p.first[i])] : null))) }));
  }
  const shown = new Set();
  for (const style of STYLES) {
    const points = Array.from({ length: count }, (_, i) => segments(i, style)).flatMap((each) => [...each, null]);
    inner.append(svgNode("path", { class: style, d: pathOf(points.map((p) => p && [X(p[0]), Y(p[1])])) }));
    if (points.some((p) => p && p[1] < top4)) shown.add(style);
  }
  const turning = pulleys();
  turning.forEach(({ line }, i) => {
    inner.append(svgNode("path", { class: `pulley d${i % 4}`, d: pathOf(line.map(([x, f]) => [X(x), Y(Math.min(f, 2 * top4))])) }));
  });
  const now = model.stroke ? state.place : state.q[state.sweep];
  inner.append(svgNode("line", { class: "now", x1: X(now), x2: X(now), y1: 0, y2: bottom }));
  const dots = measuredDots(inner, X, Y);
  keyOfCampbell(shown, turning, dots);
}

// Pieces of the i-th mode between neighbouring places at which it has a name; null between pieces.
function segments(i, style) {
  return places.slice(0, -1).flatMap((place, p) => {
    const ends = [place, places[p + 1]];
    if (ends.some((end) => !end.solved) || styleOf(place.solved.modes[i].label) !== style) return [null];
    return [null, ...ends.map((end) => [end.x, end.solved.modes[i].frequency])];
  });
}

let turned = { speed: NaN, lines: [] };

function pulleys() {
  if (turned.speed !== state.speed) turned = { speed: state.speed, lines: pulleyLines() };
  return turned.lines;
}

// Turning frequencies along the stroke at this speed; drives that turn alike are one line.
function pulleyLines() {
  if (!model.stroke) return [];
  const lines = [];
  model.drives.forEach((drive, d) => drive.orders.forEach((order) => {
    const line = places.map((place) => [place.x, order * driveRates(model, place.alpha, state.speed).rates[d] / (2 * Math.PI)]);
    const name = `pulley ${drive.pin + 1}${order !== 1 ? ` × ${order}` : ""}`;
    const same = lines.find((other) => other.line.every(([, f], i) => Math.abs(f - line[i][1]) < 1e-6 * top4));
    if (same) same.name += `, ${name}`; else lines.push({ name, line });
  }));
  return lines;
}

function measuredDots(inner, X, Y) {
  const found = model.readings.filter((r) => (
    r.kind === "frequency" && r.mass !== null && Math.abs(r.mass - state.mass) < 1e-6 && placeOf(r.posture_deg) !== null));
  for (const { posture_deg: posture, value, sigma } of found) {
    const x = X(placeOf(posture));
    inner.append(svgNode("line", { class: "measured", x1: x, x2: x, y1: Y(value - 2 * sigma), y2: Y(value + 2 * sigma) }));
    inner.append(svgNode("circle", { class: "measured", cx: x, cy: Y(value), r: 4 }));
  }
  return found.length;
}

function keyOfCampbell(shown, turning, dots) {
  const entries = [...shown].map((style) => [style, style.replace("-", " ")]);
  entries.push(["before", "as given"]);
  turning.forEach(({ name }, i) => entries.push([`pulley d${i % 4}`, `${name} at ${short(state.speed)} %`]));
  if (dots) entries.push(["measured", "measured, ± 2 std. errors"]);
  entries.push(["now", "this posture"]);
  const words = JSON.stringify(entries);
  if ($("campbell-key").dataset.words === words) return;
  $("campbell-key").dataset.words = words;
  key($("campbell-key"), entries);
}

// ---- steady response by speed

function drawResponse() {
  if (!model.stroke || !model.drives.length) return;
  worst = worst || logSpaced(40).map((speed) => [speed, worstOnStroke(model, places, speed)]);
  const own = responseHere(), speeds = worst.map(([speed]) => speed), values = worst.map(([, size]) => size);
  const envelope = own.map(([speed, size]) => [speed, Math.max(size, interpolate(speeds, values, speed))]);
  const sizes = envelope.map(([, size]) => 1e3 * size).filter((size) => size > 0);
  if (!sizes.length) { $("response").replaceChildren(); return; }
  const most = 10 ** Math.ceil(Math.log10(Math.max(...sizes)));
  const labels = ["speed [% of full speed]", "largest of x, y, z [mm]"];
  const { X, Y, inner, bottom } = chart($("response"), HEIGHT, { x: SPEEDS, y: [most / 1e4, most], log: true, labels });
  const path = (line) => pathOf(line.map(([speed, size]) => (size > 0 ? [X(speed), Y(Math.max(1e3 * size, most / 1e5))] : null)));
  inner.append(svgNode("path", { class: "worst", d: path(envelope) }));
  inner.append(svgNode("path", { class: "here", d: path(own) }));
  inner.append(svgNode("line", { class: "now", x1: X(state.speed), x2: X(state.speed), y1: 0, y2: bottom }));
  if (!$("response-key").children.length) {
    key($("response-key"), [["here", "held in this posture"], ["worst", "in the worst posture of the stroke"], ["now", "this speed"]]);
  }
}

const logSpaced = (count) => Array.from({ length: count }, (_, i) => SPEEDS[0] * (SPEEDS[1] / SPEEDS[0]) ** (i / (count - 1)));

// Amplitude at this posture by speed, with more speeds about each resonance.
function responseHere() {
  if (!here) return [];
  const alpha = state.place * DEGREE, full = driveRates(model, alpha, 100), speeds = logSpaced(120);
  full.rates.forEach((rate) => here.modes.slice(0, MODES_SHOWN).forEach(({ omega, damping }) => {
    const peak = 100 * omega / rate;
    for (let i = -4; i <= 4; i++) speeds.push(peak * (1 + i * Math.abs(i) * damping / 3));
  }));
  const within = speeds.filter((speed) => speed >= SPEEDS[0] && speed <= SPEEDS[1]).sort((a, b) => a - b);
  return within.map((speed) => {
    const { rates, signs } = driveRates(model, alpha, speed);
    return [speed, Math.max(...steadyResponse(here, rates, signs))];
  });
}

// ---- buttons, and the beginning

function listen() {
  $("reset").addEventListener("click", () => { state = copyOf(first); $("measured").selectedIndex = 0; box = boxOf(); changed(); });
  const play = $("play");
  const name = () => { play.textContent = playing ? "Pause" : "Play"; };
  play.addEventListener("click", () => { playing = !playing; name(); draw(); });
  name();
  $("copy").addEventListener("click", () => copy($("command").value));
  $("copy-link").addEventListener("click", () => copy(location.href));
  $("copy-link").hidden = WITHIN;
  $("controls").addEventListener("submit", (event) => event.preventDefault());
  addEventListener("hashchange", () => {
    if (location.hash.slice(1) === fragmentOf(model, first, state)) return;
    state = stateOf(model, first, location.hash.slice(1));
    changed();
  });
  addEventListener("resize", redraw);
  addEventListener("beforeprint", () => { clock = 250 / SLOW; printing = true; redraw(); });  // a mode at its widest
  addEventListener("afterprint", () => { printing = false; redraw(); });
}

function redraw() {
  widths.clear();
  drawCampbell();
  drawResponse();
  drawArm();
}

async function copy(text) {
  let done = true;
  try { await navigator.clipboard.writeText(text); } catch { done = false; $("command").select(); }
  $("copied").textContent = done ? "copied" : "not allowed here: select the text and copy it";
}

function begin() {
  for (const node of document.querySelectorAll(".end-name")) node.textContent = model.points[model.points.length - 1].name;
  if (!model.stroke) {
    $("along").textContent = "one joint";
    $("sweep-row").hidden = false;
    model.joints.filter((joint) => joint.driven).forEach((joint, i) => {
      const option = document.createElement("option");
      option.textContent = joint.name;
      option.selected = i === state.sweep;
      $("sweep").append(option);
    });
    $("sweep").addEventListener("change", () => { state.sweep = $("sweep").selectedIndex; box = boxOf(); changed(); });
  }
  if (!model.stroke || !model.drives.length) {
    $("response-section").hidden = true;
    $("campbell-section").className = "whole";
  }
  makeSliders();
  makeVisits();
  listen();
  box = boxOf();
  changed();
}

begin();
// For the console and the tests: what the page computes, in SI; angles in degrees.
window.explorer = {
  model, driveRates, steadyResponse, dampingRatio,
  state: () => copyOf(state),
  numbers: () => here,
  worst: (speed) => worstOnStroke(model, places, speed),
  read: (k = first.k) => model.readings.map((reading) => (reading.loads && reading.kind !== "frequency" ? readingAt(model, reading, k) : null)),
  at: (degrees, mass, k = first.k) => solveAt(model, radians(degrees), mass, k),
};
