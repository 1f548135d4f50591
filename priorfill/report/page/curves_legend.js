/* The legend of the curves: what is in them, as text with samples of the lines. */

/** The legend below the curves. */
class CurveLegend {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   * @param {CurveData} series
   */
  constructor(root, store, series) {
    this.root = root;
    this.store = store;
    this.series = series;
  }

  /**
   * List what is drawn.
   * @param {Object} chosen markers, together, neighbours, compared, pair
   */
  show(chosen) {
    const shades = colours();
    const shared = chosen.together && chosen.markers.length > 1;
    const own = shared ? shades.text : shades.measured;
    const items = [
      this.line(own, "solid", "measured"),
      this.line(shades.filled, "dashed", this.filledText(shared)),
      ...this.bands(chosen),
      this.area(shades.muted, "gap", 2 * CURVE_GAP_ALPHA),
    ];
    if (this.hasUnfilled(chosen)) items.push(this.hatched("left missing"));
    if (this.has(chosen, STATE.doubt)) items.push(this.sign("×", shades.doubt, "in doubt"));
    if (this.has(chosen, STATE.swapped)) {
      items.push(this.sign("◆", shades.swapped, "labels exchanged"));
    }
    for (const version of chosen.compared) {
      const { versions } = this.store.data;
      const style = versionStyle(versions, version);
      const dash = style.dash.length ? (style.dash[0] < 4 ? "dotted" : "dashed") : "solid";
      items.push(this.line(style.colour, dash, shortText(versions[version].name, 40)));
    }
    if (chosen.neighbours && !chosen.together) {
      items.push(this.line(shades.muted, "solid", "neighbours, shifted"));
    }
    this.root.replaceChildren(...items);
  }

  /** What the line of a fill is: a file has its name. */
  filledText(shared) {
    const { name } = this.store.data.versions[0];
    const text = name === "filled" ? name : `filled (${shortText(name, 40)})`;
    return shared ? `${text}, on this ground` : text;
  }

  /** The two bands, or that there are none. */
  bands({ markers }) {
    const known = markers.some((marker) => this.series.bound(marker).some((mm) => mm === mm));
    const shades = colours();
    if (!known) {
      const filled = markers.some((m) => this.store.filledRuns[m].length);
      return filled ? [element("li", { text: "no band: the expected error is unknown" })] : [];
    }
    return [90, 50].map((percent) => this.area(
      percent === 90 ? shades.bound90 : shades.bound50, `${percent} % band`, 1));
  }

  /** Whether a state occurs in the chosen markers. */
  has({ markers }, state) {
    const { values } = this.store.data.states;
    return markers.some((m) => values[m].some((code, i) => i % 2 === 0 && code === state));
  }

  /** Whether something of the gaps of the chosen markers stays missing. */
  hasUnfilled({ markers }) {
    const { gaps } = this.store.data;
    return markers.some((m) => this.store.gapsOf[m].some((g) => (gaps[g].unfilled || []).length));
  }

  /** An item with a sample of a line. */
  line(colour, dash, text) {
    const sample = element("span", { class: "curves-sample-line", "aria-hidden": "true" });
    sample.style.borderTop = `2px ${dash} ${colour}`;
    return element("li", {}, [sample, text]);
  }

  /** An item with a sample of an area. */
  area(colour, text, opacity) {
    const sample = element("span", { class: "curves-sample-area", "aria-hidden": "true" });
    sample.style.background = colour;
    sample.style.opacity = opacity;
    return element("li", {}, [sample, text]);
  }

  /** An item with a sample of what stays missing. */
  hatched(text) {
    const { missing } = colours();
    const ground = `repeating-linear-gradient(135deg, ${missing} 0 1px, transparent 1px 4px)`;
    return this.area(ground, text, 1);
  }

  /** An item with a sign. */
  sign(sign, colour, text) {
    const sample = element("span", { class: "curves-sample-sign", text: sign,
      "aria-hidden": "true" });
    sample.style.color = colour;
    return element("li", {}, [sample, text]);
  }
}
