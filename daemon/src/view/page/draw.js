// Draws boxes, bird's-eye view, charts and tables. Independent of the connection.
"use strict";

const SVG = "http://www.w3.org/2000/svg";
const byId = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const SERIES = ["--s1", "--s2", "--s3", "--s4", "--s5", "--s6"];

function svg(name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

const metres = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(1)} m`);
const seconds = (value) => (value === null || value === undefined ? "–" : `${value.toFixed(1)} s`);

// Whether a warning or an alarm is about an obstacle.
const isAbout = ({ alarm }, o) => ["warning", "alarm"].includes(alarm.level) && alarm.track === o.track;

// Own speed and yaw rate in words; the motion is known.
function ownMotion(motion) {
  const turn = motion.yaw_rate_rad_s;
  const side = Math.abs(turn) < 0.005 ? "" : turn > 0 ? " left" : " right";
  const notes = [motion.sources.map((s) => s.replaceAll("_", " ")).join(", ") || "predicted"];
  if (motion.standstill) notes.push("standing still");
  if (motion.disagree) notes.push("odometry and bus disagree");
  return `${motion.speed_m_s.toFixed(1)} ± ${motion.speed_sigma_m_s.toFixed(1)} m/s, ` +
    `${Math.abs(turn).toFixed(2)} rad/s${side} (${notes.join("; ")})`;
}

// The edges of the vehicle's path in the left image; dashed while the own motion is unknown.
function wayLines(frame) {
  return frame.path_px.filter((edge) => edge.length > 1).map((edge) => svg("polyline", {
    class: `way${frame.path.known ? "" : " assumed"}`, points: edge.map(([x, y]) => `${x},${y}`).join(" "),
  }));
}

// Free space as an area and boundaries as fences in the left image.
function spaceShapes(frame) {
  const list = (points) => points.map(([x, y]) => `${x},${y}`).join(" ");
  const areas = frame.free_px.filter((area) => area.length > 2).map((area) => svg("polygon", {
    class: "free", points: list(area),
  }));
  const fences = frame.boundaries_px.filter(([foot]) => foot.length > 1).map(([foot, top]) => {
    const group = svg("g", { class: "boundary" });
    group.append(svg("polygon", { points: list([...foot, ...[...top].reverse()]) }));
    foot.forEach(([x, y], i) => group.append(svg("line", { x1: x, y1: y, x2: top[i][0], y2: top[i][1] })));
    return group;
  });
  return [...areas, ...fences];
}

// Boxes over the left image, in image pixels. The farthest first, so that near ones lie on top.
function drawBoxes(frame) {
  const view = byId("boxes");
  view.setAttribute("viewBox", `0 0 ${frame.width} ${frame.height}`);
  view.dataset.sequence = frame.sequence;
  const scale = frame.width / Math.max(1, view.clientWidth || frame.width);
  const labels = placeLabels(frame, scale);
  // What was never confirmed and is not seen now is not drawn; the table lists it.
  const shown = frame.obstacles.filter((o) => o.confirmed || !o.predicted);
  const boxes = shown.sort((a, b) => b.distance_m - a.distance_m).map((o) => {
    const isCause = isAbout(frame, o);
    const group = svg("g", { class: `box${o.confirmed ? " confirmed" : ""}${isCause ? " cause" : ""}${o.predicted ? " predicted" : ""}` });
    Object.assign(group.dataset, {
      predicted: o.predicted, track: o.track, class: o.class, confirmed: o.confirmed, distance: o.distance_m,
      x: o.x_px, y: o.y_px, width: o.width_px, height: o.height_px,
      ttc: o.time_to_collision_s === null ? "" : o.time_to_collision_s,
    });
    group.append(svg("rect", { x: o.x_px, y: o.y_px, width: o.width_px, height: o.height_px }));
    const label = labels.get(o.track);
    if (label) {
      if (label.leader) group.append(svg("line", { class: "leader", ...label.leader }));
      const text = svg("text", { x: label.x, y: label.y + 11 * scale }, label.text);
      text.style.fontSize = `${13 * scale}px`;
      text.style.strokeWidth = `${3 * scale}px`;
      group.append(text);
    }
    return group;
  });
  view.replaceChildren(...spaceShapes(frame), ...wayLines(frame), ...boxes);
}

// Places for labels, as in tools/src/reporting/labels.rs: the cause of an alarm first, then the nearest. None covers another;
// what has no room at its box is shortened, then moved away with a line to it, then left out.
const LABEL_STEPS = 4;
const WHOLE_LABELS = 6;
// A picture that is shown much smaller has labels at the nearest only.
const [SMALL_SCALE, SMALL_LABELS] = [1.3, 8];

// Width of a label of 13 px with its outline, as style.css has it.
const labelWidth = (() => {
  const context = document.createElement("canvas").getContext("2d");
  return (text) => {
    context.font = "700 13px system-ui, sans-serif";
    return context.measureText(text).width + 3;
  };
})();

function placeLabels(frame, scale) {
  const placed = new Map();
  const [line, gap] = [14 * scale, 2 * scale];
  const isCause = (o) => isAbout(frame, o);
  const order = frame.obstacles.filter((o) => o.confirmed)
    .sort((a, b) => isCause(b) - isCause(a) || a.distance_m - b.distance_m)
    .slice(0, scale > SMALL_SCALE ? SMALL_LABELS : undefined);
  const fit = (x, y, width) => {
    const at = { x: Math.max(0, Math.min(x, frame.width - width)), y, width };
    const covers = (b) => at.x < b.x + b.width + gap && b.x < at.x + width + gap && Math.abs(y - b.y) < line;
    const is_inside = width <= frame.width && y >= 0 && y + line <= frame.height;
    return is_inside && ![...placed.values()].some(covers) ? at : null;
  };
  const atBox = (o, width) => {
    const right = o.x_px + o.width_px - width;
    const [above, below] = [o.y_px - line, o.y_px + o.height_px];
    return fit(o.x_px, above, width) || fit(right, above, width) || fit(o.x_px, below, width) || fit(right, below, width);
  };
  const away = (o, width) => {
    const middle = o.x_px + o.width_px / 2;
    for (let step = 1; step <= LABEL_STEPS; step += 1) {
      const far = step * (line + gap);
      const bottom = o.y_px + o.height_px;
      const above = fit(middle - width / 2, o.y_px - line - far, width);
      if (above) return { ...above, leader: { x1: middle, y1: above.y + line, x2: middle, y2: o.y_px } };
      const below = fit(middle - width / 2, bottom + far, width);
      if (below) return { ...below, leader: { x1: middle, y1: below.y, x2: middle, y2: bottom } };
    }
    return null;
  };
  for (const [rank, o] of order.entries()) {
    const soon = o.time_to_collision_s !== null && o.time_to_collision_s < 20;
    const long = `${o.class === "obstacle" ? "" : o.class + " "}${o.distance_m.toFixed(1)} m` +
      (soon ? ` · ${o.time_to_collision_s.toFixed(1)} s` : "");
    const short = `${o.distance_m.toFixed(0)} m`;
    const width = (text) => labelWidth(text) * scale;
    const found = [[rank < WHOLE_LABELS ? long : short, atBox], [short, atBox], [short, away]].map(([text, where]) => () => {
      const at = where(o, width(text));
      return at && { ...at, text };
    }).reduce((at, next) => at || next(), null);
    if (found) placed.set(o.track, found);
  }
  return placed;
}

function drawObstacles(frame) {
  const rows = [...frame.obstacles].sort((a, b) => a.distance_m - b.distance_m).filter((o) => o.confirmed);
  const body = byId("obstacles").tBodies[0];
  if (rows.length === 0) {
    body.replaceChildren(row(["no obstacles"], "none"));
    return;
  }
  body.replaceChildren(...rows.map((o) => {
    const side = Math.abs(o.lateral_m) < 0.05 ? "ahead" :
      `${Math.abs(o.lateral_m).toFixed(1)} m ${o.lateral_m > 0 ? "right" : "left"}`;
    const closing = o.closing_m_s === null ? "–" : `${o.closing_m_s.toFixed(1)} m/s`;
    const sure = o.score == null ? "" : ` ${Math.round(100 * o.score)} %`;
    const cells = [o.track, [o.class, sure, ""], [o.distance_m.toFixed(1), ` ± ${o.distance_sigma_m.toFixed(1)}`, " m"], side,
      closing, seconds(o.time_to_collision_s), ["", `${o.width_m.toFixed(1)} × ${o.height_m.toFixed(1)} m`, ""]];
    return row(cells, isAbout(frame, o) ? "cause" : "");
  }));
}

// A cell is a text, or three of which the second is left out on a narrow screen. `more`: cells that are left out there.
function row(cells, kind, more = []) {
  const line = document.createElement("tr");
  if (kind) line.className = kind;
  cells.forEach((text, i) => {
    const cell = document.createElement(i === 0 && cells.length > 1 ? "th" : "td");
    if (i === 0 && cells.length > 1) cell.scope = "row";
    if (cells.length === 1) { cell.colSpan = 12; cell.className = "none"; }
    if (Array.isArray(text)) {
      const middle = document.createElement("span");
      middle.className = "more";
      middle.textContent = text[1];
      cell.append(text[0], middle, text[2]);
      if (!text[0]) cell.classList.add("more");
    } else cell.textContent = text;
    if (more.includes(i)) cell.classList.add("more");
    line.append(cell);
  });
  return line;
}

// Bird's-eye view: the camera at the bottom centre, 40 m ahead, as wide as the panel.
const AHEAD_M = 40;

function drawBirds(frame, points) {
  const canvas = byId("birds");
  const dots = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return;
  if (canvas.width !== Math.round(width * dots)) canvas.width = Math.round(width * dots);
  if (canvas.height !== Math.round(height * dots)) canvas.height = Math.round(height * dots);
  const c = canvas.getContext("2d");
  c.setTransform(dots, 0, 0, dots, 0, 0);
  c.fillStyle = colour("--road");
  c.fillRect(0, 0, width, height);
  const perMetre = (height - 14) / AHEAD_M;
  const at = (x, z) => [width / 2 + x * perMetre, height - 6 - z * perMetre];
  // Field of view of the left camera.
  const reach = AHEAD_M * 1.2;
  const edge = (u) => ((u - frame.cx_px) * reach) / frame.focal_px;
  c.beginPath();
  c.moveTo(...at(0, 0));
  c.lineTo(...at(edge(0), reach));
  c.lineTo(...at(edge(frame.width), reach));
  c.closePath();
  c.fillStyle = colour("--panel");
  c.fill();
  drawFree(c, frame, at);
  c.strokeStyle = colour("--line");
  c.fillStyle = colour("--soft");
  c.font = "11px system-ui, sans-serif";
  c.lineWidth = 1;
  for (let z = 10; z <= AHEAD_M; z += 10) {
    const [, y] = at(0, z);
    c.beginPath(); c.moveTo(0, y); c.lineTo(width, y); c.stroke();
    c.fillText(`${z} m`, 4, Math.max(y - 3, 12));
  }
  if (points) drawPoints(c, frame, points, at);
  drawBoundaries(c, frame, at);
  drawWay(c, frame, at);
  c.lineWidth = 1;
  c.strokeStyle = colour("--s6");
  for (const r of frame.regions.filter((r) => r.evidence > 0)) {
    const [x, y] = at(r.lateral_m - r.width_m / 2, r.distance_m);
    c.strokeRect(x, y - 2, r.width_m * perMetre, 2);
  }
  const numbers = [];
  for (const o of frame.obstacles.filter((o) => o.confirmed)) {
    const isCause = isAbout(frame, o);
    const depth = Math.max(0.6, Math.min(o.width_m, 4) * 0.8);
    const [x, y] = at(o.lateral_m - o.width_m / 2, o.distance_m + depth);
    c.fillStyle = c.strokeStyle = colour(isCause ? "--bad" : "--accent");
    c.globalAlpha = 0.35;
    c.fillRect(x, y, o.width_m * perMetre, depth * perMetre);
    c.globalAlpha = 1;
    c.lineWidth = isCause ? 3 : 1.5;
    c.setLineDash(o.predicted ? [5, 4] : []);
    c.strokeRect(x, y, o.width_m * perMetre, depth * perMetre);
    c.setLineDash([]);
    // Predicted position in one second, relative to the vehicle, and two standard deviations of the distance.
    if (o.closing_m_s !== null && Math.abs(o.closing_m_s) > 0.5) {
      c.beginPath(); c.moveTo(...at(o.lateral_m, o.distance_m));
      c.lineTo(...at(o.lateral_m, o.distance_m - o.closing_m_s)); c.stroke();
    }
    c.beginPath(); c.moveTo(...at(o.lateral_m, o.distance_m - 2 * o.distance_sigma_m));
    c.lineTo(...at(o.lateral_m, o.distance_m + 2 * o.distance_sigma_m)); c.stroke();
    numbers.push({ o, isCause, x: x + o.width_m * perMetre + 3, y: y + 8, fill: c.fillStyle });
  }
  drawNumbers(c, numbers);
  c.fillStyle = colour("--ink");
  const [mx, my] = at(0, 0);
  c.beginPath(); c.moveTo(mx, my - 9); c.lineTo(mx - 6, my + 4); c.lineTo(mx + 6, my + 4); c.fill();
  const near = frame.obstacles.filter((o) => o.confirmed).length;
  const free = freeAhead(frame);
  const way = free === null ? "no road detected, free space unknown" : `free ahead ${free.toFixed(1)} m`;
  const text = `${way}; ${near} tracks, ${frame.regions.length} regions, ${points ? points.byteLength / 8 : 0} points`;
  const line = frame.path.left_m.length < 2 ? "" : frame.path.known ? "; blue: path" : "; dashed: straight path";
  canvas.setAttribute("aria-label", `Road from above: ${text}`);
  byId("birds-caption").textContent = `${text}; outline: free space; violet: boundaries; lines from tracks: predicted motion in one second${line}`;
}

// Distances beside the tracks: the cause of an alarm first, then the nearest. One that would cover another is left out.
const [NUMBER_PX, NUMBER_GAP_PX] = [11, 2];

function drawNumbers(c, numbers) {
  const placed = [];
  const order = [...numbers].sort((a, b) => b.isCause - a.isCause || a.o.distance_m - b.o.distance_m);
  for (const { o, x, y, fill } of order) {
    const text = o.distance_m.toFixed(0);
    const right = x + c.measureText(text).width + NUMBER_GAP_PX;
    if (placed.some((b) => x < b.right && b.x < right && Math.abs(y - b.y) < NUMBER_PX)) continue;
    placed.push({ x, right, y });
    c.fillStyle = fill;
    c.fillText(text, x, y);
  }
}

// Corners of the free space, from the left: [x, z] in metres, two for each group of columns.
function freeOutline(frame) {
  const x = (u, z) => ((u - frame.cx_px) * z) / frame.focal_px;
  return frame.free_m.flatMap((z, i) => {
    const from = i * frame.free_columns_px;
    const to = Math.min(from + frame.free_columns_px, frame.width);
    return [[x(from, z), z], [x(to, z), z]];
  });
}

// Boundaries: a line at the foot, with a band of two standard deviations.
function drawBoundaries(c, frame, at) {
  c.strokeStyle = colour("--s4");
  for (const { points_m: points, sigma_m: sigma } of frame.boundaries) {
    if (points.length < 2) continue;
    const mean = sigma.reduce((sum, s) => sum + s, 0) / sigma.length;
    const perMetre = at(1, 0)[0] - at(0, 0)[0];
    for (const [width, alpha] of [[4 * mean * perMetre, 0.25], [3, 1]]) {
      c.beginPath();
      points.forEach(([x, z], i) => (i ? c.lineTo(...at(x, z)) : c.moveTo(...at(x, z))));
      c.lineWidth = width;
      c.globalAlpha = alpha;
      c.stroke();
    }
  }
  c.globalAlpha = 1;
}

// Free space: where the road was measured and nothing stands. It has an outline, so that it is visible without colour.
function drawFree(c, frame, at) {
  const corners = freeOutline(frame);
  if (!corners.some(([, z]) => z > 0)) return;
  c.beginPath();
  c.moveTo(...at(0, 0));
  for (const [x, z] of corners) c.lineTo(...at(x, z));
  c.closePath();
  c.fillStyle = c.strokeStyle = colour("--s3");
  c.globalAlpha = 0.16;
  c.fill();
  c.globalAlpha = 0.9;
  c.lineWidth = 1.5;
  c.stroke();
  c.globalAlpha = 1;
}

// The strip that the vehicle will sweep, as the alarm sees it.
function drawWay(c, frame, at) {
  const { known, left_m: left, right_m: right, sigma_m: sigma } = frame.path;
  if (left.length < 2 || right.length < 2) return;
  c.strokeStyle = c.fillStyle = colour("--accent");
  c.lineWidth = 1.5;
  c.setLineDash(known ? [] : [7, 5]);
  for (const edge of [left, right]) {
    c.beginPath();
    edge.forEach(([x, z], i) => (i ? c.lineTo(...at(x, z)) : c.moveTo(...at(x, z))));
    c.stroke();
  }
  c.setLineDash([]);
  // Two standard deviations to both sides.
  c.lineWidth = 0.7;
  for (const [edge, side] of [[left, -2], [right, 2]]) {
    c.beginPath();
    edge.forEach(([x, z], i) => (i ? c.lineTo(...at(x + side * sigma[i], z)) : c.moveTo(...at(x + side * sigma[i], z))));
    c.stroke();
  }
  c.beginPath();
  [...left, ...[...right].reverse()].forEach(([x, z], i) => (i ? c.lineTo(...at(x, z)) : c.moveTo(...at(x, z))));
  c.globalAlpha = 0.1;
  c.fill();
  c.globalAlpha = 1;
}

// Free distance straight ahead, in metres, in a lane of the width of a car; null without a detected road. A direction in
// which nothing is known is not free: it counts from where the lane is seen.
const LANE_M = 2;
const LANE_SEEN_M = 8;

function freeAhead(frame) {
  const corners = freeOutline(frame);
  let free = null;
  for (let i = 0; i < corners.length; i += 2) {
    const [z, u] = [corners[i][1], (i / 2) * frame.free_columns_px];
    const at = (column) => ((column - frame.cx_px) * (z || LANE_SEEN_M)) / frame.focal_px;
    const isInLane = at(u) < LANE_M / 2 && at(u + frame.free_columns_px) > -LANE_M / 2;
    if (isInLane && frame.free_m.some((far) => far > 0)) free = Math.min(free === null ? z : free, z);
  }
  return free;
}

// Points by their height above the road: faint on the road, strong above it.
function drawPoints(c, frame, points, at) {
  const tilt = frame.road_tilt;
  const height = frame.road ? frame.road.camera_height_m : null;
  const [flat, tall] = [colour("--soft"), colour("--s2")];
  for (let i = 0; i + 8 <= points.byteLength; i += 8) {
    const x = points.getInt16(i, true) / 100;
    const y = points.getInt16(i + 2, true) / 100;
    const z = points.getInt16(i + 4, true) / 100;
    const up = height === null ? 1 : height + tilt * z - y;
    if (up > 3) continue;
    c.fillStyle = up > 0.3 ? tall : flat;
    c.globalAlpha = up > 0.3 ? 0.8 : 0.25;
    const [px, py] = at(x, z);
    c.fillRect(px - 0.75, py - 0.75, 1.5, 1.5);
  }
  c.globalAlpha = 1;
}

function drawPath(frame) {
  const view = byId("path");
  view.setAttribute("viewBox", `0 0 ${frame.disparities} ${frame.height}`);
  const list = frame.profile.map(([y, d]) => `${d.toFixed(2)},${y}`).join(" ");
  view.replaceChildren(svg("polyline", { points: list }));
  byId("v-caption").textContent = frame.road
    ? `road: camera height ${frame.road.camera_height_m.toFixed(2)} m, horizon in row ` +
      `${frame.road.horizon_px.toFixed(0)}, detected in ${(frame.road.confidence * 100).toFixed(0)} % of its rows`
    : "no road detected";
}

// The colour map of the disparity, as in tools/src/reporting/colour.rs.
const RAINBOW = [[48, 18, 59], [70, 107, 227], [40, 187, 236], [49, 242, 153], [162, 252, 60], [237, 208, 58],
  [251, 128, 34], [210, 49, 5], [122, 4, 3]];

function drawScale(frame) {
  const canvas = byId("scale");
  const c = canvas.getContext("2d");
  const gradient = c.createLinearGradient(0, 0, canvas.width, 0);
  RAINBOW.forEach((rgb, i) => gradient.addColorStop(i / (RAINBOW.length - 1), `rgb(${rgb})`));
  c.fillStyle = gradient;
  c.fillRect(0, 0, canvas.width, canvas.height);
  const near = (frame.focal_px * frame.baseline_m) / frame.disparities;
  // The scale is that of the square root: its middle is a quarter of the disparity range.
  byId("scale-text").textContent = `far · ${(near * 4).toFixed(0)} m · ${near.toFixed(1)} m; black is unknown`;
}

// Lines over the last minutes. Each series: name, colour, value of a sample (null breaks the line).
function drawChart(name, samples, series, unit, least) {
  const view = byId(`c-${name}`);
  // In pixels of the page, so that text is not stretched.
  const box = view.getBoundingClientRect();
  const [width, height, left, bottom] = [Math.max(120, box.width), Math.max(60, box.height), 34, 14];
  view.setAttribute("viewBox", `0 0 ${width} ${height}`);
  view.setAttribute("preserveAspectRatio", "none");
  view.setAttribute("role", "img");
  const values = series.map((s) => samples.map(s.value));
  const known = values.flat().filter((v) => v !== null && v !== undefined && isFinite(v));
  // What this machine does not have needs no panel.
  view.closest(".panel").hidden = series.length === 0;
  if (known.length === 0) {
    const text = noData(name, samples);
    view.replaceChildren(svg("text", { x: 10, y: height / 2 }, "no data"));
    view.setAttribute("aria-label", text);
    byId(`k-${name}`).textContent = text;
    return;
  }
  const top = niceTop(Math.max(...known, least));
  const last = samples[samples.length - 1];
  // As much time as there is, at least half a minute.
  const span = Math.min(299, Math.max(30, last.number - samples[0].number));
  const x = (s) => left + ((s.number - last.number + span) / span) * (width - left - 2);
  const y = (v) => 6 + (1 - v / top) * (height - bottom - 6);
  const children = [];
  for (const share of [0, 0.5, 1]) {
    const level = y(top * share);
    children.push(svg("line", { class: "grid", x1: left, x2: width, y1: level, y2: level }));
    children.push(svg("text", { x: 2, y: level + 4 }, short(top * share)));
  }
  children.push(svg("text", { x: left, y: height - 4 }, span > 120 ? `${Math.round(span / 60)} min ago` : `${span} s ago`));
  children.push(svg("text", { x: width - 22, y: height - 4 }, "now"));
  series.forEach((s, k) => {
    let path = "";
    let pen = "M";
    samples.forEach((sample, i) => {
      const v = values[k][i];
      if (v === null || v === undefined) { pen = "M"; return; }
      path += `${pen}${x(sample).toFixed(1)} ${y(v).toFixed(1)}`;
      pen = "L";
    });
    const line = svg("path", { d: path });
    line.style.stroke = `var(${s.colour})`;
    children.push(line);
  });
  view.replaceChildren(...children);
  const now = series.map((s) => ({ ...s, now: s.value(last) }));
  const words = now.map((s) => `${s.name} ${s.now === null || s.now === undefined ? "–" : short(s.now)}`);
  view.setAttribute("aria-label", `${words.join(", ")} ${unit}`);
  const caption = byId(`k-${name}`);
  caption.replaceChildren(...now.flatMap((s, i) => {
    const mark = document.createElement("i");
    mark.style.color = `var(${s.colour})`;
    mark.textContent = "■ ";
    return [mark, document.createTextNode(`${words[i]}${i + 1 < now.length ? "  " : ` ${unit}`}`)];
  }));
}

// Why a chart has no values: some come with frames only.
function noData(name, samples) {
  if (!["latency", "speed"].includes(name)) return "not available on this machine";
  return samples.some((s) => s.latency_ms !== null) ? "own motion unknown" : "waiting for frames";
}

function niceTop(value) {
  const power = 10 ** Math.floor(Math.log10(Math.max(value, 1e-6)));
  for (const step of [1, 1.5, 2, 3, 4, 5, 6, 8, 10]) if (value <= step * power) return step * power;
  return 10 * power;
}

const short = (v) => (v >= 100 ? v.toFixed(0) : v >= 10 ? v.toFixed(v % 1 ? 1 : 0) : v.toFixed(v % 1 ? 2 : 0));

function drawCharts(samples, stages) {
  if (samples.length === 0) return;
  const stage = stages.map((name, i) => ({
    name, colour: SERIES[i], value: (s) => (s.stage_ms ? s.stage_ms[i] : null),
  }));
  drawChart("latency", samples, [...stage,
    { name: "end to end", colour: "--s6", value: (s) => s.latency_ms },
    { name: "longest", colour: "--s5", value: (s) => s.latency_worst_ms }], "ms", 10);
  drawChart("rate", samples, [
    { name: "frames", colour: "--s1", value: (s) => s.rate_hz },
    { name: "dropped", colour: "--s5", value: (s) => s.dropped }], "per second", 5);
  drawChart("cpu", samples, [{ name: "all processes", colour: "--s1", value: (s) => s.cpu_percent }],
    "% of one core", 20);
  drawChart("speed", samples, [{ name: "own speed", colour: "--s1", value: (s) => s.speed_m_s }], "m/s", 5);
  const last = samples[samples.length - 1];
  const sensors = (key, scale) => last[key].slice(0, 6).map((sensor, i) => ({
    name: sensor.name, colour: SERIES[i % SERIES.length],
    value: (s) => { const r = s[key].find((r) => r.name === sensor.name); return r ? r.value * scale : null; },
  }));
  drawChart("heat", samples, sensors("temperatures", 1), "°C", 60);
  drawChart("clock", samples, sensors("clocks", 1e-6), "MHz", 1000);
  drawHealth(samples);
}

// Without daemon or viewer the curves stay, but no value and no process is current.
function drawAway(missing) {
  for (const view of document.querySelectorAll(".chart")) {
    // One that was never drawn waits.
    if (!view.hasChildNodes()) continue;
    const caption = byId(view.id.replace("c-", "k-"));
    caption.textContent = `${missing}: values until it was lost`;
    view.setAttribute("aria-label", caption.textContent);
  }
  byId("processes").tBodies[0].replaceChildren(row([missing], "none"));
}

// Bars with one slice for each second.
function drawHealth(samples) {
  const view = byId("c-health");
  view.setAttribute("viewBox", "0 0 300 36");
  view.setAttribute("preserveAspectRatio", "none");
  view.setAttribute("role", "img");
  const last = samples[samples.length - 1];
  const fill = { running: "--good", starting: "--warn", stopping: "--warn", degraded: "--bad" };
  const calibrated = { good: "--good", degraded: "--bad", unknown: "--warn", off: "--line" };
  const rung = (s) => s.rung ?? "not monitored";
  const heat = { normal: "--good", "not monitored": "--line", "lower frame rate": "--warn", "lower clocks": "--warn" };
  const hot = (kind) => heat[kind] || "--bad";
  const slices = (value, tint, y) => {
    // Consecutive seconds of one state are one slice.
    const found = [];
    for (const s of samples) {
      const x = 299 - (last.number - s.number);
      const kind = value(s);
      const before = found[found.length - 1];
      if (before && before.kind === kind && before.end === x) before.end = x + 1;
      else found.push({ kind, x, end: x + 1 });
    }
    return found.map((f) => {
      const slice = svg("rect", { x: f.x, width: f.end - f.x, y, height: 10 });
      slice.style.fill = `var(${tint(f.kind)})`;
      slice.append(svg("title", {}, f.kind));
      return slice;
    });
  };
  const of = (table) => (kind) => table[kind] || "--line";
  view.replaceChildren(...slices((s) => s.state, of(fill), 0),
    ...slices((s) => s.calibration, of(calibrated), 13), ...slices(rung, hot, 26));
  const text = `top to bottom: daemon (now ${last.state}), calibration (now ${last.calibration}), heat (now ${rung(last)})`;
  view.setAttribute("aria-label", text);
  byId("k-health").textContent = `${text}; last 5 minutes`;
}

function drawProcesses(status) {
  const mib = (bytes) => `${(bytes / 1048576).toFixed(1)} MiB`;
  byId("processes").tBodies[0].replaceChildren(...status.processes.map((p) => row([
    p.role, p.state, p.core === null ? "–" : p.core, `${p.rate_hz.toFixed(1)} /s`, `${p.p50_ms.toFixed(1)} ms`,
    `${p.p99_ms.toFixed(1)} ms`, p.skipped, `${p.cpu_percent.toFixed(0)} %`, mib(p.private_bytes), p.restarts,
  ], p.state === "running" ? "" : "cause", [2, 3, 4, 8])));
}
