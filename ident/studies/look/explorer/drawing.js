// Drawings as SVG, made again for each width so that letters keep their size. All words go through textContent.

const SVG = "http://www.w3.org/2000/svg";
const TALLEST = 340;  // pixels of a view of the arm; on paper less
const MARGIN = { left: 52, right: 12, top: 10, bottom: 38 };

function svgNode(kind, attributes, text) {
  const node = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

const short = (x) => (Math.abs(x) < 1e-12 ? "0" : String(Number(x.toPrecision(3))));
const fixed = (x, digits) => (x + 0).toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1");
const significant = (x, digits) => (x >= 10 ** digits ? x.toFixed(0) : x.toPrecision(digits));

// Round numbers between two ends, some five of them.
function ticks(low, high, most) {
  const rough = Math.abs(high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((digit) => digit * power >= rough * 0.999);
  const found = [], from = Math.min(low, high), to = Math.max(low, high);
  for (let i = Math.ceil(from / step - 1e-9); i * step <= to + 1e-9 * step; i++) found.push(i * step);
  return found;
}

function logTicks(low, high) {
  const found = [], few = high / low > 300;
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++) {
    for (const digit of few ? [1] : [1, 2, 5]) {
      const value = digit * 10 ** power;
      if (value >= low * 0.999 && value <= high * 1.001) found.push(value);
    }
  }
  return found;
}

// Width of what a drawing stands in, looked up once: a look makes the browser lay out the page.
const widths = new Map();

const PRINTED = 380;  // pixels of half a sheet
let printing = false;

const printedWidth = (svg) => (svg.closest(".whole > .drawing") ? 2 * PRINTED : PRINTED);

function widthOf(svg) {
  if (!widths.has(svg)) widths.set(svg, printing ? printedWidth(svg) : svg.parentNode.clientWidth || 320);
  return widths.get(svg);
}

// A frame with axes, kept while it stays the same: { x: [from, to], y: [from, to], log: whether both axes are logarithmic, labels }.
function chart(svg, height, spec) {
  const width = widthOf(svg), { left, right, top, bottom } = MARGIN, frames = JSON.stringify([width, spec]);
  if (svg.frames === frames) {
    svg.drawn.inner.replaceChildren();
    return svg.drawn;
  }
  svg.frames = frames;
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.setAttribute("height", height);
  svg.replaceChildren();
  const place = (range, from, to) => (value) => {
    const [low, high, x] = spec.log ? [...range, value].map(Math.log10) : [...range, value];
    return from + (to - from) * (x - low) / (high - low);
  };
  const X = place(spec.x, left, width - right), Y = place(spec.y, height - bottom, top);
  const few = Math.max(3, Math.min(8, Math.floor(width / 75)));
  for (const value of spec.log ? logTicks(...spec.y) : ticks(...spec.y, 5)) {
    svg.append(svgNode("line", { class: "grid", x1: left, x2: width - right, y1: Y(value), y2: Y(value) }));
    svg.append(svgNode("text", { class: "tick", x: left - 6, y: Y(value) + 4, "text-anchor": "end" }, short(value)));
  }
  for (const value of spec.log ? logTicks(...spec.x) : ticks(...spec.x, few)) {
    svg.append(svgNode("line", { class: "axis", x1: X(value), x2: X(value), y1: height - bottom, y2: height - bottom + 4 }));
    svg.append(svgNode("text", { class: "tick", x: X(value), y: height - bottom + 17, "text-anchor": "middle" }, short(value)));
  }
  svg.append(svgNode("line", { class: "axis", x1: left, x2: width - right, y1: height - bottom, y2: height - bottom }));
  svg.append(svgNode("text", { class: "label", x: (left + width - right) / 2, y: height - 4, "text-anchor": "middle" }, spec.labels[0]));
  const turned = `translate(11 ${(top + height - bottom) / 2}) rotate(-90)`;
  svg.append(svgNode("text", { class: "label", transform: turned, "text-anchor": "middle" }, spec.labels[1]));
  const frame = [left - 6, top, width - left - right + 12, height - top - bottom];  // so that no dot at an end is cut
  const inner = svgNode("svg", { x: frame[0], y: frame[1], width: frame[2], height: frame[3], viewBox: frame.join(" ") });
  svg.append(inner);
  svg.drawn = { X, Y, inner, bottom: height - bottom };
  return svg.drawn;
}

// A path through points [x, y] of the page; null interrupts it.
function pathOf(points) {
  let open = false;
  return points.map((point) => {
    const word = point ? `${open ? "L" : "M"}${point[0].toFixed(1)} ${point[1].toFixed(1)}` : "";
    open = Boolean(point);
    return word;
  }).join("");
}

// The arm in two views with the same scale: from the side (x, z) and from above (x, y).
function armViews(svgs, box, lines) {
  const width = widthOf(svgs[0]), span = minus(box.high, box.low);
  const scale = Math.min((width - 24) / span[0], (printing ? 0.6 : 1) * TALLEST / Math.max(span[1], span[2])), left = (width - scale * span[0]) / 2;
  svgs.forEach((svg, view) => {
    const up = view ? 1 : 2, tall = Math.max(70, scale * span[up] + 24);
    const middle = (box.high[up] + box.low[up]) / 2;
    const at = (p) => [left + scale * (p[0] - box.low[0]), tall / 2 - scale * (p[up] - middle)];
    svg.setAttribute("viewBox", `0 0 ${width} ${tall.toFixed(0)}`);
    svg.setAttribute("height", tall.toFixed(0));
    svg.replaceChildren();
    const name = view ? "from above" : "from the side";
    for (const line of lines) if (!line.side || !view) drawLine(svg, line, at);
    svg.append(svgNode("text", { class: "tick", x: 6, y: 14 }, `${name}: x ${view ? "and y" : "and z"}`));
    const metre = [1, 0.5, 0.2, 0.1, 0.05].find((m) => m * scale < width / 4) || 0.02;
    const end = width - 12, y = tall - 6;
    svg.append(svgNode("line", { class: "axis", x1: end - metre * scale, x2: end, y1: y, y2: y }));
    svg.append(svgNode("text", { class: "tick", x: end - metre * scale - 5, y: y + 3, "text-anchor": "end" }, `${metre} m`));
  });
}

function drawLine(svg, line, at) {
  const points = line.points.map(at);
  svg.append(svgNode("path", { class: line.style, d: pathOf(points) }));
  if (line.dots) points.forEach((p, i) => {
    const last = i === points.length - 1;
    svg.append(svgNode("circle", { class: `${line.style} ${last ? "end" : "dot"}`, cx: p[0], cy: p[1], r: last ? 3 : 5 }));
  });
  if (line.load) {
    const [x, y] = at(line.load.at), size = line.load.size;
    svg.append(svgNode("rect", { class: `${line.style} load`, x: x - size / 2, y: y - size / 2, width: size, height: size }));
  }
}

// A key: pairs of a style and its words.
function key(list, entries) {
  list.replaceChildren(...entries.map(([style, words]) => {
    const item = document.createElement("li"), sample = svgNode("svg", { width: 30, height: 12, "aria-hidden": "true" });
    const marks = { measured: ["circle", { cx: 15, cy: 6, r: 4 }], "rigid load": ["rect", { x: 10, y: 1, width: 10, height: 10 }] };
    const [shape, place] = marks[style] || ["path", { d: "M1 6H29" }];
    sample.append(svgNode(shape, { class: style, ...place }));
    item.append(sample, document.createTextNode(words));
    return item;
  }));
}
