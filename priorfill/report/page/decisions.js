/* The panel of decisions: accept, refuse or re-fill gaps; undo; fill, save, export, import. */

class Decisions {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
    this.list = new DecisionList(store.data, store.data.decisions || []);
    this.kept = store.data.unsaved === true ? "" : JSON.stringify(this.list.entries);
    store.appliedDecisions = this.list.entries;
    this.form = null;
    this.rows = new DecisionRows(store, {
      remove: (index) => this.remove(index), note: (index, note) => this.setNote(index, note),
    }, store.data.mode === "review" ? "needs a fill" : "not in this fill");
    this.files = new DecisionFiles(store, {
      take: (entries, label) => this.replace(entries, label), exported: () => this.keep(),
    });
    const { mode, can } = store.data;
    this.review = mode === "review" && can && (can.refill || can.save) ?
      new DecisionReview(store, this.reviewActions()) : null;
    this.build();
    store.on("gap", () => this.showTarget());
    store.on("data", () => this.showTarget());
    window.addEventListener("beforeunload", (event) => {
      if (this.unsaved()) event.preventDefault();
    });
    store.setDecisions(this.list.entries);
    this.draw();
  }

  /** @returns {Object} what the part that fills and saves needs */
  reviewActions() {
    return {
      entries: () => this.list.entries,
      applied: () => this.store.appliedDecisions,
      filled: (data, entries) => this.takeFill(data, entries),
      saved: (entries) => {
        this.kept = JSON.stringify(entries);
      },
      unsaved: () => this.unsaved(),
    };
  }

  /** Make the panel. */
  build() {
    this.target = element("p", { id: "decision-target" });
    this.place = element("div", { id: "decision-form" });
    this.gapButtons = [
      button("Accept", () => this.accept(), { id: "accept", title: "Accept (a)" }),
      button("Refuse", () => this.refuse(), { id: "refuse", title: "Leave missing (x)" }),
      button("Re-fill …", () => this.openRefill(),
        { id: "refill", title: "Another method, other donors or sources (f)" }),
    ];
    this.undoButton = button("Undo", () => this.undo(), { id: "undo", title: "Undo (z)" });
    this.redoButton = button("Redo", () => this.redo(), { id: "redo", title: "Redo (y)" });
    this.root.append(
      element("h2", { text: "Decisions" }),
      this.target,
      element("div", { class: "field-row decision-buttons" }, [
        ...this.gapButtons,
        button("Samples wrong …", () => this.openSamples(DO_MISSING), { id: "mark-wrong" }),
        button("Exchange labels …", () => this.openSamples(DO_SWAP), { id: "swap" }),
        this.undoButton, this.redoButton,
      ]),
      this.place, this.rows.element,
      ...(this.review ? [this.review.element] : []), this.files.element);
  }

  /** @returns {number[]} the gaps that a decision is about: the chosen ones, or the active one */
  targets() {
    const { chosenGaps, activeGap } = this.store;
    if (chosenGaps.size > 0) return [...chosenGaps].sort((a, b) => a - b);
    return activeGap >= 0 ? [activeGap] : [];
  }

  /** Accept the gaps. */
  accept() {
    this.decide(this.targets(), { do: DO_ACCEPT }, "accepted");
  }

  /** Leave the gaps missing. */
  refuse() {
    this.decide(this.targets(), { do: DO_LEAVE }, "refused");
  }

  /**
   * Decide on gaps over their own frames.
   * @param {number[]} targets indices
   * @param {Object} model what is decided
   * @param {string} word for the announcement
   */
  decide(targets, model, word) {
    if (targets.length === 0) {
      announce("No gap is chosen");
      return;
    }
    const gaps = targets.map((index) => this.store.data.gaps[index]);
    this.add(entriesForGaps(this.store, gaps, model), `${gapsText(this.store, targets)} ${word}`);
  }

  /**
   * Add decisions.
   * @param {Object[]} entries
   * @param {string} label what was decided
   */
  add(entries, label) {
    if (this.list.add(entries, label)) {
      this.changed();
      announce(label);
    } else {
      announce("Decided so already");
    }
  }

  /** Open the form that fills the gaps by another method. */
  openRefill() {
    const targets = this.targets();
    if (targets.length === 0) {
      announce("No gap is chosen");
      return;
    }
    const label = `${gapsText(this.store, targets)} to be filled again`;
    this.open((done) => new RefillForm(this.store, targets, done), label);
  }

  /** Open the form for measured samples. */
  openSamples(action) {
    const label = action === DO_SWAP ? "labels exchanged" : "samples marked as wrong";
    this.open((done) => new SamplesForm(this.store, action, done), label);
  }

  /**
   * Open a form in the place of the one that is open.
   * @param {function} make makes it, with the function to call when it is done
   * @param {string} label what its decisions do
   */
  open(make, label) {
    const from = document.activeElement;
    const { form } = make((entries) => {
      this.place.replaceChildren();
      if (entries !== null) this.add(entries, label);
      if (from && from.isConnected) from.focus();
    });
    this.place.replaceChildren(form.element);
    form.focus();
    form.element.scrollIntoView({ block: "nearest" });
  }

  /** Undo the last step. */
  undo() {
    const label = this.list.undo();
    this.changed();
    announce(label === "" ? "Nothing to undo" : `Undone: ${label}`);
  }

  /** Repeat the step undone last. */
  redo() {
    const label = this.list.redo();
    this.changed();
    announce(label === "" ? "Nothing to redo" : `Repeated: ${label}`);
  }

  /** Delete a decision. */
  remove(index) {
    this.list.remove(index);
    this.changed();
    announce("Decision deleted");
    const next = this.rows.list.children[Math.min(index, this.list.entries.length - 1)];
    if (next) next.querySelector("button").focus();
    else this.undoButton.focus();
  }

  /** Replace the note of a decision. */
  setNote(index, note) {
    if ((this.list.entries[index].note || "") === note) {
      this.draw();
      return;
    }
    this.list.setNote(index, note);
    this.changed();
    const row = this.rows.list.children[index];
    if (row) row.querySelector("button").focus();
  }

  /** Replace the whole list; the step can be undone. */
  replace(entries, label) {
    this.list.change(entries, label);
    this.changed();
    this.keep();
  }

  /** Note that the list is in a file. */
  keep() {
    if (this.review === null) this.kept = JSON.stringify(this.list.entries);
  }

  /** @returns {boolean} whether decisions are lost when the page is left */
  unsaved() {
    return JSON.stringify(this.list.entries) !== this.kept;
  }

  /** Take the data of a fill with decisions. */
  takeFill(data, entries) {
    this.list.data = data;
    this.store.appliedDecisions = entries;
    const decoding = this.store.setData(data);
    decoding.catch((error) => showProblem(`Cannot show the positions: ${error.message}.`));
    this.changed();
  }

  /** Tell all views that the list has changed. */
  changed() {
    const { entries } = this.list;
    this.store.setDecisions(entries);
    this.draw();
    if (this.review) this.review.check(entries);
  }

  /** Show what the buttons act on. */
  showTarget() {
    const targets = this.targets();
    const chosen = this.store.chosenGaps.size > 0;
    this.target.textContent = targets.length === 0 ? "No gap is chosen." :
      `${chosen ? "Chosen" : "Gap shown"}: ${gapsText(this.store, targets)}`;
    if (targets.length === 1) this.target.textContent += gapBeforeText(this.store, targets[0]);
    for (const one of this.gapButtons) one.disabled = targets.length === 0;
  }

  /** Draw at once. */
  draw() {
    const { entries } = this.list;
    const { appliedDecisions } = this.store;
    this.showTarget();
    this.undoButton.disabled = this.list.past.length === 0;
    this.redoButton.disabled = this.list.future.length === 0;
    this.rows.show(entries, appliedDecisions);
    this.files.show(entries);
    if (this.review) this.review.show(!sameEffect(entries, appliedDecisions));
  }
}
