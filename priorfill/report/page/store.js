/* What all views share: the data of the page, decoded, and what the user chose. */

/** Speeds of playing, as multiples of real time. */
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

class Store {
  /** @param {Object} data page data, version 1 */
  constructor(data) {
    this.listeners = new Map();
    this.frame = 0;
    this.playing = false;
    this.playRuns = 0;
    this.speed = 1;
    this.activeGap = -1;
    this.chosenGaps = new Set();
    this.markers = [];
    this.compared = new Set();
    this.ghost = -1;
    this.range = null;
    this.loop = null; // frames [first, last] that are played; null is the whole clip
    this.decisions = data.decisions || [];
    this.generation = 0;
    this.listed = null;
    this.take(data);
  }

  /**
   * Listen to an event.
   * @param {string} event "decoded", "frame", "play", "gap", "markers", "versions", "range",
   *   "data", "decisions" or "theme"
   * @param {function(*)} fn
   */
  on(event, fn) {
    if (!this.listeners.has(event)) this.listeners.set(event, []);
    this.listeners.get(event).push(fn);
  }

  /**
   * Tell the listeners of an event.
   * @param {string} event
   * @param {*} detail
   */
  emit(event, detail) {
    for (const fn of this.listeners.get(event) || []) fn(detail);
  }

  /**
   * Take page data without telling anyone.
   * @param {Object} data
   */
  take(data) {
    if (data.format !== 1) throw new Error("the data of the report have an unknown format");
    this.data = data;
    this.generation++;
    this.frames = data.clip.frames;
    this.rate = data.clip.rate;
    this.markerCount = data.markers.length;
    this.decodedFrames = 0;
    this.decoded = data.versions.map(() => null);
    this.states = decodeRuns(data.states, this.frames);
    this.present = data.versions.map((v, i) =>
      i && v.shown ? decodeRuns(v.shown, this.frames) : null);
    this.errors = { rms: new Uint16Array(0), bound: new Uint16Array(0) };
    this.indexGaps();
    this.indexFilled();
    this.frame = Math.max(0, Math.min(this.frame, this.frames - 1));
  }

  /** Gaps of each marker in order of time. */
  indexGaps() {
    const gaps = this.data.gaps;
    this.gapsOf = this.data.markers.map(() => []);
    gaps.forEach((gap, i) => this.gapsOf[gap.marker].push(i));
    for (const list of this.gapsOf) list.sort((a, b) => gaps[a].start - gaps[b].start);
  }

  /**
   * Runs of equal state of a marker.
   * @param {number} marker
   * @returns {Object[]} state, start, stop; of filled runs also `offset` of their errors
   */
  stateRuns(marker) {
    const known = this.runsOf[marker];
    if (known) return known;
    const coded = this.data.states.values[marker];
    const filled = this.filledRuns[marker];
    const runs = [];
    let at = 0;
    let next = 0;
    for (let r = 0; r + 1 < coded.length; r += 2) {
      const run = { state: Number(coded[r]), start: at, stop: at + coded[r + 1] };
      if (next < filled.length && filled[next].start === at) run.offset = filled[next++].offset;
      runs.push(run);
      at = run.stop;
    }
    this.runsOf[marker] = runs;
    return runs;
  }

  /** Runs of filled samples of each marker, and where their errors begin. */
  indexFilled() {
    this.runsOf = this.data.markers.map(() => null);
    let offset = 0;
    this.filledRuns = this.data.states.values.map((runs) => {
      const found = [];
      let at = 0;
      for (let r = 0; r + 1 < runs.length; r += 2) {
        if (runs[r] === STATE.filled || runs[r] === STATE.replaced) {
          found.push({ start: at, stop: at + runs[r + 1], offset });
          offset += runs[r + 1];
        }
        at += runs[r + 1];
      }
      return found;
    });
  }

  /** Decode errors and positions; "decoded" follows each block. */
  async decode() {
    const generation = this.generation;
    const { data } = this;
    const current = () => generation === this.generation;
    const errors = {
      rms: await decodeSparse(data.expected_rms), bound: await decodeSparse(data.bound_90),
    };
    if (!current()) return;
    this.errors = errors;
    for (let v = 0; v < data.versions.length; v++) {
      const coded = data.versions[v].positions;
      const positions = new Int32Array(coded.frames * coded.markers * 3);
      await decodePositions(coded, positions, (frames) => {
        if (!current()) return false;
        this.decoded[v] = positions;
        if (v === 0) this.decodedFrames = frames;
        this.emit("decoded", { version: v, frames });
        return true;
      });
      if (!current()) return;
    }
    this.emit("decoded", { version: -1, frames: this.frames });
  }

  /**
   * Positions of a version, upright.
   * @param {number} version
   * @returns {Int32Array|null} units of 0.1 mm at [(frame * markers + marker) * 3 + axis]; null
   *   before its first block is decoded
   */
  positions(version) {
    return this.decoded[version] || null;
  }

  /** @returns {number} code of STATE of a sample */
  state(frame, marker) {
    return this.states[marker * this.frames + frame];
  }

  /** @returns {boolean} whether a version has a position there that is decoded */
  shown(version, frame, marker) {
    if (!this.decoded[version]) return false;
    if (version === 0) return frame < this.decodedFrames && this.state(frame, marker) !== 0;
    const present = this.present[version];
    return present ? present[marker * this.frames + frame] !== 0 : true;
  }

  /** @returns {number} expected rms error (mm) of a filled sample, or NaN */
  rms(frame, marker) {
    return this.errorAt(this.errors.rms, frame, marker);
  }

  /** @returns {number} 90 % bound (mm) of a filled sample, or NaN */
  bound(frame, marker) {
    return this.errorAt(this.errors.bound, frame, marker);
  }

  /**
   * Value of one of the error arrays.
   * @param {Uint16Array} values
   * @param {number} frame
   * @param {number} marker
   * @returns {number} mm, or NaN
   */
  errorAt(values, frame, marker) {
    const run = runAt(this.filledRuns[marker], frame);
    if (!run) return NaN;
    const at = run.offset + frame - run.start;
    const value = at < values.length ? values[at] : UNKNOWN_ERROR;
    return value === UNKNOWN_ERROR ? NaN : value / UNITS_PER_MM;
  }

  /** @returns {number} index of the gap at a sample, or -1 */
  gapAt(frame, marker) {
    const gaps = this.data.gaps;
    const list = this.gapsOf[marker];
    let low = 0;
    let high = list.length - 1;
    while (low <= high) {
      const middle = (low + high) >> 1;
      const gap = gaps[list[middle]];
      if (frame < gap.start) high = middle - 1;
      else if (frame >= gap.stop) low = middle + 1;
      else return list[middle];
    }
    return -1;
  }

  /** @returns {number} the number that the file gives a frame */
  frameNumber(frame) {
    return this.data.clip.first_frame + frame;
  }

  /** @returns {number[]} indices of gaps as the table lists them; worst first without a table */
  gapOrder() {
    if (this.listed) return this.listed();
    return sortedGaps(this.data.gaps, null, 1);
  }

  /** @returns {string} "LKNE, frames 92–116" of a gap */
  gapName(index) {
    const gap = this.data.gaps[index];
    const label = shortText(this.data.markers[gap.marker].label);
    const word = gap.stop - gap.start === 1 ? "frame" : "frames";
    return `${label}, ${word} ${gapFrames(this, gap)}`;
  }

  /** Go to a frame. */
  setFrame(frame) {
    const wanted = Math.max(0, Math.min(this.frames - 1, Math.round(frame)));
    if (wanted === this.frame || !this.frames) return;
    this.frame = wanted;
    this.emit("frame", wanted);
  }

  /**
   * Choose the gap that all views show.
   * @param {number} index -1 for none
   * @param {{scrollTo: boolean, frame: number|null}} settings whether the table shows its row;
   *   the frame to go to, null for the middle of the gap
   */
  setActiveGap(index, { scrollTo = true, frame = null } = {}) {
    const gap = this.data.gaps[index];
    this.activeGap = gap ? index : -1;
    if (gap) {
      this.setMarkers([gap.marker]);
      this.setFrame(frame === null ? (gap.start + gap.stop - 1) / 2 : frame);
    }
    this.emit("gap", { scrollTo });
  }

  /** Choose a gap for a decision on several, or take it back. */
  toggleGap(index) {
    if (!this.chosenGaps.delete(index)) this.chosenGaps.add(index);
    this.emit("gap", { scrollTo: false });
  }

  /** Choose exactly these gaps. */
  setChosenGaps(indices) {
    this.chosenGaps = new Set(indices);
    this.emit("gap", { scrollTo: false });
  }

  /** Show the curves of these markers. */
  setMarkers(list) {
    if (list.length === this.markers.length && list.every((m, i) => m === this.markers[i])) return;
    this.markers = [...list];
    this.emit("markers", this.markers);
  }

  /** Show a version as a ghost; -1 for none. */
  setGhost(version) {
    this.ghost = version;
    this.emit("versions");
  }

  /** Draw these versions in the curves as well. */
  setCompared(versions) {
    this.compared = new Set(versions);
    this.emit("versions");
  }

  /** Choose a range of frames [first, last], or null. */
  setRange(range) {
    this.range = range;
    this.emit("range", range);
  }

  /** Play or stop. */
  setPlaying(playing) {
    if (playing === this.playing) return;
    this.playing = playing;
    this.emit("play");
    if (playing) playOn(this, ++this.playRuns, null, this.frame);
  }

  /** Speed of playing, as a multiple of real time. */
  setSpeed(speed) {
    this.speed = speed;
    this.emit("play");
  }

  /** Take new page data, of a fill with other decisions. */
  setData(data) {
    const before = this.data.gaps[this.activeGap];
    const { ghost } = this;
    this.take(data);
    this.chosenGaps = new Set();
    this.activeGap = before
      ? this.data.gaps.findIndex((g) => g.marker === before.marker && g.start === before.start)
      : -1;
    this.markers = this.markers.filter((m) => m < this.markerCount);
    this.ghost = ghost < data.versions.length ? ghost : -1;
    this.compared = new Set([...this.compared].filter((v) => v < data.versions.length));
    this.emit("data");
    return this.decode();
  }

  /** Replace the list of decisions. */
  setDecisions(list) {
    this.decisions = list;
    this.emit("decisions");
  }
}

/**
 * The run that contains a frame.
 * @param {Object[]} runs with start and stop, in order
 * @param {number} frame
 * @returns {Object|null}
 */
function runAt(runs, frame) {
  let low = 0;
  let high = runs.length - 1;
  while (low <= high) {
    const middle = (low + high) >> 1;
    if (frame < runs[middle].start) high = middle - 1;
    else if (frame >= runs[middle].stop) low = middle + 1;
    else return runs[middle];
  }
  return null;
}
