/* Pointer and keys on the curves: hover, click, zoom, pan, range. */

/** CSS pixels that the pointer moves before a press is a drag. */
const CURVE_DRAG_PIXELS = 4;

/** Zoom of one press of + or −, and of one step of a wheel. */
const CURVE_KEY_ZOOM = 1.5;
const CURVE_WHEEL_ZOOM = 1.2;

/** Pan of Page Up and Page Down, and of one step of a wheel, as parts of the view. */
const CURVE_KEY_PAN = 0.5;
const CURVE_WHEEL_PAN = 0.1;

/** What a drag does: "zoom" on a panel, "pan" on a time axis or with Alt, "range" with Shift. */
class CurvePointer {
  /**
   * @param {HTMLCanvasElement} canvas The upper canvas.
   * @param {Curves} curves
   */
  constructor(canvas, curves) {
    this.canvas = canvas;
    this.curves = curves;
    this.hovered = null;
    this.drag = null;
    const on = (event, fn, options) => canvas.addEventListener(event, fn, options);
    on("pointerdown", (event) => this.press(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.release(event));
    on("pointercancel", () => this.cancel());
    on("pointerleave", () => this.hover(null));
    on("dblclick", () => curves.showClip());
    on("wheel", (event) => this.wheel(event), { passive: false });
    on("keydown", (event) => this.key(event));
  }

  /** The panel or time axis at a place, with the frame there; null between them. */
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    const x = event.clientX - box.left;
    const y = event.clientY - box.top;
    const { panels, axes } = this.curves.laid;
    const inside = (p, height) =>
      x >= p.x && x <= p.x + p.width && y >= p.y && y <= p.y + height;
    const panel = panels.find((p) => inside(p, p.height));
    const axis = panel ? null : axes.find((a) => inside(a, CURVE_ROOM.axis));
    const found = panel || axis;
    if (!found) return null;
    return { found, axis: !panel, x, frame: frameAtX(found, this.curves.view, x) };
  }

  /** Begin a click or a drag. */
  press(event) {
    const place = this.at(event);
    if (!place || event.button > 1) return;
    let what = "zoom";
    if (place.axis || event.altKey || event.button === 1) what = "pan";
    else if (event.shiftKey) what = "range";
    this.drag = { what, from: place, to: place, moved: false };
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    if (event.button === 1) event.preventDefault();
  }

  /** Follow the pointer. */
  move(event) {
    if (!this.drag) {
      const place = this.at(event);
      this.canvas.style.cursor = place ? (place.axis ? "ew-resize" : "crosshair") : "default";
      this.hover(place && !place.axis ? place : null);
      return;
    }
    const { drag } = this;
    const box = this.canvas.getBoundingClientRect();
    const x = event.clientX - box.left;
    if (Math.abs(x - drag.from.x) >= CURVE_DRAG_PIXELS) drag.moved = true;
    const frame = frameAtX(drag.from.found, this.curves.view, x);
    if (drag.what === "pan" && drag.moved) {
      this.curves.view.pan(drag.from.frame - frame);
      this.curves.redraw();
    }
    drag.to = { ...drag.from, x, frame };
    this.hovered = null;
    this.curves.redrawOverlay();
  }

  /** End a click or a drag. */
  release() {
    const { drag, curves } = this;
    this.drag = null;
    if (!drag) return;
    const ends = [drag.from.frame, drag.to.frame].sort((a, b) => a - b);
    if (!drag.moved) curves.store.setFrame(drag.from.frame);
    else if (drag.what === "zoom") curves.showFrames(...ends);
    else if (drag.what === "range") this.markRange(ends);
    curves.redrawOverlay();
  }

  /** Give up a drag. */
  cancel() {
    this.drag = null;
    this.curves.redrawOverlay();
  }

  /** Mark the whole frames between two places as the range of the page. */
  markRange([low, high]) {
    const { store } = this.curves;
    const first = Math.max(0, Math.round(low));
    const last = Math.min(store.frames - 1, Math.round(high));
    store.setRange([first, last]);
    announce(`Range: frames ${store.frameNumber(first)} to ${store.frameNumber(last)}.`);
  }

  /** Note where the pointer is. */
  hover(place) {
    const most = this.curves.store.frames - 1;
    this.hovered = place
      ? { ...place, frame: Math.max(0, Math.min(most, Math.round(place.frame))) }
      : null;
    this.curves.redrawOverlay();
  }

  /** Zoom with the wheel, or pan with Shift; without focus only with Ctrl, so that pages scroll. */
  wheel(event) {
    const focused = document.activeElement === this.canvas;
    const place = this.at(event);
    if (!place || !(focused || event.ctrlKey || event.metaKey)) return;
    event.preventDefault();
    const { view } = this.curves;
    const turned = event.deltaY || event.deltaX;
    if (event.shiftKey || (!event.deltaY && event.deltaX)) {
      view.pan(Math.sign(turned) * CURVE_WHEEL_PAN * view.span);
    } else view.zoom(CURVE_WHEEL_ZOOM ** Math.sign(turned), place.frame);
    this.curves.redraw();
  }

  /** Keys of the focused canvas. */
  key(event) {
    const { curves } = this;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const pan = CURVE_KEY_PAN * curves.view.span;
    const acts = {
      "+": () => curves.zoom(1 / CURVE_KEY_ZOOM),
      "=": () => curves.zoom(1 / CURVE_KEY_ZOOM),
      "-": () => curves.zoom(CURVE_KEY_ZOOM),
      PageUp: () => curves.pan(-pan),
      PageDown: () => curves.pan(pan),
      Home: () => curves.showClip(),
      0: () => curves.showClip(),
      Enter: () => curves.showGap(),
      Escape: () => this.escape(),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  }

  /** Give up a drag, or take back the range. */
  escape() {
    if (this.drag) this.cancel();
    else if (this.curves.store.range) this.curves.store.setRange(null);
  }
}
