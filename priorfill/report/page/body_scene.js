/* Where the body is: what the camera fits and follows, and the floor below it. */

/** Frames, evenly spaced, from which the size of the scene is taken. */
const FIT_FRAMES = 200;

/** About how many samples the camera fits. */
const FIT_POINTS = 4000;

/** Corners of what is shown of a clip without a sample (mm). */
const EMPTY_SCENE = [-1000, -1000, 0, 1000, 1000, 2000];

/** Most frames at which the centre of the body is computed; between them it is interpolated. */
const PATH_KNOTS = 1500;

/** Markers whose median is the centre, at most; they are evenly spaced in the list. */
const MEDIAN_MARKERS = 100;

/** Time between two of these frames. */
const KNOT_SECONDS = 0.15;

/** Samples farther from the centre than this times the upper quartile of distances are outliers. */
const FAR_OUT = 3;

/** mm, possible widths of the squares of the floor. */
const GRID_STEPS = [5, 10, 50, 100, 500, 1000, 5000];

/** Most squares of the floor along one side. */
const GRID_LINES = 40;

/** Markers of a pair that are nearer do not show the side that the subject faces. */
const NARROW_MM = 60;

/** Pairs that show it: pelvis and shoulders rather than feet, which take steps. */
const FACING_PAIRS = 4;

/** What makes the label of a right marker from that of the left one. */
const LEFT_TO_RIGHT = [
  [/^L/, "R"], [/^l_/, "r_"], [/Left/, "Right"], [/left/, "right"],
  [/([_. ])L$/, "$1R"], [/([_. ])l$/, "$1r"],
];

/** By code of state: is the sample taken for the size of the scene? Samples in doubt are not. */
const SHOWN_BY_STATE = [false, true, true, false, true, true];

/** Where the body is: its path, its size, the floor and the side it faces. Lengths in mm. */
class BodyScene {
  /** Measure what is decoded of the shown version of a store's data. */
  constructor(store) {
    this.store = store;
    this.positions = store.positions(0);
    this.markers = store.data.markers.length;
    this.frames = Math.max(1, store.decodedFrames);
    this.skip = Math.ceil(this.markers / MEDIAN_MARKERS);
    this.sorted = new Float64Array(this.markers);
    this.trace();
    this.measure();
    this.pairs = this.stiffPairs();
  }

  /** Middle value of one coordinate of the valid samples of a frame, NaN without any. */
  median(frame, axis) {
    let count = 0;
    for (let marker = 0; marker < this.markers; marker += this.skip) {
      if (SHOWN_BY_STATE[this.store.state(frame, marker)]) {
        this.sorted[count++] = this.positions[(frame * this.markers + marker) * 3 + axis] / 10;
      }
    }
    return count ? this.sorted.subarray(0, count).sort()[count >> 1] : NaN;
  }

  /** Compute the path of the centre; where no marker is visible, it is held or interpolated. */
  trace() {
    const rate = this.store.data.clip.rate;
    this.step = Math.max(1, Math.round(rate * KNOT_SECONDS), Math.ceil(this.frames / PATH_KNOTS));
    this.knots = Math.ceil((this.frames - 1) / this.step) + 1;
    this.path = new Float64Array(this.knots * 3);
    const raw = new Float64Array(this.knots);
    for (let axis = 0; axis < 3; axis++) {
      for (let knot = 0; knot < this.knots; knot++) {
        raw[knot] = this.median(Math.min(this.frames - 1, knot * this.step), axis);
      }
      bridgeMissing(raw);
      for (let knot = 0; knot < this.knots; knot++) {
        const before = raw[Math.max(0, knot - 1)];
        const after = raw[Math.min(this.knots - 1, knot + 1)];
        this.path[knot * 3 + axis] = (before + 2 * raw[knot] + after) / 4;
      }
    }
  }

  /** Write the centre of the body in a frame to `out`. */
  centre(frame, out) {
    const at = Math.min(frame / this.step, this.knots - 1);
    const knot = Math.floor(at);
    const next = Math.min(knot + 1, this.knots - 1);
    for (let axis = 0; axis < 3; axis++) {
      const value = this.path[knot * 3 + axis];
      out[axis] = value + (this.path[next * 3 + axis] - value) * (at - knot);
    }
  }

  /** Call `visit` with the coordinates of valid samples and their distances from the centre. */
  eachSample(visit) {
    const centre = new Float64Array(3);
    const from = new Float64Array(3);
    const step = Math.max(1, Math.floor(this.frames / FIT_FRAMES));
    for (let frame = 0; frame < this.frames; frame += step) {
      this.centre(frame, centre);
      for (let marker = 0; marker < this.markers; marker++) {
        if (SHOWN_BY_STATE[this.store.state(frame, marker)]) {
          const at = (frame * this.markers + marker) * 3;
          for (let axis = 0; axis < 3; axis++) {
            from[axis] = this.positions[at + axis] / 10 - centre[axis];
          }
          visit(from, centre, Math.hypot(from[0], from[1], from[2]));
        }
      }
    }
  }

  /** Keep samples without outliers, from the centre of the body and as they are; their boxes. */
  measure() {
    const distances = [];
    this.eachSample((from, centre, distance) => distances.push(distance));
    const sorted = Float64Array.from(distances).sort();
    const limit = sorted.length ? FAR_OUT * Math.max(sorted[(sorted.length * 3) >> 2], 10) : 0;
    const every = Math.max(1, Math.floor(distances.length / FIT_POINTS));
    const [around, places] = [[], []];
    let number = 0;
    this.eachSample((from, centre, distance) => {
      number += 1;
      if (distance <= limit && (number % every === 0 || distances.length < FIT_POINTS)) {
        around.push(from[0], from[1], from[2]);
        places.push(from[0] + centre[0], from[1] + centre[1], from[2] + centre[2]);
      }
    });
    this.around = Float32Array.from(around.length ? around : EMPTY_SCENE);
    this.places = Float32Array.from(places.length ? places : EMPTY_SCENE);
    this.body = boxOf(this.around);
    this.box = boxOf(this.places);
    this.size = Math.max(...[0, 1, 2].map((axis) => this.body[axis + 3] - this.body[axis]), 10);
    this.travel = Math.max(this.box[3] - this.box[0], this.box[4] - this.box[1]);
    this.layFloor();
  }

  /** Choose the height of the floor, the width of its squares and its edges. */
  layFloor() {
    const [x0, y0, lowest, x1, y1] = this.box;
    const nearGround = lowest > -0.1 * this.size && lowest < 0.3 * this.size;
    this.floor = nearGround ? Math.min(0, lowest) : lowest;
    const wanted = Math.max(this.size / 8, this.travel / GRID_LINES);
    this.grid = GRID_STEPS.find((step) => step >= wanted) || Math.ceil(wanted / 10000) * 10000;
    const down = (value) => Math.floor(value / this.grid - 0.5) * this.grid;
    const up = (value) => Math.ceil(value / this.grid + 0.5) * this.grid;
    this.edges = [down(x0), down(y0), up(x1), up(y1)];
  }

  /** Pairs [left, right] of markers, those first whose distance varies least over the clip. */
  stiffPairs() {
    const step = Math.max(1, Math.floor(this.frames / FIT_FRAMES));
    const scored = markerPairs(this.store.data.markers).map(([left, right]) => {
      let [count, sum, squares] = [0, 0, 0];
      for (let frame = 0; frame < this.frames; frame += step) {
        const [x, y] = this.across(frame, left, right);
        const width = Math.hypot(x, y);
        if (width > 0) {
          count += 1;
          sum += width;
          squares += width * width;
        }
      }
      const mean = sum / count;
      const spread = Math.sqrt(Math.max(0, squares / count - mean * mean));
      return { left, right, score: count && mean > NARROW_MM ? spread / mean : Infinity };
    });
    scored.sort((one, other) => one.score - other.score);
    return scored.slice(0, FACING_PAIRS).map(({ left, right }) => [left, right]);
  }

  /** Horizontal vector (mm) from the right to the left marker of a pair; zero if one is missing. */
  across(frame, left, right) {
    if (!this.store.state(frame, left) || !this.store.state(frame, right)) {
      return [0, 0];
    }
    const [a, b] = [left, right].map((marker) => (frame * this.markers + marker) * 3);
    return [0, 1].map((axis) => (this.positions[a + axis] - this.positions[b + axis]) / 10);
  }

  /** Horizontal angle (radians) in which the subject faces in a frame; NaN where it is unknown. */
  facing(frame) {
    let [x, y] = [0, 0];
    for (const [left, right] of this.pairs) {
      const [dx, dy] = this.across(frame, left, right);
      x += dx;
      y += dy;
    }
    return x || y ? Math.atan2(-x, y) : NaN;
  }
}

/** The box [x0, y0, z0, x1, y1, z1] around points. */
function boxOf(points) {
  const box = [Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity];
  points.forEach((value, at) => {
    box[at % 3] = Math.min(box[at % 3], value);
    box[(at % 3) + 3] = Math.max(box[(at % 3) + 3], value);
  });
  return box;
}

/** Replace NaN by values between the neighbours, in place; all zeros where there is no value. */
function bridgeMissing(values) {
  let last = -1;
  for (let at = 0; at <= values.length; at++) {
    if (at < values.length && Number.isNaN(values[at])) {
      continue;
    }
    const from = last >= 0 ? values[last] : at < values.length ? values[at] : 0;
    const to = at < values.length ? values[at] : from;
    for (let between = last + 1; between < at; between++) {
      values[between] = from + ((to - from) * (between - last)) / (at - last);
    }
    last = at;
  }
}

/** Pairs [left, right] of a subject's markers, by usual labels: LKNE, LeftKnee, knee_L. */
function markerPairs(markers) {
  const key = ({ own, subject }) => `${subject} ${own}`;
  const places = new Map(markers.map((marker, i) => [key(marker), i]));
  const pairs = [];
  markers.forEach((marker, left) => {
    const { own } = marker;
    const right = LEFT_TO_RIGHT.map(([pattern, text]) => own.replace(pattern, text))
      .filter((label) => label !== own)
      .map((label) => places.get(key({ ...marker, own: label })))
      .find((place) => place !== undefined);
    if (right !== undefined) {
      pairs.push([left, right]);
    }
  });
  return pairs;
}
