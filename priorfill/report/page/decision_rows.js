/* The decisions as a list: what each does, whether the fill shown has it, and buttons. */

/** Decisions listed before the button that lists all. */
const MAX_ROWS = 100;

/** The list of decisions in the panel. */
class DecisionRows {
  /**
   * @param {Store} store
   * @param {{remove: function(number), note: function(number, string)}} actions
   * @param {string} pending word for decisions that the fill shown does not have
   */
  constructor(store, actions, pending) {
    this.store = store;
    this.actions = actions;
    this.pending = pending;
    this.all = false;
    this.list = element("ol", { id: "decision-list", "aria-label": "Decisions" });
    this.more = button("", () => this.showAll(), { hidden: true });
    const text = "No decisions: every gap is filled as usual.";
    this.empty = element("p", { class: "muted", text });
    this.element = element("div", { class: "decision-rows" }, [this.empty, this.list, this.more]);
  }

  /** List all decisions, however many. */
  showAll() {
    this.all = true;
    this.show(this.entries, this.applied);
  }

  /**
   * Show decisions.
   * @param {Object[]} entries
   * @param {Object[]} applied those that the fill shown was made with
   */
  show(entries, applied) {
    this.entries = entries;
    this.applied = applied;
    const effects = new Set(applied.map(entryEffect));
    const shown = this.all ? entries : entries.slice(0, MAX_ROWS);
    this.list.replaceChildren(...shown.map((entry, index) => this.row(entry, index, effects)));
    this.empty.hidden = entries.length > 0;
    this.more.hidden = shown.length === entries.length;
    this.more.textContent = `List all ${formatCount(entries.length)} decisions`;
  }

  /** Make the row of a decision. */
  row(entry, index, effects) {
    const { data } = this.store;
    const name = `${entryMarkersText(data, entry)}, ${entryFramesText(entry)}`;
    const known = DECISION_SIGNS[entry.do];
    const pending = entryEffect(entry) !== "" && !effects.has(entryEffect(entry));
    const state = entry.do === DO_ACCEPT ? "looked at" : pending ? this.pending : "applied";
    const text = element("span", { class: "decision-text" }, [
      button(name, () => this.jump(entry), { class: "link", title: `Show ${name}` }),
      element("span", { text: ` ${entryActionText(entry)}` }),
    ]);
    if (entry.note) {
      const note = ` “${shortText(safeText(entry.note), 200)}”`;
      text.append(element("span", { class: "muted", text: note }));
    }
    return element("li", { data: { decision: index, do: entry.do, state } }, [
      element("span", { class: "sign", "aria-hidden": "true", text: (known || FILL).sign }),
      text,
      element("span", { class: `decision-state${pending ? " pending" : ""}`, text: state }),
      button("Note", (event) => this.editNote(event.target, entry, index),
        { "aria-label": `Note on ${name}` }),
      button("Delete", () => this.actions.remove(index), { "aria-label": `Delete ${name}` }),
    ]);
  }

  /** Put a field for the note in the place of its button. */
  editNote(place, entry, index) {
    const field = element("input", {
      type: "text", value: entry.note || "", "aria-label": place.getAttribute("aria-label"),
    });
    const close = () => field.replaceWith(place);
    field.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter") this.actions.note(index, field.value.trim());
      if (event.key === "Escape") {
        close();
        place.focus();
      }
    });
    field.addEventListener("change", () => this.actions.note(index, field.value.trim()));
    field.addEventListener("blur", () => { if (field.isConnected) close(); });
    place.replaceWith(field);
    field.focus();
  }

  /** Go to the samples of a decision. */
  jump(entry) {
    const { store } = this;
    const { markers, start, stop } = entryScope(store.data, entry);
    const gap = store.data.gaps.findIndex((one) =>
      markers.has(one.marker) && one.start < stop && one.stop > start);
    const frame = Math.min(store.frames - 1, Math.max(0, start));
    if (gap >= 0) store.setActiveGap(gap, { scrollTo: true });
    if (gap < 0 || entryRank(entry) < 2) {
      store.setFrame(frame);
      const others = entry.do === DO_SWAP ?
        entryMarkers(store.data, { ...entry, marker: [entry.with] }) : [];
      store.setMarkers([...markers, ...others].slice(0, 4));
    }
  }
}
