/* The picture of the body in one frame. */

/** Levels of depth, each drawn in one go per style; far ones are fainter. */
const DEPTH_LEVELS = 6;

/** Opacity of the farthest level; the nearest has 1. */
const FAR_ALPHA = 0.4;

/** Radius of a marker in mm, for a body of 1.8 m, and its limits in pixels. */
const MARKER_MM = 14;
const MARKER_PIXELS = [2.5, 7];

/** Colours of the sticks of subjects, visible on light and dark; the lightness differs, too. */
const STICK_COLOURS = ["#7d8a99", "#b5772f", "#5b6fd6", "#3f9a76", "#a85a9e", "#8a8a3a"];

/** Dashes (pixels) of sticks that end at a filled marker. */
const FILLED_DASH = [5, 3];

/** Opacity of what falls on the floor. */
const SHADOW_ALPHA = 0.25;

/** A bound is large if its radius is more than this share of the picture; opacity of its line. */
const LARGE_BOUND = 0.12;
const LARGE_BOUND_ALPHA = 0.35;

const NO_DASH = [];

/** Draws a frame from typed arrays; allocates only when markers or sticks change. */
class BodyDrawing {
  /**
   * @param {Store} store
   * @param {BodyCamera} camera
   */
  constructor(store, camera) {
    this.store = store;
    this.camera = camera;
    this.floor = new BodyFloor(camera);
    this.ghost = new BodyGhost(this);
    this.ends = new Float64Array(6);
    this.scratch = new Float32Array(6);
    this.load();
  }

  /** Make the arrays for the data of the store. */
  load() {
    const { markers, sticks } = this.store.data;
    this.count = markers.length;
    this.at = new Float32Array(this.count * 3);
    this.shadow = new Float32Array(this.count * 3);
    this.state = new Uint8Array(this.count);
    this.level = new Uint8Array(this.count);
    this.subject = Uint8Array.from(markers, (m) => (m.subject || 0) % STICK_COLOURS.length);
    this.sticks = Uint16Array.from(sticks.flat());
    this.stickLevel = new Uint8Array(sticks.length);
    this.ghost.load(this.count);
    this.floorPoints = new Float64Array(this.count * 3);
    this.spread = 1000;
    this.markerMm = MARKER_MM;
  }

  /** Take over what a scene says about sizes. */
  setScene(scene) {
    this.scene = scene;
    this.floor.setScene(scene, this.store.data.clip.up);
    this.spread = scene.size;
    this.markerMm = (MARKER_MM * Math.min(2500, scene.size)) / 1800;
  }

  /**
   * Draw a frame.
   * @param {CanvasRenderingContext2D} context scaled to CSS pixels
   * @param {number} frame -1 draws the floor only
   * @param {Object} look what is shown: bounds (boolean), ghost (version or -1)
   */
  draw(context, frame, look) {
    const paint = colours();
    context.fillStyle = paint.surface;
    context.fillRect(0, 0, this.camera.width, this.camera.height);
    context.lineJoin = "round"; // of the outlines of labels
    this.floor.draw(context, paint);
    if (frame < 0) {
      return;
    }
    this.place(frame);
    this.drawShadows(context, paint);
    this.drawSticks(context);
    if (look.bounds) {
      this.drawBounds(context, frame, paint);
    }
    this.ghost.draw(context, frame, look.ghost, paint);
    this.drawMarkers(context, paint);
  }

  /** Project the markers, and read their states and levels of depth. */
  place(frame) {
    const { store, camera, count, at, state, level } = this;
    const positions = store.positions(0);
    camera.project(positions, frame * count * 3, count, 0.1, at);
    const [near, range] = [camera.distance - this.spread / 2, this.spread];
    for (let marker = 0; marker < count; marker++) {
      const depth = at[marker * 3 + 2];
      state[marker] = depth > 0 ? store.state(frame, marker) : 0;
      const share = Math.max(0, Math.min(0.999, (depth - near) / range));
      level[marker] = share * DEPTH_LEVELS;
    }
    for (let stick = 0; stick < this.stickLevel.length; stick++) {
      const [a, b] = [this.sticks[stick * 2], this.sticks[stick * 2 + 1]];
      const both = state[a] && state[b];
      this.stickLevel[stick] = both ? (level[a] + level[b]) >> 1 : DEPTH_LEVELS;
    }
    if (this.scene) {
      const height = this.scene.floor;
      for (let marker = 0; marker < count; marker++) {
        const from = (frame * count + marker) * 3;
        this.floorPoints[marker * 3] = positions[from] / 10;
        this.floorPoints[marker * 3 + 1] = positions[from + 1] / 10;
        this.floorPoints[marker * 3 + 2] = height;
      }
      camera.project(this.floorPoints, 0, count, 1, this.shadow);
    }
  }

  /**
   * Draw a stick between projected points. A path of its own for each line is three times as fast
   * in software as one path of many, whose crossings have to be found.
   */
  drawStick(context, stick, points) {
    const [a, b] = [this.sticks[stick * 2] * 3, this.sticks[stick * 2 + 1] * 3];
    if (points[a + 2] > 0 && points[b + 2] > 0) {
      context.beginPath();
      context.moveTo(points[a], points[a + 1]);
      context.lineTo(points[b], points[b + 1]);
      context.stroke();
    }
  }

  /** Draw sticks and markers as they would fall on the floor, seen from above it. */
  drawShadows(context, paint) {
    if (!this.scene || this.camera.pitch <= 0) {
      return;
    }
    context.globalAlpha = SHADOW_ALPHA;
    context.lineWidth = 2;
    context.strokeStyle = context.fillStyle = paint.muted;
    for (let stick = 0; stick < this.stickLevel.length; stick++) {
      if (this.stickLevel[stick] < DEPTH_LEVELS) {
        this.drawStick(context, stick, this.shadow);
      }
    }
    for (let marker = 0; marker < this.count; marker++) {
      if (this.state[marker] && this.shadow[marker * 3 + 2] > 0) {
        context.fillRect(this.shadow[marker * 3] - 1, this.shadow[marker * 3 + 1] - 1, 2, 2);
      }
    }
    context.globalAlpha = 1;
  }

  /** Does a stick end at a filled marker? */
  endsFilled(stick) {
    const [a, b] = [this.state[this.sticks[stick * 2]], this.state[this.sticks[stick * 2 + 1]]];
    return isFilled(a) || isFilled(b);
  }

  /** Draw the sticks, far ones first. */
  drawSticks(context) {
    for (let level = DEPTH_LEVELS - 1; level >= 0; level--) {
      context.globalAlpha = levelAlpha(level);
      context.lineWidth = 3.2 - (2 * level) / DEPTH_LEVELS;
      for (let stick = 0; stick < this.stickLevel.length; stick++) {
        if (this.stickLevel[stick] === level) {
          const filled = this.endsFilled(stick);
          if (filled) {
            context.setLineDash(FILLED_DASH);
          }
          context.strokeStyle = STICK_COLOURS[this.subject[this.sticks[stick * 2]]];
          this.drawStick(context, stick, this.at);
          if (filled) {
            context.setLineDash(NO_DASH);
          }
        }
      }
    }
    context.globalAlpha = 1;
  }

  /** Draw the 90 % bounds of filled markers in true size: areas, but large ones as lines only. */
  drawBounds(context, frame, paint) {
    const large = LARGE_BOUND * Math.min(this.camera.width, this.camera.height);
    context.beginPath();
    if (this.addBounds(context, frame, 0, large)) {
      paintHalo(context, paint);
    }
    context.beginPath();
    if (this.addBounds(context, frame, large, Infinity)) {
      context.globalAlpha = LARGE_BOUND_ALPHA;
      context.lineWidth = 1;
      context.strokeStyle = paint.filled;
      context.stroke();
      context.globalAlpha = 1;
    }
  }

  /** Add bounds with a radius (pixels) within limits to the current path; were there any? */
  addBounds(context, frame, least, most) {
    let any = false;
    for (let marker = 0; marker < this.count; marker++) {
      if (isFilled(this.state[marker])) {
        const [x, y] = [this.at[marker * 3], this.at[marker * 3 + 1]];
        const bound = this.store.bound(frame, marker);
        const radius = this.camera.pixels(bound, this.at[marker * 3 + 2]);
        if (radius > least && radius <= most) {
          context.moveTo(x + radius, y);
          context.arc(x, y, radius, 0, TURN);
          any = true;
        }
      }
    }
    return any;
  }

  /** Radius in pixels of a marker at a depth in mm. */
  radius(depth) {
    const radius = this.camera.pixels(this.markerMm, depth);
    return Math.max(MARKER_PIXELS[0], Math.min(MARKER_PIXELS[1], radius));
  }

  /** Draw the markers, far ones first, each in a path of its own as sticks are. */
  drawMarkers(context, paint) {
    const { state, level, at } = this;
    for (let depth = DEPTH_LEVELS - 1; depth >= 0; depth--) {
      for (let code = 1; code < MARKER_STYLES.length; code++) {
        const { shape, colour } = MARKER_STYLES[code];
        context.globalAlpha = code === STATE.measured ? levelAlpha(depth) : 1;
        for (let marker = 0; marker < this.count; marker++) {
          if (state[marker] === code && level[marker] === depth) {
            const from = marker * 3;
            context.beginPath();
            addShape(context, shape, at[from], at[from + 1], this.radius(at[from + 2]));
            paintShape(context, shape, paint[colour]);
          }
        }
      }
    }
    context.globalAlpha = 1;
  }

  /** Is any marker not missing in a frame? */
  anyVisible(frame) {
    for (let marker = 0; marker < this.count; marker++) {
      if (this.store.state(frame, marker)) {
        return true;
      }
    }
    return false;
  }

  /** The visible marker nearest to a place in pixels, within a reach in pixels; -1 without one. */
  pick(x, y, reach) {
    let found = -1;
    let best = reach * reach;
    for (let marker = 0; marker < this.count; marker++) {
      if (this.state[marker]) {
        const dx = this.at[marker * 3] - x;
        const dy = this.at[marker * 3 + 1] - y;
        if (dx * dx + dy * dy < best) {
          best = dx * dx + dy * dy;
          found = marker;
        }
      }
    }
    return found;
  }
}

/** Opacity of a level of depth. */
function levelAlpha(level) {
  return 1 - ((1 - FAR_ALPHA) * level) / (DEPTH_LEVELS - 1);
}

/** Is a state that of a filled sample? */
function isFilled(state) {
  return state === STATE.filled || state === STATE.replaced;
}
