/* The ghost: another version of the clip, drawn where it differs from the one shown. */

/** Dashes (pixels) of sticks of the ghost. */
const GHOST_DASH = [2, 3];

/** A ghost of a measured marker nearer than this (units of 0.1 mm) is not drawn. */
const GHOST_APART = 5;

/** Draws the ghost into the picture of a `BodyDrawing`. */
class BodyGhost {
  /** @param {BodyDrawing} drawing */
  constructor(drawing) {
    this.drawing = drawing;
  }

  /** Make the arrays for a number of markers. */
  load(count) {
    this.count = count;
    this.at = new Float32Array(count * 3);
    this.shown = new Uint8Array(count);
  }

  /** Project the markers; those are shown that are filled, missing or elsewhere in the fill. */
  place(frame, version, ghost) {
    const { count, at, shown } = this;
    const { store, camera, state } = this.drawing;
    const filled = store.positions(0);
    camera.project(ghost, frame * count * 3, count, 1 / UNITS_PER_MM, at);
    for (let marker = 0; marker < count; marker++) {
      const from = (frame * count + marker) * 3;
      const apart = Math.abs(ghost[from] - filled[from]) +
        Math.abs(ghost[from + 1] - filled[from + 1]) + Math.abs(ghost[from + 2] - filled[from + 2]);
      const differs = !state[marker] || isFilled(state[marker]) || apart > GHOST_APART;
      const seen = at[marker * 3 + 2] > 0;
      shown[marker] = seen && differs && store.shown(version, frame, marker) ? 1 : 0;
    }
  }

  /** Draw a version (-1 is none): its sticks, its markers, and lines from the fill to them. */
  draw(context, frame, version, paint) {
    const { store } = this.drawing;
    const ghost = version >= 0 ? store.positions(version) : null;
    if (!ghost) {
      return;
    }
    this.place(frame, version, ghost);
    context.strokeStyle = paint[ghostColour(store.data.versions[version])];
    this.drawSticks(context);
    this.drawErrors(context);
    context.beginPath();
    for (let marker = 0; marker < this.count; marker++) {
      if (this.shown[marker]) {
        const radius = this.drawing.radius(this.at[marker * 3 + 2]);
        addShape(context, "ring", this.at[marker * 3], this.at[marker * 3 + 1], radius);
      }
    }
    paintShape(context, "ring", context.strokeStyle);
  }

  /** Draw sticks with an end at the ghost; the other end may be a measured marker. */
  drawSticks(context) {
    const { sticks, stickLevel, state, at } = this.drawing;
    const { shown } = this;
    context.beginPath();
    for (let stick = 0; stick < stickLevel.length; stick++) {
      const [a, b] = [sticks[stick * 2], sticks[stick * 2 + 1]];
      if ((shown[a] && (shown[b] || state[b])) || (shown[b] && state[a])) {
        const one = shown[a] ? this.at : at;
        const other = shown[b] ? this.at : at;
        context.moveTo(one[a * 3], one[a * 3 + 1]);
        context.lineTo(other[b * 3], other[b * 3 + 1]);
      }
    }
    context.setLineDash(GHOST_DASH);
    context.lineWidth = 1.2;
    context.stroke();
    context.setLineDash(NO_DASH);
  }

  /** Draw lines from markers of the fill to the same ones of the ghost. */
  drawErrors(context) {
    const { state, at } = this.drawing;
    context.beginPath();
    for (let marker = 0; marker < this.count; marker++) {
      if (this.shown[marker] && state[marker]) {
        context.moveTo(at[marker * 3], at[marker * 3 + 1]);
        context.lineTo(this.at[marker * 3], this.at[marker * 3 + 1]);
      }
    }
    context.lineWidth = 2.5;
    context.stroke();
  }
}
