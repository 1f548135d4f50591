/* The floor with its grid, and the axes of the file. */

/** Length of the axes in the corner of the picture, and distance from the corner (pixels). */
const AXES_PIXELS = 24;
const AXES_CORNER = 40;

/** An axis that looks shorter than this (pixels) has no name. */
const SHORT_AXIS = 8;

/** Font of texts in the picture. */
const BODY_FONT = "12px system-ui, sans-serif";

/** Axes of a file (0 x, 1 y, 2 z) along upright x, y and z, with their signs, by its up axis. */
const FILE_AXES = {
  "+X": [[2, -1], [1, 1], [0, 1]],
  "-X": [[2, 1], [1, 1], [0, -1]],
  "+Y": [[0, 1], [2, -1], [1, 1]],
  "-Y": [[0, 1], [2, 1], [1, -1]],
  "+Z": [[0, 1], [1, 1], [2, 1]],
  "-Z": [[0, 1], [1, -1], [2, -1]],
};

/** Draws the floor and the axes. */
class BodyFloor {
  /** @param {BodyCamera} camera */
  constructor(camera) {
    this.camera = camera;
    this.scene = null;
    this.ends = new Float64Array(6);
    this.scratch = new Float32Array(6);
    this.axes = FILE_AXES["+Z"];
  }

  /**
   * Take the floor of a scene.
   * @param {BodyScene} scene
   * @param {string} up up axis of the file
   */
  setScene(scene, up) {
    this.scene = scene;
    this.axes = FILE_AXES[up] || FILE_AXES["+Z"];
    this.scaleText = formatLength(scene.grid);
  }

  /** Add a line on the floor to the current path (mm). */
  add(context, x0, y0, x1, y1) {
    const { ends, scene } = this;
    ends[0] = x0;
    ends[1] = y0;
    ends[2] = scene.floor;
    ends[3] = x1;
    ends[4] = y1;
    ends[5] = scene.floor;
    this.camera.line(context, ends, this.scratch);
  }

  /** Draw the grid, its scale, and the axes. */
  draw(context, paint) {
    if (this.scene) {
      const { edges: [x0, y0, x1, y1], grid } = this.scene;
      context.beginPath();
      for (let x = x0; x <= x1 + 1; x += grid) {
        this.add(context, x, y0, x, y1);
      }
      for (let y = y0; y <= y1 + 1; y += grid) {
        this.add(context, x0, y, x1, y);
      }
      context.lineWidth = 1;
      context.strokeStyle = paint.grid;
      context.stroke();
      this.drawScale(context, paint);
    }
    this.drawAxes(context, paint);
  }

  /** Draw the width of one square at the corner of the grid nearest to the eye. */
  drawScale(context, paint) {
    const { edges: [x0, y0, x1, y1], grid } = this.scene;
    const { back } = this.camera;
    const alongX = Math.abs(this.camera.right[0]) > Math.abs(this.camera.right[1]);
    const x = back[0] > 0 ? x1 : x0;
    const y = back[1] > 0 ? y1 : y0;
    const toX = alongX ? x + (back[0] > 0 ? -grid : grid) : x;
    const toY = alongX ? y : y + (back[1] > 0 ? -grid : grid);
    context.beginPath();
    this.scratch.fill(NaN);
    this.add(context, x, y, toX, toY);
    context.lineWidth = 3;
    context.strokeStyle = paint.muted;
    context.stroke();
    const middle = (this.scratch[0] + this.scratch[3]) / 2;
    const below = Math.max(this.scratch[1], this.scratch[4]) + 14;
    context.font = BODY_FONT;
    context.fillStyle = paint.muted;
    const seen = middle > 60 && middle < this.camera.width - 60 && below < this.camera.height - 4;
    if (seen && below > 20) {
      context.textAlign = "center";
      context.fillText(this.scaleText, middle, below);
    }
    context.textAlign = "right";
    context.fillText(`grid ${this.scaleText}`, this.camera.width - 8, this.camera.height - 8);
    context.textAlign = "left";
  }

  /** Draw the axes of the file as seen from here. */
  drawAxes(context, paint) {
    const { right, up, height } = this.camera;
    const [x, y] = [AXES_CORNER, height - AXES_CORNER];
    context.lineWidth = 2;
    context.font = BODY_FONT;
    context.textAlign = "center";
    for (let place = 0; place < 3; place++) {
      const [axis, sign] = this.axes[place];
      const dx = sign * right[place] * AXES_PIXELS;
      const dy = -sign * up[place] * AXES_PIXELS;
      context.strokeStyle = context.fillStyle = place === 2 ? paint.text : paint.muted;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + dx, y + dy);
      context.stroke();
      if (Math.hypot(dx, dy) > SHORT_AXIS) {
        context.fillText("XYZ"[axis], x + dx * 1.4, y + dy * 1.4 + 4);
      }
    }
    context.textAlign = "left";
  }
}

/** A round length in mm as text: "0.5 m", "5 cm", "5 mm". */
function formatLength(mm) {
  if (mm >= 100) {
    return `${mm / 1000} m`;
  }
  return mm >= 10 ? `${mm / 10} cm` : `${mm} mm`;
}
