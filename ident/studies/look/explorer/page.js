// The page itself: its state, what follows from it frame by frame, and its numbers.

const model = JSON.parse(document.getElementById("data").textContent);
const PLACES = model.joints.length > 8 ? 17 : 33, BUDGET = [3, 12], SLOW_FRAME = 30, PAUSE = 150;  // places along the motion; milliseconds a frame for them, at least and at most; a frame that is too slow; between drawings of the response
const MOST_READ = 30;
const $ = (id) => document.getElementById(id);
model.points.unshift({ name: "", joint: model.payload.joint, position: model.payload.unit.first, force: [0, 0, 0] });
const WITHIN = window.parent !== window;  // in another page's frame, whose address is not this one's to change
const JOINTS = model.joints.length, first = firstState(model);
let state = stateOf(model, first, location.hash.slice(1));
let here = null, atFirst = null, queued = false, dirty = true, quiet = 0, clock = 0;
let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
let budget = BUDGET[1], shown = 0, places = [], cursor = 0, renewed = "", worst = null, late = true, responded = 0;

// ---- what follows from the state

function sweepStates() {
  const ends = model.stroke ? strokeEnds(model.stroke).sort((a, b) => a - b) : model.joints.filter((joint) => joint.driven)[state.sweep].limits_deg;
  return Array.from({ length: PLACES }, (_, i) => {
    const x = ends[0] + (ends[1] - ends[0]) * i / (PLACES - 1);
    const q = model.stroke ? model.stroke.direction.map((d) => d * x) : state.q.map((own, j) => (j === state.sweep ? x : own));
    return { x, alpha: x * DEGREE, q: radians(q) };
  });
}

function changed() {
  dirty = true;
  quiet = performance.now() + 400;
  draw();
}

function draw() {
  if (!queued) { queued = true; requestAnimationFrame(frame); }
}

function frame(now) {
  const begun = performance.now();
  queued = false;
  budget = clamp(now - shown > SLOW_FRAME ? budget / 2 : budget * 1.1, ...BUDGET);  // a slow machine lets the diagram lag, not the arm
  shown = now;
  if (dirty) {
    dirty = false;
    late = true;
    here = solveAt(model, radians(angles(model, state)), state.mass, state.k, here && here.phi);
    renewPlaces();
    showNumbers();
  }
  if (stale()) {
    do solveNext(); while (stale() && performance.now() - begun < budget);
    drawCampbell();
  }
  if (late && !stale() && (now > quiet || now > responded + PAUSE)) {
    late = false;
    responded = now;
    drawResponse();
  }
  if (quiet && now > quiet && !stale()) {
    quiet = 0;
    settle();
  }
  if (playing) clock = now;
  drawArm();
  if (playing || quiet || late || stale()) draw();
}

const stale = () => places.some((place) => place.stale);

// Places are computed again where something has changed that their modes depend on: not by speed or along the stroke.
function renewPlaces() {
  const cause = JSON.stringify([state.k, state.mass, state.sweep, state.q && state.q.filter((_, i) => i !== state.sweep)]);
  if (cause !== renewed) {
    renewed = cause;
    worst = null;
    places = sweepStates().map((place, i) => {
      const old = places[i];
      return { ...place, stale: true, solved: old && old.solved, first: firstOf(old, place) };
    });
  } else drawCampbell();
}

const firstOf = (before, place) => (before && sameAngles(before.q, place.q) && before.first) || null;

// The next place along the motion whose modes are of an earlier state.
function solveNext() {
  while (!places[cursor % PLACES].stale) cursor += 1;
  const place = places[cursor % PLACES];
  place.solved = solveAt(model, place.q, state.mass, state.k, place.solved && place.solved.phi);
  if (!place.first) place.first = firstFrequencies(place.q);
  place.stale = false;
  cursor += 1;
}

function firstFrequencies(q) {
  const solved = solveAt(model, q, first.mass, first.k);
  return solved ? solved.modes.slice(0, MODES_SHOWN).map((mode) => mode.frequency) : [];
}

// ---- numbers

function showNumbers() {
  sliders.forEach((show) => show());
  $("collapsed").hidden = Boolean(here);
  const q = radians(angles(model, state));
  if (!atFirst || String(atFirst.q) !== String(q)) atFirst = solveAt(model, q, first.mass, first.k);
  $("brief").textContent = here ? briefly() : "";
  if (here) { modeRows(); staticRows(); readRows(); steadyRow(); } else for (const id of ["modes", "static", "read", "steady"]) $(id).replaceChildren();
}

function settle() {
  const fragment = fragmentOf(model, first, state);
  $("command").value = commandsOf(model, first, state);
  if (!WITHIN) try { history.replaceState(null, "", `#${fragment}`); } catch { location.hash = fragment; }
  if (!here) { $("spoken").textContent = ""; return; }
  $("spoken").textContent = briefly();
}

function briefly() {
  const lowest = here.modes.slice(0, 2).map((mode) => `${mode.label} ${significant(mode.frequency, 4)} Hz`);
  const end = model.points.length - 1, size = Math.hypot(...deflectionOf(here, end));
  const where = `(${angles(model, state).map(short).join(", ")}) deg`;
  return `${where}: ${lowest.join(", ")}; ${model.points[end].name} deflects by ${fixed(1e3 * size, 1)} mm`;
}

const cell = (text, kind = "td") => { const node = document.createElement(kind); node.textContent = text; return node; };
const styleOf = (label) => label.split(" ").slice(0, 2).join("-");

function modeRows() {
  const modes = here.modes.slice(0, MODES_SHOWN), body = $("modes"), focused = document.activeElement;
  state.mode = Math.min(state.mode, modes.length - 1);
  const found = readingsHere("frequency"), measured = {};
  const same = atFirst && alike(here, atFirst);
  for (const reading of found.filter((each) => each.mode)) {
    const i = modeOf(reading.mode, modes);
    if (i !== undefined) measured[i] = [...(measured[i] || []), reading];
  }
  const free = modes.map((_, i) => i).filter((i) => !measured[i]);  // as a fit takes values without a label: the lowest modes left, in order
  found.filter((each) => !each.mode).sort((a, b) => a.value - b.value).forEach((reading, order) => {
    if (order < free.length) measured[free[order]] = [reading];
  });
  while (body.rows.length > modes.length) body.lastChild.remove();
  while (body.rows.length < modes.length) body.append(modeRow(body.rows.length));
  modes.forEach((mode, i) => {
    const row = body.rows[i], before = atFirst && atFirst.modes[same[i]].frequency, radio = row.querySelector("input");
    radio.checked = i === state.mode;
    row.querySelector("span.name").textContent = mode.label + (mode.unsure ? " (?)" : "");
    row.querySelector("span.swatch").className = `swatch c-${styleOf(mode.label)}`;
    const values = [
      mode.frequency.toFixed(4), before ? before.toFixed(4) : "–",
      before ? `${fixed(100 * (mode.frequency / before - 1), 1)} %` : "–",
      (measured[i] || []).map((r) => `${significant(r.value, 4)} ± ${short(r.sigma)}`).join(", ") || "–",
      `${fixed(100 * dampingRatio(here, i), 2)} %`,
    ];
    values.forEach((text, c) => { row.cells[c + 1].textContent = text; });
  });
  if (focused && body.contains(focused)) focused.focus();
}

function modeRow(i) {
  const row = document.createElement("tr"), head = document.createElement("th"), label = document.createElement("label");
  const radio = document.createElement("input"), swatch = document.createElement("span"), name = document.createElement("span");
  Object.assign(radio, { type: "radio", name: "mode" });
  radio.addEventListener("change", () => { state.mode = i; changed(); });
  swatch.setAttribute("aria-hidden", "true");
  swatch.className = "swatch";
  name.className = "name";
  head.scope = "row";
  label.append(radio, swatch, name);
  head.append(label);
  row.append(head, ...Array.from({ length: 5 }, () => cell("")));
  return row;
}

const deflectionOf = (solved, p) => minus(solved.line[JOINTS + p], solved.rigid[JOINTS + p]);

function staticRows() {
  const found = readingsHere("deflection");
  $("static").replaceChildren(...model.points.slice(1).map((point, i) => {
    const moved = scale(deflectionOf(here, i + 1), 1e3), row = document.createElement("tr");
    const before = atFirst && Math.hypot(...deflectionOf(atFirst, i + 1)) * 1e3;
    const own = found.filter((reading) => reading.point === point.name).map((reading) => {
      const words = directionWords(reading.direction);
      return `${measuredValue(reading)} (${words.includes(" ") ? `along ${words}` : words})`;
    });
    row.append(cell(point.name, "th"), ...moved.map((x) => cell(fixed(x, 3))), cell(fixed(Math.hypot(...moved), 3)));
    row.append(cell(before ? fixed(before, 3) : "–"), cell(own.join(", ") || "–"));
    return row;
  }));
}

const measuredValue = (reading) => `${fixed(1e3 * reading.value, 2)} ± ${short(1e3 * reading.sigma)}`;

// What was read here besides: rotations, twists, differences, and deflections under other loads than the page's.
function readRows() {
  const shownAbove = new Set(readingsHere("deflection"));
  const found = model.readings.filter((reading) => (
    reading.loads && reading.kind !== "frequency" && !shownAbove.has(reading) && sameAngles(reading.posture_deg, angles(model, state))));
  $("read-part").hidden = !found.length;
  $("read").replaceChildren(...found.slice(0, MOST_READ).map((reading) => {
    const row = document.createElement("tr"), [what, loads] = readingWords(reading), head = cell(what, "th"), under = document.createElement("div");
    under.className = "soft";
    under.textContent = loads;
    head.append(under);
    const computed = [state.k, first.k].map((k) => readingAt(model, reading, k)).map((x) => (x === null ? "–" : fixed(1e3 * x, 3)));
    row.append(head, ...computed.map((x) => cell(x)), cell(measuredValue(reading)), cell(isLength(reading) ? "mm" : "mrad"));
    return row;
  }));
  $("read-more").textContent = found.length > MOST_READ ? `and ${found.length - MOST_READ} more` : "";
}

function steadyRow() {
  if (!model.stroke || !model.drives.length) return;
  const { rates, signs } = driveRates(model, state.place * DEGREE, state.speed);
  const row = document.createElement("tr"), size = steadyResponse(here, rates, signs);
  const still = rates.every((rate) => !(rate > 0)) ? ", the pulleys at rest" : "";
  row.append(cell(model.points[model.points.length - 1].name + still, "th"), ...size.map((x) => cell(short(1e3 * x))));
  $("steady").replaceChildren(row);
}
