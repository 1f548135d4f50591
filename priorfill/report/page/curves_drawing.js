/* Lines, bands and marks of the curves, on a Canvas 2D. */

/** Colours of markers that share a panel (Okabe and Ito 2008, without those of fills), on a light
 * and on a dark ground, and the symbols that tell them apart without colours. */
const CURVE_MARKER_COLOURS = {
  light: ["#0072b2", "#007a5a", "#a8478b", "#1b1f24", "#7a6a00", "#5b3fb0"],
  dark: ["#56b4e9", "#2fc796", "#e69fcb", "#e8ebee", "#f0e442", "#b9a5ff"],
};
const CURVE_SYMBOLS = ["circle", "square", "triangle", "diamond", "cross", "ring"];

/** Colours and dashes (CSS pixels) of further versions, on a light and on a dark ground. */
const CURVE_OTHER_COLOURS = {
  light: ["#7b3fb5", "#0077aa", "#8a6d00", "#b0307a"],
  dark: ["#c9a0ff", "#5cc3f0", "#e0c341", "#ff8fc7"],
};
const CURVE_OTHER_DASHES = [[9, 3, 2, 3], [2, 3], [12, 4], [5, 2, 2, 2, 2, 2]];

/** Dashes (CSS pixels) of fills and of the kinds of versions. */
const CURVE_FILL_DASH = [6, 3];
const CURVE_KIND_DASHES = { truth: [], original: [1, 3] };

/** Frames on a CSS pixel from which pixel columns are filled from their least to greatest value. */
const CURVE_DENSE = 4;

/** CSS pixels: size of the square of a single sample, and width of a frame from which it fits. */
const CURVE_DOT = 3;
const CURVE_DOT_ROOM = 4;

/** Opacity of the shade of gaps. */
const CURVE_GAP_ALPHA = 0.15;

/** CSS pixels between two marks of doubtful samples, and between symbols on a line. */
const CURVE_MARK_EVERY = 6;
const CURVE_SYMBOL_EVERY = 110;

/**
 * How a version is drawn.
 * @param {Object[]} versions Of the page data.
 * @param {number} version Index.
 * @returns {{colour: string, dash: number[], width: number}}
 */
function versionStyle(versions, version) {
  const shades = colours();
  const { kind } = versions[version];
  if (kind === "filled") return { colour: shades.filled, dash: CURVE_FILL_DASH, width: 1.8 };
  if (kind === "truth") return { colour: shades.truth, dash: CURVE_KIND_DASHES.truth, width: 1.3 };
  if (kind === "original") {
    return { colour: shades.ghost, dash: CURVE_KIND_DASHES.original, width: 2 };
  }
  const others = versions.map((v, i) => (v.kind === "other" ? i : -1)).filter((i) => i >= 0);
  const palette = CURVE_OTHER_COLOURS[shades.dark ? "dark" : "light"];
  const place = Math.max(0, others.indexOf(version));
  const round = Math.floor(place / palette.length); // the same colours with other dashes
  const dash = CURVE_OTHER_DASHES[(place + round) % CURVE_OTHER_DASHES.length];
  return { colour: palette[place % palette.length], dash, width: 1.5 };
}

/**
 * How a marker is drawn that shares its panel with others.
 * @param {number} place Among the chosen markers.
 * @returns {{colour: string, symbol: string}}
 */
function markerStyle(place) {
  const palette = CURVE_MARKER_COLOURS[colours().dark ? "dark" : "light"];
  return { colour: palette[place % palette.length], symbol: CURVE_SYMBOLS[place % 6] };
}

/**
 * The frames in view, with one more at each end for lines that leave it.
 * @param {CurveView} view
 * @returns {[number, number]} First, and the one after the last.
 */
function framesInView(view) {
  return [
    Math.max(0, Math.floor(view.first)),
    Math.min(view.frames, Math.ceil(view.last) + 1),
  ];
}

/**
 * The least and the greatest value of a series in view.
 * @param {Float32Array} series
 * @param {CurveView} view
 * @param {{low: number, high: number}} range Widened in place.
 * @param {Float32Array|null} spread Added and subtracted, times `factor`, where it is known.
 * @param {number} factor
 */
function widenRange(series, view, range, spread = null, factor = 0) {
  const [first, stop] = framesInView(view);
  for (let frame = first; frame < stop; frame += 1) {
    const value = series[frame];
    if (value !== value) continue; // NaN
    let half = spread ? spread[frame] * factor : 0;
    if (half !== half) half = 0;
    if (value - half < range.low) range.low = value - half;
    if (value + half > range.high) range.high = value + half;
  }
}

/**
 * Set the ends of the value axis of a panel.
 * @param {Object} panel
 * @param {{low: number, high: number}} range Of the values; low > high if there are none.
 */
function setPanelRange(panel, range) {
  const least = CURVE_LEAST_RANGE[panel.kind];
  if (!(range.low <= range.high)) {
    panel.low = 0;
    panel.high = least;
    panel.empty = true;
    return;
  }
  const margin = CURVE_MARGIN * (range.high - range.low);
  const lack = Math.max(0, least - (range.high - range.low + 2 * margin)) / 2;
  panel.low = range.low - margin - lack;
  panel.high = range.high + margin + lack;
  panel.empty = false;
  const errors = panel.kind === "distance" || panel.kind === "error";
  const speed = panel.kind === "speed" && (panel.low < 0 || range.low < 0.5 * range.high);
  if (errors || speed) panel.low = 0;
}

/**
 * Add a series to the current path; lines stop where values are missing.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Float32Array} series
 */
function traceSeries(context, panel, view, series) {
  const [first, stop] = framesInView(view);
  let down = false;
  for (let frame = first; frame < stop; frame += 1) {
    const value = series[frame];
    if (value !== value) { // NaN
      down = false;
      continue;
    }
    const x = frameX(panel, view, frame);
    const y = valueY(panel, value);
    if (down) context.lineTo(x, y);
    else {
      context.moveTo(x, y);
      const next = series[frame + 1];
      const alone = next !== next || next === undefined;
      if (alone && panel.width >= CURVE_DOT_ROOM * view.span) {
        context.rect(x - CURVE_DOT / 2, y - CURVE_DOT / 2, CURVE_DOT, CURVE_DOT);
      } else if (alone) context.lineTo(x + 1, y);
    }
    down = true;
  }
}

/**
 * Draw a series where many frames share a pixel: each column is filled from its least to its
 * greatest value, so that no peak is lost. Rectangles are drawn much faster than strokes.
 * @param {CanvasRenderingContext2D} context With its fill style set.
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Float32Array} series
 * @param {number} width Least height of a rectangle (CSS pixels): that of the line.
 */
function fillColumns(context, panel, view, series, width) {
  const columns = Math.max(1, Math.round(panel.width));
  const scale = panel.height / (panel.high - panel.low);
  const bottom = panel.y + panel.height + panel.low * scale;
  let end = NaN; // value of the frame before the column, NaN if it is missing
  for (let column = 0; column < columns; column += 1) {
    const [from, to] = framesOfColumn(panel, view, column, columns);
    let low = end === end ? end : Infinity;
    let high = end === end ? end : -Infinity;
    let found = false;
    for (let frame = from; frame < to; frame += 1) {
      const value = series[frame];
      if (value !== value) continue; // NaN
      found = true;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (found) {
      const height = Math.max(width, (high - low) * scale);
      const middle = bottom - ((high + low) / 2) * scale;
      context.fillRect(panel.x + column, middle - height / 2, 1, height);
    }
    if (to > from) end = series[to - 1];
  }
}

/** The frames [from, to) of a pixel column of a panel. */
function framesOfColumn(panel, view, column, columns) {
  const at = (place) => Math.ceil(view.first + (place / columns) * view.span);
  return [Math.max(0, at(column)), Math.min(view.frames, at(column + 1))];
}

/**
 * Draw one series.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Float32Array} series
 * @param {{colour: string, dash: number[], width: number, alpha: number}} style
 */
function drawSeries(context, panel, view, series, style) {
  context.globalAlpha = style.alpha || 1;
  if (view.span > CURVE_DENSE * panel.width) {
    context.fillStyle = style.colour;
    fillColumns(context, panel, view, series, style.width);
  } else {
    context.strokeStyle = style.colour;
    context.lineWidth = style.width;
    context.lineJoin = "round";
    context.setLineDash(style.dash || []);
    context.beginPath();
    traceSeries(context, panel, view, series);
    context.stroke();
    context.setLineDash([]);
  }
  context.globalAlpha = 1;
}

/**
 * Draw a band around a series.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Float32Array|null} series Its middle; null for a band that begins at 0.
 * @param {Float32Array} bound 90 % bounds (mm).
 * @param {{factor: number, colour: string}} style Half width as part of the bound; colour.
 */
function drawBand(context, panel, view, series, bound, style) {
  const [first, stop] = framesInView(view);
  const step = Math.max(1, (stop - first) / Math.max(1, 2 * panel.width));
  context.fillStyle = style.colour;
  let upper = [];
  let lower = [];
  const flush = () => {
    if (upper.length) fillBetween(context, upper, lower);
    upper = [];
    lower = [];
  };
  for (let place = first; place < stop; place += step) {
    const found = bandAt(series, bound, style.factor, Math.floor(place), Math.floor(place + step));
    if (!found) {
      flush();
      continue;
    }
    const x = frameX(panel, view, step > 1 ? place : Math.floor(place));
    upper.push([x, valueY(panel, found[1])]);
    lower.push([x, valueY(panel, found[0])]);
  }
  flush();
}

/** The lower and upper end of a band in frames [from, to), or null where it is unknown. */
function bandAt(series, bound, factor, from, to) {
  let low = Infinity;
  let high = -Infinity;
  for (let frame = from; frame < to; frame += 1) {
    const half = factor * bound[frame];
    const middle = series ? series[frame] : 0;
    if (half !== half || middle !== middle) continue; // NaN
    low = Math.min(low, series ? middle - half : 0);
    high = Math.max(high, middle + half);
  }
  return low <= high ? [low, high] : null;
}

/** Fill the area between two lines of the same places; one place is 2 CSS pixels wide. */
function fillBetween(context, upper, lower) {
  const wide = upper.length === 1 ? 1 : 0;
  context.beginPath();
  for (const [x, y] of upper) context.lineTo(x - wide, y);
  if (wide) context.lineTo(upper[0][0] + wide, upper[0][1]);
  if (wide) context.lineTo(lower[0][0] + wide, lower[0][1]);
  for (const [x, y] of lower.reverse()) context.lineTo(x - wide, y);
  context.closePath();
  context.fill();
}

/**
 * Shade frames in which a marker is missing.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {number} start First frame.
 * @param {number} stop The frame after the last one.
 */
function shadeGap(context, panel, view, start, stop) {
  const left = frameX(panel, view, start - 0.5);
  const right = frameX(panel, view, stop - 0.5);
  if (stop <= start || right < panel.x || left > panel.x + panel.width) return;
  context.globalAlpha = CURVE_GAP_ALPHA;
  context.fillStyle = colours().muted;
  context.fillRect(left, panel.y, Math.max(1, right - left), panel.height);
  context.globalAlpha = 1;
}

/**
 * Mark the edges of a gap; what stays missing is hatched.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Object} gap Of the page data.
 * @param {boolean} active Whether it is the gap chosen.
 */
function edgeGap(context, panel, view, gap, active) {
  const left = frameX(panel, view, gap.start - 0.5);
  const right = frameX(panel, view, gap.stop - 0.5);
  if (right < panel.x || left > panel.x + panel.width) return;
  context.globalAlpha = active ? 0.9 : 0.45;
  context.strokeStyle = colours().missing;
  context.lineWidth = 1;
  if (right - left > 3 || active) {
    for (const x of [left, right]) strokeLine(context, x, panel.y, x, panel.y + panel.height);
  }
  for (const lack of gap.unfilled || []) {
    hatch(context, panel, frameX(panel, view, lack.start - 0.5),
      frameX(panel, view, lack.stop - 0.5));
  }
  context.globalAlpha = 1;
}

/** Hatch a panel between two horizontal places (CSS pixels). */
function hatch(context, panel, from, to) {
  const left = Math.max(panel.x, from);
  const right = Math.min(panel.x + panel.width, to);
  if (right <= left) return;
  context.save();
  context.beginPath();
  context.rect(left, panel.y, right - left, panel.height);
  context.clip();
  context.beginPath();
  for (let x = left - panel.height - (left % 8); x < right; x += 8) {
    context.moveTo(x, panel.y + panel.height);
    context.lineTo(x + panel.height, panel.y);
  }
  context.stroke();
  context.restore();
}
