/* What lies over the picture of the body: trails, chosen markers, labels, messages. */

/** Most points of a trail; longer ones leave out frames. */
const TRAIL_POINTS = 400;

/** Most chosen markers with a trail. */
const TRAILS = 12;

/** Longest label in the picture (characters). */
const LABEL_LENGTH = 28;

/** Height of a label, and its distance from the marker (pixels). */
const LABEL_HEIGHT = 14;
const LABEL_GAP = 8;

/** Draws over the picture that a `BodyDrawing` has made. */
class BodyOverlay {
  /**
   * @param {Store} store
   * @param {BodyCamera} camera
   * @param {BodyDrawing} drawing
   */
  constructor(store, camera, drawing) {
    this.store = store;
    this.camera = camera;
    this.drawing = drawing;
    this.point = new Float32Array(3);
    this.load();
  }

  /** Take the labels of the data of the store. */
  load() {
    this.labels = this.store.data.markers.map(({ label }) => shortText(label, LABEL_LENGTH));
    this.widths = new Float32Array(this.labels.length);
    this.boxes = new Float32Array(this.labels.length * 4);
    this.measured = false;
  }

  /**
   * Draw all of it.
   * @param {CanvasRenderingContext2D} context
   * @param {number} frame
   * @param {Object} look trail (s), labels ("none", "chosen" or "all"), hovered (marker or -1)
   */
  draw(context, frame, look) {
    const paint = colours();
    const { store } = this;
    const gap = store.data.gaps[store.activeGap];
    const active = gap ? gap.marker : -1;
    if (look.trail > 0) {
      for (let i = 0; i < Math.min(TRAILS, store.markers.length); i++) {
        this.drawTrail(context, frame, store.markers[i], look.trail, paint);
      }
    }
    for (let i = 0; i < store.markers.length; i++) {
      if (store.markers[i] !== active) {
        this.ring(context, store.markers[i], paint.text, 1.2);
      }
    }
    this.ring(context, active, paint.accent, 2.5);
    this.ring(context, look.hovered, paint.text, 1.5);
    this.drawLabels(context, look, active, paint);
  }

  /** Draw a circle around a marker, if it is visible. */
  ring(context, marker, colour, width) {
    const { at, state } = this.drawing;
    if (marker < 0 || !state[marker]) {
      return;
    }
    context.beginPath();
    const radius = this.drawing.radius(at[marker * 3 + 2]) * 2 + 2;
    context.arc(at[marker * 3], at[marker * 3 + 1], radius, 0, TURN);
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.stroke();
  }

  /** Draw the path of a marker around a frame: measured thin, filled thick and dashed. */
  drawTrail(context, frame, marker, seconds, paint) {
    const reach = Math.max(1, Math.round(seconds * this.store.rate));
    const first = Math.max(0, frame - reach);
    const last = Math.min(this.store.decodedFrames - 1, frame + reach);
    const step = Math.max(1, Math.ceil((last - first) / TRAIL_POINTS));
    context.beginPath();
    this.addTrail(context, marker, first, last, step, false);
    context.lineWidth = 1.3;
    context.strokeStyle = paint.measured;
    context.stroke();
    context.beginPath();
    this.addTrail(context, marker, first, last, step, true);
    context.setLineDash(FILLED_DASH);
    context.lineWidth = 2.5;
    context.strokeStyle = paint.filled;
    context.stroke();
    context.setLineDash(NO_DASH);
  }

  /** Add the measured or the filled pieces of a path to the current path of the canvas. */
  addTrail(context, marker, first, last, step, filled) {
    let [x, y, before, joined] = [0, 0, 0, false];
    for (let frame = first - (first % step); frame <= last; frame += step) {
      const known = this.store.state(frame, marker);
      const state = known && this.projectSample(frame, marker) ? known : 0;
      if (state && before && (isFilled(state) || isFilled(before)) === filled) {
        if (!joined) {
          context.moveTo(x, y);
        }
        context.lineTo(this.point[0], this.point[1]);
        joined = true;
      } else {
        joined = false;
      }
      [x, y] = [this.point[0], this.point[1]];
      before = state;
    }
  }

  /** Project a sample to `point`; false behind the eye. */
  projectSample(frame, marker) {
    const at = (frame * this.drawing.count + marker) * 3;
    this.camera.project(this.store.positions(0), at, 1, 0.1, this.point);
    return this.point[2] > 0;
  }

  /** Draw labels; in a crowd, those of chosen markers first, then those that do not overlap. */
  drawLabels(context, look, active, paint) {
    context.font = BODY_FONT;
    if (!this.measured) {
      this.labels.forEach((label, i) => (this.widths[i] = context.measureText(label).width));
      this.measured = true;
    }
    context.lineWidth = 3;
    context.strokeStyle = paint.surface;
    context.fillStyle = paint.text;
    this.placed = 0;
    this.label(context, look.hovered);
    if (look.labels === "none") {
      return;
    }
    if (active !== look.hovered) {
      this.label(context, active);
    }
    for (const marker of this.store.markers) {
      if (marker !== active && marker !== look.hovered) {
        this.label(context, marker);
      }
    }
    if (look.labels === "all") {
      for (let marker = 0; marker < this.labels.length; marker++) {
        const drawn = marker === active || marker === look.hovered;
        if (!drawn && !this.store.markers.includes(marker)) {
          this.label(context, marker);
        }
      }
    }
  }

  /** Draw the label of a marker, unless it is invisible or another label is in its place. */
  label(context, marker) {
    const { at, state } = this.drawing;
    if (marker < 0 || !state[marker]) {
      return;
    }
    const width = this.widths[marker];
    const right = at[marker * 3] + LABEL_GAP + width > this.camera.width;
    const x = at[marker * 3] + (right ? -LABEL_GAP - width : LABEL_GAP);
    const y = at[marker * 3 + 1] - 4;
    const { boxes } = this;
    for (let box = 0; box < this.placed; box++) {
      if (x < boxes[box * 4] + boxes[box * 4 + 2] && x + width > boxes[box * 4] &&
          Math.abs(y - boxes[box * 4 + 1]) < LABEL_HEIGHT) {
        return;
      }
    }
    boxes[this.placed * 4] = x;
    boxes[this.placed * 4 + 1] = y;
    boxes[this.placed * 4 + 2] = width;
    this.placed += 1;
    context.strokeText(this.labels[marker], x, y);
    context.fillText(this.labels[marker], x, y);
  }

  /** Write a sentence in the middle of the picture. */
  message(context, text) {
    const paint = colours();
    context.font = "15px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineWidth = 4;
    context.strokeStyle = paint.surface;
    context.fillStyle = paint.text;
    context.strokeText(text, this.camera.width / 2, this.camera.height / 2);
    context.fillText(text, this.camera.width / 2, this.camera.height / 2);
    context.textAlign = "left";
  }
}
