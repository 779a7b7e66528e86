// What instruments read of the arm at rest, each reading under its own loads (ident/identify/readings.py).

const isLength = (reading) => reading.kind.startsWith("deflection");

// A deflection [m], rotation or twist [rad] at its posture, or its difference between two load cases; null where the arm collapses.
function readingAt(model, reading, k) {
  const q = radians(reading.posture_deg);
  const rests = reading.loads.map((load) => {
    const chain = chainAt(model, q, load.mass, k, load), rest = equilibrium(chain);
    return rest && { chain, ...rest };
  });
  if (rests.some((rest) => !rest)) return null;
  const now = rests[0], before = rests[1] || unloaded(now.chain);
  if (reading.kind.startsWith("twist")) {
    const j = model.joints.findIndex((joint) => joint.name === reading.joint);
    return dot(now.chain.joints[j].axis, minus(now.phi[j], before.phi[j]));
  }
  const p = pointNamed(model, reading.point), carrier = model.points[p].joint;
  const [line, axes] = [now, before].map(({ chain, at }) => [pointPositions(chain, at)[p], at[carrier].axes])
    .reduce(([x, A], [y, B]) => [minus(x, y), matmul(A, transpose(B))]);
  return dot(reading.direction, isLength(reading) ? line : rotationVector(axes));
}

function unloaded(chain) {
  const phi = chain.joints.map(() => [0, 0, 0]);
  return { chain, phi, at: forwardKinematics(chain, phi) };
}

// The vector about which a rotation turns, as long as its angle (below half a turn).
function rotationVector(R) {
  const sine = scale(axial(R), -0.5), size = Math.hypot(...sine), angle = Math.atan2(size, (R[0] + R[4] + R[8] - 1) / 2);
  return size > 1e-12 ? scale(sine, angle / size) : sine;
}

function directionWords(direction) {
  const along = direction.findIndex((x) => Math.abs(Math.abs(x) - 1) < 1e-9);
  return along < 0 ? direction.map(short).join(" ") : `${direction[along] < 0 ? "-" : ""}${"xyz"[along]}`;
}

function readingWords(reading) {
  const [kind, difference] = reading.kind.split("_"), loads = reading.loads.map((load) => load.words).join(" less ");
  const what = kind === "twist" ? `twist of ${reading.joint}`
    : `${kind} of ${reading.point} ${kind === "rotation" ? "about" : "along"} ${directionWords(reading.direction)}`;
  return [what, difference ? loads : `under ${loads}`];
}
