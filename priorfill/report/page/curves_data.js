/* Series that the curves draw: coordinates, speed, distances between versions, and bands. */

/** Half widths of the bands of one coordinate, and the median of a distance in space, as parts of
 * the 90 % bound of the distance: those of report/bands.py, measured on recordings. */
const CURVE_BANDS = { 90: 0.658, 50: 0.2 };
const CURVE_MEDIAN_DISTANCE = 0.48;

/** Ratio of the 90 % bound to the expected rms error where no bound is known. */
const CURVE_BOUND_FACTOR = 1.6;

/** Series kept in memory. 300 series of 36,000 frames take 43 MB. */
const CURVE_SERIES_KEPT = 300;

/** Which axis of the file each upright axis is, by the axis that points up in the file. */
const CURVE_FILE_AXES = {
  "+X": ["-Z", "+Y", "+X"],
  "-X": ["+Z", "+Y", "-X"],
  "+Y": ["+X", "-Z", "+Y"],
  "-Y": ["+X", "+Z", "-Y"],
  "+Z": ["+X", "+Y", "+Z"],
  "-Z": ["+X", "-Y", "-Z"],
};

/** What can be drawn: coordinates, speed, the distance between two versions, the expected error. */
const CURVE_QUANTITIES = ["x", "y", "z", "speed", "distance", "error"];

/**
 * The title of a panel, with its unit.
 * @param {string} kind One of CURVE_QUANTITIES.
 * @param {string} up The axis that points up in the file, such as "+Y".
 */
function curveTitle(kind, up) {
  if (kind === "speed") return "speed (mm/s)";
  if (kind === "distance") return "distance (mm)";
  if (kind === "error") return "expected error (mm)";
  const place = CURVE_QUANTITIES.indexOf(kind);
  const axes = CURVE_FILE_AXES[up];
  const file = axes ? axes[place] : "";
  const own = file === `+${kind.toUpperCase()}` || !file ? "" : `, file ${file.replace("+", "")}`;
  return `${kind}${kind === "z" ? " up" : ""} (mm${own})`;
}

/** Series of a clip's markers, computed when they are first needed. */
class CurveData {
  /** @param {Store} store The store of the page. */
  constructor(store) {
    this.store = store;
    this.kept = new Map();
    this.known = new Map();
  }

  /** Forget all series: more frames have come. */
  clear() {
    this.kept.clear();
  }

  /** Forget all: other data have come. */
  reset() {
    this.kept.clear();
    this.known.clear();
  }

  /**
   * Note how many frames of a version are decoded.
   * @param {{version: number, frames: number}} block Detail of the event "decoded".
   */
  note({ version, frames }) {
    if (version >= 0) this.known.set(version, frames);
  }

  /** Number of frames of the clip. */
  get frames() {
    return this.store.data.clip.frames;
  }

  /**
   * A series from the memory, or computed by `make`.
   * @param {string} key Its name.
   * @param {function(): Float32Array} make Computes it.
   */
  remembered(key, make) {
    let series = this.kept.get(key);
    if (!series) {
      series = make();
      if (this.kept.size >= CURVE_SERIES_KEPT) this.kept.delete(this.kept.keys().next().value);
      this.kept.set(key, series);
    }
    return series;
  }

  /**
   * Values of a version of a marker, one a frame; NaN where it has none.
   * @param {number} version Index in the page data.
   * @param {number} marker Index in the page data.
   * @param {string} kind "x", "y", "z" (mm) or "speed" (mm/s).
   */
  values(version, marker, kind) {
    const key = `${version} ${marker} ${kind}`;
    return this.remembered(key, () =>
      kind === "speed" ? this.speed(version, marker) : this.coordinate(version, marker, kind));
  }

  /** Coordinate `kind` of a version of a marker (mm); NaN where it is not shown. */
  coordinate(version, marker, kind) {
    const series = new Float32Array(this.frames).fill(NaN);
    const positions = this.store.positions(version);
    if (!positions) return series;
    const shown = this.presence(version, marker);
    const step = 3 * this.store.data.markers.length;
    const known = this.known.get(version) || 0;
    let at = 3 * marker + CURVE_QUANTITIES.indexOf(kind);
    for (let frame = 0; frame < known; frame += 1, at += step) {
      if (shown === null || shown[frame] !== 0) series[frame] = positions[at] / UNITS_PER_MM;
    }
    return series;
  }

  /** Where a version of a marker has a value: 0 where it has none; null where it always has. */
  presence(version, marker) {
    const all = version === 0 ? this.store.states : this.store.present[version];
    return all ? all.subarray(marker * this.frames, (marker + 1) * this.frames) : null;
  }

  /**
   * Speed (mm/s): the distance of the neighbouring frames over the time between them; at the end
   * of a stretch, the distance of the last two frames. NaN for a sample without neighbours.
   */
  speed(version, marker) {
    const [x, y, z] = ["x", "y", "z"].map((kind) => this.values(version, marker, kind));
    const series = new Float32Array(this.frames).fill(NaN);
    const { rate } = this.store.data.clip;
    const known = (frame) => x[frame] === x[frame]; // not NaN
    for (let frame = 0; frame < this.frames; frame += 1) {
      if (!known(frame)) continue;
      const before = frame > 0 && known(frame - 1) ? frame - 1 : frame;
      const after = frame + 1 < this.frames && known(frame + 1) ? frame + 1 : frame;
      if (before === after) continue;
      const away = Math.sqrt(
        (x[after] - x[before]) ** 2 + (y[after] - y[before]) ** 2 + (z[after] - z[before]) ** 2);
      series[frame] = (away * rate) / (after - before);
    }
    return series;
  }

  /**
   * The measured or the filled part of a series of version 0. The filled part begins and ends at
   * the measured samples next to it, so that a jump at an edge is seen.
   * @param {number} marker Index in the page data.
   * @param {string} kind "x", "y", "z" or "speed".
   * @param {boolean} filled Which part.
   */
  part(marker, kind, filled) {
    return this.remembered(`${marker} ${kind} part ${filled}`, () => {
      const all = this.values(0, marker, kind);
      const series = filled ? new Float32Array(this.frames).fill(NaN) : all.slice();
      for (const { start, stop } of this.store.filledRuns[marker]) {
        if (filled) {
          const first = Math.max(0, start - 1);
          series.set(all.subarray(first, stop + 1), first);
        } else series.fill(NaN, start, stop);
      }
      return series;
    });
  }

  /** Distance (mm) between two versions of a marker; NaN where one of them has no value. */
  distance(version, other, marker) {
    return this.remembered(`${version} ${other} ${marker} distance`, () => {
      const series = new Float32Array(this.frames);
      const [x, y, z] = ["x", "y", "z"].map((kind) => this.values(version, marker, kind));
      const [u, v, w] = ["x", "y", "z"].map((kind) => this.values(other, marker, kind));
      for (let t = 0; t < this.frames; t += 1) {
        series[t] = Math.sqrt((x[t] - u[t]) ** 2 + (y[t] - v[t]) ** 2 + (z[t] - w[t]) ** 2);
      }
      return series;
    });
  }

  /** The 90 % bound (mm) of the filled samples of a marker; NaN elsewhere and where unknown. */
  bound(marker) {
    return this.remembered(`${marker} bound`, () => {
      return this.ofFilled(marker, (frame) => {
        const bound = this.store.bound(frame, marker);
        return bound === bound ? bound : CURVE_BOUND_FACTOR * this.store.rms(frame, marker);
      });
    });
  }

  /** The expected rms error (mm) of the filled samples of a marker; NaN elsewhere. */
  rms(marker) {
    return this.remembered(`${marker} rms`, () =>
      this.ofFilled(marker, (frame) => this.store.rms(frame, marker)));
  }

  /** A series of values of filled samples; NaN elsewhere. */
  ofFilled(marker, value) {
    const series = new Float32Array(this.frames).fill(NaN);
    for (const { start, stop } of this.store.filledRuns[marker]) {
      for (let frame = start; frame < stop; frame += 1) series[frame] = value(frame);
    }
    return series;
  }

  /** Half width of the band of 90 or 50 % of a quantity, as part of the bound. */
  halfWidth(kind, percent) {
    if (kind === "speed") return NaN;
    if (kind === "distance" || kind === "error") return percent === 90 ? 1 : CURVE_MEDIAN_DISTANCE;
    return CURVE_BANDS[percent];
  }

  /**
   * Stretches of frames in which a marker has a state, as [first, stop) pairs.
   * @param {number} marker Index in the page data.
   * @param {number} state Code of STATE.
   */
  stretches(marker, state) {
    const runs = this.store.data.states.values[marker];
    const found = [];
    for (let r = 0, at = 0; r + 1 < runs.length; r += 2) {
      if (runs[r] === state) found.push([at, at + runs[r + 1]]);
      at += runs[r + 1];
    }
    return found;
  }

  /**
   * Other markers of the segment of a marker (of the same subject), at most `most`; where the
   * segment is unknown, those joined to it by sticks.
   */
  neighbours(marker, most) {
    const { markers, sticks } = this.store.data;
    const own = markers[marker];
    const alike = (other, index) =>
      index !== marker && other.subject === own.subject && other.segment === own.segment;
    let found = own.segment ? markers.map((m, i) => (alike(m, i) ? i : -1)) : [];
    found = found.filter((index) => index >= 0);
    if (!found.length) {
      found = sticks.filter((s) => s.includes(marker)).map(([a, b]) => (a === marker ? b : a));
    }
    return [...new Set(found)].slice(0, most);
  }
}
