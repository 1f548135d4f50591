/* Controls of the curves: markers, quantities, versions, zoom. */

/** Markers that are shown at most: as many as have their own symbol. */
const CURVE_MOST_MARKERS = 6;

/** Characters of a label in controls; the whole label is in the title. */
const CURVE_LABEL_LENGTH = 32;

/** Versions that are compared unless the user chooses others. */
const CURVE_COMPARED = 4;

/** The markers shown, and a field that adds one. */
class CurveMarkers {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.store = store;
    this.chips = element("span", { class: "curves-chips" });
    this.names = element("datalist", { id: "curves-marker-names" });
    this.field = element("input", {
      id: "curves-add", list: "curves-marker-names", size: 12, autocomplete: "off",
      placeholder: "Add marker", "aria-label": "Add a marker to the curves",
      on: {
        keydown: (event) => this.key(event),
        input: () => { if (this.byName.has(this.field.value)) this.add(); },
      },
    });
    this.message = element("span", { class: "curves-message", role: "status" });
    root.append(this.chips, this.field, this.names, this.message);
    this.list();
  }

  /** List the markers of the clip; equal labels get their number. */
  list() {
    this.byName = new Map();
    this.store.data.markers.forEach((marker, index) => {
      let name = shortText(marker.label, CURVE_LABEL_LENGTH);
      if (this.byName.has(name)) name = `${name} (${index + 1})`;
      this.byName.set(name, index);
    });
    this.names.replaceChildren(
      ...[...this.byName.keys()].map((name) => element("option", { value: name })));
  }

  /** Show the chosen markers, each with a button that removes it. */
  show() {
    const { markers } = this.store.data;
    this.chips.replaceChildren(...this.store.markers.map((index) => {
      const { label } = markers[index];
      const short = shortText(label, CURVE_LABEL_LENGTH);
      return element("span", { class: "curves-chip", title: label }, [
        short,
        button("×", () => this.remove(index), {
          "aria-label": `Remove ${short} from the curves`, title: "Remove",
        }),
      ]);
    }));
    this.field.disabled = this.store.markers.length >= CURVE_MOST_MARKERS;
    this.field.title = this.field.disabled ? `At most ${CURVE_MOST_MARKERS} markers` : "";
  }

  /** Add the marker that was typed at Enter, empty the field at Escape. */
  key(event) {
    if (event.key === "Enter") this.add();
    if (event.key === "Escape") this.field.value = "";
    event.stopPropagation();
  }

  /** Add the marker with the name typed, or the only one whose name contains it. */
  add() {
    const text = this.field.value.trim();
    if (!text) return;
    const index = this.find(text);
    if (typeof index === "string") {
      this.message.textContent = index;
      return;
    }
    this.message.textContent = "";
    this.field.value = "";
    if (this.store.markers.includes(index)) return;
    this.store.setMarkers([...this.store.markers, index]);
  }

  /** The index of the marker with a name, or a message. */
  find(text) {
    const exact = this.byName.get(text);
    if (exact !== undefined) return exact;
    const wanted = text.toLowerCase();
    const names = [...this.byName.keys()];
    const same = names.filter((name) => name.toLowerCase() === wanted);
    const found = same.length ? same : names.filter((n) => n.toLowerCase().includes(wanted));
    if (found.length === 1) return this.byName.get(found[0]);
    const short = shortText(text, CURVE_LABEL_LENGTH);
    return found.length ? `${found.length} markers contain “${short}”`
      : `No marker contains “${short}”`;
  }

  /** Take a marker away. */
  remove(index) {
    this.store.setMarkers(this.store.markers.filter((marker) => marker !== index));
    this.field.focus();
  }
}

/** Which quantities are shown, and how. */
class CurveOptions {
  /**
   * @param {HTMLElement} root For the quantities.
   * @param {HTMLElement} further For how they are shown.
   * @param {function()} changed Called after each choice.
   */
  constructor(root, further, changed) {
    this.boxes = {};
    const box = (name, text, checked, title) => {
      const input = element("input", { type: "checkbox", on: { change: changed } });
      input.checked = checked;
      this.boxes[name] = input;
      return element("label", { title }, [input, ` ${text}`]);
    };
    this.distance = box("distance", "distance", false, "Distance between two versions");
    root.append(
      element("span", { role: "group", "aria-label": "Quantities", class: "curves-group" }, [
        ...["x", "y", "z", "speed"].map((kind) => box(kind, kind, true)),
        box("error", "expected error", true,
          "Expected rms error of filled samples, and their 90 % bound"),
        this.distance,
      ]));
    further.append(
      element("span", { role: "group", "aria-label": "Panels", class: "curves-group" }, [
        box("together", "in one panel", false, "All chosen markers in the same panels"),
        box("alike", "same scale", false, "The same height for a millimetre in x, y and z"),
        box("neighbours", "neighbours", false,
          "Other markers of the segment, shifted to the mean of the marker"),
      ]));
  }

  /** Offer what the versions allow: the distance to the truth at first, or the expected error. */
  offer(versions) {
    const kinds = versions.map(({ kind }) => kind).join();
    if (kinds === this.versions) return;
    this.versions = kinds;
    this.distance.hidden = versions.length < 2;
    this.boxes.distance.checked = kinds.includes("truth");
    this.boxes.error.checked = !kinds.includes("truth");
  }

  /** Whether a box is ticked. */
  is(name) {
    return this.boxes[name].checked;
  }

  /** The quantities chosen, from above. */
  get kinds() {
    return CURVE_QUANTITIES.filter((kind) => this.is(kind));
  }
}

/** Which versions are drawn over the fill, and between which two the distance is drawn. */
class CurveVersions {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   * @param {function()} changed Called after the pair has changed.
   */
  constructor(root, store, changed) {
    this.root = root;
    this.store = store;
    this.changed = changed;
    this.pair = null;
  }

  /** Offer the versions of the page data; the truth, or else the first other, is compared. */
  list() {
    const { versions } = this.store.data;
    const kinds = versions.map(({ kind }) => kind);
    if (kinds.join() !== this.kinds) this.choose(kinds);
    this.kinds = kinds.join();
    this.root.hidden = versions.length < 2;
    this.root.replaceChildren(
      ...(this.pair ? [this.boxes(versions), this.pairChoice(versions)] : []));
  }

  /** Choose what is compared at first, by the kinds of the versions. */
  choose(kinds) {
    const other = ["truth", "other", "original"].map((kind) => kinds.indexOf(kind));
    const found = other.find((version) => version > 0);
    this.pair = found === undefined ? null : [0, found];
    if (this.store.compared.size) return;
    this.store.setCompared(kinds.map((_, i) => i).slice(1, 1 + CURVE_COMPARED));
  }

  /** A box for each version. */
  boxes(versions) {
    const labels = versions.slice(1).map(({ name }, place) => {
      const input = element("input", { type: "checkbox", on: { change: () => {
        const chosen = new Set(this.store.compared);
        if (!chosen.delete(place + 1)) chosen.add(place + 1);
        this.store.setCompared([...chosen].sort((a, b) => a - b));
      } } });
      input.checked = this.store.compared.has(place + 1);
      return element("label", { title: name }, [input, ` ${shortText(name, CURVE_LABEL_LENGTH)}`]);
    });
    return element("span", { role: "group", "aria-label": "Compared versions",
      class: "curves-group" }, ["Compare with", ...labels]);
  }

  /** Two menus for the distance. */
  pairChoice(versions) {
    const menus = ["First", "Second"].map((word, side) => {
      const options = versions.map(({ name }, i) => element("option", {
        value: i, text: shortText(name, CURVE_LABEL_LENGTH), selected: this.pair[side] === i,
      }));
      return element("select", { "aria-label": `${word} version of the distance`, on: {
        change: (event) => {
          this.pair[side] = Number(event.target.value);
          this.changed();
        },
      } }, options);
    });
    return element("span", { role: "group", "aria-label": "Versions of the distance",
      class: "curves-group" }, ["Distance between", menus[0], "and", menus[1]]);
  }
}
