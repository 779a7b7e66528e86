// The page itself: sliders, what follows from them, and the drawings.

const model = JSON.parse(document.getElementById("data").textContent);
const PLACES = 33, BUDGET = 9;  // places along the motion; milliseconds a frame for them while something is dragged
const $ = (id) => document.getElementById(id);
model.points.unshift({ name: "", joint: model.payload.joint, position: model.payload.unit.first, force: [0, 0, 0] });
const JOINTS = model.joints.length, first = firstState(model);
let state = stateOf(model, first, location.hash.slice(1));
let here = null, atFirst = null, queued = false, dirty = true, quiet = 0, clock = 0;
let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
let places = [], cursor = 0, response = null;

// ---- sliders

const sliders = [];

function slider(parent, words, range, { read, write, show, value, bands }) {
  const box = document.createElement("div"), label = document.createElement("label");
  const input = document.createElement("input"), output = document.createElement("output");
  box.className = "slider";
  input.id = `slider-${sliders.length}`;
  Object.assign(input, { type: "range", min: range[0], max: range[1], step: range[2] });
  label.htmlFor = output.htmlFor = input.id;
  label.textContent = words;
  box.append(label, output, input);
  if (bands !== undefined) box.append(scaleOf(range, bands));
  parent.append(box);
  input.addEventListener("input", () => { write(value ? value(Number(input.value)) : Number(input.value)); changed(); });
  sliders.push(() => {
    input.value = read();
    output.textContent = show();
    input.setAttribute("aria-valuetext", show());
  });
  return input;
}

// The number to begin with as a tick, and a posterior's interval as a bar.
function scaleOf([low, high], band) {
  const scale = document.createElement("div"), at = (x) => `${100 * clamp((x - low) / (high - low), 0, 1)}%`;
  scale.className = "scale";
  scale.setAttribute("aria-hidden", "true");
  if (band) {
    const bar = document.createElement("i");
    bar.style.left = at(band[0]);
    bar.style.width = `calc(${at(band[1])} - ${at(band[0])})`;
    scale.append(bar);
  }
  const tick = document.createElement("b");
  tick.style.left = at(0);
  scale.append(tick);
  return scale;
}

function stiffnessSlider(parent, j, f) {
  const own = first.k[j][f], range = Math.log2(SPAN), band = model.joints[j].bands[f];
  slider(parent, f ? "torsion" : "bending", [-range, range, 0.01], {
    read: () => Math.log2(state.k[j][f] / own),
    value: (x) => (Math.abs(x) < 1e-9 ? own : Number((own * 2 ** x).toPrecision(6))),
    write: (x) => { state.k[j][f] = x; },
    show: () => `${engineering(state.k[j][f] / model.unit.size)} ${model.unit.name} (× ${(state.k[j][f] / own).toFixed(2)})`,
    bands: band && band.map((x) => Math.log2(x / own)),
  });
}

function engineering(x) {
  const power = 3 * Math.floor(Math.log10(x) / 3);
  return `${Number((x / 10 ** power).toPrecision(4))}${power ? `e${power}` : ""}`;
}

function makeSliders() {
  const motion = $("motion"), { payload, stroke } = model;
  if (stroke) {
    const [from, to] = strokeEnds(stroke), low = Math.min(from, to), high = Math.max(from, to);
    slider(motion, "place on the stroke (alpha)", [low, high, 0.5], {
      read: () => state.place, write: (x) => { state.place = x; }, show: () => `${fixed(state.place, 1)} deg`,
    });
    slider(motion, "speed", [...SPEEDS, 0.5], {
      read: () => state.speed, write: (x) => { state.speed = x; }, show: () => `${short(state.speed)} % of full speed`,
    });
  } else {
    model.joints.filter((joint) => joint.driven).forEach((joint, i) => slider(motion, joint.name, [...joint.limits_deg, 0.5], {
      read: () => state.q[i], write: (x) => { state.q[i] = x; }, show: () => `${fixed(state.q[i], 1)} deg`,
    }));
  }
  slider(motion, payload.kind === "payload" ? `mass of ${payload.name}` : `mass at ${payload.name}`, [0, payload.largest, payload.largest / 200], {
    read: () => state.mass, write: (x) => { state.mass = round(x); }, show: () => `${short(state.mass)} kg`,
  });
  model.joints.forEach((joint, j) => {
    const group = document.createElement("fieldset"), legend = document.createElement("legend");
    legend.textContent = `Stiffness of ${joint.name}`;
    group.append(legend);
    $("controls").append(group);
    stiffnessSlider(group, j, 0);
    stiffnessSlider(group, j, 1);
  });
  if (model.joints.some((joint) => joint.bands.some(Boolean))) {
    const note = document.createElement("p");
    note.className = "note";
    note.textContent = "Bar below a slider: 5 to 95 % of the posterior; tick: the value to begin with.";
    $("controls").append(note);
  }
}

// ---- measured values

const sameAngles = (a, b) => a.every((x, i) => Math.abs(x - b[i]) < 0.05);

// Where on the horizontal axis of the diagram a posture lies; null beside it.
function placeOf(posture) {
  if (!model.stroke) {
    const others = posture.map((x, i) => (i === state.sweep ? state.q[i] : x));
    return sameAngles(others, state.q) ? posture[state.sweep] : null;
  }
  const { direction } = model.stroke;
  const share = direction.reduce((sum, d, i) => sum + d * posture[i], 0) / direction.reduce((sum, d) => sum + d * d, 0);
  return sameAngles(direction.map((d) => d * share), posture) ? round(share) : null;
}

const visits = [];

function makeVisits() {
  const select = $("measured"), head = document.createElement("option"), known = new Set();
  head.textContent = "go to a measured posture …";
  select.append(head);
  for (const reading of model.readings) {
    const place = model.stroke ? placeOf(reading.posture_deg) : 0, name = JSON.stringify([reading.posture_deg, reading.load]);
    if (reading.mass === null || place === null || known.has(name)) continue;
    known.add(name);
    visits.push({ place, q: reading.posture_deg, mass: reading.mass });
    const option = document.createElement("option");
    option.textContent = `${reading.posture_deg.map((x) => short(x)).join(", ")} deg, ${reading.load}`;
    select.append(option);
  }
  select.hidden = !visits.length;
  select.addEventListener("change", () => {
    const visit = visits[select.selectedIndex - 1];
    if (!visit) return;
    if (model.stroke) state.place = visit.place; else state.q = visit.q.map(round);
    state.mass = visit.mass;
    changed();
  });
}

const readingsHere = (kind) => model.readings.filter((r) => (
  r.kind === kind && r.mass !== null && Math.abs(r.mass - state.mass) < 1e-6 && sameAngles(r.posture_deg, angles(model, state))));

// Which mode a measured label means: the one whose name it is, or the so many-th that it admits.
function modeOf(label, modes, order) {
  if (!label) return order;
  const [, name, ordinal] = label.match(/^(.*?)\s*(\d+)$/) || [];
  const admitted = modes.map((_, i) => i).filter((i) => (name || "").split(/\s+/).every((word) => modes[i].label.includes(word)));
  const exact = modes.findIndex((mode) => mode.label === label);
  return exact >= 0 ? exact : admitted[Number(ordinal) - 1];
}

// ---- what follows from the state

function sweepStates() {
  const ends = model.stroke ? strokeEnds(model.stroke) : model.joints.filter((joint) => joint.driven)[state.sweep].limits_deg;
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
  queued = false;
  if (dirty) {
    dirty = false;
    here = solveAt(model, radians(angles(model, state)), state.mass, state.k, here && here.phi);
    sweepStates().forEach((place, i) => { places[i] = { ...place, stale: true, solved: places[i] && places[i].solved, first: firstOf(places[i], place) }; });
    response = null;
    showNumbers();
  }
  if (places.some((place) => place.stale)) {
    const end = performance.now() + BUDGET;
    do solveNext(); while (performance.now() < end && places.some((place) => place.stale));
    drawCampbell();
    if (!places.some((place) => place.stale)) drawResponse();
  } else if (quiet && now > quiet) {
    quiet = 0;
    settle();
  }
  if (playing) clock = now;
  drawArm();
  if (playing || quiet || places.some((place) => place.stale)) draw();
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
  if (here) { modeRows(); staticRows(); steadyRow(); } else for (const id of ["modes", "static", "steady"]) $(id).replaceChildren();
}

function settle() {
  const fragment = fragmentOf(model, first, state);
  $("command").value = commandsOf(model, first, state);
  try { history.replaceState(null, "", `#${fragment}`); } catch { location.hash = fragment; }
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
  let order = 0;
  for (const reading of [...found].sort((a, b) => a.value - b.value)) {
    const i = modeOf(reading.mode, modes, order);
    if (!reading.mode) order += 1;
    if (i !== undefined) measured[i] = [...(measured[i] || []), reading];
  }
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
      const { direction } = reading, along = direction.findIndex((x) => Math.abs(Math.abs(x) - 1) < 1e-9);
      const words = along < 0 ? `along ${direction.map(short).join(" ")}` : `${direction[along] < 0 ? "-" : ""}${"xyz"[along]}`;
      return `${fixed(1e3 * reading.value, 2)} ± ${short(1e3 * reading.sigma)} (${words})`;
    });
    row.append(cell(point.name, "th"), ...moved.map((x) => cell(fixed(x, 3))), cell(fixed(Math.hypot(...moved), 3)));
    row.append(cell(before ? fixed(before, 3) : "–"), cell(own.join(", ") || "–"));
    return row;
  }));
}

function steadyRow() {
  if (!model.stroke || !model.drives.length) return;
  const { rates, signs } = driveRates(model, state.place * DEGREE, state.speed);
  const row = document.createElement("tr"), size = steadyResponse(here, rates, signs);
  row.append(cell(model.points[model.points.length - 1].name, "th"), ...size.map((x) => cell(short(1e3 * x))));
  $("steady").replaceChildren(row);
}
