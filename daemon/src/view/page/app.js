// The connection to the viewer, and the handling of its responses. One request is in flight at a time: the next
// is sent after the last response was drawn, so a slow device gets fewer frames but never old ones.
"use strict";

const STALE_MS = 2500;
const KEPT = 300;

const page = {
  socket: null,
  wait_ms: 250,
  is_paused: false,
  live: false,
  frames: 0,
  connections: 0,
  frame: null,
  points: null,
  samples: [],
  stages: [],
  frame_at: 0,
  said: "",
  said_at: 0,
};

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  page.socket = socket;
  socket.onopen = () => {
    page.wait_ms = 250;
    page.connections += 1;
    ask();
  };
  socket.onmessage = async (event) => {
    await take(event.data).catch((error) => console.error(error));
    // Wait until the browser has drawn the frame. Hidden pages are not drawn and need no frames.
    if (document.hidden) setTimeout(ask, 1000);
    else requestAnimationFrame(ask);
  };
  socket.onclose = () => {
    if (page.socket !== socket) return;
    page.socket = null;
    away("viewer not reachable: reconnecting", "no viewer");
    setTimeout(connect, page.wait_ms);
    page.wait_ms = Math.min(page.wait_ms * 2, 5000);
  };
}

// Requests only the parts whose panels are visible.
function ask() {
  const socket = page.socket;
  if (!socket || socket.readyState !== WebSocket.OPEN) return;
  const want = [...document.querySelectorAll("[data-part]")].filter(isInView).map((p) => p.dataset.part);
  socket.send(JSON.stringify({ want, frames: !page.is_paused && !document.hidden }));
}

function isInView(panel) {
  const box = panel.getBoundingClientRect();
  return box.bottom > -200 && box.top < innerHeight + 200;
}

async function take(data) {
  const view = new DataView(data);
  const length = view.getUint32(0, true);
  const answer = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  page.stages = answer.stages;
  const parts = {};
  let at = 4 + length;
  for (const part of answer.parts) {
    parts[part.name] = new DataView(data, at, part.bytes);
    at += part.bytes;
  }
  if (answer.absent) away(answer.absent, "no daemon");
  else if (answer.status || answer.frame) present();
  if (answer.status) takeStatus(answer.status, answer.history);
  if (answer.frame && !page.is_paused) await takeFrame(answer.frame, parts);
  tellAge();
}

// `missing` names what is not there: the daemon, or the viewer between it and this page.
function away(why, missing) {
  page.live = false;
  const link = byId("link");
  link.className = "away";
  if (link.textContent !== why) link.textContent = why;
  // The reason stands beside it already.
  if (page.frames === 0) wait("");
  else if (missing === "no daemon") setAlarm("off", "alarm off", missing);
  // The daemon may run on.
  else setAlarm("off", "alarm not known", missing);
  // Nothing that was true of the daemon is shown as current.
  forgetMotion();
  byId("health").textContent = "";
  drawAway(missing);
}

// Before the first frame nothing is known, not even that the alarm is off.
function wait(why) {
  setAlarm("waiting", "waiting for the first frame", why);
}

function present() {
  if (page.live) return;
  page.live = true;
  byId("link").className = "live";
  byId("link").textContent = "live";
}

async function takeFrame(frame, parts) {
  const pictures = ["left", "disparity", "v_disparity"].filter((name) => parts[name] && parts[name].byteLength);
  // All pictures of a frame are decoded before any is shown, and then replace the old ones together, so that
  // boxes and image always belong to the same frame.
  const images = pictures.map((name) => {
    const image = new Image(frame.width, frame.height);
    image.src = URL.createObjectURL(new Blob([parts[name]], { type: "image/jpeg" }));
    return image;
  });
  const decoded = await Promise.allSettled(images.map((image) => image.decode()));
  images.forEach((image) => URL.revokeObjectURL(image.src));
  // The connection may have been lost meanwhile.
  if (!page.live) return;
  pictures.forEach((name, i) => {
    if (decoded[i].status !== "fulfilled") return;
    const before = byId(name);
    images[i].alt = before.alt;
    images[i].id = name;
    images[i].dataset.sequence = frame.sequence;
    before.replaceWith(images[i]);
  });
  page.frame = frame;
  page.points = parts.points || null;
  page.frame_at = performance.now();
  page.frames += 1;
  drawBoxes(frame);
  drawObstacles(frame);
  if (parts.points) drawBirds(frame, parts.points);
  if (parts.v_disparity) drawPath(frame);
  if (parts.disparity) drawScale(frame);
  tellMotion(frame);
  byId("left-caption").textContent =
    `frame ${frame.sequence}, ${frame.time_s.toFixed(1)} s; ${frame.latency_ms.toFixed(0)} ms from capture to result`;
  tellAlarm(frame.alarm);
}

// Level, reason and object of the alarm.
function tellAlarm({ level, reason, object, nearest_m: nearest }) {
  const ahead = nearest === null ? "" : `, ${metres(nearest)} ahead`;
  const more = `${reason || ""}${object ? `, ${alarmObject(object)}` : ""}${ahead}`;
  if (level === "alarm") setAlarm("alarm", "alarm raised", more);
  else if (level === "warning") setAlarm("warning", "warning raised", more);
  else if (level === "clear") setAlarm("clear", "alarm clear", reason || "");
  else setAlarm("off", "alarm off", reason || "");
}

// Such as "vehicle 12, 0.6 m into the path".
function alarmObject({ track, class: name, clearance_m: clearance }) {
  const place = clearance === null ? "" :
    clearance < 0 ? `, ${(-clearance).toFixed(1)} m into the path` : `, ${clearance.toFixed(1)} m beside the path`;
  return `${name || "track"} ${track}${place}`;
}

// Own speed and yaw rate, and what they are known from.
function tellMotion({ motion }) {
  const element = byId("motion");
  element.className = motion.known ? "" : "unknown";
  element.textContent = motion.known ? ownMotion(motion) : "own motion unknown: straight path";
}

function forgetMotion() {
  byId("motion").className = byId("motion").textContent = "";
}

// The visible text changes with every frame. The text for screen readers changes only with the level, and is
// repeated while an alarm lasts.
function setAlarm(level, text, more) {
  const element = byId("alarm");
  element.className = level;
  byId("alarm-level").textContent = text;
  byId("alarm-more").textContent = more && `· ${more}`;
  const now = performance.now();
  if (level !== page.said || (level === "alarm" && now - page.said_at > 5000)) {
    byId("spoken").textContent = level === "waiting" ? "" : level === "clear" ? "alarm over: clear" : `${text} ${more}`;
    [page.said, page.said_at] = [level, now];
  }
}

function takeStatus(status, history) {
  const before = page.samples[page.samples.length - 1];
  // The numbers start over after a restart of the viewer.
  if (before && history.length && history[0].number <= before.number) page.samples = [];
  page.samples = [...page.samples, ...history].slice(-KEPT);
  drawCharts(page.samples, page.stages);
  drawProcesses(status);
  if (status.calibration.state !== "off") byId("k-health").append(`. Calibration ${status.calibration.text}`);
  const last = page.samples[page.samples.length - 1];
  const rate = last && last.rate_hz !== null ? `${last.rate_hz.toFixed(1)} frames per second, ` : "";
  const why = status.reason ? ` (${status.reason})` : "";
  if (page.frames === 0) wait(status.reason || status.state);
  const latency = status.frames === 0 ? "no frame yet" :
    `latency p50 ${status.latency_p50_ms.toFixed(0)} ms, p99 ${status.latency_p99_ms.toFixed(0)} ms`;
  byId("health").textContent = `${status.state}${why}: ${rate}${latency}`;
}

// An old picture must not be mistaken for the current road, nor none for an empty road.
function tellAge() {
  const age = performance.now() - page.frame_at;
  const stale = document.querySelector(".stale");
  const is_first = page.frame === null;
  const is_old = !is_first && age > STALE_MS;
  stale.hidden = !is_first && !is_old && !page.is_paused;
  stale.classList.toggle("waiting", is_first);
  if (!stale.hidden) {
    const why = page.is_paused ? "paused" : "no new frame";
    const last = `${why}: last frame ${(age / 1000).toFixed(0)} s ago`;
    const text = !is_first ? last : page.is_paused ? "paused before the first frame" : "waiting for the first frame";
    if (stale.textContent !== text) stale.textContent = text;
  }
  if (is_old && !page.is_paused && page.live) {
    setAlarm("off", "alarm off", "no new frame");
    forgetMotion();
  }
}

function pause() {
  page.is_paused = !page.is_paused;
  const button = byId("pause");
  button.setAttribute("aria-pressed", String(page.is_paused));
  button.textContent = page.is_paused ? "Resume" : "Pause";
  tellAge();
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const panels = [...document.querySelectorAll(".panel")];
  if (event.key === "p") pause();
  else if (event.key >= "1" && event.key <= "9" && panels[event.key - 1]) panels[event.key - 1].focus();
  else if (event.key === "f") {
    const panel = document.activeElement.closest(".panel");
    if (document.fullscreenElement) document.exitFullscreen();
    else if (panel && panel.requestFullscreen) panel.requestFullscreen();
  }
});
byId("pause").addEventListener("click", pause);
setInterval(tellAge, 1000);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  if (page.frame && page.points) drawBirds(page.frame, page.points);
});
connect();
