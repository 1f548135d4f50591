/* Shapes of markers, the same in the picture and in its legend. */

/** A full turn in radians. */
const TURN = 2 * Math.PI;

/**
 * How a marker is drawn by its state (order of the codes): name, colour of the theme, shape.
 * Shapes differ, so that nothing depends on colours alone.
 */
const MARKER_STYLES = [
  { name: "missing", colour: "missing", shape: null },
  { name: "measured", colour: "measured", shape: "disc" },
  { name: "filled", colour: "filled", shape: "diamond" },
  { name: "in doubt", colour: "doubt", shape: "cross" },
  { name: "measured, replaced by a fill", colour: "replaced", shape: "square" },
  { name: "labels exchanged", colour: "swapped", shape: "triangle" },
];

/** Radius of each shape as a multiple of that of a disc: about equal areas, fills larger. */
const SHAPE_SCALE = { disc: 1, diamond: 1.75, cross: 1.4, square: 1.3, triangle: 1.7, ring: 2.2 };

/**
 * Add a shape to the current path.
 * @param {CanvasRenderingContext2D} context
 * @param {string} shape key of SHAPE_SCALE
 * @param {number} x pixels
 * @param {number} y pixels
 * @param {number} radius radius of a disc in pixels
 */
function addShape(context, shape, x, y, radius) {
  const r = radius * SHAPE_SCALE[shape];
  if (shape === "disc" || shape === "ring") {
    context.moveTo(x + r, y);
    context.arc(x, y, r, 0, TURN);
  } else if (shape === "diamond") {
    context.moveTo(x, y - r);
    context.lineTo(x + r, y);
    context.lineTo(x, y + r);
    context.lineTo(x - r, y);
    context.closePath();
  } else if (shape === "cross") {
    context.moveTo(x - r, y - r);
    context.lineTo(x + r, y + r);
    context.moveTo(x - r, y + r);
    context.lineTo(x + r, y - r);
  } else if (shape === "square") {
    context.rect(x - r, y - r, 2 * r, 2 * r);
  } else {
    context.moveTo(x, y - r);
    context.lineTo(x + r * 0.9, y + r * 0.7);
    context.lineTo(x - r * 0.9, y + r * 0.7);
    context.closePath();
  }
}

/** Paint the current path of shapes: crosses and rings as lines, the others as areas. */
function paintShape(context, shape, colour) {
  if (shape === "cross" || shape === "ring") {
    context.strokeStyle = colour;
    context.lineWidth = shape === "ring" ? 1.5 : 2;
    context.stroke();
  } else {
    context.fillStyle = colour;
    context.fill();
  }
}

/** Paint the current path of circles as 90 % bounds. */
function paintHalo(context, paint) {
  context.fillStyle = context.strokeStyle = paint.filled;
  context.globalAlpha = 0.2;
  context.fill();
  context.globalAlpha = 0.75;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
}
