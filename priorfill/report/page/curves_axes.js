/* Scales, ticks and labels of the curves. */

/** Frames of the narrowest view. */
const CURVE_LEAST_FRAMES = 4;

/** CSS pixels between the ticks of the time axis, and between those of a value axis. */
const CURVE_TICK_WIDTH = 64;
const CURVE_TICK_HEIGHT = 17;

/** Least height of a value axis, by quantity (mm, mm/s): what is smaller is noise of cameras. */
const CURVE_LEAST_RANGE = { x: 4, y: 4, z: 4, speed: 40, distance: 1, error: 1 };

/** Free space above and below the values, as part of their range. */
const CURVE_MARGIN = 0.06;

/** CSS pixels: room for numbers left of a panel, its title above it, the symbols of markers above
 * shared panels, the time axis below a column, and below that. */
const CURVE_ROOM = { left: 58, right: 10, title: 17, head: 18, axis: 36, block: 6 };

/** CSS pixels: least width of a column of panels; least and greatest height of a panel. */
const CURVE_COLUMN_WIDTH = 300;
const CURVE_LEAST_HEIGHT = 48;
const CURVE_MOST_HEIGHT = 150;

/** Share of the window's height, and CSS pixels: height of all panels together that is aimed at. */
const CURVE_AIMED_SHARE = 0.4;
const CURVE_AIMED_LEAST = 240;
const CURVE_AIMED_MOST = 560;

const CURVE_FONT = "12px system-ui, sans-serif";
const CURVE_BOLD = "600 12px system-ui, sans-serif";

/**
 * A step of 1, 2 or 5 times a power of ten that divides a range into at most `count` parts.
 * @param {number} range Greater than 0.
 * @param {number} count At least 1.
 */
function niceStep(range, count) {
  const raw = range / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(raw));
  const times = [1, 2, 5, 10].find((t) => t * power >= raw * (1 - 1e-9));
  return times * power;
}

/**
 * Ticks of an axis.
 * @param {number} low
 * @param {number} high
 * @param {number} count Greatest number of parts.
 * @param {number} least Smallest step: 1 for frames.
 * @returns {{step: number, values: number[]}}
 */
function niceTicks(low, high, count, least = 0) {
  if (!(high > low)) return { step: 1, values: [low] };
  const step = Math.max(least, niceStep(high - low, count));
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    values.push(k * step);
  }
  return { step, values };
}

/**
 * A tick as text with as many decimals as the step needs.
 * @param {number} value
 * @param {number} step
 */
function tickText(value, step) {
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const text = Math.abs(value).toFixed(Math.min(decimals, 6));
  return Number(text) !== 0 && value < 0 ? `−${text}` : text;
}

/** The frames in view: the first and the last, which need not be whole numbers. */
class CurveView {
  /** @param {number} frames Frames of the clip. */
  constructor(frames) {
    this.frames = frames;
    this.fit();
  }

  /** Frames between the first and the last in view. */
  get span() {
    return this.last - this.first;
  }

  /** Show the whole clip; a single frame is in the middle. */
  fit() {
    const alone = this.frames < 2 ? 0.5 : 0;
    this.first = -alone;
    this.last = Math.max(0, this.frames - 1) + alone;
  }

  /** Whether the whole clip is in view. */
  get whole() {
    return this.first <= 0 && this.last >= this.frames - 1;
  }

  /**
   * Show a range of frames, moved and cut so that it lies in the clip.
   * @param {number} first
   * @param {number} last
   */
  set(first, last) {
    if (this.frames < 2) {
      this.fit();
      return;
    }
    const most = Math.max(1, this.frames - 1);
    const span = Math.min(most, Math.max(Math.min(CURVE_LEAST_FRAMES, most), last - first));
    const middle = (first + last) / 2;
    this.first = Math.min(Math.max(0, middle - span / 2), most - span);
    this.last = this.first + span;
  }

  /**
   * Zoom.
   * @param {number} factor Of the span; below 1 zooms in.
   * @param {number} around Frame that stays in its place.
   */
  zoom(factor, around) {
    const most = Math.max(1, this.frames - 1);
    const span = Math.min(most, Math.max(Math.min(CURVE_LEAST_FRAMES, most), this.span * factor));
    const part = (around - this.first) / this.span;
    this.set(around - part * span, around + (1 - part) * span);
  }

  /** Move the view by a number of frames. */
  pan(frames) {
    this.set(this.first + frames, this.last + frames);
  }

  /** Whether a frame is in view. */
  shows(frame) {
    return frame >= this.first && frame <= this.last;
  }
}

/**
 * Where panels and time axes are.
 * @param {number} width CSS pixels.
 * @param {number[]} markers
 * @param {string[]} kinds Quantities, from above.
 * @param {boolean} together Whether a panel shows all markers.
 * @returns {{height: number, panels: Object[], heads: Object[], axes: Object[]}} Panels: kind,
 *   markers, label (marker named above it, or -1), x, y, width, height, group; heads of shared
 *   panels and axes: x, y, width.
 */
function layCurves(width, markers, kinds, together) {
  const groups = together ? [markers] : markers.map((marker) => [marker]);
  const columns = Math.max(1, Math.min(groups.length, Math.floor(width / CURVE_COLUMN_WIDTH), 3));
  const blocks = Math.ceil(groups.length / columns);
  const room = CURVE_ROOM;
  const aimed = aimedCurvesHeight() / (blocks * kinds.length) - room.title;
  const high = Math.round(Math.min(CURVE_MOST_HEIGHT, Math.max(CURVE_LEAST_HEIGHT, aimed)));
  const shared = together && markers.length > 1;
  const headHigh = shared ? room.head : 0;
  const blockHigh = headHigh + kinds.length * (room.title + high) + room.axis + room.block;
  const wide = width / columns;
  const laid = { height: blocks * blockHigh, panels: [], heads: [], axes: [] };
  groups.forEach((group, place) => {
    const x = Math.round((place % columns) * wide) + room.left;
    const inner = Math.max(40, Math.round(wide) - room.left - room.right);
    let y = Math.floor(place / columns) * blockHigh;
    if (shared) laid.heads.push({ x, y, width: inner });
    y += headHigh;
    kinds.forEach((kind, row) => {
      const label = row === 0 && !shared ? group[0] : -1;
      y += room.title;
      laid.panels.push(
        { kind, markers: group, label, x, y, width: inner, height: high, group: place });
      y += high;
    });
    laid.axes.push({ x, y, width: inner });
  });
  return laid;
}

/** @returns {number} height (CSS pixels) of all panels together that is aimed at */
function aimedCurvesHeight() {
  const share = CURVE_AIMED_SHARE * window.innerHeight;
  return Math.max(CURVE_AIMED_LEAST, Math.min(CURVE_AIMED_MOST, share));
}

/**
 * The horizontal place of a frame.
 * @param {Object} panel
 * @param {CurveView} view
 * @param {number} frame
 */
function frameX(panel, view, frame) {
  return panel.x + ((frame - view.first) / view.span) * panel.width;
}

/** The frame, not rounded, at a horizontal place. */
function frameAtX(panel, view, x) {
  return view.first + ((x - panel.x) / panel.width) * view.span;
}

/**
 * Draw the time axis of a column: seconds, and below them frame numbers.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} axis x, y, width
 * @param {CurveView} view
 * @param {Object} clip The clip of the page data.
 */
function drawTimeAxis(context, axis, view, clip) {
  const shades = colours();
  const count = axis.width / CURVE_TICK_WIDTH;
  const rows = [
    { title: "time (s)", tick: true, shift: 0, scale: 1 / clip.rate,
      least: view.frames < 2 ? 1 / clip.rate : 0, y: axis.y + 17 },
    { title: "frame", tick: false, shift: clip.first_frame, scale: 1, least: 1, y: axis.y + 33 },
  ];
  context.font = CURVE_FONT;
  for (const row of rows) {
    const low = (view.first + row.shift) * row.scale;
    const high = (view.last + row.shift) * row.scale;
    const { step, values } = niceTicks(low, high, count, row.least);
    context.textAlign = "right";
    context.fillStyle = shades.muted;
    context.fillText(row.title, axis.x - 8, row.y);
    context.textAlign = "center";
    context.fillStyle = shades.text;
    context.strokeStyle = shades.muted;
    context.lineWidth = 1;
    for (const value of values) {
      const x = Math.round(frameX(axis, view, value / row.scale - row.shift)) + 0.5;
      const text = tickText(value, step);
      const half = context.measureText(text).width / 2;
      if (x - half >= axis.x - 6 && x + half <= axis.x + axis.width + CURVE_ROOM.right) {
        context.fillText(text, x, row.y);
      }
      if (row.tick) strokeLine(context, x, axis.y, x, axis.y + 4);
    }
  }
}

/** Stroke one straight line. */
function strokeLine(context, fromX, fromY, toX, toY) {
  context.beginPath();
  context.moveTo(fromX, fromY);
  context.lineTo(toX, toY);
  context.stroke();
}

/**
 * Draw the frame of a panel: background, grid, numbers, title with unit.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel With `low` and `high`, the ends of its value axis.
 * @param {CurveView} view
 * @param {Object} clip The clip of the page data.
 */
function drawPanelGrid(context, panel, view, clip) {
  const shades = colours();
  context.strokeStyle = shades.grid;
  context.lineWidth = 1;
  const times = niceTicks(view.first / clip.rate, view.last / clip.rate,
    panel.width / CURVE_TICK_WIDTH);
  for (const time of times.values) {
    const x = Math.round(frameX(panel, view, time * clip.rate)) + 0.5;
    strokeLine(context, x, panel.y, x, panel.y + panel.height);
  }
  const { step, values } = valueTicks(panel);
  context.font = CURVE_FONT;
  context.textAlign = "right";
  context.textBaseline = "alphabetic";
  context.fillStyle = shades.text;
  for (const value of values) {
    const y = Math.round(valueY(panel, value)) + 0.5;
    strokeLine(context, panel.x, y, panel.x + panel.width, y);
    context.fillText(tickText(value, step), panel.x - 6, y + 4);
  }
  context.strokeStyle = shades.muted;
  context.strokeRect(panel.x + 0.5, panel.y + 0.5, panel.width - 1, panel.height - 1);
}

/** Ticks of a value axis, as many as there is room for: steps can be 2.5 times too long. */
function valueTicks(panel) {
  const most = Math.max(2, Math.floor(panel.height / CURVE_TICK_HEIGHT));
  const ticks = niceTicks(panel.low, panel.high, most);
  return ticks.values.length > 1 ? ticks : niceTicks(panel.low, panel.high, 2 * most);
}

/** The vertical place of a value. */
function valueY(panel, value) {
  return panel.y + panel.height * (1 - (value - panel.low) / (panel.high - panel.low));
}

/**
 * Write above a panel: the title at its left end, a value at its right end.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel With `titleStop`, where the title ends, if the text is a value.
 * @param {string} text
 * @param {number|null} x Left end of a title (CSS pixels); null for a value, which is written only
 *   if there is room.
 */
function writeAbove(context, panel, text, x) {
  context.font = CURVE_FONT;
  context.fillStyle = colours().text;
  const wide = context.measureText(text).width;
  const right = panel.x + panel.width;
  if (x === null && right - wide < panel.titleStop + 8) return;
  context.textAlign = "left";
  context.fillText(text, x === null ? right - wide : x, panel.y - 4);
  if (x !== null) panel.titleStop = x + wide;
}
