/* Shared helpers: elements, canvases, colours, numbers as text. */

/** Samples of the colour-blind-safe scale cividis (Nunez, Anderton, Renslow 2018), as r, g, b. */
const CIVIDIS = [
  [0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115],
  [138, 134, 120], [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56],
];

/** Expected errors (mm) at the two ends of the colour scale; the scale is logarithmic. */
const SCALE_LOW_MM = 0.5;
const SCALE_HIGH_MM = 50;

/** Number of colours into which the scale is divided. */
const SCALE_STEPS = 64;

/** Colour names of the theme: key of `colours()` and CSS variable. */
const COLOUR_NAMES = {
  measured: "--measured", filled: "--filled", bound50: "--bound-50", bound90: "--bound-90",
  missing: "--missing", doubt: "--doubt", replaced: "--replaced", ghost: "--ghost",
  truth: "--truth", text: "--text", muted: "--muted", grid: "--grid", surface: "--surface",
  panel: "--panel", accent: "--accent", selection: "--selection", swapped: "--swapped",
  track: "--track",
};

/** Least and greatest number of decimals of a time in seconds. */
const LEAST_TIME_DIGITS = 2;
const MOST_TIME_DIGITS = 6;

/** Part of a decade by which a rate may exceed 100 Hz, for example, and have its decimals. */
const RATE_ROUNDING = 1e-3;

/** Digits of a rate that are shown; formats store no more. */
const RATE_DIGITS = 6;

let colourCache = null;

/**
 * Make an element. Text goes in as text, never as markup.
 * @param {string} tag name of the element
 * @param {Object} settings attributes; `text`, `class`, `on` ({event: function}) and `data`
 *   are treated specially; true sets an empty attribute, false, null and undefined none
 * @param {Array} children elements or texts
 * @returns {HTMLElement}
 */
function element(tag, settings = {}, children = []) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(settings)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "text") made.textContent = value;
    else if (name === "class") made.className = value;
    else if (name === "on") {
      for (const [event, fn] of Object.entries(value)) made.addEventListener(event, fn);
    } else if (name === "data") {
      for (const [key, text] of Object.entries(value)) made.dataset[key] = text;
    } else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/**
 * Make a real button.
 * @param {string} text what it says
 * @param {function} fn called at a click
 * @param {Object} settings further attributes
 * @returns {HTMLButtonElement}
 */
function button(text, fn, settings = {}) {
  return element("button", { type: "button", text, on: { click: fn }, ...settings });
}

/**
 * Fit a canvas to its size on the page in device pixels.
 * @param {HTMLCanvasElement} canvas
 * @returns {{context: CanvasRenderingContext2D, width: number, height: number, ratio: number}}
 *   the context scaled to CSS pixels, and the size in CSS pixels
 */
function fitCanvas(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, canvas.clientWidth);
  const height = Math.max(1, canvas.clientHeight);
  const wide = Math.round(width * ratio);
  const high = Math.round(height * ratio);
  if (canvas.width !== wide || canvas.height !== high || isPrinting()) {
    canvas.width = wide;
    canvas.height = high;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height, ratio };
}

/** @returns {boolean} whether the page is being printed */
function isPrinting() {
  return document.documentElement.classList.contains("printing");
}

/**
 * Clear a canvas that lies on another one. On paper, `fitCanvas` has cleared it, and Chromium would
 * print what is cleared once more as a white box.
 * @param {CanvasRenderingContext2D} context
 * @param {number} width CSS pixels
 * @param {number} height CSS pixels
 */
function clearCanvas(context, width, height) {
  if (!isPrinting()) context.clearRect(0, 0, width, height);
}

/**
 * Colours of the theme, read from the CSS variables.
 * @returns {Object} CSS colours by the keys of COLOUR_NAMES, and `dark` (boolean)
 */
function colours() {
  if (colourCache) return colourCache;
  const style = getComputedStyle(document.documentElement);
  const found = {};
  for (const [key, name] of Object.entries(COLOUR_NAMES)) {
    found[key] = style.getPropertyValue(name).trim() || "#888";
  }
  found.dark = style.getPropertyValue("--dark").trim() === "1";
  found.scale = errorScale(found.dark);
  colourCache = found;
  return found;
}

/** Read the colours again: the theme has changed. */
function forgetColours() {
  colourCache = null;
}

/**
 * The colour scale of expected errors: what is worse stands out more from the background.
 * @param {boolean} dark whether the background is dark
 * @returns {string[]} SCALE_STEPS CSS colours, from SCALE_LOW_MM to SCALE_HIGH_MM
 */
function errorScale(dark) {
  const ends = CIVIDIS.length - 1;
  const scale = [];
  for (let step = 0; step < SCALE_STEPS; step++) {
    const along = step / (SCALE_STEPS - 1);
    const place = (dark ? 0.12 + 0.88 * along : 1 - along) * ends;
    const low = Math.min(ends - 1, Math.floor(place));
    const mixed = CIVIDIS[low].map(
      (from, i) => Math.round(from + (place - low) * (CIVIDIS[low + 1][i] - from)));
    scale.push(`rgb(${mixed.join(",")})`);
  }
  return scale;
}

/**
 * Place of an expected error on the colour scale.
 * @param {number} mm expected error
 * @returns {number} 0 to SCALE_STEPS - 1; -1 where the error is unknown
 */
function errorStep(mm) {
  if (!(mm >= 0)) return -1;
  const range = Math.log(SCALE_HIGH_MM / SCALE_LOW_MM);
  const along = Math.log(Math.max(mm, SCALE_LOW_MM) / SCALE_LOW_MM) / range;
  return Math.min(SCALE_STEPS - 1, Math.round(along * (SCALE_STEPS - 1)));
}

/**
 * Colour of an expected error.
 * @param {number} mm expected error
 * @returns {string} CSS colour; that of filled samples where the error is unknown
 */
function errorColour(mm) {
  const step = errorStep(mm);
  return step < 0 ? colours().filled : colours().scale[step];
}

/**
 * A length as text.
 * @param {number|null} mm
 * @returns {string} "0.4 mm", "12 mm"; "–" where unknown
 */
function formatMm(mm) {
  return mm === null || mm === undefined || Number.isNaN(mm) ? "–" : `${formatNumber(mm)} mm`;
}

/**
 * A number as short text: one decimal below 10, none above.
 * @param {number|null} value
 * @returns {string} "–" where unknown
 */
function formatNumber(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  return Math.abs(value) < 9.95 ? value.toFixed(1) : formatCount(Math.round(value));
}

/**
 * A whole number with separators of thousands.
 * @param {number} count
 * @returns {string} "10,000"
 */
function formatCount(count) {
  return String(count).replace(/\B(?=(\d{3})+$)/g, ",");
}

/**
 * A number of things as text.
 * @param {number} count
 * @param {string} name of one of them; an "s" is added for any other number
 * @returns {string} "1 frame", "10,000 frames"
 */
function countOf(count, name) {
  return `${formatCount(count)} ${name}${count === 1 ? "" : "s"}`;
}

/**
 * A rate as text.
 * @param {number} rate Hz
 * @returns {string} "119.88 Hz"
 */
function formatRate(rate) {
  return `${Number(rate.toPrecision(RATE_DIGITS))} Hz`;
}

/**
 * A time as text, with decimals that tell two frames apart.
 * @param {number} seconds
 * @param {number} rate Hz
 * @returns {string} "0.21" at 100 Hz, "0.004" at 240 Hz
 */
function formatSeconds(seconds, rate) {
  const digits = Math.ceil(Math.log10(rate) - RATE_ROUNDING);
  return seconds.toFixed(Math.max(LEAST_TIME_DIGITS, Math.min(MOST_TIME_DIGITS, digits)));
}

/**
 * The number of a frame as text.
 * @param {number} number as the file numbers frames
 * @returns {string} with a minus sign where it is negative
 */
function frameName(number) {
  return number < 0 ? `−${-number}` : String(number);
}

/**
 * A range of frames as text.
 * @param {number} first
 * @param {number} last as the file numbers them, inclusive
 * @returns {string} "92–116", "7", "−5 to 3"
 */
function frameRange(first, last) {
  if (first === last) return frameName(first);
  return `${frameName(first)}${first < 0 ? " to " : "–"}${frameName(last)}`;
}

/**
 * A share as text.
 * @param {number} part
 * @param {number} whole
 * @returns {string} "0 %", "0.4 %", "12 %"
 */
function formatShare(part, whole) {
  const percent = whole ? (100 * part) / whole : 0;
  if (percent === 0) return "0 %";
  if (percent < 0.1) return "<0.1 %";
  return `${percent < 9.95 ? percent.toFixed(1) : Math.round(percent)} %`;
}

/**
 * Text cut to a width, for canvases.
 * @param {CanvasRenderingContext2D} context with its font set
 * @param {string} text
 * @param {number} width in CSS pixels
 * @returns {string} the text, ended by "…" if it was cut
 */
function cutText(context, text, width) {
  if (text.length < 400 && context.measureText(text).width <= width) return text;
  let low = 0;
  let high = Math.min(text.length, 400);
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (context.measureText(`${text.slice(0, middle)}…`).width <= width) low = middle;
    else high = middle - 1;
  }
  return `${text.slice(0, low)}…`;
}

/**
 * Cut a long text, for titles and announcements.
 * @param {string} text
 * @param {number} length greatest number of characters
 * @returns {string}
 */
function shortText(text, length = 60) {
  return text.length > length ? `${text.slice(0, length - 1)}…` : text;
}

/**
 * Say something to screen readers.
 * @param {string} text
 */
function announce(text) {
  document.getElementById("announcer").textContent = text;
}

/**
 * Show a problem as one line at the top of the page.
 * @param {string} text an empty text removes the line
 */
function showProblem(text) {
  const line = document.getElementById("problem");
  line.textContent = text;
  line.hidden = !text;
}

/**
 * Make a function that asks for one drawing at the next frame of the screen.
 * @param {function} draw
 * @returns {function} may be called any number of times
 */
function scheduled(draw) {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      draw();
    });
  };
}
