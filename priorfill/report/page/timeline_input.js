/* Pointer, wheel, keys and buttons of the timeline. */

/** Fewest frames that the timeline shows. */
const FEWEST_FRAMES = 20;

/** Factor of one step of zooming. */
const ZOOM_STEP = 1.5;

/** Distance (px) from which a movement of the pressed pointer is a drag. */
const DRAG_FROM = 4;

/** Distance (px) within which a click next to a gap chooses it. */
const NEAR = 4;

class TimelineInput {
  /** @param {Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.store = timeline.store;
    this.drag = null;
  }

  /** @returns {HTMLElement} buttons that zoom and move */
  buttons() {
    const make = (text, title, fn) => button(text, fn, { title, "aria-label": title });
    return element("span", { class: "group", role: "group", "aria-label": "Frames shown" }, [
      make("◀", "Earlier frames (Page Up)", () => this.pan(-0.5)),
      make("−", "Show more frames (-)", () => this.zoom(ZOOM_STEP)),
      make("+", "Show fewer frames (+)", () => this.zoom(1 / ZOOM_STEP)),
      make("▶", "Later frames (Page Down)", () => this.pan(0.5)),
      make("Gap", "Zoom to the gap (Enter)", () => this.zoomToGap()),
      make("Fit", "Show all frames (0)", () => this.fit()),
    ]);
  }

  /** Listen to pointer, wheel and keys. */
  listen(canvas) {
    this.canvas = canvas;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => { this.drag = null; });
    canvas.addEventListener("pointerleave", () => { this.timeline.tip.hidden = true; });
    canvas.addEventListener("dblclick", () => this.zoomToGap());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  /** Begin a click or a drag. */
  press(event) {
    if (event.button !== 0) return;
    const { x, y } = pointOf(event, this.canvas);
    const place = this.timeline.at(x, y);
    this.drag = { x, y, frame: place.frame, moved: false, axis: y < AXIS_HEIGHT };
    this.canvas.setPointerCapture(event.pointerId);
    if (this.drag.axis && !place.names) this.store.setFrame(place.frame);
  }

  /** Drag a range of frames, scrub on the axis, or show what is under the pointer. */
  move(event) {
    const { x, y } = pointOf(event, this.canvas);
    const place = this.timeline.at(x, y);
    if (!this.drag) {
      this.showTip(place, x, y);
      return;
    }
    this.timeline.tip.hidden = true;
    if (this.drag.axis) {
      this.store.setFrame(place.frame);
      return;
    }
    if (!this.drag.moved && Math.abs(x - this.drag.x) < DRAG_FROM) return;
    this.drag.moved = true;
    const ends = [this.drag.frame, place.frame].sort((a, b) => a - b);
    this.store.setRange(ends);
  }

  /** End a drag, or take the click. */
  release(event) {
    const { drag } = this;
    this.drag = null;
    if (!drag || drag.axis) return;
    if (drag.moved) {
      const [first, last] = this.store.range;
      announce(`Frames ${this.store.frameNumber(first)} to ${this.store.frameNumber(last)} chosen`);
      return;
    }
    const { x, y } = pointOf(event, this.canvas);
    this.choose(this.timeline.at(x, y), event.shiftKey);
  }

  /**
   * Choose what was clicked: gap and frame, or marker and frame.
   * @param {Object} place of Timeline.at
   * @param {boolean} more add the marker to the curves
   */
  choose(place, more) {
    const { store } = this;
    const marker = place.row ? place.row.marker : undefined;
    if (store.range) store.setRange(null);
    if (marker === undefined) {
      if (!place.names) store.setFrame(place.frame);
      return;
    }
    if (more) {
      const rest = store.markers.filter((m) => m !== marker);
      store.setMarkers(rest.length < store.markers.length ? rest : [...rest, marker]);
      return;
    }
    if (place.names) {
      const first = store.gapsOf[marker][0];
      if (first === undefined) store.setMarkers([marker]);
      else store.setActiveGap(first);
      return;
    }
    const gap = gapNear(store, marker, place.frame, place.near);
    if (gap < 0) {
      store.setMarkers([marker]);
      store.setFrame(place.frame);
      return;
    }
    const { start, stop } = store.data.gaps[gap];
    store.setActiveGap(gap, { frame: Math.max(start, Math.min(stop - 1, place.frame)) });
  }

  /** Zoom around the pointer; scroll where nothing is left to zoom, or over the names. */
  wheel(event) {
    const { x, y } = pointOf(event, this.canvas);
    const { view } = this.timeline;
    const { names, width } = this.timeline.columns();
    if (x < names && !event.ctrlKey) return;
    const sideways = event.shiftKey ? event.deltaY || event.deltaX : event.deltaX;
    const whole = view.from <= 0 && view.to >= this.store.frames;
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      if (whole) return;
      event.preventDefault();
      this.pan(sideways / width);
      return;
    }
    if (!event.deltaY || (whole && event.deltaY > 0)) return;
    event.preventDefault();
    const factor = Math.exp(Math.max(-1, Math.min(1, event.deltaY / 300)));
    this.zoom(factor, view.from + ((x - names) / width) * (view.to - view.from));
    this.showTip(this.timeline.at(x, y), x, y);
  }

  /** Keys of the timeline. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = {
      "+": () => this.zoom(1 / ZOOM_STEP), "=": () => this.zoom(1 / ZOOM_STEP),
      "-": () => this.zoom(ZOOM_STEP), 0: () => this.fit(),
      PageUp: () => this.pan(-0.5), PageDown: () => this.pan(0.5),
      ArrowUp: () => this.stepMarker(-1), ArrowDown: () => this.stepMarker(1),
      Enter: () => this.zoomToGap(),
      Home: () => this.store.setFrame(0), End: () => this.store.setFrame(this.store.frames - 1),
    };
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    event.stopPropagation();
    action();
  }

  /**
   * Go to the row above or below: to its gap next to the playhead.
   * @param {number} by -1 or 1
   */
  stepMarker(by) {
    const { store, timeline } = this;
    const count = timeline.rows.length;
    let row = timeline.rowOf.get(store.markers[store.markers.length - 1]);
    row = row === undefined ? (by > 0 ? -1 : count) : row;
    do row += by; while (timeline.rows[row] && timeline.rows[row].marker === undefined);
    if (!timeline.rows[row]) return;
    const { marker } = timeline.rows[row];
    const gap = gapNear(store, marker, store.frame, store.frames);
    if (gap >= 0) store.setActiveGap(gap);
    else store.setMarkers([marker]);
    announce(gap >= 0 ? store.gapName(gap) : shortText(store.data.markers[marker].label));
  }

  /**
   * Show more or fewer frames.
   * @param {number} factor above 1 shows more
   * @param {number} around frame that stays in place; the playhead, or the middle
   */
  zoom(factor, around = null) {
    const { view } = this.timeline;
    const { frame, frames } = this.store;
    const inside = frame >= view.from && frame <= view.to;
    const fixed = around !== null ? around : inside ? frame : (view.from + view.to) / 2;
    const before = view.to - view.from;
    const most = Math.max(1, frames);
    const span = Math.max(Math.min(FEWEST_FRAMES, most), Math.min(most, before * factor));
    this.setView(fixed - ((fixed - view.from) * span) / before, span);
  }

  /** Move by a share of what is shown. */
  pan(share) {
    const { view } = this.timeline;
    const span = view.to - view.from;
    this.setView(view.from + share * span, span);
  }

  /** Show all frames. */
  fit() {
    this.setView(0, Math.max(1, this.store.frames));
  }

  /** Show the active gap and as much again on both sides. */
  zoomToGap() {
    const gap = this.store.data.gaps[this.store.activeGap];
    if (!gap) return;
    const most = Math.max(1, this.store.frames);
    const span = Math.min(most, Math.max(FEWEST_FRAMES, 3 * (gap.stop - gap.start)));
    this.setView((gap.start + gap.stop - span) / 2, span);
  }

  /** Put a frame into the middle. */
  centre(frame) {
    const span = this.timeline.view.to - this.timeline.view.from;
    this.setView(frame - span / 2, span);
  }

  /** Keep the playhead in view while playing. */
  follow() {
    const { view } = this.timeline;
    const { frame } = this.store;
    if (frame >= view.from && frame < view.to) return;
    const span = view.to - view.from;
    const from = Math.max(0, Math.min(this.store.frames - span, frame - 0.05 * span));
    this.timeline.view = { from, to: from + span };
  }

  /** Show `span` frames from `from` on, within the clip. */
  setView(from, span) {
    const begin = Math.max(0, Math.min(Math.max(1, this.store.frames) - span, from));
    this.timeline.view = { from: begin, to: begin + span };
    this.timeline.redraw();
  }

  /** Show what is under the pointer as text. */
  showTip(place, x, y) {
    const { tip } = this.timeline;
    const marker = place.row ? place.row.marker : undefined;
    tip.hidden = marker === undefined;
    if (tip.hidden) return;
    tip.textContent = place.names
      ? markerText(this.store, marker)
      : sampleText(this.store, place.frame, marker, place.near);
    const room = this.canvas.clientWidth - tip.offsetWidth - 8;
    tip.style.left = `${Math.max(0, Math.min(room, x + 12))}px`;
    tip.style.top = `${y + 16}px`;
  }
}

/**
 * Place of a pointer event on a canvas.
 * @param {PointerEvent} event
 * @param {HTMLCanvasElement} canvas
 * @returns {{x: number, y: number}} CSS pixels
 */
function pointOf(event, canvas) {
  const box = canvas.getBoundingClientRect();
  return { x: event.clientX - box.left, y: event.clientY - box.top };
}

/**
 * The gap at a frame, or the nearest within some frames.
 * @returns {number} index, or -1
 */
function gapNear(store, marker, frame, within) {
  const exact = store.gapAt(frame, marker);
  if (exact >= 0) return exact;
  let best = -1;
  let least = within + 1;
  for (const index of store.gapsOf[marker]) {
    const { start, stop } = store.data.gaps[index];
    const away = frame < start ? start - frame : frame - stop + 1;
    if (away < least) {
      least = away;
      best = index;
    }
  }
  return best;
}

/** @returns {string} name of a marker, its segment, and what is missing */
function markerText(store, marker) {
  const info = store.data.markers[marker];
  const segment = info.segment ? ` (${shortText(info.segment)})` : "";
  const gaps = countOf(store.gapsOf[marker].length, "gap");
  return `${shortText(info.label, 200)}${segment}: ${gaps}, ` +
    `missing ${formatShare(info.missing_before, store.frames)} before, ` +
    `${formatShare(info.missing_after, store.frames)} after the fill`;
}

/** @returns {string} marker, frame, state and expected error of the sample nearest to a point */
function sampleText(store, frame, marker, near) {
  const gap = gapNear(store, marker, frame, near);
  let at = frame;
  if (gap >= 0) {
    const { start, stop } = store.data.gaps[gap];
    at = Math.max(start, Math.min(stop - 1, frame));
  }
  const names = ["missing", "measured", "filled", "measured, in doubt", "replaced by a fill",
    "measured, labels exchanged"];
  const error = store.rms(at, marker);
  const bound = store.bound(at, marker);
  const errors = Number.isNaN(error) ? "" : `, expected rms error ${formatMm(error)}`;
  const bounds = Number.isNaN(bound) ? "" : `, 90 % below ${formatMm(bound)}`;
  const time = formatSeconds(at / store.rate, store.rate);
  return `${shortText(store.data.markers[marker].label)}, frame ${store.frameNumber(at)} ` +
    `(${time} s): ${names[store.state(at, marker)]}${errors}${bounds}`;
}
