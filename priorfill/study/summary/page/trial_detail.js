/* What is known about the active trial. */

/** Markers of a trial that are listed. */
const MOST_TRIAL_MARKERS = 10;

class TrialDetail {
  /**
   * @param {HTMLElement} root
   * @param {StudyStore} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
    store.on("trial", () => this.draw());
    this.draw();
  }

  /** Show the active trial. */
  draw() {
    const trial = this.store.data.trials[this.store.active];
    if (!trial) {
      this.root.replaceChildren(element("p", {
        class: "muted", text: "Choose a trial in the table to see the reasons." }));
      return;
    }
    this.root.replaceChildren(
      element("div", { class: "panel-head" }, [
        element("h2", { text: trial.name }), groupBadge(trial.group),
        element("span", { text: trial.group ? trial.status : "" }), this.links(trial)]),
      element("div", { class: "trial-columns" }, [
        ...this.texts("Why", trial.reasons),
        this.facts(trial),
        ...this.markers(trial),
        ...this.texts("Left alone", trial.alone.map(([samples, reason]) =>
          `${countOf(samples, "sample")}: ${reason}`)),
        ...this.texts("Notes", trial.notes),
        ...this.texts("Warnings", this.warnings(trial)),
      ]));
  }

  /** @returns {HTMLElement} links to the files of a trial */
  links(trial) {
    const names = { report: "Open the report", output: "Filled file", uncertainty:
      "Expected errors", source: "Recording" };
    return element("span", { class: "links" }, Object.keys(names)
      .filter((name) => trial.links[name])
      .map((name) => linked(names[name], trial.links[name])));
  }

  /** @returns {HTMLElement[]} a list with a heading, or nothing */
  texts(title, texts) {
    if (!texts.length) return [];
    return [element("section", {}, [
      element("h3", { text: title }),
      element("ul", {}, texts.map((text) => element("li", { text }))),
    ])];
  }

  /** @returns {HTMLElement} the figures of a trial */
  facts(trial) {
    const rows = [
      ["Subject", trial.subjects.map((one) => this.store.data.subjects[one].name).join(", ")],
      ["Missing", trial.missing ? `${countOf(trial.missing, "sample")} in ` +
        `${countOf(trial.gaps, "gap")}, ${shareText(trial.share)} of all` : ""],
      ["Filled", trial.missing ? `${trialFilled(trial)}, expected mean error ` +
        `${formatMm(trial.error)}` : ""],
      ["Longest gap", this.gap(trial.longest)],
      ["Worst gap", this.gap(trial.worst)],
      ["Artefacts", trial.artefacts ? formatCount(trial.artefacts) : ""],
      ["Method", trial.method],
      ["Time", formatTime(trial.seconds)],
    ].filter(([, text]) => text);
    return element("dl", { class: "facts" }, rows.flatMap(([name, text]) => [
      element("dt", { text: name }), element("dd", { text })]));
  }

  /** @returns {string} a gap in words */
  gap(gap) {
    if (!gap) return "";
    const [marker, first, last, seconds, error] = gap;
    const known = error === null ? "" : `, expected ${formatMm(error)}`;
    return `${marker}, frames ${frameRange(first, last)} (${seconds.toFixed(2)} s)${known}`;
  }

  /** @returns {HTMLElement[]} the markers with most missing frames */
  markers(trial) {
    const cells = [...trial.cells].sort((a, b) => b[1].frames - a[1].frames);
    if (!cells.length) return [];
    const names = cells.slice(0, MOST_TRIAL_MARKERS).map(([marker, cell]) =>
      `${this.store.data.markers[marker].marker} ` +
      `${cell.share ? shareText(cell.share) : countOf(cell.frames, "frame")}`);
    const more = cells.length - names.length;
    const text = names.join(", ") + (more > 0 ? ` and ${more} more` : "");
    return [element("section", {}, [
      element("h3", { text: "Markers with gaps" }), element("p", { text })])];
  }

  /** @returns {string[]} warnings; the report has all */
  warnings(trial) {
    const more = trial.warnings - trial.warned.length;
    return more > 0 ? [...trial.warned, `and ${formatCount(more)} more`] : trial.warned;
  }
}
