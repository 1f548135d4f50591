/* The read-out of the curves: values at the pointer or the playhead, as a table of text. */

/** Words for the states of a sample, by their codes. */
const CURVE_STATES = [
  "missing", "measured", "filled", "measured, in doubt", "replaced by a fill", "labels exchanged",
];

/** Markers up to which the read-out has rows for compared versions. */
const CURVE_READ_VERSIONS = 2;

/** The table below the controls. */
class CurveReadout {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   * @param {CurveData} series
   */
  constructor(root, store, series) {
    this.store = store;
    this.series = series;
    this.place = element("p", { class: "curves-place" });
    this.table = element("table", { class: "curves-values" });
    root.append(this.place, this.table);
  }

  /**
   * Show the values of a frame.
   * @param {number} frame
   * @param {Object} chosen markers, kinds, compared, pair
   * @param {boolean} pointed Whether the pointer is there, and not the playhead.
   */
  show(frame, chosen, pointed) {
    const seconds = formatSeconds(frame / this.store.rate, this.store.rate);
    const where = pointed ? "at the pointer" : "at the playhead";
    this.place.textContent = `Frame ${this.store.frameNumber(frame)}, ${seconds} s, ${where}:`;
    const kinds = chosen.kinds;
    const up = this.store.data.clip.up;
    const titles = ["marker", "sample", ...kinds.map((kind) => curveTitle(kind, up))];
    const head = element("tr", {}, titles.map((text) => element("th", { scope: "col", text })));
    const rows = chosen.markers.flatMap((marker) => this.rowsOf(frame, marker, chosen));
    this.table.replaceChildren(
      element("thead", {}, [head]), element("tbody", {}, rows));
    this.table.hidden = !rows.length;
  }

  /** Rows of a marker: the fill, and compared versions if there is room. */
  rowsOf(frame, marker, chosen) {
    const { markers, versions } = this.store.data;
    const state = this.store.state(frame, marker);
    const { label } = markers[marker];
    const values = chosen.kinds.map((kind) => this.text(frame, marker, kind, 0, chosen));
    const rows = [this.row(shortText(label, 40), CURVE_STATES[state], values, label)];
    if (chosen.markers.length > CURVE_READ_VERSIONS) return rows;
    for (const version of chosen.compared) {
      const { name } = versions[version];
      const values = chosen.kinds.map((kind) => ["distance", "error"].includes(kind)
        ? "" : this.text(frame, marker, kind, version, chosen));
      rows.push(this.row("", shortText(name, 40), values, name));
    }
    return rows;
  }

  /** The value of a panel with one marker, as short text. */
  short(panel, frame, chosen) {
    if (panel.markers.length !== 1) return "";
    const text = this.text(frame, panel.markers[0], panel.kind, 0, chosen);
    return text === "–" ? "" : text;
  }

  /** One row of text. */
  row(label, sample, values, title) {
    return element("tr", { title }, [
      element("th", { scope: "row", text: label }),
      element("td", { text: sample }),
      ...values.map((text) => element("td", { class: "number", text })),
    ]);
  }

  /** A value with the half width of its 90 % band. */
  text(frame, marker, kind, version, { pair }) {
    if (kind === "distance") {
      return this.number(this.series.distance(pair[0], pair[1], marker)[frame], 1);
    }
    if (kind === "error") {
      const [rms, bound] = [this.series.rms(marker)[frame], this.series.bound(marker)[frame]];
      return Number.isNaN(bound) ? "–" : `${this.number(rms, 1)}, 90 % below ${bound.toFixed(1)}`;
    }
    const value = this.number(
      this.series.values(version, marker, kind)[frame], kind === "speed" ? 0 : 1);
    if (version !== 0 || kind === "speed" || value === "–") return value;
    const half = this.series.bound(marker)[frame] * this.series.halfWidth(kind, 90);
    return Number.isNaN(half) ? value : `${value} ± ${half.toFixed(1)}`;
  }

  /** A number with a true minus sign; "–" where unknown. */
  number(value, decimals) {
    if (!Number.isFinite(value)) return "–";
    return value.toFixed(decimals).replace(/^-(?=.*[1-9])/, "−").replace(/^-/, "");
  }
}
