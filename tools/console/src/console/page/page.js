"use strict";
// The state that the console tells, on the screen.

const LIMITS = [5, 12.5]; // Before a picture has come: seconds until a thing is old, and very old.
const NOTE = 20; // Seconds after which a note fades.
const SLOTS = 120; // Seconds of the plots.
const SIGNS = { waiting: "○", certain: "●", searching: "◐", lost: "✕" };
const NAMES = { waiting: "no picture yet", certain: "certain", searching: "searching", lost: "LOST" };
const LABELS = {
  waiting: "waiting for the vehicle",
  certain: "the picture is confirmed",
  searching: "the vehicle looks for its pose",
  lost: "the place shown may be wrong",
};

const byId = (id) => document.getElementById(id);
const address = (path) => path + location.search;
const isView = new URLSearchParams(location.search).has("view");
const me = Math.random().toString(36).slice(2); // Tells this page's commands from those of others.

let run = null; // Of the console, which this page shows. What another one showed is gone.
let state = null; // As the console told it last.
let told = 0; // When that was, milliseconds of this page's clock.
let isConnected = false;
let box = null; // Where the picture lies on the stage.
const shows = { overlay: true, path: true };
const images = { picture: null, chase: null, plan: null };
const loaded = { picture: null, chase: null };
const loading = {};
// Seconds from a modem frame's arrival to its picture on this page, the newest last; for tests.
window.latencies = [];

// How many seconds the console's clock went on since it told its state.
const since = () => ((performance.now() - told) / 1000) * state.speed;

async function fetchImage(path) {
  const response = await fetch(address(path), { cache: "no-store" });
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return createImageBitmap(await response.blob());
}

function forget(name) {
  if (images[name]) images[name].close();
  [images[name], loaded[name]] = [null, null];
}

const timeOfDay = (utc) => new Date(utc * 1000).toTimeString().slice(0, 8);
let seen = 0; // Until when the pilot has seen the alarms, UTC of the console.
let noted = 0; // When the last note came, milliseconds of this page's clock.

// What a command came to, with the time of day.
function note(text) {
  noted = performance.now();
  byId("note").textContent = text && `${timeOfDay(Date.now() / 1000)} ${text}`;
}

// Nothing that an ended run of the console has shown stays.
function beginRun(next) {
  [run, seen] = [next, 0];
  Object.keys(images).forEach(forget);
  note("");
}

// Has an image that the state tells of, unless it is on its way already.
async function load(name, number, path, then) {
  if (number === loaded[name] || loading[name]) return;
  loading[name] = true;
  const { arrived } = state.picture || {};
  const asked = run;
  try {
    const image = await fetchImage(path);
    if (asked === run) {
      forget(name);
      [images[name], loaded[name]] = [image, number];
      then(arrived);
    } else image.close();
  } catch (error) {
    console.warn(error.message);
  }
  loading[name] = false;
}

function loadAll() {
  if (state.picture) {
    load("picture", state.picture.number, "/picture.png", (arrived) => {
      drawPicture();
      window.latencies.push(Date.now() / 1000 - arrived);
      if (window.latencies.length > 1000) window.latencies.shift();
    });
  }
  if (state.chase.number) load("chase", state.chase.number, "/chase.png", () => drawViews());
  load("plan", 1, "/plan.png", () => drawViews());
}

function drawPicture() {
  const place = begin(byId("picture"));
  const image = images.picture;
  box = image && fit(place, image.width, image.height);
  if (image) drawImage(place, box, image);
  drawMarks();
}

function drawMarks() {
  const place = begin(byId("marks"));
  const overlay = shows.overlay && state && state.overlay;
  if (!state || !box) return;
  if (overlay) drawOverlay(place, box, overlay);
  if (shows.path && state.path) drawPath(place, box, state.path);
  const region = marker.drawn || state.region;
  if (!region) return;
  const [left, top, right, bottom] = region.map((part, k) => part * (k % 2 ? box.height : box.width));
  const corners = [[left, top], [right, top], [right, bottom], [left, bottom], [left, top]];
  line(place, box, corners, TEXT, 2, marker.drawn ? [6, 4] : []);
  if (!marker.drawn) words(place, box.x + left * box.scale + 6, box.y + top * box.scale + 18, "region", TEXT);
}

function drawViews() {
  if (!state) return;
  showScale(drawPlan(byId("plan"), images.plan, state.plan));
  drawChase(byId("chase"), images.chase, state.chase);
}

// A bar of a round length, where the map is drawn at some scale.
function showScale(scale) {
  byId("scale").hidden = !scale;
  if (!scale) return;
  const unit = state.plan.pixels_per_unit * scale, most = 110 / unit;
  const power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((digit) => digit * power).find((length) => length <= most);
  byId("scale").style.width = `${length * unit}px`;
  byId("scale").textContent = `${Number(length.toPrecision(1))} units`;
}

function drawPlots() {
  const bits = state.link.seconds.map(([count]) => count * 8);
  const losses = state.link.seconds.map(([, loss]) => loss);
  const most = Math.max(...bits, 8);
  const worst = Math.max(...losses, 0.1);
  byId("bytes-most").textContent = `· top: ${most}`;
  byId("loss-most").textContent = `· top: ${Math.round(worst * 100)} %`;
  drawBars(byId("bytes-plot"), bits, most, GOOD, SLOTS);
  drawBars(byId("loss-plot"), losses, worst, DOUBT, SLOTS);
}

// What the vehicle said of its pose. Of long ago, it says nothing of now.
function showPose(isOld) {
  const pose = state.pose;
  byId("pose").dataset.pose = isOld && pose !== "lost" ? "old" : pose;
  byId("pose-sign").textContent = isOld ? "?" : SIGNS[pose];
  byId("pose-name").textContent = isOld && pose !== "waiting" ? `was ${NAMES[pose]}` : NAMES[pose];
  byId("pose-label").textContent = isOld ? "nothing new is known" : LABELS[pose];
  const isKnown = !isOld && pose === "certain";
  byId("position").textContent = isKnown ? position(state.picture.known) : "–";
  const { heading } = state.plan;
  byId("heading").textContent = `heading ${isKnown && heading !== null ? `${Math.round(heading) % 360}°` : "–"}`;
}

// Within how much the position is known, as standard deviations.
function position(known) {
  if (!known) return "not known";
  const short = (value) => Number(value.toPrecision(1)).toString();
  return `± ${short(known[0])}, ${short(known[1])}°`;
}

const seconds = (value) => (value < 99.95 ? `${value.toFixed(1)} s` : `${Math.round(value)} s`);

// The one rule by which what is shown fades: 1, old; 2, very old, or nobody tells any more. `null`: nothing is shown.
function levelOf(age) {
  if (age === null) return 0;
  const [old, veryOld] = state.picture ? state.picture.limits : LIMITS;
  return !isConnected || age >= veryOld ? 2 : age >= old ? 1 : 0;
}

// What the link did of late. Of long ago, it says nothing of now.
function showLink(isOld) {
  const { bit_rate: rate, loss, pictures_per_second: pictures, frames } = state.link;
  byId("rate").textContent = frames === 0 || (isOld && (rate === 0 || !isConnected)) ? "–" : Math.round(rate);
  byId("loss").textContent = isOld || loss === null ? "–" : `${Math.round(loss * 100)} %`;
  byId("pictures").textContent = isOld || !state.picture ? "–" : pictures.toFixed(1);
}

// What goes on between two states: ages.
function tick() {
  if (!state) return;
  showLegend();
  const picture = state.picture;
  const age = picture && picture.age + since();
  byId("age").textContent = picture ? (picture.clock ? "" : "≥ ") + seconds(age) : "–";
  const silence = state.link.silence === null ? null : state.link.silence + since();
  byId("silence").textContent = silence === null ? "–" : seconds(silence);
  const chase = state.chase.age === null ? null : state.chase.age + since();
  const levels = { picture: levelOf(age), chase: levelOf(chase), link: levelOf(silence) };
  for (const shown of document.querySelectorAll("[data-age]")) shown.dataset.level = levels[shown.dataset.age];
  const level = levels.picture;
  showPose(level === 2);
  showLink(levels.link === 2);
  byId("note").classList.toggle("faded", performance.now() - noted > NOTE * 1000);
  byId("banner").hidden = isConnected && level < 2 && state.pose !== "lost" && !state.stopped && !state.missing;
  if (!isConnected) byId("banner").textContent = `The console does not answer. Picture: ${seconds(age || 0)} old`;
  else if (state.stopped) byId("banner").textContent = `Nothing comes: ${state.stopped}`;
  else if (state.missing) {
    const { what, seconds: lasting, advice } = state.missing;
    byId("banner").textContent = `${what}, for ${seconds(lasting + since())}. ${advice}`;
  } else if (level === 2) byId("banner").textContent = `This picture is ${seconds(age)} old`;
  else byId("banner").textContent = `Lost for ${seconds(state.uncertain_for + since())}: the place shown may be wrong`;
}

function showState() {
  const { link, picture, prior } = state;
  byId("prior").textContent = `· ${prior.file} · ${prior.identity}`;
  const clocks = { reports: "age of the picture", vehicle: "age, by the vehicle's clock" };
  const untold = picture && picture.is_clock_off ? "since it came: the vehicle's clock is off, set it" : "since it came";
  const counted = (picture && clocks[picture.clock]) || (picture ? untold : "age of the picture");
  const exposed = picture && timeOfDay(state.now - picture.age);
  byId("age-label").textContent = picture ? `${counted} · seen ${picture.clock ? "" : "before "}${exposed}` : counted;
  byId("about").textContent = picture
    ? `frame ${picture.frame} · ${picture.shares[0]} of ${picture.shares[1] ?? "?"} modem frames · ${picture.bytes} bytes` +
      (picture.has_residual ? "" : " · the prior alone, nothing seen by the camera")
    : "";
  byId("link-line").textContent =
    `${state.source} · ${link.bytes} bytes in ${link.frames} modem frames, ${link.garbage} unreadable · ` +
    (link.foreign === null ? "" : `${link.foreign} of strangers, ${link.replayed} replayed · `) +
    (link.reports === null ? "no return channel" : `${link.reports} reports sent`);
  byId("warnings").replaceChildren(...state.warnings.map((text) => {
    const item = document.createElement("li");
    item.textContent = text;
    return item;
  }));
  const isOthers = state.note_page !== null && state.note_page !== me;
  if (state.note) note(isOthers ? `another page: ${state.note}` : state.note);
  const pages = state.pages > 1 ? `${state.pages} pages are open` : "";
  byId("pages").textContent = [isView ? "this page only looks" : "", pages].filter(Boolean).join(" · ");
  showAlarms();
  showRecording();
}

// Alarms stay until they are seen, on each page for itself: another pilot's click is not this one's.
function showAlarms() {
  byId("alarms").replaceChildren(...state.alarms.filter(({ time }) => time > seen).map(({ time, text }) =>
    Object.assign(document.createElement("li"), { textContent: `${timeOfDay(time)} ${text}` })));
}

function sawAlarms() {
  seen = state ? state.now : 0;
  if (state) showAlarms();
}

const megabytes = (bytes) => (bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(1)} GB`);

function showRecording() {
  const { recorded, free } = state;
  const button = byId("record-button");
  const digits = (part) => String(Math.floor(part)).padStart(2, "0");
  const clock = (time) => [time / 3600, (time / 60) % 60, time % 60].map(digits).join(":");
  button.setAttribute("aria-pressed", recorded !== null);
  button.lastChild.textContent = recorded
    ? `ec ${clock(recorded.seconds)}, ${megabytes(recorded.bytes)}` : "ecord";
  byId("free").textContent = free === null ? "" : `${megabytes(free)} free`;
}

function connect() {
  const events = new EventSource(address("/events"));
  events.onmessage = (event) => {
    const next = JSON.parse(event.data);
    if (!next.link) return;
    if (next.run !== run) beginRun(next.run);
    if (!isConnected) note("");
    [state, told, isConnected] = [next, performance.now(), true];
    if (!state.picture) forget("picture");
    if (!state.chase.number) forget("chase");
    if (!images.picture) drawPicture();
    showState();
    tick();
    drawMarks();
    drawViews();
    drawPlots();
    loadAll();
  };
  events.onerror = () => {
    isConnected = false;
    tick();
    // The browser tries again by itself, unless the answer was a refusal.
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, 2000);
  };
}

async function send(path, body) {
  if (isView) return note("This page only looks: nothing was done.");
  const headers = { "content-type": "application/json" };
  try {
    const options = { method: "POST", headers, body: JSON.stringify({ ...body, page: me }) };
    const response = await fetch(address(path), options);
    if (!response.ok) note(await response.text());
  } catch {
    note("The console does not answer: nothing was done.");
  }
}

function partsAt(event) {
  const place = byId("marks").getBoundingClientRect();
  const part = (at, from, length) => Math.min(1, Math.max(0, (at - from) / length));
  if (!box) return [0, 0];
  return [
    part(event.clientX - place.left, box.x, box.width * box.scale),
    part(event.clientY - place.top, box.y, box.height * box.scale),
  ];
}

const marker = new RegionMarker(byId("stage"), partsAt, (parts) => send("/region", { parts }));
byId("stage").addEventListener("pointermove", () => marker.start && drawMarks());

function toggle(name) {
  shows[name] = !shows[name];
  byId(`${name}-button`).setAttribute("aria-pressed", shows[name]);
  drawMarks();
}

function togglePath() {
  toggle("path");
  const why = state?.pose === "certain" ? "too few poses yet" : "the vehicle is not certain of its pose";
  if (!state?.path) note(`No path to draw: ${why}.`);
}

// The picture alone; also if the browser keeps its window.
function goFull(on) {
  document.body.classList.toggle("full", on);
  byId("full-button").setAttribute("aria-pressed", on);
  const asked = on ? document.documentElement.requestFullscreen?.() : document.fullscreenElement && document.exitFullscreen();
  if (asked) asked.catch(() => {});
}
document.addEventListener("fullscreenchange", () => document.fullscreenElement || goFull(false));

const help = byId("help");
const commands = {
  o: () => toggle("overlay"),
  p: togglePath,
  m: () => byId("maps-button").setAttribute("aria-pressed", !document.body.classList.toggle("folded")),
  f: () => goFull(!document.body.classList.contains("full")),
  "?": () => (help.open ? help.close() : help.showModal()),
  s: () => send("/snapshot", {}),
  a: sawAlarms,
  r: () => state && send("/record", { on: state.recorded === null }),
};
const buttons = { overlay: "o", path: "p", snapshot: "s", record: "r", maps: "m", full: "f", help: "?" };
for (const [name, key] of Object.entries(buttons)) byId(`${name}-button`).onclick = commands[key];
document.body.classList.toggle("looks", isView);
byId("alarms").onclick = sawAlarms;
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (help.open && event.key !== "?") return;
  if (event.key === "Escape" && document.body.classList.contains("full")) return goFull(false);
  const command = commands[event.key.toLowerCase()];
  if (command) command();
  if (command || (state && marker.key(event, state.region))) event.preventDefault();
});

// What the patterns mean, and how much of the picture has each.
const legend = LEVELS.map((level, number) => {
  const item = document.createElement("span"), swatch = document.createElement("canvas");
  const words = document.createElement("b");
  [swatch.width, swatch.height] = [40, 24];
  const context = swatch.getContext("2d");
  if (level.pattern) {
    context.fillStyle = pattern(context, level);
    context.fillRect(0, 0, swatch.width, swatch.height);
  }
  item.append(swatch, words);
  return { level, number, item, words };
});
const lacksMap = Object.assign(document.createElement("span"), {
  className: "lacks", textContent: "this packet tells nothing of what is as seen",
});
const wasSeen = document.createElement("span");
byId("legend").append(...legend.map(({ item }) => item), wasSeen, lacksMap);

function showLegend() {
  const { overlay, picture } = state;
  byId("legend").hidden = !picture;
  lacksMap.hidden = !overlay || overlay.has_map;
  if (!overlay || !picture) return;
  const { levels, told_ago, seen_before, seen_ago } = overlay;
  const part = (count) => `${Math.max(Math.round((100 * count) / levels.length), 1)} %`;
  const ago = (age) => `${picture.clock ? "" : "≥ "}${Math.ceil(age + since())} s ago`;
  for (const { level, number, item, words } of legend) {
    const count = levels.filter((found) => found === number).length;
    // Those that the picture does not have are left out: there is little room.
    item.hidden = count === 0;
    words.textContent = `${level.name}${level.isTold ? `, told ${ago(told_ago)}` : ""} ${part(count)}`;
  }
  wasSeen.hidden = seen_ago === null;
  wasSeen.textContent = `of memory, ${part(seen_before)} was as seen ${ago(seen_ago)}`;
}

const places = new ResizeObserver(() => { drawPicture(); drawViews(); if (state) drawPlots(); });
document.querySelectorAll("section").forEach((place) => places.observe(place));
setInterval(tick, 100);
connect();
