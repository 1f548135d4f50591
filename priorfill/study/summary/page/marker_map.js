/* Which marker falls off in which trials: a row for each marker, a column for each trial. */

/** Height (px) of a row of the map, and of the names of folders above it. */
const MAP_ROW_HEIGHT = 17;
const MAP_HEAD_HEIGHT = 20;

/** Markers that fit on a sheet of paper. */
const PAPER_MARKERS = 34;

/** Greatest width (px) of the labels, and their share of the whole at most. */
const MAP_LABEL_WIDTH = 110;
const MAP_LABEL_SHARE = 0.3;

/** Greatest width (px) of a column; where there are more trials than pixels, several share one. */
const MAP_COLUMN_WIDTH = 22;

/** Shares of the frames at the two ends of the colour scale, which is logarithmic. */
const SHARE_LOW = 0.002;
const SHARE_HIGH = 1;

/** @returns {number} place of a missing share on the scale, from 0 to 1 */
function sharePlace(share) {
  return Math.log(Math.max(share, SHARE_LOW) / SHARE_LOW) / Math.log(SHARE_HIGH / SHARE_LOW);
}

/** @returns {string} colour of a missing share */
function shareColour(share) {
  const step = Math.round(sharePlace(share) * (SCALE_STEPS - 1));
  return colours().scale[Math.min(SCALE_STEPS - 1, step)];
}

/** @returns {string} name of a folder cut to a width, the last part of its path if need be */
function shortFolderName(context, name, width) {
  if (context.measureText(name).width <= width) return name;
  return cutText(context, name.split("/").pop(), width);
}

class MarkerMap {
  /**
   * @param {HTMLElement} root
   * @param {StudyStore} store
   */
  constructor(root, store) {
    this.store = store;
    const { trials } = store.data;
    const words = new Intl.Collator("en", { numeric: true });
    this.order = trials.map((_, index) => index).sort((a, b) =>
      trials[a].folder - trials[b].folder || words.compare(trials[a].name, trials[b].name));
    this.draw = scheduled(() => this.paint());
    this.build(root);
    store.on("theme", () => this.draw());
    store.on("filter", () => this.draw());
    store.on("trial", () => this.draw());
    store.on("print", () => this.paint());
  }

  /** Make the elements. */
  build(root) {
    const { markers, more_markers: more } = this.store.data;
    const head = element("div", { class: "panel-head" }, [
      element("h2", { text: "Which marker falls off in which trials" })]);
    root.append(head);
    if (!markers.length) {
      root.append(element("p", { class: "muted", text: "No marker has gaps." }));
      return;
    }
    head.append(this.legend());
    this.canvas = element("canvas", {
      tabindex: "0", role: "application", "aria-label":
        "Map of markers and trials; arrow keys move, Enter shows the trial. The table of markers " +
        "below has the same figures.",
    });
    this.scroller = element("div", { class: "map-scroller" }, [this.canvas]);
    const box = element("div", { class: "map-box" }, [this.scroller]);
    this.input = new MarkerMapInput(this, box);
    root.append(box);
    if (more) {
      root.append(element("p", {
        class: "muted", text: `${countOf(more, "marker")} with fewer missing frames left out; ` +
          "the JSON file has all.",
      }));
    }
    new ResizeObserver(this.draw).observe(this.scroller);
  }

  /** @returns {HTMLElement} what the colours mean */
  legend() {
    this.scale = element("canvas", { class: "scale", "aria-hidden": "true" });
    const key = (kind, text) => element("span", { class: "key" }, [
      element("span", { class: `swatch swatch-${kind}`, "aria-hidden": "true" }), text]);
    const marks = element("span", { class: "scale-marks" });
    for (const share of [0.01, 0.1, 0.5]) {
      const mark = element("span", { text: `${100 * share} %` });
      mark.style.left = `${100 * sharePlace(share)}%`;
      marks.append(mark);
    }
    return element("div", { class: "legend" }, [
      element("span", { class: "key" }, ["missing share of the trial",
        element("span", { class: "scale-box" }, [this.scale, marks])]),
      key("none", "no gap"), key("left", "some stay missing"), key("failed", "trial failed"),
    ]);
  }

  /** Find the sizes of the map for the width that there is. */
  measure(width) {
    const { trials } = this.store.data;
    const labels = Math.min(MAP_LABEL_WIDTH, MAP_LABEL_SHARE * width);
    const room = Math.max(10, width - labels - 2);
    this.perColumn = Math.max(1, Math.ceil(trials.length / room));
    this.columns = Math.ceil(trials.length / this.perColumn);
    this.columnWidth = Math.min(MAP_COLUMN_WIDTH, room / Math.max(1, this.columns));
    this.labels = labels;
    if (this.found && this.found.perColumn === this.perColumn) return;
    this.found = { perColumn: this.perColumn, cells: this.gather() };
  }

  /** @returns {Map[]} of each column: the worst cell of each marker, with its trial */
  gather() {
    const { trials } = this.store.data;
    return Array.from({ length: this.columns }, (_, column) => {
      const worst = new Map();
      for (const index of this.trialsOf(column)) {
        for (const [marker, cell] of trials[index].cells) {
          const before = worst.get(marker);
          if (!before || cell.share > before.share) {
            worst.set(marker, { ...cell, left: cell.left || (before && before.left), index });
          }
        }
      }
      return worst;
    });
  }

  /** @returns {number[]} trials of a column */
  trialsOf(column) {
    return this.order.slice(column * this.perColumn, (column + 1) * this.perColumn);
  }

  /** Draw the map. */
  paint() {
    if (!this.canvas) return;
    this.paintScale();
    const { markers } = this.store.data;
    this.rows = isPrinting() ? Math.min(PAPER_MARKERS, markers.length) : markers.length;
    this.canvas.style.height = `${MAP_HEAD_HEIGHT + this.rows * MAP_ROW_HEIGHT}px`;
    const { context, width, height } = fitCanvas(this.canvas);
    this.measure(width);
    const theme = colours();
    context.fillStyle = theme.surface;
    context.fillRect(0, 0, width, height);
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "middle";
    context.fillStyle = theme.track;
    const wide = this.columns * this.columnWidth;
    context.fillRect(this.labels, MAP_HEAD_HEIGHT, wide, height - MAP_HEAD_HEIGHT);
    for (let column = 0; column < this.columns; column++) this.paintColumn(context, column, height);
    this.paintLabels(context);
    this.paintFolders(context, height);
    this.paintChosen(context, height);
  }

  /** Draw the scale of colours. */
  paintScale() {
    const { context, width, height } = fitCanvas(this.scale);
    const { scale } = colours();
    for (let x = 0; x < width; x++) {
      context.fillStyle = scale[Math.min(SCALE_STEPS - 1, Math.floor((x / width) * SCALE_STEPS))];
      context.fillRect(x, 0, 1, height);
    }
  }

  /** Draw the cells of a column. */
  paintColumn(context, column, height) {
    const theme = colours();
    const { trials } = this.store.data;
    const x = this.labels + column * this.columnWidth;
    const gap = this.columnWidth >= 6 ? 1 : 0;
    const wide = this.columnWidth - gap;
    const own = this.trialsOf(column);
    if (own.every((index) => trials[index].group === 0)) {
      context.fillStyle = theme.surface;
      context.fillRect(x, MAP_HEAD_HEIGHT, wide, height);
      context.fillStyle = theme.muted;
      for (let y = MAP_HEAD_HEIGHT; y < height; y += 5) context.fillRect(x, y, wide, 1);
      return;
    }
    for (const [marker, cell] of this.found.cells[column]) {
      const y = MAP_HEAD_HEIGHT + marker * MAP_ROW_HEIGHT;
      context.fillStyle = cell.share ? shareColour(cell.share) : theme.filled;
      context.fillRect(x, y, wide, MAP_ROW_HEIGHT - 1);
      if (!cell.left) continue;
      context.fillStyle = theme.missing;
      context.fillRect(x, y + MAP_ROW_HEIGHT - 5, wide, 4);
    }
  }

  /** Write the labels of the markers. */
  paintLabels(context) {
    const theme = colours();
    const { markers } = this.store.data;
    context.textAlign = "left";
    for (let marker = 0; marker < this.rows; marker++) {
      const y = MAP_HEAD_HEIGHT + marker * MAP_ROW_HEIGHT;
      if (marker === this.store.marker) {
        context.fillStyle = theme.selection;
        context.fillRect(0, y, this.labels, MAP_ROW_HEIGHT - 1);
      }
      context.fillStyle = markers[marker].absent_in ? theme.muted : theme.text;
      context.fillText(
        cutText(context, markers[marker].marker, this.labels - 10), 4, y + MAP_ROW_HEIGHT / 2);
    }
  }

  /** Write the names of folders where there is room, with lines between them. */
  paintFolders(context, height) {
    const theme = colours();
    const { trials, folders } = this.store.data;
    let begin = 0;
    while (begin < this.order.length) {
      const { folder } = trials[this.order[begin]];
      let end = begin;
      while (end < this.order.length && trials[this.order[end]].folder === folder) end += 1;
      const x = this.labels + (begin / this.perColumn) * this.columnWidth;
      const wide = ((end - begin) / this.perColumn) * this.columnWidth;
      if (wide > 3) {
        context.fillStyle = theme.muted;
        if (begin) context.fillRect(Math.round(x) - 1, 4, 1, height);
      }
      if (wide > 24) {
        context.fillStyle = theme.text;
        const name = shortFolderName(context, partName(folders[folder]), wide - 6);
        context.fillText(name, x + 3, MAP_HEAD_HEIGHT / 2);
      }
      begin = end;
    }
  }

  /** Mark the active trial, and the cell that keys move. */
  paintChosen(context, height) {
    const theme = colours();
    const place = isPrinting() ? -1 : this.order.indexOf(this.store.active);
    const mark = (column, y, high) => {
      context.strokeStyle = theme.accent;
      context.lineWidth = 2;
      context.strokeRect(this.labels + column * this.columnWidth - 1, y,
        this.columnWidth + 1, high);
    };
    if (place >= 0) {
      mark(Math.floor(place / this.perColumn), MAP_HEAD_HEIGHT, height - MAP_HEAD_HEIGHT - 1);
    }
    const { focused, row, column } = this.input;
    if (focused) mark(column, MAP_HEAD_HEIGHT + row * MAP_ROW_HEIGHT, MAP_ROW_HEIGHT);
  }

  /** @returns {string} a cell in words */
  cellText(row, column) {
    const { trials, markers } = this.store.data;
    const cell = this.found.cells[column].get(row);
    const own = this.trialsOf(column);
    const { marker } = markers[row];
    if (!cell) {
      const where = own.length > 1 ? countOf(own.length, "trial") : trials[own[0]].name;
      const failed = own.every((index) => trials[index].group === 0);
      return `${marker}, ${where}: ${failed ? "failed" : "no gap"}`;
    }
    const share = cell.share ? `${shareText(cell.share)} missing` : countOf(cell.frames, "frame");
    const left = cell.left ? ", some stay missing" : "";
    const more = own.length > 1 ? ` (the worst of ${own.length} trials)` : "";
    return `${marker}, ${trials[cell.index].name}: ${share}${left}${more}`;
  }
}
