// The arm's exact mechanics, as ident/arm/{chain,mechanics,equilibrium,modes}.py have them, function by function.
// 3-vectors and 3 x 3 matrices are arrays, a matrix row by row; SI units. tests/report/html/test_explore.py compares both.

const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];

function add(a, b) {
  const c = new Array(a.length);
  for (let i = 0; i < a.length; i++) c[i] = a[i] + b[i];
  return c;
}

function minus(a, b) {
  const c = new Array(a.length);
  for (let i = 0; i < a.length; i++) c[i] = a[i] - b[i];
  return c;
}

function scale(a, s) {
  const c = new Array(a.length);
  for (let i = 0; i < a.length; i++) c[i] = a[i] * s;
  return c;
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const outer = (a, b) => [
  a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[0], a[1] * b[1], a[1] * b[2], a[2] * b[0], a[2] * b[1], a[2] * b[2],
];
const skew = (v) => [0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0];
const transpose = (A) => [A[0], A[3], A[6], A[1], A[4], A[7], A[2], A[5], A[8]];
const matvec = (A, v) => [
  A[0] * v[0] + A[1] * v[1] + A[2] * v[2], A[3] * v[0] + A[4] * v[1] + A[5] * v[2], A[6] * v[0] + A[7] * v[1] + A[8] * v[2],
];
const axial = (S) => [S[5] - S[7], S[6] - S[2], S[1] - S[3]];

function matmul(A, B) {
  const C = new Array(9);
  for (let i = 0; i < 9; i += 3) {
    for (let j = 0; j < 3; j++) C[i + j] = A[i] * B[j] + A[i + 1] * B[3 + j] + A[i + 2] * B[6 + j];
  }
  return C;
}

// tr(S) 1 - S: the map w -> sum of b x (w x a) over the dyads a b' of S.
function inertiaFromSecondMoment(S) {
  const trace = S[0] + S[4] + S[8];
  return S.map((x, i) => (i % 4 ? -x : trace - x));
}

// Rodrigues' formula: the rotation by any angle about a unit axis.
function turnAbout(axis, angle) {
  const sine = Math.sin(angle), cosine = Math.cos(angle), across = skew(axis), along = outer(axis, axis);
  return IDENTITY.map((unit, i) => sine * across[i] + (1 - cosine) * along[i] + cosine * unit);
}

// Power series in t^2 of b = (1 - cos t)/t^2, c = (t - sin t)/t^3 and their derivatives b', c'.
const SERIES = (() => {
  const factorial = (n) => (n < 2 ? 1 : n * factorial(n - 1));
  const rows = [2, 3].map((k) => Array.from({ length: 17 }, (_, n) => (-1) ** n / factorial(2 * n + k)));
  return [...rows, ...rows.map((row) => row.slice(1).map((x, n) => (n + 1) * x))];
})();
function series(row, t2) {
  const terms = SERIES[row];
  let sum = 0;
  for (let i = terms.length - 1; i >= 0; i--) sum = sum * t2 + terms[i];
  return sum;
}

// J with (d/dt exp[phi]) exp[-phi] = [J dphi/dt]; Barfoot, "State Estimation for Robotics", eq. 7.77.
function leftJacobian(phi) {
  const t2 = dot(phi, phi), b = series(0, t2), c = series(1, t2), across = skew(phi), twice = matmul(across, across);
  return IDENTITY.map((unit, i) => unit + b * across[i] + c * twice[i]);
}

// Symmetric part of d(J(phi)' moment)/dphi at constant moment.
function curvature(phi, moment) {
  const t2 = dot(phi, phi), c = series(1, t2), bDash = series(2, t2), cDash = series(3, t2);
  const along = dot(phi, moment), across = cross(phi, moment);
  const first = scale(outer(across, phi), -2 * bDash);
  const second = scale(outer(minus(scale(phi, along), scale(moment, t2)), phi), 2 * cDash);
  const third = minus(add(scale(IDENTITY, along), outer(phi, moment)), scale(outer(moment, phi), 2));
  const slope = add(add(first, second), scale(third, c));
  return scale(add(slope, transpose(slope)), 0.5);
}

// The arm at a posture under a load: all axes parallel to the base frame (ident.arm.chain.at_posture).
// k: stiffness by joint, [bending, torsion] each; mass: of the payload [kg]; more: masses and forces at points by name.
function chainAt(model, q, mass, k, more = { masses: [], forces: [] }) {
  let frame = IDENTITY;
  const joints = model.joints.map((joint, j) => {
    const before = frame, after = matmul(before, turnAbout(joint.axis, joint.driven ? q[joint.pin] : 0));
    frame = after;
    const axis = matvec(before, joint.axis), along = outer(axis, axis), across = minus(IDENTITY, along);
    const parts = [[joint.shaft, before, 1], [joint.link, after, 1]];
    if (j === model.payload.joint) parts.push([model.payload.unit, after, mass]);
    for (const [kilograms, name] of more.masses) {
      const { joint: carrier, position } = model.points[pointNamed(model, name)];
      if (carrier === j) parts.push([{ mass: 1, first: position, second: outer(position, position) }, after, kilograms]);
    }
    const bend = scale(across, k[j][0]), tors = scale(along, k[j][1]);
    return {
      axis, before, after, bend, tors,
      offset: matvec(before, joint.offset),
      mass: parts.reduce((sum, [m, , share]) => sum + share * m.mass, 0),
      moment: parts.map(([m, axes, share]) => scale(matvec(axes, m.first), share)).reduce(add),
      second: parts.map(([m, axes, s]) => scale(matmul(matmul(axes, m.second), transpose(axes)), s)).reduce(add),
      stiffness: add(bend, tors),
      damping: add(scale(bend, joint.tau[0]), scale(tors, joint.tau[1])),
      loss: add(scale(bend, joint.loss[0]), scale(tors, joint.loss[1])),
    };
  });
  const points = model.points.map((point) => (
    { joint: point.joint, force: point.force, position: matvec(joints[point.joint].after, point.position) }));
  for (const [force, name] of more.forces) {
    const point = points[pointNamed(model, name)];
    point.force = add(point.force, force);
  }
  return { joints, points, gravity: model.gravity, alpha: model.alpha };
}

const pointNamed = (model, name) => model.points.findIndex((point) => point.name === name);

// Centres of the bushings, rotations of the bodies, and W_j with w_j = W_j dphi_j/dt.
function forwardKinematics(chain, phi) {
  let before = IDENTITY, centre = [0, 0, 0];
  return chain.joints.map((joint, j) => {
    const J = leftJacobian(phi[j]), own = before;
    centre = add(centre, matvec(own, joint.offset));
    before = matmul(own, add(IDENTITY, matmul(skew(phi[j]), J)));
    return { centre, before: own, axes: before, rate: matmul(own, J) };
  });
}

const pointPositions = (chain, at) => chain.points.map((point) => (
  add(at[point.joint].centre, matvec(at[point.joint].axes, point.position))));

function placeBlock(matrix, n, j, i, block) {
  for (let a = 0; a < 3; a++) for (let b = 0; b < 3; b++) matrix[(3 * j + a) * n + 3 * i + b] = block[3 * a + b];
}

// M with T = dphi' M dphi / 2 [kg m^2].
function massMatrix(chain, at) {
  const N = at.length, n = 3 * N, M = new Float64Array(n * n);
  let mass = 0, moment = [0, 0, 0], second = new Array(9).fill(0);
  for (let j = N - 1; j >= 0; j--) {
    const body = chain.joints[j], { axes, centre } = at[j], arm = matvec(axes, body.moment);
    mass += body.mass;
    moment = add(moment, add(scale(centre, body.mass), arm));
    const own = matmul(matmul(axes, body.second), transpose(axes));
    const moved = add(add(outer(arm, centre), outer(centre, arm)), scale(outer(centre, centre), body.mass));
    second = add(second, add(own, moved));
    for (let i = 0; i <= j; i++) {
      const pj = centre, pi = at[i].centre;
      const S = minus(minus(add(second, scale(outer(pi, pj), mass)), outer(moment, pj)), outer(pi, moment));
      const block = matmul(matmul(transpose(at[j].rate), inertiaFromSecondMoment(S)), at[i].rate);
      placeBlock(M, n, j, i, block);
      placeBlock(M, n, i, j, transpose(block));
    }
  }
  return M;
}

// Gradient [N m] and Hessian [N m/rad] of the potential energy.
function potentialDerivatives(chain, phi, at) {
  const N = at.length, n = 3 * N, gradient = new Float64Array(n), H = new Float64Array(n * n);
  const points = pointPositions(chain, at), T = new Array(N), D = new Array(N);
  let dyads = new Array(9).fill(0), force = [0, 0, 0];
  for (let j = N - 1; j >= 0; j--) {
    const body = chain.joints[j], arm = add(scale(at[j].centre, body.mass), matvec(at[j].axes, body.moment));
    dyads = add(dyads, outer(arm, chain.gravity));
    force = add(force, scale(chain.gravity, body.mass));
    chain.points.forEach((point, p) => {
      if (point.joint !== j) return;
      dyads = add(dyads, outer(points[p], point.force));
      force = add(force, point.force);
    });
    T[j] = minus(dyads, outer(at[j].centre, force));
    D[j] = inertiaFromSecondMoment(T[j]);
  }
  for (let j = 0; j < N; j++) {
    const moment = scale(axial(T[j]), -1), turned = transpose(at[j].rate), K = chain.joints[j].stiffness;
    add(matvec(turned, moment), matvec(K, phi[j])).forEach((x, a) => { gradient[3 * j + a] = x; });
    const both = scale(add(D[j], transpose(D[j])), 0.5);
    const own = add(curvature(phi[j], matvec(transpose(at[j].before), moment)), K);
    placeBlock(H, n, j, j, add(matmul(matmul(turned, both), at[j].rate), own));
    for (let i = 0; i < j; i++) {
      const block = matmul(matmul(turned, transpose(D[j])), at[i].rate);
      placeBlock(H, n, j, i, block);
      placeBlock(H, n, i, j, transpose(block));
    }
  }
  return { gradient, H };
}

// Lower Cholesky factor of a symmetric matrix; null where it is not positive definite.
function cholesky(A, n) {
  const L = new Float64Array(n * n);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j <= i; j++) {
      let sum = A[i * n + j];
      for (let k = 0; k < j; k++) sum -= L[i * n + k] * L[j * n + k];
      if (i === j && !(sum > 0)) return null;
      L[i * n + j] = i === j ? Math.sqrt(sum) : sum / L[j * n + j];
    }
  }
  return L;
}

function forwardSolve(L, n, b) {
  const x = Float64Array.from(b);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < i; k++) x[i] -= L[i * n + k] * x[k];
    x[i] /= L[i * n + i];
  }
  return x;
}

function backSolve(L, n, b) {
  const x = Float64Array.from(b);
  for (let i = n - 1; i >= 0; i--) {
    for (let k = i + 1; k < n; k++) x[i] -= L[k * n + i] * x[k];
    x[i] /= L[i * n + i];
  }
  return x;
}

// Eigenvalues and orthonormal vectors (rows) of a symmetric matrix, by Jacobi's method:
// Golub, Van Loan, "Matrix Computations", 4th ed., 8.5.
function jacobi(A, n) {
  const V = new Float64Array(n * n);
  for (let i = 0; i < n; i++) V[i * n + i] = 1;
  for (let sweep = 0; sweep < 30; sweep++) {
    let off = 0, diagonal = 0;
    for (let p = 0; p < n; p++) {
      diagonal += A[p * n + p] ** 2;
      for (let q = p + 1; q < n; q++) off += A[p * n + q] ** 2;
    }
    if (off <= 1e-34 * diagonal) break;
    for (let p = 0; p < n; p++) for (let q = p + 1; q < n; q++) rotate(A, V, n, p, q);
  }
  return { values: Array.from({ length: n }, (_, i) => A[i * n + i]), vectors: V };
}

function rotate(A, V, n, p, q) {
  const apq = A[p * n + q], app = A[p * n + p], aqq = A[q * n + q];
  if (Math.abs(apq) <= 1e-20 * Math.sqrt(Math.abs(app * aqq))) return;
  const tau = (aqq - app) / (2 * apq), root = Math.sqrt(1 + tau * tau);
  const t = 1 / (tau >= 0 ? tau + root : tau - root), c = 1 / Math.sqrt(1 + t * t), s = t * c;
  for (let k = 0; k < n; k++) {
    const v = V[p * n + k], w = V[q * n + k];
    V[p * n + k] = c * v - s * w;
    V[q * n + k] = s * v + c * w;
    if (k === p || k === q) continue;
    const x = A[p * n + k], y = A[q * n + k];
    A[p * n + k] = A[k * n + p] = c * x - s * y;
    A[q * n + k] = A[k * n + q] = s * x + c * y;
  }
  A[p * n + p] = app - t * apq;
  A[q * n + q] = aqq + t * apq;
  A[p * n + q] = A[q * n + p] = 0;
}

const byJoint = (x) => Array.from({ length: x.length / 3 }, (_, j) => [x[3 * j], x[3 * j + 1], x[3 * j + 2]]);

// Static equilibrium by Newton's method, beginning at a guess; null where the arm collapses.
function equilibrium(chain, guess) {
  const n = 3 * chain.joints.length;
  let phi = guess || chain.joints.map(() => [0, 0, 0]);
  for (let step = 0; step < 30; step++) {
    const at = forwardKinematics(chain, phi), { gradient, H } = potentialDerivatives(chain, phi, at);
    const L = cholesky(H, n);
    if (!L) return guess ? equilibrium(chain) : null;
    const move = backSolve(L, n, forwardSolve(L, n, gradient));
    const size = move.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
    if (!(size < Infinity)) return null;
    if (size < 1e-8) {  // convergence is quadratic: this step leaves an error of 1e-16
      phi = byJoint(move.map((x, i) => phi[Math.floor(i / 3)][i % 3] - x));
      const rest = forwardKinematics(chain, phi);
      const factor = cholesky(potentialDerivatives(chain, phi, rest).H, n);
      return factor && { phi, at: rest, L: factor };
    }
    const share = Math.min(1, 0.5 / size);
    phi = byJoint(move.map((x, i) => phi[Math.floor(i / 3)][i % 3] - share * x));
  }
  return null;
}
