/* All gaps: markers down, frames across, filled frames in the colour of their expected error. */

/** Height (px) of a row with its name. */
const ROW_HEIGHT = 16;

/** Height (px) of the time axis. */
const AXIS_HEIGHT = 32;

/** Expected errors (mm) at which the legend has a number. */
const LEGEND_MM = [0.5, 1, 2, 5, 10, 20, 50];

/** Height (px) of the time axis and of what surrounds the rows. */
const FRAME_HEIGHT = AXIS_HEIGHT + 5;

/** Height (px) of a row on paper, and rows on a page. */
const PAPER_ROW_HEIGHT = 12;
const PAPER_ROWS = 50;

/** Height (px) of the timeline where the style sheet states none. */
const USUAL_HEIGHT = 200;

class Timeline {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.store = store;
    this.view = { from: 0, to: Math.max(1, store.frames) };
    this.image = document.createElement("canvas");
    this.imageKey = "";
    this.themes = 0;
    this.redraw = scheduled(() => this.draw());
    this.input = new TimelineInput(this);
    this.marks = new TimelineMarks(this);
    this.build(root);
    this.arrange();
    this.listen();
  }

  /** Make the elements. */
  build(root) {
    const tick = (text, name) => {
      const on = { change: () => this.arrange() };
      const box = element("input", { type: "checkbox", name, on });
      return [box, element("label", {}, [box, ` ${text}`])];
    };
    const [all, allLabel] = tick("All markers", "all-markers");
    const [fit, fitLabel] = tick("Fit rows", "fit-rows");
    this.all = all;
    this.fitRows = fit;
    this.legend = element("div", { class: "legend" });
    this.canvas = element("canvas", {
      tabindex: "0", role: "application",
      "aria-label": "Timeline of all gaps. Up and down: marker. Enter: gap. " +
        "Plus and minus: zoom. 0: all frames.",
    });
    this.spacer = element("div", { class: "timeline-rows" }, [this.canvas]);
    this.scroller = element("div", { class: "timeline-scroller" }, [this.spacer]);
    this.paper = element("div", { class: "timeline-paper" });
    this.tip = element("div", { class: "tip", role: "tooltip", hidden: true });
    root.append(
      element("div", { class: "panel-head" }, [
        element("h2", { text: "Timeline" }), this.legend, allLabel, fitLabel,
        this.input.buttons(),
      ]),
      element("div", { class: "timeline-box" }, [this.scroller, this.tip]), this.paper);
    this.drawLegend();
  }

  /** React to the store and to the user. */
  listen() {
    const { store } = this;
    for (const event of ["frame", "range", "markers", "decisions"]) store.on(event, this.redraw);
    store.on("decoded", ({ version }) => {
      if (version <= 0) this.imageKey = "";
      if (this.store.errors !== this.errors) this.drawLegend();
      this.redraw();
    });
    store.on("data", () => {
      this.drawLegend();
      this.view.to = Math.min(this.view.to, store.frames);
      this.arrange();
    });
    store.on("gap", () => this.showGap());
    store.on("play", this.redraw);
    store.on("theme", () => {
      this.themes++;
      this.drawLegend();
      this.redraw();
    });
    store.on("print", (on) => this.print(on));
    new ResizeObserver(this.redraw).observe(this.scroller);
    this.scroller.addEventListener("scroll", this.redraw);
    this.input.listen(this.canvas);
  }

  /** Choose the rows, and their height. */
  arrange() {
    const { data } = this.store;
    const rows = [];
    const grouped = data.subjects.length > 1 || (data.subjects[0] || "") !== "";
    data.subjects.forEach((name, subject) => {
      const markers = data.markers.map((m, i) => i).filter((i) =>
        data.markers[i].subject === subject && (this.all.checked || this.hasGap(i)));
      if (grouped && markers.length) rows.push({ subject: name || "Subject without a name" });
      for (const marker of markers) rows.push({ marker });
    });
    this.rows = rows;
    this.rowOf = new Map(rows.map((row, i) => [row.marker, i]));
    this.imageKey = "";
    const room = parseFloat(getComputedStyle(this.scroller).maxHeight) || USUAL_HEIGHT;
    this.rowHeight = this.fitRows.checked
      ? Math.max(1, Math.min(ROW_HEIGHT, (room - FRAME_HEIGHT) / Math.max(1, rows.length)))
      : ROW_HEIGHT;
    const total = AXIS_HEIGHT + Math.ceil(this.rowHeight * Math.max(1, rows.length)) + 2;
    this.spacer.style.height = `${total}px`;
    this.redraw();
  }

  /** @returns {boolean} whether a marker has a gap, or samples that are not as measured */
  hasGap(marker) {
    const runs = this.store.data.states.values[marker];
    return this.store.gapsOf[marker].length > 0 || runs.length > 2 || runs[0] !== STATE.measured;
  }

  /** Widths (px) of the column of names and of the frames. */
  columns() {
    const width = this.canvas.clientWidth || this.paper.clientWidth;
    const names = width < 500 ? 110 : Math.min(230, Math.round(width * 0.17));
    return { names, width: Math.max(10, width - names - 6) };
  }

  /** Draw at once. */
  draw() {
    const high = this.scroller.clientHeight;
    if (!this.scroller.clientWidth || !high) return;
    this.canvas.style.height = `${high}px`;
    const { context, width, height, ratio } = fitCanvas(this.canvas);
    if (this.store.playing) this.input.follow();
    this.drawRows(ratio, width, height);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.drawImage(this.image, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.marks.draw(context, height);
  }

  /** Draw rows and axis into the stored image, unless it shows them already. */
  drawRows(ratio, width, height) {
    const { store, view } = this;
    const scroll = this.scroller.scrollTop;
    const key = [view.from, view.to, scroll, width, height, ratio, this.themes, this.rowHeight,
      this.rows.length, store.generation, store.markers.join()].join("|");
    if (key === this.imageKey) return;
    this.imageKey = key;
    this.image.width = this.canvas.width;
    this.image.height = this.canvas.height;
    const context = this.image.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const { names, width: plot } = this.columns();
    const first = Math.max(0, Math.floor(scroll / this.rowHeight));
    const count = Math.ceil(height / this.rowHeight) + 1;
    this.paintRows(context, first, count, -scroll);
    if (!this.rows.length) {
      context.fillStyle = colours().muted;
      context.font = "12px system-ui, sans-serif";
      context.fillText("No marker has a gap.", names + 12, AXIS_HEIGHT + 12);
    }
    paintAxis(context, store, { left: names, width: plot, height: AXIS_HEIGHT, ...view });
  }

  /** Draw some rows; `shift` (px) moves them down. */
  paintRows(context, first, count, shift) {
    const { store } = this;
    const { names, width } = this.columns();
    const stripes = stripePattern(context);
    const chosen = new Set(store.markers);
    this.rows.slice(first, first + count).forEach((row, i) => {
      const top = AXIS_HEIGHT + (first + i) * this.rowHeight + shift;
      const size = { left: names, top, width, height: this.rowHeight };
      const box = { ...size, ...this.view, names, stripes };
      if (row.marker === undefined) this.drawSubject(context, row.subject, box);
      else {
        paintMarkerRow(context, store, row.marker, box);
        paintName(context, store, row.marker, { ...box, chosen: chosen.has(row.marker) });
      }
    });
  }

  /** Draw all rows for paper, some to a page, all frames; afterwards take them away. */
  print(on) {
    this.paper.replaceChildren();
    if (!on) return;
    const { view, rowHeight } = this;
    this.view = { from: 0, to: Math.max(1, this.store.frames) };
    this.rowHeight = PAPER_ROW_HEIGHT;
    for (let first = 0; first < this.rows.length; first += PAPER_ROWS) {
      const count = Math.min(PAPER_ROWS, this.rows.length - first);
      const canvas = element("canvas");
      this.paper.append(canvas);
      canvas.style.height = `${AXIS_HEIGHT + count * PAPER_ROW_HEIGHT}px`;
      const { context } = fitCanvas(canvas);
      const { names, width } = this.columns();
      this.paintRows(context, first, count, -first * PAPER_ROW_HEIGHT);
      paintAxis(context, this.store, { left: names, width, height: AXIS_HEIGHT, ...this.view });
    }
    this.view = view;
    this.rowHeight = rowHeight;
  }

  /** Draw the name of a subject above its markers. */
  drawSubject(context, text, box) {
    if (box.height < LEAST_NAMED_ROW) return;
    context.fillStyle = colours().text;
    context.font = "bold 12px system-ui, sans-serif";
    context.textBaseline = "middle";
    context.textAlign = "left";
    context.fillText(cutText(context, text, box.names + 200), 6, box.top + box.height / 2);
  }

  /** @returns {number} place (px) of a frame on the canvas */
  xOf(frame) {
    const { names, width } = this.columns();
    return names + ((frame - this.view.from) / (this.view.to - this.view.from)) * width;
  }

  /** @returns {{frame: number, row: Object|null, near: number}} what is at a point (px); `near`
   *   is the number of frames within which a click chooses a gap */
  at(x, y) {
    const { names, width } = this.columns();
    const per = (this.view.to - this.view.from) / width;
    const frame = Math.floor(this.view.from + (x - names) * per);
    const index = Math.floor((y - AXIS_HEIGHT + this.scroller.scrollTop) / this.rowHeight);
    const row = y < AXIS_HEIGHT ? null : this.rows[index] || null;
    const inside = Math.max(0, Math.min(this.store.frames - 1, frame));
    return { frame: inside, row, near: Math.ceil(NEAR * per), names: x < names };
  }

  /** Scroll the row and the frames of the active gap into view. */
  showGap() {
    const { store, scroller } = this;
    const gap = store.data.gaps[store.activeGap];
    const row = gap && this.rowOf.get(gap.marker);
    if (row !== undefined) {
      const top = row * this.rowHeight;
      const room = scroller.clientHeight - AXIS_HEIGHT;
      if (top < scroller.scrollTop) scroller.scrollTop = top;
      else if (top + this.rowHeight > scroller.scrollTop + room) {
        scroller.scrollTop = top + this.rowHeight - room;
      }
      const { from, to } = this.view;
      if (gap.stop < from || gap.start > to) this.input.centre((gap.start + gap.stop) / 2);
    }
    this.redraw();
  }

  /** Show the meaning of the colours, in mm. */
  drawLegend() {
    const shades = colours();
    const bar = element("span", { class: "scale", title: "Expected rms error of filled frames" });
    bar.style.background = `linear-gradient(to right, ${shades.scale.join(",")})`;
    const marks = element("span", { class: "scale-marks", "aria-hidden": "true" });
    for (const mm of LEGEND_MM) {
      const mark = element("span", { text: String(mm) });
      mark.style.left = `${(100 * errorStep(mm)) / (SCALE_STEPS - 1)}%`;
      marks.append(mark);
    }
    const whole = element("span", {
      class: "scale-box", role: "img",
      "aria-label": `Expected rms error by colour: ${SCALE_LOW_MM} to ${SCALE_HIGH_MM} mm`,
    }, [bar, marks]);
    const key = (name, text) => element("span", { class: "key" }, [
      element("span", { class: `swatch swatch-${name}` }), text,
    ]);
    const states = new Set();
    for (const runs of this.store.data.states.values) {
      for (let r = 0; r < runs.length; r += 2) states.add(Number(runs[r]));
    }
    this.errors = this.store.errors; // known once the first frames are decoded
    const unknown = this.errors.rms.includes(UNKNOWN_ERROR);
    const keys = [["measured", "measured"], ["missing", "missing"], ["doubt", "in doubt"],
      ["replaced", "replaced"], ["swapped", "labels exchanged"]];
    this.legend.replaceChildren(
      element("span", { text: "expected rms error (mm)" }), whole,
      ...keys.filter(([name]) => states.has(STATE[name])).map(([name, text]) => key(name, text)),
      ...(unknown ? [key("filled", "filled, error unknown")] : []));
  }
}
