// Sliders, and measured values to go to.

const sliders = [];

// The joint's limits, or further where the page begins beyond them.
const rangeOf = (joint, i) => [Math.min(joint.limits_deg[0], first.q[i]), Math.max(joint.limits_deg[1], first.q[i])];

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
    if (model.drives.length) slider(motion, "speed", [...SPEEDS, 0.5], {
      read: () => state.speed, write: (x) => { state.speed = x; }, show: () => `${short(state.speed)} % of full speed`,
    });
  } else {
    model.joints.filter((joint) => joint.driven).forEach((joint, i) => slider(motion, joint.name, [...rangeOf(joint, i), 0.5], {
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
    const place = model.stroke ? placeOf(reading.posture_deg) : 0, set = reading.mass !== null, name = JSON.stringify([reading.posture_deg, set && reading.load]);
    if ((!set && !reading.loads) || place === null || known.has(name)) continue;
    known.add(name);
    visits.push({ place, q: reading.posture_deg, mass: reading.mass });
    const option = document.createElement("option");
    option.textContent = `${reading.posture_deg.map((x) => short(x)).join(", ")} deg${set ? `, ${reading.load}` : ""}`;
    select.append(option);
  }
  select.hidden = !visits.length;
  select.addEventListener("change", () => {
    const visit = visits[select.selectedIndex - 1];
    if (!visit) return;
    if (model.stroke) state.place = visit.place; else state.q = visit.q.map(round);
    if (visit.mass !== null) state.mass = visit.mass;
    changed();
  });
}

const readingsHere = (kind) => model.readings.filter((r) => (
  r.kind === kind && r.mass !== null && Math.abs(r.mass - state.mass) < 1e-6 && sameAngles(r.posture_deg, angles(model, state))));

// Which mode a measured label means: the one whose name it is, or the so many-th that it admits.
function modeOf(label, modes) {
  const [, name, ordinal] = label.match(/^(.*?)\s*(\d+)$/) || [];
  const admitted = modes.map((_, i) => i).filter((i) => (name || "").split(/\s+/).every((word) => modes[i].label.includes(word)));
  const exact = modes.findIndex((mode) => mode.label === label);
  return exact >= 0 ? exact : admitted[Number(ordinal) - 1];
}
