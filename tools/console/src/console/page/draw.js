"use strict";
// Drawing on canvases. All sizes are CSS pixels.

const GOOD = "#56b4e9", DOUBT = "#e69f00", BAD = "#ff6a3d", TEXT = "#e8ecef", FAINT = "#98a4ae";

// The canvas's context, with as many pixels as the screen shows, and its size.
function begin(canvas) {
  const scale = window.devicePixelRatio || 1;
  const box = canvas.getBoundingClientRect();
  const [width, height] = [Math.round(box.width * scale), Math.round(box.height * scale)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, box.width, box.height);
  return { context, width: box.width, height: box.height };
}

// Where a picture lies that fills as much of a place as its shape allows.
function fit(place, width, height) {
  const scale = Math.min(place.width / width, place.height / height);
  return { scale, x: (place.width - width * scale) / 2, y: (place.height - height * scale) / 2, width, height };
}

function drawImage(place, box, image) {
  place.context.imageSmoothingQuality = "high";
  place.context.drawImage(image, box.x, box.y, box.width * box.scale, box.height * box.scale);
}

// A line through pixels of a picture; on a dark edge, so that it is seen on any ground.
function line(place, box, points, colour, width, dash = []) {
  if (points.length < 2) return;
  const { context } = place;
  context.beginPath();
  points.forEach(([x, y], k) => context[k ? "lineTo" : "moveTo"](box.x + x * box.scale, box.y + y * box.scale));
  context.lineJoin = "round";
  context.setLineDash([]);
  context.strokeStyle = "#000a";
  context.lineWidth = width + 2.5;
  context.stroke();
  context.setLineDash(dash);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
  context.setLineDash([]);
}

function words(place, x, y, text, colour) {
  const { context } = place;
  context.font = "600 14px system-ui, 'DejaVu Sans', sans-serif";
  context.lineWidth = 3;
  context.strokeStyle = "#000c";
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}

// Where the vehicle goes: rails, a sleeper for each second, and one for where it is by now.
function drawPath(place, box, path) {
  path.rails.forEach((rail) => line(place, box, rail, TEXT, 2, [2, 5]));
  path.sleepers.forEach(({ seconds, line: ends }) => {
    line(place, box, ends, TEXT, 1.5);
    words(place, box.x + ends[1][0] * box.scale + 6, box.y + ends[1][1] * box.scale + 4, `+${seconds} s`, TEXT);
  });
  if (!path.now) return;
  line(place, box, path.now, GOOD, 4);
  const [x, y] = path.now[0];
  words(place, box.x + x * box.scale - 40, box.y + y * box.scale + 5, "now", GOOD);
}

// Levels of the overlay: name, colour, pattern. Each has a pattern of its own, for those who do not see colours.
// Of the pose, other colours tell. The last two were told before.
const DIFFERS = "#f0e442", WRONG = "#cc79a7";
const LEVELS = [
  { name: "unmarked: as seen" },
  { name: "differs", colour: DIFFERS, pattern: "dots" },
  { name: "wrong", colour: WRONG, pattern: "stripes" },
  { name: "memory", colour: FAINT, pattern: "corner" },
  { name: "doubtful memory", colour: FAINT, pattern: "cross" },
  { name: "never mapped", colour: FAINT, pattern: "bars" },
  { name: "differs", colour: DIFFERS, pattern: "rings", isTold: true },
  { name: "wrong", colour: WRONG, pattern: "dashes", isTold: true },
];

const TILE = 14;
const patterns = new Map();

function pattern(context, { colour, pattern: kind }) {
  if (patterns.has(kind)) return patterns.get(kind);
  const tile = document.createElement("canvas");
  tile.width = tile.height = TILE;
  const ink = tile.getContext("2d");
  ink.fillStyle = colour + "28";
  ink.fillRect(0, 0, TILE, TILE);
  ink.fillStyle = ink.strokeStyle = colour;
  ink.lineWidth = 2.5;
  if (kind === "dots") {
    // With a dark edge, since water has their colour.
    ink.fillStyle = "#000b";
    ink.fillRect(4, 4, 7, 7);
    ink.fillStyle = colour;
    ink.fillRect(5, 5, 5, 5);
  }
  if (kind === "rings") {
    ink.lineWidth = 1.25;
    ink.strokeRect(4, 4, 6, 6);
  }
  if (kind === "bars") ink.fillRect(0, 4, TILE, 6);
  // Beyond the tile's edges, so that lines go on from tile to tile.
  const rising = [-1, 0, 1].map((k) => [k * TILE, TILE, (k + 1) * TILE, 0]);
  const falling = [-1, 0, 1].map((k) => [k * TILE, 0, (k + 1) * TILE, TILE]);
  const corner = [[1, 6, 6, 1]];
  const dash = [[3, TILE - 3, TILE - 3, 3]];
  const strokes = { stripes: rising, dashes: dash, cross: [...rising, ...falling], corner }[kind] || [];
  for (const [fromX, fromY, toX, toY] of strokes) {
    ink.beginPath();
    ink.moveTo(fromX, fromY);
    ink.lineTo(toX, toY);
    ink.stroke();
  }
  patterns.set(kind, context.createPattern(tile, "repeat"));
  return patterns.get(kind);
}

// What may not be believed of the picture, block by block, with a line around what is of one level.
function drawOverlay(place, box, overlay) {
  const { columns, levels } = overlay;
  const rows = levels.length / columns;
  // Blocks are 16 pixels wide; the last ones of a row or column may reach beyond the picture.
  const side = 16 * box.scale;
  const { context } = place;
  const at = (column, row) => (column < 0 || row < 0 || column >= columns ? 0 : levels[row * columns + column] || 0);
  context.save();
  context.beginPath();
  context.rect(box.x, box.y, box.width * box.scale, box.height * box.scale);
  context.clip();
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const level = at(column, row);
      if (!LEVELS[level].pattern) continue;
      const [x, y] = [box.x + column * side, box.y + row * side];
      context.fillStyle = pattern(context, LEVELS[level]);
      context.fillRect(x, y, side, side);
      const edges = [[-1, 0, x + 1, y, 0, 1], [1, 0, x + side - 1, y, 0, 1], [0, -1, x, y + 1, 1, 0], [0, 1, x, y + side - 1, 1, 0]];
      context.strokeStyle = LEVELS[level].colour;
      context.lineWidth = 2;
      for (const [right, down, fromX, fromY, along, downward] of edges) {
        if (at(column + right, row + down) === level) continue;
        context.beginPath();
        context.moveTo(fromX, fromY);
        context.lineTo(fromX + along * side, fromY + downward * side);
        context.stroke();
      }
    }
  }
  context.restore();
}

// Returns how large a pixel of the map is drawn.
function drawPlan(canvas, image, plan) {
  const place = begin(canvas);
  if (!image) return null;
  const box = fit(place, image.width, image.height);
  drawImage(place, box, image);
  line(place, box, plan.track, TEXT, 2);
  line(place, box, plan.predicted, GOOD, 2, [3, 4]);
  if (!plan.vehicle) return box.scale;
  const { context } = place;
  const at = ([x, y]) => [box.x + x * box.scale, box.y + y * box.scale];
  if (plan.cone.length === 2) {
    context.beginPath();
    context.moveTo(...at(plan.vehicle));
    plan.cone.forEach((corner) => context.lineTo(...at(corner)));
    context.closePath();
    context.fillStyle = "#ffffff30";
    context.fill();
    line(place, box, [plan.cone[0], plan.vehicle, plan.cone[1]], TEXT, 1.5);
  }
  // Within what the vehicle says that it is.
  if (plan.known.length) line(place, box, [...plan.known, plan.known[0]], TEXT, 1.5, [2, 2]);
  context.beginPath();
  context.arc(...at(plan.vehicle), 6, 0, 7);
  context.fillStyle = GOOD;
  context.fill();
  context.strokeStyle = "#000";
  context.lineWidth = 1.5;
  context.stroke();
  return box.scale;
}

function drawChase(canvas, image, chase) {
  const place = begin(canvas);
  if (!image) return;
  const box = fit(place, image.width, image.height);
  drawImage(place, box, image);
  chase.track.forEach((points) => line(place, box, points, TEXT, 1.5));
  chase.predicted.forEach((points) => line(place, box, points, GOOD, 2, [3, 4]));
  chase.vehicle.forEach((points) => line(place, box, points, DOUBT, 2));
}

// Bars, oldest left; `null`: nothing is known of that second.
function drawBars(canvas, values, most, colour, slots) {
  const place = begin(canvas);
  const { context, width, height } = place;
  context.fillStyle = "#ffffff12";
  context.fillRect(0, 0, width, height);
  const step = width / slots;
  values.forEach((value, k) => {
    if (value === null) return;
    const x = width - (values.length - k) * step;
    const tall = Math.max(value > 0 ? 2 : 0, (value / (most || 1)) * height);
    context.fillStyle = colour;
    context.fillRect(x, height - tall, Math.max(step - 1, 1), tall);
  });
}
