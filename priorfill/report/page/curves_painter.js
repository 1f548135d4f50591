/* Paints the panels of the curves, from the ground to the titles. */

/** Opacity of bands and lines where markers share a panel, and of neighbours. */
const CURVE_SHARED_ALPHA = 0.55;
const CURVE_NEIGHBOUR_ALPHA = 0.5;

/** CSS pixels: width of a panel from which its title names the versions of a distance. */
const CURVE_WIDE_PANEL = 320;

/** Neighbours of a marker that are drawn at most. */
const CURVE_NEIGHBOURS = 8;

/** CSS pixels: width of the ground in the colour of fills below a filled line. */
const CURVE_CASING = 5;

/** Paints panels on a canvas. */
class CurvePainter {
  /**
   * @param {Store} store
   * @param {CurveData} series
   */
  constructor(store, series) {
    this.store = store;
    this.series = series;
  }

  /**
   * Paint all panels.
   * @param {CanvasRenderingContext2D} context In CSS pixels.
   * @param {Object} laid What `layCurves` returned.
   * @param {CurveView} view
   * @param {Object} chosen markers, together, neighbours, alike (one scale for x, y, z),
   *   compared (versions), pair (two versions, or null)
   */
  paint(context, laid, view, chosen) {
    const { clip } = this.store.data;
    for (const panel of laid.panels) {
      panel.lines = this.linesOf(panel, chosen);
      setPanelRange(panel, this.rangeOf(panel, view));
    }
    if (chosen.alike) this.makeAlike(laid.panels);
    context.textBaseline = "alphabetic";
    for (const panel of laid.panels) {
      drawPanelGrid(context, panel, view, clip);
      context.save();
      context.beginPath();
      context.rect(panel.x, panel.y, panel.width, panel.height);
      context.clip();
      this.paintGaps(context, panel, view);
      this.paintBands(context, panel, view);
      for (const line of panel.lines) this.paintLine(context, panel, view, line);
      if (!["distance", "error"].includes(panel.kind)) this.paintMarks(context, panel, view);
      context.restore();
      this.paintTitle(context, panel, chosen);
    }
    for (const head of laid.heads) this.paintHead(context, head, chosen);
    for (const axis of laid.axes) drawTimeAxis(context, axis, view, clip);
  }

  /** The title of a panel. */
  titleOf(panel, { pair }) {
    const text = curveTitle(panel.kind, this.store.data.clip.up);
    if ((this.series.known.get(0) || 0) < this.store.frames) return `${text}: loading`;
    if (panel.empty) return `${text}: none`;
    if (panel.kind !== "distance") return text;
    if (panel.width < CURVE_WIDE_PANEL) return text;
    const [one, other] = pair.map((v) => shortText(this.store.data.versions[v].name, 24));
    return `${text}, ${one} to ${other}`;
  }

  /**
   * The lines of a panel, the lowest first.
   * @returns {Object[]} series, style, marker, place, and what else the painting needs
   */
  linesOf(panel, chosen) {
    const lines = [];
    panel.markers.forEach((marker) => {
      const place = chosen.markers.indexOf(marker);
      const own = chosen.together && panel.markers.length > 1 ? markerStyle(place) : null;
      if (panel.kind === "distance" || panel.kind === "error") {
        lines.push(this.errorLine(marker, place, own, panel.kind, chosen));
        return;
      }
      if (chosen.neighbours && !chosen.together && panel.kind !== "speed") {
        lines.push(...this.neighbourLines(marker, panel.kind));
      }
      lines.push(...this.markerLines(marker, place, own, panel.kind, chosen));
    });
    const order = ["neighbour", "version", "filled", "measured", "error"];
    return lines.sort((a, b) => order.indexOf(a.role) - order.indexOf(b.role));
  }

  /** The lines of a marker: other versions, what is filled, what is measured. */
  markerLines(marker, place, own, kind, { compared }) {
    const { versions } = this.store.data;
    const shades = colours();
    const lines = [...compared].filter((v) => v > 0).map((version) => ({
      role: "version", marker, place, own: null,
      series: this.series.values(version, marker, kind),
      style: { ...versionStyle(versions, version), alpha: own ? CURVE_SHARED_ALPHA : 1 },
    }));
    lines.push({
      role: "filled", marker, place, own,
      series: this.series.part(marker, kind, true),
      bound: kind === "speed" ? null : this.series.bound(marker),
      style: own ? { colour: own.colour, dash: CURVE_FILL_DASH, width: 1.8 }
        : versionStyle(versions, 0),
    });
    lines.push({
      role: "measured", marker, place, own,
      series: this.series.part(marker, kind, false),
      style: { colour: own ? own.colour : shades.measured, dash: [], width: 1.5 },
    });
    return lines;
  }

  /** The line of a distance between versions, or of the expected rms error; its band is at 0. */
  errorLine(marker, place, own, kind, { pair }) {
    const distance = kind === "distance";
    const colour = own ? own.colour : colours()[distance ? "accent" : "filled"];
    return {
      role: "error", marker, place, own,
      series: distance ? this.series.distance(...pair, marker) : this.series.rms(marker),
      bound: distance ? this.boundOf(marker, pair) : this.series.bound(marker),
      style: { colour, dash: [], width: 1.5 },
    };
  }

  /** Lines of the markers of the same segment. */
  neighbourLines(marker, kind) {
    return this.series.neighbours(marker, CURVE_NEIGHBOURS).map((other) => ({
      role: "neighbour", marker, other, place: -1, own: null,
      series: this.series.values(0, other, kind),
      style: { colour: colours().muted, dash: [], width: 1, alpha: CURVE_NEIGHBOUR_ALPHA },
    }));
  }

  /** Bounds of the distance between two versions, where one is the truth and the other the fill. */
  boundOf(marker, pair) {
    const kinds = pair.map((version) => this.store.data.versions[version].kind);
    return kinds.includes("truth") && pair.includes(0) ? this.series.bound(marker) : null;
  }

  /** The range of the values of a panel in view; neighbours are shifted to the marker's middle. */
  rangeOf(panel, view) {
    const range = { low: Infinity, high: -Infinity };
    for (const line of panel.lines) {
      if (line.role === "neighbour") continue;
      const spread = line.role === "filled" ? line.bound : null;
      widenRange(line.series, view, range, spread, this.series.halfWidth(panel.kind, 90));
      if (line.role === "error" && line.bound) widenRange(line.bound, view, range);
    }
    for (const line of panel.lines) {
      if (line.role === "neighbour") this.shiftNeighbour(line, panel, view, range);
    }
    return range;
  }

  /** Shift a neighbour so that its mean over the frames in view is that of the marker. */
  shiftNeighbour(line, panel, view, range) {
    const own = this.series.values(0, line.marker, panel.kind);
    const [first, stop] = framesInView(view);
    let sum = 0;
    let count = 0;
    for (let frame = first; frame < stop; frame += 1) {
      const away = own[frame] - line.series[frame];
      if (away !== away) continue; // NaN
      sum += away;
      count += 1;
    }
    line.series = line.series.map((value) => value + (count ? sum / count : NaN));
    widenRange(line.series, view, range);
  }

  /** Give x, y and z of the same markers the same number of millimetres on a pixel. */
  makeAlike(panels) {
    const groups = new Set(panels.map((panel) => panel.group));
    for (const group of groups) {
      const axes = panels.filter((p) => p.group === group && "xyz".includes(p.kind) && !p.empty);
      const most = Math.max(...axes.map((panel) => panel.high - panel.low));
      for (const panel of axes) {
        const middle = (panel.low + panel.high) / 2;
        panel.low = middle - most / 2;
        panel.high = middle + most / 2;
      }
    }
  }

  /** Shade the gaps of the markers of a panel, common frames once, and mark their edges. */
  paintGaps(context, panel, view) {
    const indices = panel.markers.flatMap((marker) => this.store.gapsOf[marker]);
    const gaps = indices.map((index) => this.store.data.gaps[index])
      .sort((one, other) => one.start - other.start);
    let shaded = 0;
    for (const gap of gaps) {
      shadeGap(context, panel, view, Math.max(gap.start, shaded), gap.stop);
      shaded = Math.max(shaded, gap.stop);
    }
    const active = this.store.data.gaps[this.store.activeGap];
    for (const gap of gaps) edgeGap(context, panel, view, gap, gap === active);
  }

  /** Draw the bands of fills, the wide ones first. */
  paintBands(context, panel, view) {
    const shades = colours();
    for (const [percent, colour] of [[90, shades.bound90], [50, shades.bound50]]) {
      for (const line of panel.lines) {
        if (!line.bound) continue;
        const factor = this.series.halfWidth(panel.kind, percent);
        context.globalAlpha = line.own ? CURVE_SHARED_ALPHA : 1;
        const middle = line.role === "error" ? null : line.series;
        drawBand(context, panel, view, middle, line.bound, { factor, colour });
        context.globalAlpha = 1;
      }
    }
  }

  /** Draw a line, on a ground in the colour of fills if it is a fill in a marker's colour. */
  paintLine(context, panel, view, line) {
    if (line.role === "filled" && line.own) {
      const ground = { colour: colours().filled, width: CURVE_CASING, alpha: CURVE_SHARED_ALPHA };
      drawSeries(context, panel, view, line.series, ground);
    }
    drawSeries(context, panel, view, line.series, line.style);
    if (line.own) {
      drawSymbols(context, panel, view, line.series, line.own, 17 * line.place);
    }
  }

  /** Mark samples in doubt, and those whose labels were exchanged. */
  paintMarks(context, panel, view) {
    for (const marker of panel.markers) {
      const series = this.series.values(0, marker, panel.kind);
      for (const [state, symbol, colour] of [
        [STATE.doubt, "cross", colours().doubt],
        [STATE.swapped, "diamond", colours().swapped],
      ]) {
        const stretches = this.series.stretches(marker, state);
        drawMarks(context, panel, view, series, { stretches, symbol, colour });
      }
    }
  }

  /** Write the title above a panel, after the marker if it is the first one of a column. */
  paintTitle(context, panel, chosen) {
    const title = this.titleOf(panel, chosen);
    let { x } = panel;
    if (panel.label >= 0) {
      context.font = CURVE_BOLD;
      context.fillStyle = colours().text;
      context.textAlign = "left";
      const { label } = this.store.data.markers[panel.label];
      const text = cutText(context, label, panel.width / 2);
      context.fillText(text, x, panel.y - 4);
      x += context.measureText(text).width + 12;
    }
    writeAbove(context, panel, title, x);
  }

  /** Write all markers with their symbols above shared panels. */
  paintHead(context, head, { markers }) {
    context.font = CURVE_BOLD;
    context.textAlign = "left";
    const room = head.width / markers.length;
    markers.forEach((marker, place) => {
      const own = markerStyle(place);
      const x = head.x + place * room;
      const y = head.y + 14;
      context.fillStyle = context.strokeStyle = own.colour;
      context.lineWidth = 1.5;
      drawSymbol(context, own.symbol, x + 5, y - 4, 4);
      context.fillStyle = colours().text;
      const { label } = this.store.data.markers[marker];
      context.fillText(cutText(context, label, room - 24), x + 14, y);
    });
  }
}
