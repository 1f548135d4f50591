/* Filling and saving with decisions, on the server of a review. */

/** Name of the version that holds the fill before the last one. */
const FILL_BEFORE = "fill before";

/** The part of the panel that fills and saves. */
class DecisionReview {
  /**
   * @param {Store} store
   * @param {{entries: function(): Object[], applied: function(): Object[],
   *   filled: function(Object, Object[]), saved: function(Object[]),
   *   unsaved: function(): boolean}} actions
   */
  constructor(store, actions) {
    this.store = store;
    this.actions = actions;
    this.link = new ServerLink(location.href);
    this.bar = element("progress", { id: "fill-progress", "aria-label": "Progress of the fill" });
    this.status = element("p", { class: "decision-status", role: "status", id: "review-status" });
    this.paths = element("dl", { class: "facts", id: "saved-paths" });
    const { can } = store.data;
    this.fillButton = button("Fill again", () => this.run("fill"),
      { id: "fill", class: "main-button", hidden: !can.refill });
    this.saveButton = button("Save", () => this.run("save"),
      { id: "save", class: "main-button", hidden: !can.save });
    this.stopButton = button("Stop", () => this.link.cancel(), { id: "cancel" });
    this.beforeButton = button("Show the fill before", () => this.toggleBefore(),
      { id: "before", "aria-pressed": "false" });
    this.closeButton = button("End review", () => this.end(), { id: "end-review" });
    this.element = element("div", { class: "decision-review" }, [
      element("div", { class: "field-row" }, [this.fillButton, this.saveButton, this.stopButton,
        this.bar, this.beforeButton, this.closeButton]),
      this.status, this.paths,
    ]);
    this.show(false);
  }

  /**
   * Show what can be done.
   * @param {boolean} pending whether decisions need a fill
   */
  show(pending) {
    const { busy } = this.link;
    this.warned = false;
    this.pending = pending;
    this.fillButton.disabled = busy || !pending;
    this.saveButton.disabled = busy;
    this.closeButton.disabled = busy;
    this.stopButton.hidden = !busy;
    this.bar.hidden = !busy;
    const before = this.versionBefore();
    this.beforeButton.hidden = before < 0;
    const shown = before >= 0 && this.store.ghost === before;
    this.beforeButton.setAttribute("aria-pressed", String(shown));
    if (!busy && pending) this.tell("Some decisions need a fill.");
  }

  /**
   * Ask the server whether it can fill with decisions, and show what it cannot.
   * @param {Object[]} entries
   */
  async check(entries) {
    this.asked = entries;
    if (this.link.busy) return;
    try {
      await this.link.check(entries);
    } catch (error) {
      if (!(error instanceof ServerError)) throw error;
      if (this.asked === entries && !this.link.busy) this.tell(asSentence(error.message));
    }
  }

  /** @returns {number} the version with the fill before, or -1 */
  versionBefore() {
    return this.store.data.versions.findIndex((version) => version.before === true);
  }

  /** Show the fill before as ghost and curve, or hide it. */
  toggleBefore() {
    const version = this.versionBefore();
    const shown = this.store.ghost === version;
    const compared = new Set(this.store.compared);
    if (shown) compared.delete(version);
    else compared.add(version);
    this.store.setGhost(shown ? -1 : version);
    this.store.setCompared(compared);
    this.show(this.pending);
  }

  /**
   * Fill, or fill and save.
   * @param {string} action "fill" or "save"
   */
  async run(action) {
    if (this.link.busy) return;
    const entries = this.actions.entries();
    const doing = action === "fill" ? "Filling" : "Saving";
    this.bar.removeAttribute("value");
    const running = this.link.run(action, entries, (done, total) => {
      this.bar.max = Math.max(1, total);
      this.bar.value = done;
      this.status.textContent = `${doing}: ${formatCount(done)} of ${formatCount(total)}`;
    });
    this.show(this.pending);
    this.tell(`${doing} …`);
    try {
      const last = await running;
      if (last === null) this.finish("Stopped; nothing was changed.");
      else this.receive(last, entries);
    } catch (error) {
      if (!(error instanceof ServerError)) throw error;
      this.finish(asSentence(error.message));
    }
  }

  /** Take the result of a fill. */
  receive(last, entries) {
    const before = this.store.data;
    if (last.data) {
      const same = sameEffect(entries, this.actions.applied());
      const data = (same ? withOldBefore : withVersionBefore)(last.data, before);
      this.actions.filled(data, entries);
    }
    if (last.saved) {
      this.showPaths(last.saved);
      this.actions.saved(entries);
      this.finish("Saved.");
    } else {
      this.finish("Filled.");
    }
  }

  /** Show the paths of the files that were written. */
  showPaths(saved) {
    this.paths.replaceChildren(...Object.keys(saved).flatMap((key) => [
      element("dt", { text: key === "output" ? "Filled file" : "Decisions" }),
      element("dd", { text: safeText(saved[key]) }),
    ]));
  }

  /** Show how a run ended. */
  finish(text) {
    this.show(this.pending);
    this.tell(text);
  }

  /** End the server; decisions that are not saved need a second click. */
  async end() {
    if (this.actions.unsaved() && !this.warned) {
      this.warned = true;
      this.tell("Some decisions are not saved. End review once more ends without them.");
      return;
    }
    try {
      await this.link.close();
      this.tell("The review has ended; this page can be closed.");
      this.fillButton.hidden = true;
      this.saveButton.hidden = true;
      this.closeButton.hidden = true;
    } catch (error) {
      if (!(error instanceof ServerError)) throw error;
      this.tell(asSentence(error.message));
    }
  }

  /** Show a line; screen readers say it. */
  tell(text) {
    this.status.textContent = text;
  }
}

/**
 * Return a message as a sentence.
 * @param {string} text
 * @returns {string} with a capital letter and a dot
 */
function asSentence(text) {
  return `${text.charAt(0).toUpperCase()}${text.slice(1).replace(/\.$/, "")}.`;
}

/**
 * Add the fill shown so far to new data, as a version to compare with.
 * @param {Object} data new page data
 * @param {Object} before page data of the fill shown so far
 * @returns {Object}
 */
function withVersionBefore(data, before) {
  const shown = {
    coding: before.states.coding,
    values: before.states.values.map((runs) => runs.map((value, place) =>
      (place % 2 === 0 ? Number(value !== STATE.missing) : value))),
  };
  const version = {
    name: FILL_BEFORE, kind: "other", before: true, positions: before.versions[0].positions, shown,
    gaps: before.gaps,
  };
  return { ...data, versions: [...data.versions, version] };
}

/**
 * Say how a gap was filled before.
 * @param {Store} store
 * @param {number} index of the gap
 * @returns {string} empty if there was no other fill before
 */
function gapBeforeText(store, index) {
  const version = store.data.versions.find((one) => one.before === true);
  if (version === undefined) return "";
  const gap = store.data.gaps[index];
  const old = version.gaps.find((one) =>
    one.marker === gap.marker && one.start < gap.stop && one.stop > gap.start);
  if (old === undefined) return "; not missing before";
  const error = old.expected_mean === null ? "" :
    `, expected mean error ${formatMm(old.expected_mean)}`;
  const share = formatShare(old.filled, old.stop - old.start);
  return `; before: ${share} filled by ${old.method}${error}`;
}

/**
 * Add the fill before to new data of the same fill, if there was one.
 * @param {Object} data new page data
 * @param {Object} before page data so far
 * @returns {Object}
 */
function withOldBefore(data, before) {
  const old = before.versions.filter((version) => version.before === true);
  return { ...data, versions: [...data.versions, ...old] };
}
