/* The list of decisions: adding, joining, dividing, undoing. Without any element of the page. */

/** Steps that can be undone. */
const MAX_UNDO = 200;

/** Signs and words of decisions on gaps, by action; FILL is that of the methods. */
const DECISION_SIGNS = {
  accept: { sign: "✓", word: "accept", text: "accepted" },
  leave: { sign: "✕", word: "leave", text: "refused" },
  missing: { sign: "!", word: "missing", text: "samples wrong" },
  swap: { sign: "⇄", word: "swap", text: "exchanged" },
};
const FILL = { sign: "↻", word: "fill" };

/** Decisions with undo and redo. Lists and entries are replaced, never changed. */
class DecisionList {
  /**
   * @param {Object} data the page's data
   * @param {Object[]} entries
   */
  constructor(data, entries) {
    this.data = data;
    this.entries = entries;
    this.past = [];
    this.future = [];
  }

  /**
   * Replace the list; the step can be undone.
   * @param {Object[]} entries
   * @param {string} label what was done
   */
  change(entries, label) {
    this.past = [...this.past.slice(1 - MAX_UNDO), { entries: this.entries, label }];
    this.future = [];
    this.entries = entries;
  }

  /**
   * Add decisions. Earlier ones that contradict them are cut where they do; but accepting keeps
   * the methods that were chosen before: it is their fill that is accepted.
   * @param {Object[]} wanted
   * @param {string} label what was done
   * @returns {boolean} whether the list has changed
   */
  add(wanted, label) {
    const kept = this.entries.filter((old) => !DO_NO_METHOD.includes(old.do));
    const added = wanted.flatMap((entry) =>
      (entry.do === DO_ACCEPT ? this.without([entry], kept) : [entry]));
    const joined = joinEntries([...this.without(this.entries, added), ...added]);
    const ranked = [0, 1, 2].flatMap((rank) => joined.filter((one) => entryRank(one) === rank));
    if (JSON.stringify(ranked) === JSON.stringify(this.entries)) return false;
    this.change(ranked, label);
    return true;
  }

  /**
   * Return what is left of decisions when others are added.
   * @param {Object[]} entries
   * @param {Object[]} others
   * @returns {Object[]}
   */
  without(entries, others) {
    const ofMarker = new Map();
    for (const other of others) {
      for (const marker of entryScope(this.data, other).markers) {
        if (!ofMarker.has(marker)) ofMarker.set(marker, []);
        ofMarker.get(marker).push(other);
      }
    }
    return entries.flatMap((entry) => {
      const { markers } = entryScope(this.data, entry);
      const near = new Set([...markers].flatMap((marker) => ofMarker.get(marker) || []));
      return [...near].reduce(
        (parts, other) => parts.flatMap((part) => this.rest(part, other)), [entry]);
    });
  }

  /**
   * Return what is left of a decision when another is added.
   * @param {Object} old
   * @param {Object} added
   * @returns {Object[]} the decision itself, its parts, or nothing
   */
  rest(old, added) {
    if (!displaces(old, added)) return [old];
    const { start: from, stop: to, markers: taken } = entryScope(this.data, added);
    const { start, stop, markers } = entryScope(this.data, old);
    const own = [...markers];
    if (from >= stop || to <= start || !own.some((marker) => taken.has(marker))) return [old];
    const parts = [];
    const others = own.filter((marker) => !taken.has(marker));
    if (others.length > 0) parts.push(...entriesFor(this.data, others, old));
    const cut = own.filter((marker) => taken.has(marker));
    const base = this.data.clip.first_frame;
    for (const [a, b] of [[start, from], [to, stop]]) {
      const matters = a < b ? cut.filter((marker) => this.matters(old, marker, a, b)) : [];
      if (matters.length > 0) {
        const frames = framesValue(base + a, base + b - 1);
        parts.push(...entriesFor(this.data, matters, { ...old, frames }));
      }
    }
    return parts;
  }

  /** Whether a decision on some frames of a marker has anything to decide. */
  matters(entry, marker, start, stop) {
    if (entryRank(entry) < 2) return true;
    return this.data.gaps.some((gap) =>
      gap.marker === marker && gap.start < stop && gap.stop > start);
  }

  /**
   * Delete a decision.
   * @param {number} index
   */
  remove(index) {
    this.change(this.entries.filter((_, place) => place !== index), "deletion");
  }

  /**
   * Replace the note of a decision.
   * @param {number} index
   * @param {string} note
   */
  setNote(index, note) {
    const entries = [...this.entries];
    const { note: _, ...rest } = entries[index];
    entries[index] = note === "" ? rest : { ...rest, note };
    this.change(entries, "note");
  }

  /**
   * Undo the last step.
   * @returns {string} what was undone; empty if there was nothing
   */
  undo() {
    return this.move(this.past, this.future);
  }

  /**
   * Repeat the step that was undone last.
   * @returns {string} what was repeated; empty if there was nothing
   */
  redo() {
    return this.move(this.future, this.past);
  }

  /** Take a step from one stack, and put its reverse on the other. */
  move(from, to) {
    const step = from.pop();
    if (step === undefined) return "";
    to.push({ entries: this.entries, label: step.label });
    this.entries = step.entries;
    return step.label;
  }
}

/**
 * Whether a decision takes the place of an older one on the samples that both mean.
 * @param {Object} old
 * @param {Object} added
 * @returns {boolean}
 */
function displaces(old, added) {
  if (entryRank(old) === entryRank(added)) {
    return entryRank(added) < 2 ? added.do === DO_MISSING || old.with === added.with : true;
  }
  const pair = [old.do, added.do];
  return pair.includes(DO_LEAVE) && pair.includes(DO_MISSING);
}

/**
 * Make a decision for some markers: one for each subject among them.
 * @param {Object} data
 * @param {number[]} markers indices
 * @param {Object} model all but marker and subject
 * @returns {Object[]}
 */
function entriesFor(data, markers, model) {
  const several = data.subjects.length > 1;
  const subjects = [...new Set(markers.map((marker) => data.markers[marker].subject))];
  return subjects.map((subject) => {
    const own = markers.filter((marker) => data.markers[marker].subject === subject);
    const { marker: _, subject: __, ...rest } = model;
    const entry = { marker: markersValue(own.map((marker) => ownLabel(data.markers[marker]))) };
    if (several) entry.subject = subjectName(data, subject);
    return { ...entry, ...rest };
  });
}

/**
 * Join decisions that differ in their markers only.
 * @param {Object[]} entries
 * @returns {Object[]}
 */
function joinEntries(entries) {
  const found = new Map();
  for (const entry of entries) {
    const { marker: _, ...rest } = entry;
    const key = entry.do === DO_SWAP ? JSON.stringify(entry) :
      JSON.stringify(ENTRY_KEYS.map((name) => rest[name]));
    const before = found.get(key);
    const labels = [...(before ? entryPatterns(before) : []), ...entryPatterns(entry)];
    found.set(key, before ? { ...entry, marker: markersValue([...new Set(labels)]) } : entry);
  }
  return [...found.values()];
}

/**
 * Whether two lists of decisions lead to the same values.
 * @param {Object[]} one
 * @param {Object[]} two
 * @returns {boolean}
 */
function sameEffect(one, two) {
  const effects = (list) => JSON.stringify(list.map(entryEffect).filter(Boolean).sort());
  return effects(one) === effects(two);
}

/** Decisions on gaps that were found for a list: they are asked for once for each row. */
const gapDecisionMemo = new WeakMap();

/**
 * Return the decision on a gap.
 * @param {Store} store
 * @param {number} index of the gap
 * @returns {{sign: string, word: string, text: string, pending: boolean}|null}
 */
function decisionOfGap(store, index) {
  const { data, decisions } = store;
  const applied = store.appliedDecisions || data.decisions || [];
  let known = gapDecisionMemo.get(decisions);
  if (known === undefined || known.data !== data || known.applied !== applied) {
    known = { data, applied, found: gapDecisions(data, decisions, applied) };
    gapDecisionMemo.set(decisions, known);
  }
  return known.found[index] || null;
}

/**
 * Find the decisions on all gaps; of several on a gap, the last of the list is shown.
 * @param {Object} data
 * @param {Object[]} entries
 * @param {Object[]} applied decisions that the data were computed with
 * @returns {Array} for each gap its decision or null
 */
function gapDecisions(data, entries, applied) {
  const effects = new Set(applied.map(entryEffect));
  const ofMarker = new Map();
  data.gaps.forEach((gap, index) => {
    if (!ofMarker.has(gap.marker)) ofMarker.set(gap.marker, []);
    ofMarker.get(gap.marker).push(index);
  });
  const found = data.gaps.map(() => null);
  for (const entry of entries) {
    const { start, stop, markers: own } = entryScope(data, entry);
    const markers = [...own];
    if (entry.do === DO_SWAP) {
      markers.push(...entryMarkers(data, { ...entry, marker: [entry.with] }));
    }
    for (const index of markers.flatMap((marker) => ofMarker.get(marker) || [])) {
      const gap = data.gaps[index];
      if (gap.start >= stop || gap.stop <= start) continue;
      const shown = DECISION_SIGNS[entry.do] || { ...FILL, text: safeText(entry.do) };
      const part = start > gap.start || stop < gap.stop ? "partly " : "";
      const pending = entryEffect(entry) !== "" && !effects.has(entryEffect(entry));
      found[index] = { ...shown, text: part + shown.text, pending };
    }
  }
  return found;
}
