/* Marks of the curves: samples in doubt, exchanged labels, symbols of markers. */

/**
 * Mark samples on a curve: × in doubt, a small triangle where labels were exchanged.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Float32Array} series Values at which the marks are drawn.
 * @param {Object} marks stretches ([first, stop) pairs), symbol, colour
 */
function drawMarks(context, panel, view, series, marks) {
  context.strokeStyle = marks.colour;
  context.fillStyle = marks.colour;
  context.lineWidth = 1.5;
  const every = Math.max(1, Math.ceil((CURVE_MARK_EVERY * view.span) / panel.width));
  for (const [start, stop] of marks.stretches) {
    const first = Math.max(start, Math.ceil(view.first));
    for (let frame = first; frame < stop && frame <= view.last; frame += every) {
      const value = series[frame];
      if (value !== value) continue; // NaN
      const x = frameX(panel, view, frame);
      drawSymbol(context, marks.symbol, x, valueY(panel, value), 3.5);
    }
  }
}

/**
 * Draw the symbol of a marker along its curve, so that it is known without colours.
 * @param {CanvasRenderingContext2D} context
 * @param {Object} panel
 * @param {CurveView} view
 * @param {Float32Array} series
 * @param {{colour: string, symbol: string}} style
 * @param {number} shift CSS pixels along the curve, different for each marker.
 */
function drawSymbols(context, panel, view, series, style, shift) {
  context.fillStyle = style.colour;
  context.strokeStyle = style.colour;
  context.lineWidth = 1.5;
  for (let x = panel.x + 12 + shift; x < panel.x + panel.width; x += CURVE_SYMBOL_EVERY) {
    const value = series[Math.round(frameAtX(panel, view, x))];
    if (value === undefined || value !== value) continue; // NaN
    const place = frameX(panel, view, Math.round(frameAtX(panel, view, x)));
    drawSymbol(context, style.symbol, place, valueY(panel, value), 4);
  }
}

/**
 * Draw one symbol.
 * @param {CanvasRenderingContext2D} context
 * @param {string} symbol
 * @param {number} x
 * @param {number} y
 * @param {number} size Half its width (CSS pixels).
 */
function drawSymbol(context, symbol, x, y, size) {
  context.beginPath();
  if (symbol === "cross") {
    context.moveTo(x - size, y - size);
    context.lineTo(x + size, y + size);
    context.moveTo(x - size, y + size);
    context.lineTo(x + size, y - size);
    context.stroke();
    return;
  }
  if (symbol === "circle" || symbol === "ring") context.arc(x, y, size, 0, 2 * Math.PI);
  else if (symbol === "square") context.rect(x - size, y - size, 2 * size, 2 * size);
  else if (symbol === "triangle") {
    context.moveTo(x, y - size);
    context.lineTo(x + size, y + size);
    context.lineTo(x - size, y + size);
    context.closePath();
  } else {
    context.moveTo(x, y - 1.2 * size);
    context.lineTo(x + 1.2 * size, y);
    context.lineTo(x, y + 1.2 * size);
    context.lineTo(x - 1.2 * size, y);
    context.closePath();
  }
  if (symbol === "ring") context.stroke();
  else context.fill();
}
