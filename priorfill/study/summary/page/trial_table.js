/* All trials, worst first, with filters above the table. */

class TrialTable {
  /**
   * @param {HTMLElement} root
   * @param {StudyStore} store
   */
  constructor(root, store) {
    this.store = store;
    this.count = element("span", { class: "muted", "aria-live": "polite" });
    this.words = element("input", {
      type: "search", name: "filter", placeholder: "trial, subject, marker, reason …", size: "28",
      on: { input: () => store.setWords(this.words.value) },
    });
    this.chosen = element("span", { class: "filters" });
    root.append(element("div", { class: "panel-head" }, [
      element("h2", { text: "Trials" }), this.count,
      element("label", {}, ["Filter ", this.words]), this.chosen,
      button("Worst first", () => this.list.sortBy(null), { title: "Sort as at first" }),
    ]));
    this.list = new ListTable(root, {
      label: "Trials", columns: trialColumns(), rows: store.data.trials,
      open: (index) => store.setActive(index, { scrollTo: false }),
      follow: (index) => store.setActive(index),
      empty: store.data.trials.length ? "No trial fits the filters." : "There are no trials.",
    });
    store.on("filter", () => this.filter());
    store.on("trial", ({ scrollTo, focus }) => {
      this.list.setActive(store.active, scrollTo);
      if (focus) this.list.focusRow(store.active);
    });
    store.on("print", (on) => this.list.print(on));
    this.filter();
  }

  /** Show the trials that fit, and state by what they were chosen. */
  filter() {
    const { store } = this;
    const { trials, folders, subjects, markers } = store.data;
    const shown = store.shownTrials();
    this.list.setShown(shown);
    this.count.textContent = shown.length === trials.length ? countOf(trials.length, "trial")
      : `${formatCount(shown.length)} of ${countOf(trials.length, "trial")}`;
    if (!store.words.length && this.words.value.trim()) this.words.value = "";
    const filters = [...store.groups].map((group) =>
      [GROUP_TITLES[group], () => store.toggleGroup(group)]);
    if (store.folder >= 0) {
      filters.push([`folder ${partName(folders[store.folder])}`,
        () => store.choose("folder", store.folder)]);
    }
    if (store.subject >= 0) {
      filters.push([`subject ${subjects[store.subject].name}`,
        () => store.choose("subject", store.subject)]);
    }
    if (store.marker >= 0) {
      filters.push([`gaps of ${markers[store.marker].marker}`,
        () => store.choose("marker", store.marker)]);
    }
    this.chosen.replaceChildren(...filters.map(([text, fn]) =>
      button(`${shortText(text, 40)} ×`, fn, { title: "Remove this filter" })));
  }
}
