// What is on the screen as a value: read from and written to the address, and put into commands.

const SPAN = 4;  // a stiffness may be changed by this factor, up and down
const SPEEDS = [1, 120];

function firstState(model) {
  const { start, stroke } = model;
  const state = {
    k: model.joints.map((joint) => [...joint.stiffness]),
    mass: model.payload.present,
    speed: start.speed,
    mode: 0,
  };
  if (stroke) {
    const j = stroke.direction.reduce((best, x, i) => (Math.abs(x) > Math.abs(stroke.direction[best]) ? i : best), 0);
    state.place = round(start.posture_deg[j] / stroke.direction[j]);
  } else {
    state.q = [...start.posture_deg];
    state.sweep = Math.min(1, state.q.length - 1);  // the first joint of most arms is vertical: it changes nothing
  }
  return state;
}

const DEGREE = Math.PI / 180;
const strokeEnds = (stroke) => [stroke.alpha[0] / DEGREE, stroke.alpha[stroke.alpha.length - 1] / DEGREE].map(round);
const round = (x) => Number(x.toPrecision(12)) + 0;
const copyOf = (state) => JSON.parse(JSON.stringify(state));
const clamp = (x, low, high) => Math.min(Math.max(x, Math.min(low, high)), Math.max(low, high));

// Joint angles [deg], and the same in radians.
const angles = (model, state) => (state.q || model.stroke.direction.map((share) => round(share * state.place)));
const radians = (degrees) => degrees.map((x) => x * DEGREE);

// What differs from the first state, as NAME=NUMBER&...
function fragmentOf(model, first, state) {
  const words = new URLSearchParams();
  model.joints.forEach((joint, j) => joint.paths.forEach((path, f) => {
    if (state.k[j][f] !== first.k[j][f]) words.set(path, String(state.k[j][f]));
  }));
  for (const name of ["mass", "speed", "place", "sweep", "mode"]) {
    if (state[name] !== undefined && state[name] !== first[name]) words.set(name, String(state[name]));
  }
  if (state.q && state.q.some((x, i) => x !== first.q[i])) words.set("q", state.q.join(","));
  return words.toString();
}

// Anybody may have written an address: numbers only, within the sliders' ends, all else is ignored.
function stateOf(model, first, fragment) {
  const state = copyOf(first), words = new URLSearchParams(fragment);
  const number = (name) => (words.get(name) ? Number(words.get(name)) : NaN);
  model.joints.forEach((joint, j) => joint.paths.forEach((path, f) => {
    const value = number(path), own = first.k[j][f];
    if (Number.isFinite(value)) state.k[j][f] = clamp(value, own / SPAN, own * SPAN);
  }));
  const ends = { mass: [0, model.payload.largest], speed: SPEEDS, mode: [0, 3 * model.joints.length - 1] };
  if (model.stroke) ends.place = strokeEnds(model.stroke); else ends.sweep = [0, state.q.length - 1];
  for (const [name, range] of Object.entries(ends)) {
    const value = number(name);
    if (Number.isFinite(value)) state[name] = clamp(value, ...range);
  }
  for (const name of ["mode", "sweep"]) if (state[name] !== undefined) state[name] = Math.round(state[name]);
  const q = (words.get("q") || "").split(",").map(Number);
  if (state.q && q.length === state.q.length && q.every((x) => Math.abs(x) <= 3600)) state.q = q;
  return state;
}

const quote = (word) => (/^[\w@%+=:,.\/-]+$/.test(word) ? word : `'${word.replace(/'/g, "'\\''")}'`);

// The commands that compute the same.
function commandsOf(model, first, state) {
  const { payload } = model, numbers = { ...model.set }, loads = model.fixed ? [model.fixed] : [];
  model.joints.forEach((joint, j) => joint.paths.forEach((path, f) => {
    if (state.k[j][f] !== first.k[j][f]) numbers[path] = state.k[j][f];
  }));
  if (state.mass > 0 && payload.kind === "point") loads.push(`${state.mass} kg @ ${payload.name}`);
  if (state.mass > 0 && payload.kind === "payload") {
    loads.push(payload.name);
    const share = state.mass / payload.nominal;
    if (share !== 1) {
      numbers[`${payload.name}.mass`] = state.mass;
      ["xx", "yy", "zz"].forEach((end, i) => { numbers[`${payload.name}.inertia.${end}`] = payload.inertia[i] * share; });
    }
  }
  const more = [
    ...(loads.length ? [`--load=${loads.join(" + ")}`] : []),
    ...Object.entries(numbers).map(([path, value]) => `--set=${path}=${value}`),
  ];
  const predict = ["ident", "predict", ...model.command, `--posture=${angles(model, state).join(",")}`, ...more];
  const commands = [predict];
  if (model.stroke && model.drives.length) {
    commands.push(["ident", "resonance", ...model.command, `--speed=${state.speed}`, ...more]);
  }
  return commands.map((words) => words.map(quote).join(" ")).join("\n");
}
