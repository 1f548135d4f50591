/* What needs a hand: failed trials by reason, trials to record again, trials to look at. */

/** Trials of a list that are shown at first. */
const FIRST_ENTRIES = 6;

/** Reasons of a trial that are shown; the trial in full has all. */
const FIRST_REASONS = 2;

/** Names of an entry that are shown. */
const MOST_NAMES = 12;

/** Groups that need a hand. */
const NEEDY_GROUPS = [0, 1, 2];

class AttentionLists {
  /**
   * @param {HTMLElement} root
   * @param {StudyStore} store
   */
  constructor(root, store) {
    this.store = store;
    this.lists = [];
    const { groups } = store.data;
    const needy = NEEDY_GROUPS.filter((group) => groups[group].count);
    root.append(element("div", { class: "panel-head" }, [
      element("h2", { text: "What needs a hand" })]));
    if (!needy.length) {
      root.append(element("p", { text: "Nothing. All trials are good by the rule below." }));
    }
    root.append(
      element("div", { class: "attention-lists" }, needy.map((group) => this.list(group))),
      this.rules(needy));
    store.on("print", (on) => this.print(on));
  }

  /** @returns {HTMLElement} list of a group, with its rule */
  list(group) {
    const { data } = this.store;
    const entries = group === 0 ? this.failures() : data.trials
      .filter((trial) => trial.group === group)
      .map((trial) => ({ trials: [trial], reasons: trial.reasons }));
    const body = element("ol");
    const more = button("", () => this.store.onlyGroup(group), { class: "link" });
    const list = { entries, body, more, shown: FIRST_ENTRIES };
    this.lists.push(list);
    this.fill(list);
    return element("section", { class: "attention-list" }, [
      element("h3", {}, [groupBadge(group),
        countOf(data.groups[group].count, "trial")]),
      element("p", { class: "rule", text: data.groups[group].rule }),
      body, more,
    ]);
  }

  /** @returns {Object[]} failed trials, those with the same reason together, most first */
  failures() {
    const byReason = new Map();
    for (const trial of this.store.data.trials.filter((one) => one.group === 0)) {
      const reason = trial.reasons.join(" ").split(trial.name).join("FILE");
      const again = trial.again ? " (the same command tries it again)" : "";
      const key = `${reason}${again}`;
      if (!byReason.has(key)) {
        byReason.set(key, { trials: [], reasons: [`${trial.reasons.join(" ")}${again}`], key });
      }
      byReason.get(key).trials.push(trial);
    }
    return [...byReason.values()].sort((a, b) => b.trials.length - a.trials.length)
      .map((entry) => (entry.trials.length > 1 ? { ...entry, reasons: [entry.key] } : entry));
  }

  /** Make the entries of a list. */
  fill(list) {
    const shown = list.entries.slice(0, list.shown);
    list.body.replaceChildren(...shown.map((entry) => this.entry(entry)));
    const left = list.entries.length - shown.length;
    list.more.hidden = left <= 0;
    list.more.textContent = `${formatCount(left)} more in the table below`;
  }

  /** @returns {HTMLElement} an entry: one trial, or several that failed for one reason */
  entry({ trials, reasons }) {
    const names = element("p", {}, []);
    trials.slice(0, MOST_NAMES).forEach((trial, number) => {
      if (number) names.append(", ");
      const several = trials.length > 1;
      const name = button(several ? trial.name : fileName(trial), () => this.show(trial), {
        class: "link trial-name", title: trial.name });
      names.append(several ? name : trialName(trial, name));
      if (trial.links.report) {
        names.append(" ", linked("report", trial.links.report, { class: "to-report" }));
      }
    });
    if (trials.length > 1) names.prepend(`${countOf(trials.length, "trial")}: `);
    if (trials.length > MOST_NAMES) {
      names.append(` and ${formatCount(trials.length - MOST_NAMES)} more`);
    }
    const more = reasons.length - FIRST_REASONS;
    const texts = more > 1 ? reasons.slice(0, FIRST_REASONS) : reasons;
    return element("li", {}, [
      names, ...texts.map((text) => element("p", { text: shortText(text, 400) }))]);
  }

  /** Show a trial in the table and in full. */
  show(trial) {
    const index = this.store.data.trials.indexOf(trial);
    if (!this.store.fits(index)) this.store.showAll();
    this.store.setActive(index, { focus: true });
    document.getElementById("trials").scrollIntoView({ block: "start" });
  }

  /** @returns {HTMLElement} the rule of the groups that have no list */
  rules(needy) {
    const { groups } = this.store.data;
    const others = groups.map((_, group) => group).filter((group) => !needy.includes(group));
    const all = needy.length === 0;
    return element("details", { open: all }, [
      element("summary", { text: all ? "The rule" : "The rule of the other groups" }),
      ...others.map((group) => element("p", {}, [
        groupBadge(group), ` ${groups[group].rule}`])),
    ]);
  }

  /** Print all entries, and what is folded. */
  print(on) {
    const folds = document.querySelectorAll(on ? "details:not([open])" : "details.unfolded");
    for (const fold of folds) {
      fold.open = on;
      fold.classList.toggle("unfolded", on);
    }
    for (const list of this.lists) {
      list.shown = on ? MOST_PRINTED_ROWS : FIRST_ENTRIES;
      this.fill(list);
    }
  }
}
