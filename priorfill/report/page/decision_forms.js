/* Forms of decisions that need more than a button: other methods, wrong samples, exchanges. */

/** Words of the sources that a method may be limited to. */
const SOURCE_WORDS = [
  ["clip", "frames of this recording"],
  ["same-subject", "other recordings of the subject"],
  ["database", "database"],
];

/** A form inside the panel of decisions. No <form>: a sandboxed page may not have any. */
class DecisionForm {
  /**
   * @param {string} title
   * @param {string} submit text of the button that adds the decision
   * @param {function} done called with the decisions, or null when closed
   */
  constructor(title, submit, done) {
    this.done = done;
    this.problem = element("p", { class: "form-problem", role: "alert", hidden: true });
    this.note = element("input", { type: "text" });
    this.body = element("div", { class: "form-body" });
    const buttons = element("div", { class: "field-row" }, [
      button(submit, () => this.submit(), { class: "main-button" }),
      button("Close", () => this.done(null), { title: "Close without a decision (Escape)" }),
    ]);
    this.element = element("div", {
      class: "decision-form", role: "group", "aria-label": title,
      on: { keydown: (event) => this.onKey(event) },
    }, [element("h3", { text: title }), this.body, labelled("Note", this.note), this.problem,
      buttons]);
  }

  /** Enter in a field of one line adds the decision, Escape closes the form. */
  onKey(event) {
    const field = event.target;
    if (event.key === "Escape") {
      this.done(null);
    } else if (event.key === "Enter" && field.tagName === "INPUT" && field.type !== "checkbox") {
      this.submit();
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  }

  /** Read the fields, and hand over the decisions. */
  submit() {
    let entries;
    try {
      const note = this.note.value.trim();
      entries = this.read().map((entry) => (note === "" ? entry : { ...entry, note }));
    } catch (error) {
      if (!(error instanceof DecisionError)) throw error;
      this.problem.textContent = error.message;
      this.problem.hidden = false;
      return;
    }
    this.done(entries);
  }

  /** Put the cursor into the first field. */
  focus() {
    this.body.querySelector("input, select, button").focus();
  }
}

/** Fill gaps by another method, with other donor markers or sources. */
class RefillForm {
  /**
   * @param {Store} store
   * @param {number[]} targets indices of gaps
   * @param {function} done
   */
  constructor(store, targets, done) {
    this.store = store;
    this.gaps = targets.map((index) => store.data.gaps[index]);
    this.form = new DecisionForm(`Re-fill ${gapsText(store, targets)}`, "Add re-fill", done);
    this.form.read = () => this.read();
    const aliases = store.data.aliases || {};
    const methods = store.data.methods.filter((one) => aliases[one] === undefined);
    const { method } = this.gaps[0];
    const first = methods.includes(method) ? method : methods[0];
    this.method = choice([...methods.map((one) => [one, one]),
      [DO_LEAVE, "none: leave missing"]], first);
    this.method.addEventListener("change", () => this.showOptions());
    this.frames = this.gaps.length > 1 ? null : this.framesField();
    this.details = [this.donorFields(), this.sourceFields(), this.optionFields()];
    this.form.body.append(
      element("div", { class: "field-row" }, [labelled("Method", this.method)]),
      this.frames ? this.frames.element :
        element("p", { text: "Frames: those of each gap." }), ...this.details);
    this.showOptions();
  }

  /** Make the fields for frames: those of the gap, or what is dragged of them. */
  framesField() {
    const [{ start, stop }] = this.gaps;
    const frames = new FramesField(this.store, start, stop, "Whole gap");
    const { range } = this.store;
    if (range !== null && range[0] < stop && range[1] >= start) {
      frames.set(Math.max(start, range[0]), Math.min(stop, range[1] + 1));
    }
    return frames;
  }

  /** Make the choice of donor markers, near ones first. */
  donorFields() {
    const { data } = this.store;
    const [gap] = this.gaps;
    const near = markersByDistance(this.store, gap.marker, gap.start, gap.stop);
    this.donors = new CheckList("donor markers", near.map(([marker, mm]) => [String(marker),
      `${data.markers[marker].label} (${Number.isNaN(mm) ? "distance unknown" : formatMm(mm)})`]));
    return element("details", {}, [
      element("summary", { text: "Donor markers" }),
      element("p", { text: "The method sees these markers only. With none checked it sees all." }),
      this.donors.element,
    ]);
  }

  /** Make the choice of sources. */
  sourceFields() {
    this.sources = SOURCE_WORDS.map(([value, text]) => checkBox(text, true, value));
    const clips = this.store.data.database_clips || [];
    this.clips = new CheckList("clips", clips.map((name) => [name, safeText(name)]));
    return element("details", {}, [
      element("summary", { text: "Sources" }),
      element("p", { text: "What the method may learn from." }),
      element("div", { class: "field-row", role: "group", "aria-label": "Sources" }, this.sources),
      ...(clips.length > 0 ? [
        element("p", { text: "Single clips; with none checked, all of the database." }),
        this.clips.element,
      ] : []),
    ]);
  }

  /** Make the field for options of the method. */
  optionFields() {
    this.options = element("textarea", { rows: 3, spellcheck: "false" });
    this.known = choice([], "");
    this.known.addEventListener("change", () => this.insertOption());
    this.knownField = labelled("Insert an option with its default", this.known);
    return element("details", {}, [
      element("summary", { text: "Options of the method" }),
      this.knownField,
      labelled("NAME = VALUE, one a line; texts in quotes", this.options),
    ]);
  }

  /** Show what the chosen method has: donors, sources, and its options. */
  showOptions() {
    for (const one of this.details) one.hidden = this.method.value === DO_LEAVE;
    const options = (this.store.data.method_options || {})[this.method.value] || [];
    this.knownField.hidden = options.length === 0;
    this.known.replaceChildren(element("option", { value: "", text: "Choose an option" }));
    for (const [name, value] of options) {
      this.known.append(element("option", { value: name, text: `${name} = ${tomlValue(value)}` }));
    }
  }

  /** Append the option chosen to the text, with its default. */
  insertOption() {
    if (this.known.value === "") return;
    const before = this.options.value.trimEnd();
    const line = this.known.selectedOptions[0].textContent;
    this.options.value = `${before}${before === "" ? "" : "\n"}${line}`;
    this.known.value = "";
    this.options.focus();
  }

  /** @returns {Object} what the decisions share, besides marker and frames */
  model() {
    const model = { do: this.method.value };
    if (model.do === DO_LEAVE) return model;
    const { data } = this.store;
    const donors = this.donors.chosen().map((index) => ownLabel(data.markers[Number(index)]));
    if (donors.length > 0) model.donors = donors;
    const boxes = this.sources.map((box) => box.firstChild);
    const clips = this.clips.chosen();
    if (!boxes.every((box) => box.checked) || clips.length > 0) {
      const kinds = boxes.filter((box) => box.checked).map((box) => box.value);
      model.sources = kinds.flatMap((kind) => (kind !== "database" || clips.length === 0 ? [kind] :
        clips.map((name) => SOURCE_PATTERN + literalPattern(name))));
      if (model.sources.length === 0) throw new DecisionError("Choose a source at least.");
    }
    const options = parseOptionLines(this.options.value);
    if (options !== undefined) model.options = options;
    return model;
  }

  /** @returns {Object[]} the decisions of the form */
  read() {
    const model = this.model();
    if (this.frames === null) return entriesForGaps(this.store, this.gaps, model);
    const frames = framesValue(...this.frames.value());
    return entriesFor(this.store.data, [this.gaps[0].marker], { frames, ...model });
  }
}

/** Measured samples of a marker, alone or exchanged with those of another. */
class SamplesForm {
  /**
   * @param {Store} store
   * @param {string} action DO_MISSING or DO_SWAP
   * @param {function} done
   */
  constructor(store, action, done) {
    this.store = store;
    this.action = action;
    const swap = action === DO_SWAP;
    const title = swap ? "Exchange the labels of two markers" : "Mark measured samples as wrong";
    this.form = new DecisionForm(title, swap ? "Add exchange" : "Add mark", done);
    this.form.read = () => this.read();
    const { markers } = store.data;
    const gap = store.data.gaps[store.activeGap];
    const own = store.markers.length > 0 ? store.markers[0] : gap ? gap.marker : 0;
    this.marker = choice(markers.map((one, index) => [String(index), one.label]), String(own));
    const row = element("div", { class: "field-row" }, [labelled("Marker", this.marker)]);
    const [start, stop] = store.range ? [store.range[0], store.range[1] + 1] :
      doubtfulRun(store, own, store.frame);
    this.span = [start, stop];
    this.frames = new FramesField(store, start, stop, "As at first");
    if (swap) {
      this.other = choice([], "");
      row.append(labelled("and", this.other));
      this.marker.addEventListener("change", () => this.listOthers());
      this.listOthers();
    }
    const text = swap ?
      "The measured samples of the two markers change places in these frames." :
      "The samples are treated as missing, and filled. If they cannot be, they stay as measured.";
    this.form.body.append(row, this.frames.element, element("p", { text }));
  }

  /** List the markers to exchange with, near ones first. */
  listOthers() {
    const { data } = this.store;
    const near = markersByDistance(this.store, Number(this.marker.value), ...this.span);
    this.other.replaceChildren(...near.map(([marker, mm]) => {
      const distance = Number.isNaN(mm) ? "" : ` (${formatMm(mm)})`;
      const { label } = data.markers[marker];
      return element("option", { value: marker, text: shortText(label) + distance, title: label });
    }));
  }

  /** @returns {Object[]} the decision of the form */
  read() {
    const { data } = this.store;
    const [first, last] = this.frames.value();
    const marker = Number(this.marker.value);
    const base = data.clip.first_frame;
    const involved = [marker];
    const model = { frames: framesValue(first, last), do: this.action };
    if (this.action === DO_SWAP) {
      if (this.other.value === "") throw new DecisionError("Choose the other marker.");
      involved.push(Number(this.other.value));
      model.with = ownLabel(data.markers[involved[1]]);
    }
    if (!involved.some((one) => hasMeasured(this.store, one, first - base, last - base + 1))) {
      throw new DecisionError("No sample is measured in these frames.");
    }
    return entriesFor(data, [marker], model);
  }
}

/**
 * Find the samples in doubt around a frame.
 * @param {Store} store
 * @param {number} marker
 * @param {number} frame from 0
 * @returns {number[]} start and stop of the run, from 0; the frame alone if it is not in doubt
 */
function doubtfulRun(store, marker, frame) {
  const inDoubt = (one) => one >= 0 && one < store.frames &&
    store.state(one, marker) === STATE.doubt;
  let [start, stop] = [frame, frame + 1];
  while (inDoubt(frame) && inDoubt(start - 1)) start -= 1;
  while (inDoubt(frame) && inDoubt(stop)) stop += 1;
  return [start, stop];
}

/**
 * Whether a marker has measured samples in some frames.
 * @param {Store} store
 * @param {number} marker
 * @param {number} start frame, from 0
 * @param {number} stop exclusive
 * @returns {boolean}
 */
function hasMeasured(store, marker, start, stop) {
  for (let frame = start; frame < stop; frame++) {
    const state = store.state(frame, marker);
    if (state !== STATE.missing && state !== STATE.filled) return true;
  }
  return false;
}

/**
 * Make a decision for each of some gaps, over its own frames.
 * @param {Store} store
 * @param {Object[]} gaps
 * @param {Object} model all but marker, subject and frames
 * @returns {Object[]}
 */
function entriesForGaps(store, gaps, model) {
  return gaps.flatMap((gap) => {
    const frames = framesValue(store.frameNumber(gap.start), store.frameNumber(gap.stop - 1));
    return entriesFor(store.data, [gap.marker], { frames, ...model });
  });
}

/**
 * Name gaps.
 * @param {Store} store
 * @param {number[]} targets indices
 * @returns {string} "LKNE, frames 92–116", or "3 gaps"
 */
function gapsText(store, targets) {
  if (targets.length === 1) return store.gapName(targets[0]);
  return targets.length === 0 ? "no gap" : `${formatCount(targets.length)} gaps`;
}
