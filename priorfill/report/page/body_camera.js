/* The camera of the body player. */

/** Radians across the shorter side of the canvas: 30 degrees, little distortion at the edges. */
const FIELD_OF_VIEW = 0.52;

/** mm in front of the eye: what is nearer is not drawn. */
const NEAREST = 20;

/** mm, eye to target: from a finger to a hall of 200 m. */
const DISTANCES = [30, 400000];

/** Share of the canvas that a fitted scene fills. */
const FIT_MARGIN = 0.86;

/** mm, eye to target: a single marker is not seen from nearer. */
const FIT_LEAST = 200;

/** Steps of fitting: distance and middle in turn, each a better guess for the other. */
const FIT_ROUNDS = 5;

/** A perspective camera that orbits a target. Lengths in mm, upright axes, pixels from top left. */
class BodyCamera {
  constructor() {
    this.target = new Float64Array(3);
    this.yaw = 0.7;
    this.pitch = 0.22;
    this.distance = 5000;
    this.right = new Float64Array(3);
    this.up = new Float64Array(3);
    this.back = new Float64Array(3);
    this.resize(1, 1);
  }

  /** Set the size of the picture in pixels. */
  resize(width, height) {
    this.width = width;
    this.height = height;
    this.focal = Math.min(width, height) / 2 / Math.tan(FIELD_OF_VIEW / 2);
    this.update();
  }

  /** Compute the directions of the picture from the angles. */
  update() {
    const [cy, sy] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    this.right.set([-sy, cy, 0]);
    this.up.set([-sp * cy, -sp * sy, cp]);
    this.back.set([cp * cy, cp * sy, sp]);
  }

  /** Turn by angles in radians; the pitch stays between straight up and straight down. */
  orbit(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, this.pitch + pitch));
    this.update();
  }

  /** Move the target so that the picture moves by pixels. */
  pan(dx, dy) {
    const scale = this.distance / this.focal;
    for (let axis = 0; axis < 3; axis++) {
      this.target[axis] += (this.up[axis] * dy - this.right[axis] * dx) * scale;
    }
  }

  /** Divide the distance by a factor; the point of the target's plane at (x, y) stays in place. */
  zoom(factor, x, y) {
    const before = this.distance;
    this.distance = Math.max(DISTANCES[0], Math.min(DISTANCES[1], before / factor));
    const moved = (before - this.distance) / this.focal;
    const dx = (x - this.width / 2) * moved;
    const dy = (this.height / 2 - y) * moved;
    for (let axis = 0; axis < 3; axis++) {
      this.target[axis] += this.right[axis] * dx + this.up[axis] * dy;
    }
  }

  /**
   * Keep the direction, and choose target and distance so that points fill the picture.
   * @param {Float32Array} points x, y, z of each in mm, from the origin
   * @param {ArrayLike<number>} origin x, y, z in mm
   */
  fit(points, origin) {
    this.target.set(origin);
    for (let round = 0; round < FIT_ROUNDS; round++) {
      let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
      let distance = FIT_LEAST;
      const from = [0, 1, 2].map((axis) => origin[axis] - this.target[axis]);
      for (let at = 0; at < points.length; at += 3) {
        const [x, y] = [points[at] + from[0], points[at + 1] + from[1]];
        const z = points[at + 2] + from[2];
        const across = x * this.right[0] + y * this.right[1];
        const above = x * this.up[0] + y * this.up[1] + z * this.up[2];
        const nearer = x * this.back[0] + y * this.back[1] + z * this.back[2];
        const share = Math.max(Math.abs(across) / this.width, Math.abs(above) / this.height);
        distance = Math.max(distance, nearer + (2 * this.focal * share) / FIT_MARGIN);
        const scale = this.focal / Math.max(NEAREST, this.distance - nearer);
        [left, right] = [Math.min(left, across * scale), Math.max(right, across * scale)];
        [low, high] = [Math.min(low, above * scale), Math.max(high, above * scale)];
      }
      if (round % 2 === 0) {
        this.distance = Math.min(DISTANCES[1], distance);
      } else if (left <= right) {
        this.pan(-(left + right) / 2, (low + high) / 2);
      }
    }
  }

  /**
   * Project points.
   * @param {ArrayLike<number>} points x, y, z of each point
   * @param {number} start index of the first coordinate
   * @param {number} count number of points
   * @param {number} unit mm of one unit of the points
   * @param {Float32Array} out x, y (pixels) and depth (mm) of each; depth 0 is behind the eye
   */
  project(points, start, count, unit, out) {
    const { target, right, up, back, distance, focal } = this;
    const [middle, centre] = [this.width / 2, this.height / 2];
    for (let point = 0; point < count; point++) {
      const at = start + point * 3;
      const x = points[at] * unit - target[0];
      const y = points[at + 1] * unit - target[1];
      const z = points[at + 2] * unit - target[2];
      const depth = distance - (x * back[0] + y * back[1] + z * back[2]);
      const scale = focal / depth;
      out[point * 3] = middle + (x * right[0] + y * right[1] + z * right[2]) * scale;
      out[point * 3 + 1] = centre - (x * up[0] + y * up[1] + z * up[2]) * scale;
      out[point * 3 + 2] = depth >= NEAREST ? depth : 0;
    }
  }

  /** Pixels of a length in mm at a depth in mm. */
  pixels(length, depth) {
    return (length * this.focal) / depth;
  }

  /**
   * Add a straight line to the current path, without its part behind the eye.
   * @param {CanvasRenderingContext2D} context
   * @param {Float64Array} ends x, y, z of both ends in mm
   * @param {Float32Array} scratch six numbers
   */
  line(context, ends, scratch) {
    const { target, back, distance } = this;
    let first = distance;
    let last = distance;
    for (let axis = 0; axis < 3; axis++) {
      first -= (ends[axis] - target[axis]) * back[axis];
      last -= (ends[axis + 3] - target[axis]) * back[axis];
    }
    if (first < NEAREST && last < NEAREST) {
      return;
    }
    const cut = (NEAREST * 1.001 - first) / (last - first);
    const end = first < NEAREST ? 0 : 3;
    if (first < NEAREST || last < NEAREST) {
      for (let axis = 0; axis < 3; axis++) {
        ends[end + axis] = ends[axis] + (ends[axis + 3] - ends[axis]) * cut;
      }
    }
    this.project(ends, 0, 2, 1, scratch);
    context.moveTo(scratch[0], scratch[1]);
    context.lineTo(scratch[3], scratch[4]);
  }
}
