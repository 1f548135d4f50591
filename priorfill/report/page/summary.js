/* What was done: file, method, options, database, versions, notes. */

/** Names of the facts that the folded summary shows. */
const SHORT_FACTS = ["Subject", "Marker set", "Method", "Database"];

class Summary {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
    store.on("data", () => this.draw());
    store.on("print", (on) => this.print(on));
    this.draw();
  }

  /** Write the facts; the folds stay as they are. */
  draw() {
    const open = this.box ? this.box.open : false;
    const { facts } = this.store.data;
    this.box = element("details", { open }, [
      element("summary", {}, [
        element("h2", { text: "What was done" }),
        element("span", { class: "muted", text: ` ${this.firstFacts()}` }),
      ]),
      element("div", {
        class: "fact-groups", tabindex: "0", role: "group", "aria-label": "What was done",
      }, facts.map((group) => this.group(group))),
    ]);
    this.root.replaceChildren(this.box);
    document.getElementById("headline").textContent = this.headline();
  }

  /** Unfold everything for paper, and fold it again. */
  print(on) {
    if (on) this.wasOpen = this.box.open;
    this.box.open = on || this.wasOpen;
  }

  /** @returns {HTMLElement} facts with one title */
  group(group) {
    const rows = group.rows.map(([name, text]) => element("tr", {}, name
      ? [element("th", { scope: "row", text: name }), element("td", { text })]
      : [element("td", { text, colspan: "2" })]));
    return element("section", { class: "fact-group" }, [
      element("h3", { text: group.title }),
      element("table", {}, [element("tbody", {}, rows)]),
    ]);
  }

  /** @returns {string} the facts that matter most, in one line */
  firstFacts() {
    const rows = this.store.data.facts.flatMap((group) => group.rows);
    return SHORT_FACTS.map((name) => rows.find((row) => row[0] === name)).filter((row) => row)
      .map(([name, text]) => shortText(`${name.toLowerCase()} ${text}`, 60)).join(" · ");
  }

  /** @returns {string} size of the clip and state of its gaps */
  headline() {
    const { store } = this;
    const { gaps, clip } = store.data;
    const lasts = store.frames / store.rate;
    const seconds = lasts < 1 ? formatSeconds(lasts, store.rate) : formatNumber(lasts);
    const before = store.data.markers.reduce((sum, m) => sum + m.missing_before, 0);
    const after = store.data.markers.reduce((sum, m) => sum + m.missing_after, 0);
    const samples = store.frames * store.markerCount;
    const warned = gaps.filter((gap) => gap.warnings.length).length;
    const parts = [
      `${countOf(store.frames, "frame")} at ${formatRate(clip.rate)} (${seconds} s)`,
      countOf(store.markerCount, "marker"),
      countOf(gaps.length, "gap"),
      `missing ${formatShare(before, samples)} before, ${formatShare(after, samples)} after`,
    ];
    if (warned) parts.push(`${countOf(warned, "gap")} with warnings`);
    return parts.join(" · ");
  }
}
