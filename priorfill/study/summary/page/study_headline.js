/* What happened in a sentence, the share of each group, and buttons that show only one. */

class StudyHeadline {
  /**
   * @param {HTMLElement} root
   * @param {StudyStore} store
   */
  constructor(root, store) {
    this.store = store;
    const { data } = store;
    this.buttons = data.groups.map((group, number) => this.groupButton(group, number));
    root.append(
      element("p", { class: "sentence", text: data.sentence }),
      element("p", { class: "to-do", text: data.to_do }),
      this.bar(),
      element("div", {
        class: "group-buttons", role: "group", "aria-label": "Show trials of some groups only",
      }, this.buttons),
      element("p", { class: "muted", text: this.details() }));
    if (data.waiting.length) root.append(this.waiting());
    store.on("filter", () => this.mark());
    this.mark();
  }

  /** @returns {HTMLElement} the share of each group as a bar */
  bar() {
    const { data } = this.store;
    const counts = [...data.groups.map((group) => group.count), data.waiting.length];
    const parts = counts.map((count, number) => {
      const kind = number < GROUP_TITLES.length ? number : "waiting";
      const part = element("span", { class: `of-${kind}` });
      part.style.flexGrow = String(count);
      part.hidden = count === 0;
      return part;
    });
    return element("div", { class: "share-bar", "aria-hidden": "true" }, parts);
  }

  /** @returns {HTMLElement} button of a group */
  groupButton(group, number) {
    return element("button", {
      type: "button", "aria-pressed": "false", title: group.rule, disabled: group.count === 0,
      on: { click: () => this.store.toggleGroup(number) },
    }, [
      element("span", { class: `group-sign of-${number}`, "aria-hidden": "true" }),
      `${GROUP_TITLES[number]} ${formatCount(group.count)}`,
    ]);
  }

  /** Show which groups are shown alone. */
  mark() {
    this.buttons.forEach((one, number) =>
      one.setAttribute("aria-pressed", String(this.store.groups.has(number))));
  }

  /** @returns {string} amounts, times and settings */
  details() {
    const { trials, seconds, facts } = this.store.data;
    const sum = (key) => trials.reduce((total, trial) => total + (trial[key] || 0), 0);
    const wanted = sum("filled") + sum("left");
    const parts = [
      countOf(sum("gaps"), "gap"),
      `${formatCount(sum("filled"))} of ${countOf(wanted, "missing sample")} filled`,
    ];
    if (sum("kept")) parts.push(`${formatCount(sum("kept"))} left alone`);
    const errors = trials.filter((trial) => trial.error !== null && trial.filled);
    const filled = errors.reduce((total, trial) => total + trial.filled, 0);
    if (filled) {
      const mean = errors.reduce((total, one) => total + one.error * one.filled, 0) / filled;
      parts.push(`expected mean error ${formatMm(mean)}`);
    }
    parts.push(`${formatTime(sum("seconds"))} of computing`);
    if (seconds !== null) parts.push(`${formatTime(seconds)} in all`);
    return [...parts, ...facts.map(([name, text]) => `${name}: ${text}`)].join(" · ");
  }

  /** @returns {HTMLElement} names of the trials that are not done yet */
  waiting() {
    const { waiting } = this.store.data;
    return element("details", {}, [
      element("summary", {
        text: `${countOf(waiting.length, "trial")} not done yet; the same command goes on`,
      }),
      element("p", { text: waiting.join(", ") }),
    ]);
  }
}
