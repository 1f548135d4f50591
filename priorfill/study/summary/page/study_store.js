/* The data of a summary, and what the user chose: groups, folder, subject, marker, words. */

/** Version of the data that this page reads. */
const STUDY_FORMAT = 1;

/** Numbers that a marker of a trial has in the data. */
const MARKER_NUMBERS = 4;

/** Names of the groups, worst first, as headings and in the table. */
const GROUP_TITLES = ["Failed", "Record again", "Look at", "Good"];

class StudyStore {
  /** @param {Object} data as as_page.py makes it */
  constructor(data) {
    if (data.format !== STUDY_FORMAT) throw new Error("the data have an unknown format");
    this.data = data;
    this.groups = new Set();
    this.folder = -1;
    this.subject = -1;
    this.marker = -1;
    this.words = [];
    this.active = -1;
    this.listeners = {};
    data.trials.forEach((trial) => { trial.cells = markerCells(trial.markers); });
  }

  /** Call a function at each event of a kind: "filter", "trial", "theme" or "print". */
  on(kind, fn) {
    (this.listeners[kind] = this.listeners[kind] || []).push(fn);
  }

  /** Call the listeners of an event. */
  emit(kind, value) {
    for (const fn of this.listeners[kind] || []) fn(value);
  }

  /** Show trials of a group, or of all groups again. */
  toggleGroup(group) {
    if (!this.groups.delete(group)) this.groups.add(group);
    this.emit("filter");
  }

  /** Show trials of one group only. */
  onlyGroup(group) {
    this.groups = new Set([group]);
    this.emit("filter");
  }

  /** Show trials of one folder or subject, or in which one marker falls off; again: all. */
  choose(name, number) {
    this[name] = this[name] === number ? -1 : number;
    this.emit("filter");
  }

  /** Show all trials. */
  showAll() {
    Object.assign(this, { groups: new Set(), folder: -1, subject: -1, marker: -1, words: [] });
    this.emit("filter");
  }

  /** Show trials that have all words. */
  setWords(text) {
    this.words = text.toLowerCase().split(/\s+/).filter((word) => word);
    this.emit("filter");
  }

  /** Make a trial the active one; `focus` moves the focus to its row in the table. */
  setActive(trial, { scrollTo = true, focus = false } = {}) {
    this.active = trial;
    this.emit("trial", { scrollTo, focus });
  }

  /** @returns {boolean} whether a trial is shown */
  fits(index) {
    const trial = this.data.trials[index];
    return (!this.groups.size || this.groups.has(trial.group)) &&
      (this.folder < 0 || trial.folder === this.folder) &&
      (this.subject < 0 || trial.subjects.includes(this.subject)) &&
      (this.marker < 0 || trial.cells.has(this.marker)) &&
      (!this.words.length || this.hasWords(trial));
  }

  /** @returns {boolean} whether a trial has all words of the filter */
  hasWords(trial) {
    if (trial.text === undefined) {
      const { subjects } = this.data;
      trial.text = [trial.name, ...trial.reasons, trial.method,
        ...trial.subjects.map((number) => subjects[number].name),
        GROUP_TITLES[trial.group], trial.status,
        ...[...trial.cells.keys()].map((marker) => this.data.markers[marker].marker),
      ].join(" ").toLowerCase();
    }
    return this.words.every((word) => trial.text.includes(word));
  }

  /** @returns {number[]} trials that are shown, worst first */
  shownTrials() {
    return this.data.trials.map((_, index) => index).filter((index) => this.fits(index));
  }
}

/**
 * Markers with gaps of a trial.
 * @param {number[]} numbers four of each marker
 * @returns {Map} from the number of a marker to its frames, share (of 1) and whether some stay
 *   missing
 */
function markerCells(numbers) {
  const cells = new Map();
  for (let i = 0; i < numbers.length; i += MARKER_NUMBERS) {
    const [marker, frames, share, left] = numbers.slice(i, i + MARKER_NUMBERS);
    cells.set(marker, { frames, share: share / 1e4, left: left > 0 });
  }
  return cells;
}

/**
 * Name of a trial: that of its file, then its folder.
 * @param {Object} trial
 * @param {HTMLElement} named with the name of the file as its text
 * @returns {DocumentFragment}
 */
function trialName(trial, named) {
  const made = document.createDocumentFragment();
  made.append(named);
  const folder = trial.name.slice(0, -fileName(trial).length - 1);
  if (folder) made.append(" ", element("span", { class: "muted", text: folder }));
  return made;
}

/** @returns {string} name of the file of a trial, without its folder */
function fileName(trial) {
  return trial.name.split("/").pop();
}

/** @returns {string} name of a folder or subject */
function partName({ name }) {
  return name === "." ? "(top)" : name;
}

/** @returns {string} a time as hours, minutes and seconds that matter */
function formatTime(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds < 99.5) return `${formatNumber(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 100) return `${minutes} min`;
  return `${formatCount(Math.floor(minutes / 60))} h ${minutes % 60} min`;
}

/** @returns {string} share of 1 in percent; "–" where unknown */
function shareText(share) {
  return share === null || share === undefined ? "–" : formatShare(share, 1);
}

/** @returns {HTMLElement} a text that is a link where there is an address */
function linked(text, address, settings = {}) {
  if (!address || !/^(\.\.?\/|file:\/\/)/.test(address)) {
    return element("span", { text, ...settings });
  }
  return element("a", { text, href: address, target: "_blank", rel: "noopener", ...settings });
}

/** @returns {HTMLElement} the name of a group as a coloured label */
function groupBadge(group) {
  return element("span", { class: `badge badge-${group}`, text: GROUP_TITLES[group] });
}
