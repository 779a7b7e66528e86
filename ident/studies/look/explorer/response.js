// What the arm does at a posture: modes, static deflection, steady response to its eccentric masses.

const MODES_SHOWN = 6, CANDIDATES = 4;

// Everything at one posture, or null where the arm collapses; guess: bushings' rotations nearby.
function solveAt(model, q, mass, k, guess) {
  const chain = chainAt(model, q, mass, k), rest = equilibrium(chain, guess);
  if (!rest) return null;
  const n = 3 * chain.joints.length, { phi, at, L } = rest, M = massMatrix(chain, at), modes = eigenmodes(chain, at, L, M, n);
  const straight = forwardKinematics(chain, phi.map(() => [0, 0, 0]));
  const line = [...at.map((body) => body.centre), ...pointPositions(chain, at)];
  const rigid = [...straight.map((body) => body.centre), ...pointPositions(chain, straight)];
  const [damping, loss] = ["damping", "loss"].map((field) => chain.joints.map((joint) => joint[field]));
  return { q, phi, line, rigid, M, modes, damping, loss, alpha: model.alpha, torques: harmonicTorques(model, chain, at) };
}

// H v = omega^2 M v by the largest eigenvalues of L^-1 M L^-T, the most accurate ones; V' M V = 1.
function eigenmodes(chain, at, L, M, n) {
  const half = Float64Array.from(M), A = new Float64Array(n * n);
  for (let i = 0; i < n; i++) {
    const column = forwardSolve(L, n, half.subarray(i * n, i * n + n));
    for (let r = 0; r < n; r++) half[i * n + r] = column[r];
  }
  for (let r = 0; r < n; r++) {
    const column = forwardSolve(L, n, Float64Array.from({ length: n }, (_, i) => half[i * n + r]));
    for (let i = 0; i < n; i++) A[i * n + r] = column[i];
  }
  for (let i = 0; i < n; i++) for (let r = 0; r < i; r++) A[i * n + r] = A[r * n + i] = (A[i * n + r] + A[r * n + i]) / 2;
  const { values, vectors } = jacobi(A, n);
  const order = values.map((_, i) => i).sort((a, b) => values[b] - values[a]);
  const counts = {};
  return order.map((i) => {
    const y = vectors.subarray(i * n, i * n + n), omega = 1 / Math.sqrt(values[i]);
    const shape = backSolve(L, n, y).map((x) => x * omega);
    return describe(chain, at, shape, omega, counts);
  });
}

// Damping ratio of light damping, shares of strain energy, motion of the line, label (ident.arm.modes).
function describe(chain, at, shape, omega, counts) {
  const by = byJoint(shape), form = (field) => by.map((x, j) => dot(x, matvec(chain.joints[j][field], x)));
  const [bend, tors, viscous, loss] = ["bend", "tors", "damping", "loss"].map(form), sum = (x) => x.reduce((a, b) => a + b, 0);
  const motion = movement(chain, at, by), end = motion[motion.length - 1];
  const torsion = sum(tors) / (sum(bend) + sum(tors)), vertical = end[2] ** 2 / dot(end, end);
  const name = `${vertical > 0.5 ? "vertical" : "lateral"} ${torsion > 0.5 ? "torsion" : "bending"}`;
  counts[name] = (counts[name] || 0) + 1;
  return {
    omega, frequency: omega / (2 * Math.PI), damping: (sum(viscous) + sum(loss) / omega + chain.alpha) / (2 * omega),
    shape, motion,
    label: `${name} ${counts[name]}`,
    reach: Math.max(...end.map(Math.abs)),
    unsure: Math.abs(torsion - 0.5) < 0.1 || Math.abs(vertical - 0.5) < 0.1,
  };
}

// Damping ratio of a mode with the damping that couples it to the others, by its root s of s^2 + s C + omega^2 in modal
// coordinates: the others are eliminated at the last s, and the quadratic that is left is solved again.
function dampingRatio(solved, r) {
  const { modes } = solved, n = modes.length, C = modalDamping(solved), own = C[r * n + r], { omega } = modes[r];
  if (own >= 2 * omega) return 1;
  const others = [...modes.keys()].filter((i) => i !== r), m = n - 1;
  let x = -own / 2, y = Math.sqrt(omega * omega - own * own / 4);
  for (let step = 0; step < 20; step++) {
    const re = new Float64Array(m), im = new Float64Array(m), A = new Float64Array(m * m), B = new Float64Array(m * m);
    others.forEach((i, a) => {
      others.forEach((j, b) => { A[a * m + b] = x * C[i * n + j]; B[a * m + b] = y * C[i * n + j]; });
      A[a * m + a] += x * x - y * y + modes[i].omega ** 2;
      B[a * m + a] += 2 * x * y;
      re[a] = x * C[i * n + r];
      im[a] = y * C[i * n + r];
    });
    solveSymmetric(A, B, re, im);
    let h = 0, g = 0;  // s C_ro A^-1 s C_or
    others.forEach((i, a) => { h += C[i * n + r] * (x * re[a] - y * im[a]); g += C[i * n + r] * (x * im[a] + y * re[a]); });
    // s^2 + own s + omega^2 - h - i g = 0, the root in the upper half plane
    const p = own * own / 4 - omega * omega + h, size = Math.hypot(p, g), root = Math.sqrt((size - p) / 2);
    const before = [x, y];
    x = -own / 2 + (root > 0 ? g / (2 * root) : Math.sqrt(size));
    y = root;
    if (Math.hypot(x - before[0], y - before[1]) < 1e-13 * omega) break;
  }
  return -x / Math.hypot(x, y);
}

// V' C V, row by row, with 2 v_i' L v_r / (omega_i + omega_r) for loss factors (ident.arm.structural); computed once for
// each solution.
function modalDamping(solved) {
  if (solved.C) return solved.C;
  const n = solved.modes.length, C = new Float64Array(n * n), shapes = solved.modes.map((mode) => byJoint(mode.shape));
  shapes.forEach((shape, i) => {
    const by = (matrices) => shape.map((x, j) => matvec(matrices[j], x)), viscous = by(solved.damping), lost = by(solved.loss);
    for (let r = 0; r <= i; r++) {
      const share = 2 / (solved.modes[i].omega + solved.modes[r].omega);
      C[i * n + r] = C[r * n + i] = shapes[r].reduce((sum, x, j) => sum + dot(x, viscous[j]) + share * dot(x, lost[j]), r === i ? solved.alpha : 0);
    }
  });
  solved.C = C;
  return C;
}

// For each mode of one solution the mode of another that is most like it, by mass-weighted MAC, no mode twice.
function alike(solved, other) {
  const n = solved.modes.length, free = new Set(other.modes.keys());
  const weigh = (shape) => shape.map((_, i) => shape.reduce((sum, x, j) => sum + solved.M[i * n + j] * x, 0));
  const inner = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
  const weighed = other.modes.map((mode) => weigh(mode.shape));
  const sizes = other.modes.map((mode, i) => inner(mode.shape, weighed[i]));
  return solved.modes.slice(0, MODES_SHOWN).map((mode) => {
    const mac = (i) => inner(mode.shape, weighed[i]) ** 2 / sizes[i];
    const best = [...free].reduce((a, b) => (mac(b) > mac(a) ? b : a));
    free.delete(best);
    return best;
  });
}

// How bushings and points move while the bushings' rotations change by v.
function movement(chain, at, v) {
  let w = [0, 0, 0], velocity = [0, 0, 0];
  const turning = [], centres = at.map((body, j) => {
    if (j) velocity = add(velocity, cross(w, minus(body.centre, at[j - 1].centre)));
    w = add(w, matvec(body.rate, v[j]));
    turning.push(w);
    return velocity;
  });
  const points = chain.points.map((point) => (
    add(centres[point.joint], cross(turning[point.joint], matvec(at[point.joint].axes, point.position)))));
  return [...centres, ...points];
}

// Phasors of the torques of the eccentric masses about all bushings, pulleys turning forwards: real and imaginary parts
// of the pull over the square of the rate, and of the weight's moment.
function harmonicTorques(model, chain, at) {
  return model.drives.map((drive) => {
    const j = drive.joint, turn = matmul(at[j].axes, chain.joints[j].before), [first, second] = drive.across;
    const a = matvec(turn, first), b = matvec(turn, second), c = Math.cos(drive.phase), s = Math.sin(drive.phase);
    const u = [add(scale(a, c), scale(b, s)), minus(scale(a, s), scale(b, c))].map((x) => scale(x, drive.imbalance));
    const where = add(at[j].centre, scale(matvec(turn, model.joints[j].axis), drive.height));
    return u.map((part) => {
      const weight = cross(part, chain.gravity), none = [0, 0, 0];
      const rows = at.map((body, i) => (i > j ? [none, none] : [
        matvec(transpose(body.rate), cross(minus(where, body.centre), part)), matvec(transpose(body.rate), weight)]));
      return { pull: rows.flatMap((row) => row[0]), weight: rows.flatMap((row) => row[1]) };
    });
  });
}

// How strongly each drive excites each mode: [real, imaginary] of pull and weight, computed once for all speeds.
function participation(solved) {
  const inner = (x, y) => x.reduce((sum, value, i) => sum + value * y[i], 0);
  return solved.torques.map((parts) => solved.modes.map((mode) => parts.map((part) => (
    [inner(part.pull, mode.shape), inner(part.weight, mode.shape)]))));
}

// Amplitude of the end point in x, y, z [m] for rates of the drives [rad/s], at worst phases: the sum over drives.
// Turning backwards, a phasor is its conjugate. Damping couples the modes; all of them are solved for together.
function steadyResponse(solved, rates, sign) {
  const total = [0, 0, 0], shares = solved.shares || (solved.shares = participation(solved)), n = solved.modes.length;
  shares.forEach((ofModes, d) => {
    const w = rates[d], re = new Float64Array(n), im = new Float64Array(n);
    if (!(w > 0)) return;
    ofModes.forEach(([real, imaginary], r) => {
      re[r] = w * w * real[0] + real[1];
      im[r] = sign[d] * (w * w * imaginary[0] + imaginary[1]);
    });
    solveModal(solved, w, re, im);
    for (let i = 0; i < 3; i++) {
      let x = 0, y = 0;
      solved.modes.forEach(({ motion }, r) => {
        const end = motion[motion.length - 1][i];
        x += end * re[r];
        y += end * im[r];
      });
      total[i] += Math.hypot(x, y);
    }
  });
  return total;
}

// Solve (omega^2 - w^2 + i w C) x = b in modal coordinates, in place.
function solveModal(solved, w, re, im) {
  const n = re.length, A = new Float64Array(n * n), B = modalDamping(solved).map((c) => w * c);
  solved.modes.forEach(({ omega }, i) => { A[i * n + i] = omega * omega - w * w; });
  solveSymmetric(A, B, re, im);
}

// Solve (A + i B) x = b in place, by symmetric elimination. No pivot is needed: what damping couples is positive
// semi-definite, so that what a row adds to another is no larger than that one's own damping.
function solveSymmetric(A, B, re, im) {
  const n = re.length;
  for (let k = 0; k < n; k++) {
    const a = A[k * n + k], b = B[k * n + k], size = a * a + b * b || 1e-300;
    for (let i = k + 1; i < n; i++) {
      const x = A[k * n + i], y = B[k * n + i], f = (x * a + y * b) / size, g = (y * a - x * b) / size;
      for (let j = i; j < n; j++) {
        A[i * n + j] -= f * A[k * n + j] - g * B[k * n + j];
        B[i * n + j] -= f * B[k * n + j] + g * A[k * n + j];
      }
      re[i] -= f * re[k] - g * im[k];
      im[i] -= f * im[k] + g * re[k];
    }
  }
  for (let k = n - 1; k >= 0; k--) {
    for (let j = k + 1; j < n; j++) {
      re[k] -= A[k * n + j] * re[j] - B[k * n + j] * im[j];
      im[k] -= A[k * n + j] * im[j] + B[k * n + j] * re[j];
    }
    const a = A[k * n + k], b = B[k * n + k], size = a * a + b * b || 1e-300, own = re[k];
    re[k] = (own * a + im[k] * b) / size;
    im[k] = (im[k] * a - own * b) / size;
  }
}

// Angular rates of the drives [rad/s], and their signs, where the stroke passes a place at a speed [%].
function driveRates(model, alpha, percent) {
  const stroke = model.stroke, rate = interpolate(stroke.alpha, stroke.rate, alpha) * percent / 100;
  const turns = model.drives.map((drive) => drive.ratio * stroke.direction[drive.pin] * rate);
  return { rates: turns.map(Math.abs), signs: turns.map((x) => (x < 0 ? -1 : 1)) };
}

function interpolate(x, y, at) {
  const up = x[x.length - 1] > x[0];
  let low = 0, high = x.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((x[middle] <= at) === up) low = middle; else high = middle;
  }
  const share = Math.min(1, Math.max(0, (at - x[low]) / (x[high] - x[low])));
  return y[low] + share * (y[high] - y[low]);
}

// Largest component of the steady response over the stroke at a speed: at each place, and where a drive passes a
// mode's frequency between two of them, as if it did so at either. Few of
// them, found without the coupling of modes, are solved.
function worstOnStroke(model, places, percent) {
  const candidates = [];
  let before = null;
  const offer = (solved, rates, signs) => candidates.push({ size: roughResponse(solved, rates), solved, rates, signs });
  for (const { solved, alpha } of places) {
    if (!solved) { before = null; continue; }
    const { rates, signs } = driveRates(model, alpha, percent);
    offer(solved, rates, signs);
    if (before) {
      rates.forEach((rate, d) => solved.modes.slice(0, MODES_SHOWN).forEach((mode, r) => {
        if ((rate - mode.omega) * (before.rates[d] - before.solved.modes[r].omega) >= 0) return;
        offer(solved, tuned(rates, d, mode.omega), signs);
        offer(before.solved, tuned(before.rates, d, before.solved.modes[r].omega), before.signs);
      }));
    }
    before = { rates, signs, solved };
  }
  const largest = candidates.sort((a, b) => b.size - a.size).slice(0, CANDIDATES);
  return Math.max(0, ...largest.flatMap((one) => steadyResponse(one.solved, one.rates, one.signs)));
}

const tuned = (rates, d, omega) => rates.map((rate, i) => (i === d ? omega : rate));

// About how large the response is: the sum over drives of the largest that one mode does.
function roughResponse(solved, rates) {
  const shares = solved.shares || (solved.shares = participation(solved));
  let total = 0;
  for (let d = 0; d < shares.length; d++) {
    const w2 = rates[d] ** 2;
    let largest = 0;
    for (let r = 0; r < shares[d].length; r++) {
      const { omega, damping, reach } = solved.modes[r], [real, imaginary] = shares[d][r];
      const a = w2 * real[0] + real[1], b = w2 * imaginary[0] + imaginary[1], x = omega * omega - w2;
      const size = reach * reach * (a * a + b * b) / (x * x + 4 * damping * damping * omega * omega * w2);
      if (size > largest) largest = size;
    }
    total += Math.sqrt(largest);
  }
  return total;
}
