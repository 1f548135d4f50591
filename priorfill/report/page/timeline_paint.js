/* Draws the rows and the time axis of the timeline. */

/** Height (px) below which a row has no room for its name. */
const LEAST_NAMED_ROW = 10;

/** Distances (s) between two labels of the time axis. */
const TIME_STEPS_S = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600,
  1200, 3600];

/** Least distance (px) between two labels of the time axis. */
const LABEL_ROOM = 74;

/** Distance (px) between the stripes of missing frames. */
const STRIPE = 4;

/**
 * Draw one row: measured, filled by expected error, in doubt, replaced, exchanged, missing.
 * @param {CanvasRenderingContext2D} context
 * @param {Store} store
 * @param {number} marker
 * @param {Object} box left, top, width, height (px), from, to (frames), and `stripes` (pattern)
 */
function paintMarkerRow(context, store, marker, box) {
  const shades = colours();
  const scale = box.width / (box.to - box.from);
  const runs = store.stateRuns(marker);
  const inset = box.height >= 6 ? 1 : 0;
  const top = box.top + inset;
  const high = Math.max(1, box.height - 2 * inset);
  const last = Math.min(box.to, store.frames);
  context.fillStyle = shades.track;
  context.fillRect(box.left, top, (last - box.from) * scale, high);
  for (const late of [false, true]) {
    for (const run of runs) {
      if (run.stop <= box.from || run.state === STATE.measured) continue;
      if (run.start >= box.to) break;
      if ((run.state === STATE.missing) !== late) continue;
      const left = box.left + Math.max(0, (run.start - box.from) * scale);
      const right = box.left + Math.min(box.width, (run.stop - box.from) * scale);
      const wide = Math.max(1.5, right - left);
      paintRun(context, store, run, { left, top, wide, high, scale, box });
    }
  }
}

/**
 * Draw a run of one state.
 * @param {CanvasRenderingContext2D} context
 * @param {Store} store
 * @param {Object} run state, start, stop, offset of its errors
 * @param {Object} place left, top, wide, high (px), scale (px a frame), box of the row
 */
function paintRun(context, store, run, place) {
  const shades = colours();
  const { left, top, wide, high } = place;
  if (run.state === STATE.missing) {
    context.fillStyle = shades.surface;
    context.fillRect(left, top, wide, high);
    context.fillStyle = wide < 6 || high < 5 ? shades.missing : place.box.stripes;
    context.fillRect(left, top, wide, high);
    context.fillStyle = shades.missing;
    if (high >= 5) {
      context.fillRect(left, top, wide, 1);
      context.fillRect(left, top + high - 1, wide, 1);
    }
    return;
  }
  if (run.state === STATE.doubt || run.state === STATE.swapped) {
    context.fillStyle = run.state === STATE.doubt ? shades.doubt : shades.swapped;
    context.fillRect(left, top + high * 0.25, wide, Math.max(1, high * 0.5));
    return;
  }
  paintErrors(context, store, run, place);
  if (run.state === STATE.replaced && high >= 5) {
    context.fillStyle = shades.replaced;
    context.fillRect(left, top, wide, 3);
  }
}

/**
 * Draw filled frames, each column of pixels in the colour of its greatest expected error.
 * @param {CanvasRenderingContext2D} context
 * @param {Store} store
 * @param {Object} run start, stop, offset of its errors
 * @param {Object} place as for paintRun
 */
function paintErrors(context, store, run, place) {
  const errors = store.errors.rms;
  const shades = colours();
  const { left, top, wide, high, scale, box } = place;
  const first = Math.max(run.start, Math.floor(box.from));
  const stop = Math.min(run.stop, Math.ceil(box.to));
  const right = left + wide;
  const perColumn = Math.max(1, 1 / scale);
  let from = left;
  let before = -2;
  for (let f = first; f < stop; f += perColumn) {
    const begin = Math.floor(f);
    const end = Math.min(stop, Math.max(begin + 1, Math.floor(f + perColumn)));
    let worst = -1;
    for (let k = begin; k < end; k++) {
      const value = errors[run.offset + k - run.start];
      if (value !== undefined && value !== UNKNOWN_ERROR && value > worst) worst = value;
    }
    const step = worst < 0 ? -1 : errorStep(worst / UNITS_PER_MM);
    if (step === before) continue;
    const x = Math.max(left, box.left + (begin - box.from) * scale);
    if (before > -2 && x > from) context.fillRect(from, top, x - from, high);
    context.fillStyle = step < 0 ? shades.filled : shades.scale[step];
    before = step;
    from = x;
  }
  context.fillRect(from, top, Math.max(1, right - from), high);
}

/**
 * Pattern of stripes for missing frames.
 * @param {CanvasRenderingContext2D} context
 * @returns {CanvasPattern}
 */
function stripePattern(context) {
  const tile = document.createElement("canvas");
  tile.width = STRIPE;
  tile.height = STRIPE;
  const pen = tile.getContext("2d");
  pen.fillStyle = colours().missing;
  for (let i = 0; i < STRIPE; i++) pen.fillRect(i, STRIPE - 1 - i, 1, 1);
  return context.createPattern(tile, "repeat");
}

/**
 * Draw the name of a row and its missing percentages before and after.
 * @param {CanvasRenderingContext2D} context
 * @param {Store} store
 * @param {number} marker
 * @param {Object} box top, height, names (width of the column of names, px), chosen
 */
function paintName(context, store, marker, box) {
  if (box.height < LEAST_NAMED_ROW) return;
  const shades = colours();
  const info = store.data.markers[marker];
  const middle = box.top + box.height / 2;
  const before = formatShare(info.missing_before, store.frames);
  const after = formatShare(info.missing_after, store.frames);
  const shares = box.names < 130 ? after : `${before} → ${after}`;
  context.textBaseline = "middle";
  const size = Math.min(12, box.height);
  context.font = `${size - 1}px system-ui, sans-serif`;
  context.textAlign = "right";
  context.fillStyle = info.missing_after ? shades.missing : shades.muted;
  context.fillText(shares, box.names - 8, middle);
  const room = box.names - 20 - context.measureText(shares).width;
  context.font = `${box.chosen ? "bold " : ""}${size}px system-ui, sans-serif`;
  context.textAlign = "left";
  context.fillStyle = box.chosen ? shades.accent : shades.text;
  const label = store.data.subjects.length > 1 ? info.own : info.label;
  context.fillText(cutText(context, label, room), 6, middle);
}

/**
 * Distance between two labels of the time axis.
 * @param {number} least s
 * @returns {number} s; parts of minutes and hours, below them and above them 1, 2 or 5 times a
 *   power of ten seconds or hours
 */
function timeStep(least) {
  if (least <= TIME_STEPS_S[0]) return niceStep(least, 1);
  const hour = TIME_STEPS_S.at(-1);
  return TIME_STEPS_S.find((step) => step >= least) || hour * niceStep(least / hour, 1);
}

/**
 * Draw the time axis: seconds, and frame numbers below.
 * @param {CanvasRenderingContext2D} context
 * @param {Store} store
 * @param {Object} box left, width, height (px), from, to (frames)
 */
function paintAxis(context, store, box) {
  const shades = colours();
  const scale = box.width / (box.to - box.from);
  const wanted = Math.max(LABEL_ROOM / scale, 1) / store.rate; // at least a frame
  const step = timeStep(wanted);
  context.fillStyle = shades.panel;
  context.fillRect(0, 0, box.left + box.width, box.height);
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "alphabetic";
  context.textAlign = "right";
  context.fillStyle = shades.muted;
  context.fillText("time (s)", box.left - 8, 12);
  context.fillText("frame", box.left - 8, 25);
  context.textAlign = "center";
  const first = Math.ceil(box.from / store.rate / step);
  for (let k = first; k * step * store.rate < box.to; k++) {
    const frame = k * step * store.rate;
    const x = box.left + (frame - box.from) * scale;
    if (frame > store.frames) break;
    context.fillStyle = shades.grid;
    context.fillRect(Math.round(x), box.height - 4, 1, 4);
    if (x < box.left + 12 && k > first) continue;
    if (x > box.left + box.width - 14) continue;
    const frameText = frameName(store.frameNumber(Math.round(frame)));
    const middle = Math.max(x, box.left + context.measureText(frameText).width / 2);
    context.fillStyle = shades.text;
    const timeText = tickText(k * step, step);
    const centre = Math.max(x, box.left + context.measureText(timeText).width / 2 - 2);
    context.fillText(timeText, centre, 12);
    context.fillStyle = shades.muted;
    context.fillText(frameText, middle, 25);
  }
}
