/* Curves of the chosen markers over time: coordinates, speed, bands, other versions. */

/** Time shown before and after a gap: as long as the gap, and at least this (s). */
const CURVE_SURROUNDINGS_S = 0.5;

/** ms between two drawings while blocks of positions are decoded. */
const CURVE_DECODE_MS = 250;

/** ms between two tables of values while playing. */
const CURVE_READ_MS = 200;

/** CSS pixels: height of the window from which all controls are shown. */
const CURVE_HIGH_WINDOW = 1000;

/** Where the playhead is put when it leaves the view while playing, as part of the view. */
const CURVE_PLAY_PLACE = 0.1;

class Curves {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
    this.series = new CurveData(store);
    this.painter = new CurvePainter(store, this.series);
    this.view = new CurveView(store.frames);
    this.laid = { height: 0, panels: [], heads: [], axes: [] };
    this.visible = true;
    this.timer = 0;
    this.readAt = -Infinity;
    this.redraw = scheduled(() => { if (this.visible) this.draw(); });
    this.redrawOverlay = scheduled(() => { if (this.visible) this.drawOverlay(); });
    this.build();
    this.listen();
    this.takeData();
  }

  /** Build the controls, the canvases and the tables. */
  build() {
    const line = (name) => element("div", { class: `curves-line ${name}` });
    const [first, second, third, fourth] = ["markers", "options", "further", "versions"].map(
      (name) => line(`curves-${name}`));
    this.more = element("div", { id: "curves-more" }, [third, fourth]);
    first.append(element("h2", { text: "Curves" }));
    this.markers = new CurveMarkers(first, this.store);
    this.zoomButtons(first);
    this.options = new CurveOptions(second, third, () => this.change());
    this.versions = new CurveVersions(fourth, this.store, () => this.change());
    this.base = element("canvas", { class: "curves-base", "aria-hidden": "true" });
    this.overlay = element("canvas", { id: "curves-canvas", class: "curves-overlay", tabindex: "0",
      role: "img", "aria-describedby": "curves-help" });
    this.frame = element("div", { class: "curves-frame" }, [this.base, this.overlay]);
    this.empty = element("p", { class: "curves-empty", hidden: true });
    const legend = element("ul", { class: "curves-legend", "aria-label": "Legend of the curves" });
    this.legend = new CurveLegend(legend, this.store, this.series);
    const values = element("div", {
      class: "curves-readout", tabindex: "0", role: "group", "aria-label": "Values of the curves",
    });
    this.readout = new CurveReadout(values, this.store, this.series);
    this.note = element("p", { class: "curves-note", id: "curves-help" });
    this.root.append(first, second, this.more, this.empty, this.frame, legend, values, this.note);
    this.pointer = new CurvePointer(this.overlay, this);
  }

  /** Buttons that zoom. */
  zoomButtons(root) {
    const make = (text, label, title, fn) =>
      button(text, fn, { "aria-label": label, title, class: "curves-zoom" });
    this.gapButton = make("Gap", "Curves: zoom to the gap", "Zoom to the gap (Enter)",
      () => this.showGap());
    root.append(element("span", { role: "group", "aria-label": "Zoom of the curves",
      class: "curves-group" }, [
      make("−", "Curves: zoom out", "Zoom out (−)", () => this.zoom(CURVE_KEY_ZOOM)),
      make("+", "Curves: zoom in", "Zoom in (+)", () => this.zoom(1 / CURVE_KEY_ZOOM)),
      this.gapButton,
      make("Clip", "Curves: show the whole clip", "Whole clip (Home, double click)",
        () => this.showClip()),
    ]));
    this.moreButton = button("", () => this.showMore(this.more.hidden), {
      "aria-controls": "curves-more",
    });
    root.append(this.moreButton);
    this.showMore(window.innerHeight >= CURVE_HIGH_WINDOW);
  }

  /** Show or hide the controls of comparison and arrangement. */
  showMore(shown) {
    this.more.hidden = !shown;
    this.moreButton.setAttribute("aria-expanded", String(shown));
  }

  /** Follow the store, the size and the visibility of the element. */
  listen() {
    const { store } = this;
    store.on("data", () => this.takeData());
    store.on("decoded", (block) => this.decoded(block));
    store.on("markers", () => this.change());
    store.on("versions", () => this.change());
    store.on("theme", () => this.change());
    store.on("gap", () => this.followGap());
    store.on("frame", () => this.followFrame());
    for (const event of ["range", "play"]) store.on(event, () => this.redrawOverlay());
    new ResizeObserver(() => this.redraw()).observe(this.root);
    new IntersectionObserver((entries) => {
      this.visible = entries[entries.length - 1].isIntersecting;
      if (this.visible) this.redraw();
    }).observe(this.root);
  }

  /** Take over new page data. */
  takeData() {
    const { clip } = this.store.data;
    this.series.reset();
    if (this.view.frames !== clip.frames) this.view = new CurveView(clip.frames);
    this.gapShown = this.store.activeGap; // the view stays where a gap is filled again
    this.markers.list();
    this.versions.list();
    this.options.offer(this.store.data.versions);
    const several = this.store.data.versions.length > 1;
    this.moreButton.textContent = several ? "Compare" : "Arrange";
    this.moreButton.title = several ? "Compare versions, arrange panels" : "Arrange panels";
    this.note.textContent = this.noteText(clip);
    this.followGap();
    this.change();
  }

  /** What the bands and the axes are. */
  noteText(clip) {
    const axes = CURVE_FILE_AXES[clip.up];
    const turned = axes && clip.up !== "+Z"
      ? ` The file's up axis is ${clip.up}: x, y and z are ${axes.join(", ")} of the file.`
      : "";
    return `Bands: 90 and 50 % of the errors of a coordinate are within ± ${CURVE_BANDS[90]} and ` +
      `± ${CURVE_BANDS[50]} times the 90 % bound; of the distances, 90 % are below the bound and ` +
      `50 % below ${CURVE_MEDIAN_DISTANCE} times the bound. Numbers after ± are the 90 % band. ` +
      `Time 0 s is the first frame of the file.${turned}`;
  }

  /** What the user chose. */
  get chosen() {
    const { compared, markers } = this.store;
    const { pair } = this.versions;
    const kinds = this.options.kinds.filter((kind) => kind !== "distance" || pair);
    return {
      markers: markers.slice(0, CURVE_MOST_MARKERS), kinds, pair,
      compared: [...compared].filter((version) => version > 0),
      together: this.options.is("together"), alike: this.options.is("alike"),
      neighbours: this.options.is("neighbours"),
    };
  }

  /** Show what was chosen. */
  change() {
    this.markers.show();
    this.redraw();
  }

  /** More frames of a version have come. */
  decoded(block) {
    this.series.note(block);
    const last = block.version < 0;
    if (this.timer && !last) return;
    clearTimeout(this.timer);
    const first = block.frames <= this.store.data.versions[0].positions.block;
    this.timer = setTimeout(() => {
      this.timer = 0;
      this.series.clear();
      this.redraw();
    }, last || first ? 0 : CURVE_DECODE_MS);
  }

  /** Zoom to the active gap when another one was chosen. */
  followGap() {
    const { activeGap } = this.store;
    this.gapButton.disabled = activeGap < 0;
    if (activeGap !== this.gapShown && activeGap >= 0) this.showGap();
    this.gapShown = activeGap;
    this.redraw();
  }

  /** Keep the playhead in view. */
  followFrame() {
    const { frame, playing } = this.store;
    if (!this.view.shows(frame)) {
      const place = playing ? CURVE_PLAY_PLACE : 0.5;
      const first = frame - place * this.view.span;
      this.view.set(first, first + this.view.span);
      this.redraw();
    }
    this.redrawOverlay();
  }

  /** Zoom around the playhead if it is in view, else around the middle. */
  zoom(factor) {
    const { view, store } = this;
    view.zoom(factor, view.shows(store.frame) ? store.frame : view.first + view.span / 2);
    this.redraw();
  }

  /** Move the view by a number of frames. */
  pan(frames) {
    this.view.pan(frames);
    this.redraw();
  }

  /** Show a range of frames. */
  showFrames(first, last) {
    this.view.set(first, last);
    this.redraw();
  }

  /** Show the whole clip. */
  showClip() {
    this.view.fit();
    this.redraw();
  }

  /** Show the active gap with what surrounds it. */
  showGap() {
    const gap = this.store.data.gaps[this.store.activeGap];
    if (!gap) return;
    const around = Math.max(gap.stop - gap.start, CURVE_SURROUNDINGS_S * this.store.rate);
    this.showFrames(gap.start - around, gap.stop - 1 + around);
  }

  /** Draw all at once. */
  draw() {
    const { chosen } = this;
    const some = chosen.markers.length > 0 && chosen.kinds.length > 0 && this.store.frames > 0;
    this.frame.hidden = !some;
    this.empty.hidden = some;
    this.empty.textContent = chosen.markers.length
      ? "Choose a quantity." : "Choose a gap, or add a marker.";
    this.legend.show(chosen);
    if (!some) return;
    const wide = Math.max(200, this.frame.clientWidth);
    this.laid = layCurves(wide, chosen.markers, chosen.kinds, chosen.together);
    this.frame.style.height = `${this.laid.height}px`;
    const { context, width, height } = fitCanvas(this.base);
    context.clearRect(0, 0, width, height);
    this.painter.paint(context, this.laid, this.view, chosen);
    this.overlay.setAttribute("aria-label", this.describe(chosen));
    this.drawOverlay();
  }

  /** A sentence on what the curves show, for screen readers. */
  describe({ markers, kinds }) {
    const labels = markers.map((index) => shortText(this.store.data.markers[index].label));
    const first = this.store.frameNumber(Math.ceil(this.view.first));
    const last = this.store.frameNumber(Math.floor(this.view.last));
    return `Curves of ${labels.join(", ")}: ${kinds.join(", ")}; frames ${first} to ${last}`;
  }

  /** Draw the playhead, the pointer and what is dragged; write the values there. */
  drawOverlay() {
    if (this.frame.hidden) return;
    const { context, width, height } = fitCanvas(this.overlay);
    const { hovered, drag } = this.pointer;
    const shades = colours();
    clearCanvas(context, width, height);
    const { range } = this.store;
    if (range) this.shade(context, range[0] - 0.5, range[1] + 0.5, shades.accent, 0.15);
    if (drag && drag.moved && drag.what !== "pan") {
      const ends = [drag.from.frame, drag.to.frame];
      this.shade(context, Math.min(...ends), Math.max(...ends), shades.text, 0.15);
    }
    if (hovered) this.upright(context, hovered.frame, shades.muted, [3, 3]);
    this.upright(context, this.store.frame, shades.accent, []);
    const chosen = this.chosen;
    const frame = hovered ? hovered.frame : this.store.frame;
    this.read(frame, chosen, Boolean(hovered));
    if (!this.view.shows(frame)) return;
    for (const panel of this.laid.panels) {
      const text = this.readout.short(panel, frame, chosen);
      if (text) writeAbove(context, panel, text, null);
    }
  }

  /** Write the values of a frame; while playing, only as often as they can be read. */
  read(frame, chosen, pointed) {
    const now = performance.now();
    if (this.store.playing && now - this.readAt < CURVE_READ_MS) return;
    this.readAt = now;
    this.readout.show(frame, chosen, pointed);
  }

  /** Draw an upright line at a frame through all panels. */
  upright(context, frame, colour, dash) {
    if (!this.view.shows(frame)) return;
    context.strokeStyle = colour;
    context.lineWidth = 1.5;
    context.setLineDash(dash);
    for (const panel of this.laid.panels) {
      const x = frameX(panel, this.view, frame);
      strokeLine(context, x, panel.y, x, panel.y + panel.height);
    }
    context.setLineDash([]);
  }

  /** Shade frames in all panels. */
  shade(context, first, last, colour, alpha) {
    context.globalAlpha = alpha;
    context.fillStyle = colour;
    for (const panel of this.laid.panels) {
      const left = Math.max(panel.x, frameX(panel, this.view, first));
      const right = Math.min(panel.x + panel.width, frameX(panel, this.view, last));
      if (right > left) context.fillRect(left, panel.y, right - left, panel.height);
    }
    context.globalAlpha = 1;
  }
}
