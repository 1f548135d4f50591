/* From the coded data of the page to arrays. */

/** Names of the states of a sample, in the order of their codes. */
const STATE = { missing: 0, measured: 1, filled: 2, doubt: 3, replaced: 4, swapped: 5 };

/** Units of positions and errors in a millimetre. */
const UNITS_PER_MM = 10;

/** Code of an unknown error. */
const UNKNOWN_ERROR = 65535;

/**
 * Inflate base64 text.
 * @param {string} text zlib data as base64
 * @returns {Promise<Uint8Array>}
 */
async function inflate(text) {
  const packed = atob(text);
  const bytes = new Uint8Array(packed.length);
  for (let i = 0; i < packed.length; i++) bytes[i] = packed.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Decode one block of positions.
 * @param {Uint8Array} planes 4 byte planes, low first, each in order marker, axis, frame
 * @param {Int32Array} positions all positions in units of 0.1 mm; frame, marker, axis
 * @param {number} markers number of markers
 * @param {number} first first frame of the block
 * @param {number} frames frames of the block
 */
function decodeBlock(planes, positions, markers, first, frames) {
  const series = markers * 3;
  const size = series * frames;
  if (planes.length !== size * 4) throw new Error("the data of the report are damaged");
  let at = 0;
  for (let s = 0; s < series; s++) {
    let value = 0;
    let step = 0;
    let target = first * series + s;
    for (let f = 0; f < frames; f++, at++, target += series) {
      const coded = planes[at] | (planes[size + at] << 8) | (planes[2 * size + at] << 16) |
        (planes[3 * size + at] << 24);
      const change = (coded >>> 1) ^ -(coded & 1);
      if (f === 0) value = change;
      else {
        step = f === 1 ? change : (step + change) | 0;
        value = (value + step) | 0;
      }
      positions[target] = value;
    }
  }
}

/**
 * Decode positions, first block first.
 * @param {Object} coded POSITIONS of the page data
 * @param {Int32Array} positions filled in place
 * @param {function(number)} done called after each block with the frames decoded so far; the
 *   decoding stops if it returns false
 */
async function decodePositions(coded, positions, done) {
  if (coded.coding !== "delta2") throw new Error("the positions have an unknown coding");
  for (let b = 0; b < coded.data.length; b++) {
    const first = b * coded.block;
    const frames = Math.min(coded.block, coded.frames - first);
    decodeBlock(await inflate(coded.data[b]), positions, coded.markers, first, frames);
    if (done(first + frames) === false) return;
    if (b + 1 < coded.data.length) await letOthersRun();
  }
}

/** Let the browser draw and react before the next piece of work. */
function letOthersRun() {
  return new Promise((resolve) => setTimeout(resolve, 0));
}

/**
 * Decode runs to one value a sample.
 * @param {Object} coded RUNS of the page data
 * @param {number} frames
 * @returns {Uint8Array} order marker, frame
 */
function decodeRuns(coded, frames) {
  if (coded.coding !== "runs") throw new Error("the states have an unknown coding");
  const all = new Uint8Array(coded.values.length * frames);
  coded.values.forEach((runs, marker) => {
    let at = marker * frames;
    for (let r = 0; r + 1 < runs.length; r += 2) {
      all.fill(Number(runs[r]), at, at + runs[r + 1]);
      at += runs[r + 1];
    }
    if (at !== (marker + 1) * frames) throw new Error("the data of the report are damaged");
  });
  return all;
}

/**
 * Decode the errors of filled samples.
 * @param {Object|null} coded SPARSE of the page data
 * @returns {Promise<Uint16Array>} units of 0.1 mm, in order marker, frame of filled samples
 */
async function decodeSparse(coded) {
  if (!coded || !coded.data) return new Uint16Array(0);
  if (coded.coding !== "sparse16") throw new Error("the errors have an unknown coding");
  const planes = await inflate(coded.data);
  const count = planes.length >> 1;
  const values = new Uint16Array(count);
  for (let i = 0; i < count; i++) values[i] = planes[i] | (planes[count + i] << 8);
  return values;
}
