/* Fields of the forms of decisions. */

/** Frames at which distances of markers are measured. */
const DISTANCE_FRAMES = 15;

/** Entries of a list of check boxes that are shown without searching. */
const MAX_CHOICES = 400;

let fieldCount = 0;

/**
 * Make a label with its field.
 * @param {string} text
 * @param {HTMLElement} control
 * @returns {HTMLElement}
 */
function labelled(text, control) {
  fieldCount += 1;
  control.id = control.id || `decision-field-${fieldCount}`;
  const label = element("label", { for: control.id, text });
  return element("span", { class: "field" }, [label, control]);
}

/**
 * Make a check box with its label.
 * @param {string} text
 * @param {boolean} checked
 * @param {string} value
 * @returns {HTMLElement} with the input as its first child
 */
function checkBox(text, checked, value) {
  const box = element("input", { type: "checkbox", value });
  box.checked = checked;
  return element("label", { class: "check", title: text }, [box, shortText(text)]);
}

/**
 * Make a field with a choice.
 * @param {Array} options pairs of value and text
 * @param {string} chosen
 * @returns {HTMLSelectElement}
 */
function choice(options, chosen) {
  const select = element("select", {}, options.map(([value, text]) =>
    element("option", { value, text: shortText(text), title: text })));
  select.value = chosen;
  return select;
}

/**
 * Make a field with a number.
 * @param {number} value
 * @param {Object} settings attributes
 * @returns {HTMLInputElement}
 */
function numberField(value, settings) {
  return element("input", { type: "number", value, ...settings });
}

/** A list of check boxes, with a field to search it. */
class CheckList {
  /**
   * @param {string} what what is chosen, such as "donor markers"
   * @param {Array} options pairs of value and text
   */
  constructor(what, options) {
    this.boxes = options.slice(0, MAX_CHOICES).map(([value, text]) => checkBox(text, false, value));
    this.search = element("input", { type: "search", on: { input: () => this.filter() } });
    const many = options.length - MAX_CHOICES;
    this.element = element("div", { class: "check-list" }, [
      labelled(`Search ${what}`, this.search),
      element("div", { class: "checks", role: "group", "aria-label": what }, this.boxes),
    ]);
    if (many > 0) {
      this.element.append(element("p", { text: `${formatCount(many)} more are not listed.` }));
    }
  }

  /** Show what contains the text searched. */
  filter() {
    const wanted = this.search.value.trim().toLowerCase();
    for (const box of this.boxes) {
      box.hidden = !box.textContent.toLowerCase().includes(wanted);
    }
  }

  /** @returns {string[]} values chosen */
  chosen() {
    return this.boxes.map((box) => box.firstChild).filter((box) => box.checked)
      .map((box) => box.value);
  }
}

/** Two fields with the first and the last frame, as the file numbers them. */
class FramesField {
  /**
   * @param {Store} store
   * @param {number} start frame, from 0
   * @param {number} stop exclusive
   * @param {string} whole text of the button that sets these frames again
   */
  constructor(store, start, stop, whole) {
    this.store = store;
    const first = store.frameNumber(0);
    const limits = { min: first, max: store.frameNumber(store.frames - 1), step: 1 };
    this.first = numberField(store.frameNumber(start), limits);
    this.last = numberField(store.frameNumber(stop - 1), limits);
    this.element = element("div", { class: "field-row" }, [
      labelled("First frame", this.first), labelled("Last frame", this.last),
      button(whole, () => this.set(start, stop)),
      button("Dragged range", () => this.set(store.range[0], store.range[1] + 1),
        { disabled: store.range === null, title: "The range chosen in timeline or curves" }),
      button("Current frame", () => this.set(store.frame, store.frame + 1)),
    ]);
  }

  /** Put in frames, from 0, the second exclusive. */
  set(start, stop) {
    this.first.value = this.store.frameNumber(start);
    this.last.value = this.store.frameNumber(stop - 1);
  }

  /**
   * Return the frames, checked.
   * @returns {number[]} first and last, as the file numbers them
   */
  value() {
    const [first, last] = [this.first, this.last].map((field) => Number(field.value));
    const begin = this.store.frameNumber(0);
    const end = this.store.frameNumber(this.store.frames - 1);
    const whole = this.first.value !== "" && this.last.value !== "" &&
      Number.isInteger(first) && Number.isInteger(last);
    if (!whole || first > last || first < begin || last > end) {
      throw new DecisionError(`Give a first and a last frame from ${begin} to ${end}.`);
    }
    return [first, last];
  }
}

/**
 * Sort markers by their distance from one of them around some frames.
 * @param {Store} store
 * @param {number} marker index
 * @param {number} start frame, from 0
 * @param {number} stop exclusive
 * @returns {Array} pairs of index and mean distance (mm; NaN where never seen together)
 */
function markersByDistance(store, marker, start, stop) {
  const positions = store.positions(0);
  const { markerCount, data } = store;
  const subject = data.markers[marker].subject;
  const span = 3 * (stop - start);
  const first = Math.max(0, start - (stop - start));
  const found = [];
  for (let other = 0; other < markerCount; other++) {
    if (other === marker || data.markers[other].subject !== subject) continue;
    let sum = 0;
    let count = 0;
    for (let k = 0; positions !== null && k < DISTANCE_FRAMES; k++) {
      const frame = Math.min(store.frames - 1, first + Math.floor((span * k) / DISTANCE_FRAMES));
      if (!store.shown(0, frame, marker) || !store.shown(0, frame, other)) continue;
      const a = (frame * markerCount + marker) * 3;
      const b = (frame * markerCount + other) * 3;
      sum += Math.hypot(positions[a] - positions[b], positions[a + 1] - positions[b + 1],
        positions[a + 2] - positions[b + 2]);
      count += 1;
    }
    found.push([other, count > 0 ? sum / count / UNITS_PER_MM : NaN]);
  }
  const order = ([, mm]) => (Number.isNaN(mm) ? Infinity : mm);
  return found.sort((one, two) => (order(one) === order(two) ? 0 : order(one) - order(two)));
}

/**
 * Read options of a method: NAME = VALUE on lines.
 * @param {string} text
 * @returns {Object|undefined} values by name; undefined if there are none
 */
function parseOptionLines(text) {
  const options = {};
  for (const line of text.split("\n").filter((one) => one.trim() !== "")) {
    const found = /^\s*"?([\w.-]+)"?\s*=\s*(.*?)\s*$/.exec(line);
    if (found === null || found[2] === "") {
      throw new DecisionError(`Write options as NAME = VALUE, not ${shortText(safeText(line))}.`);
    }
    const reader = new TomlReader(found[2]);
    let value;
    try {
      value = reader.value(0);
    } catch (error) {
      if (!(error instanceof DecisionError)) throw error;
      throw new DecisionError(`Option ${found[1]}: ${error.message.replace(/^line 1: /, "")}.`);
    }
    if (reader.at < reader.text.length) {
      throw new DecisionError(`Option ${found[1]}: more follows after the value.`);
    }
    options[found[1]] = value;
  }
  return Object.keys(options).length > 0 ? options : undefined;
}

/**
 * Return the pattern that matches one clip's name only.
 * @param {string} name
 * @returns {string}
 */
function literalPattern(name) {
  return name.replace(/[*?[]/g, "[$&]");
}
