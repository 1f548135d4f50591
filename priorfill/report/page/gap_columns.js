/* Columns of the gap table: what they show, and how they sort. */

/** Short names of warnings. */
const WARNING_NAMES = {
  jump: "jump", length: "length", floor: "floor", speed: "speed", extrapolated: "extrapolated",
  no_similar: "nothing alike", beyond_bound: "beyond bound",
};

/** @returns {string} name of the kind of a warning */
function warningName(kind) {
  return WARNING_NAMES[kind] || shortText(String(kind).replace(/_/g, " "), 20);
}

/** @returns {string} frames of a gap as the file numbers them */
function gapFrames(store, gap) {
  return frameRange(store.frameNumber(gap.start), store.frameNumber(gap.stop - 1));
}

/** @returns {string} share of a gap that was filled */
function filledShare(gap) {
  const whole = gap.stop - gap.start;
  if (gap.filled === whole) return "100 %";
  if (!gap.filled) return "0 %";
  return `${Math.min(99, Math.max(1, Math.round((100 * gap.filled) / whole)))} %`;
}

/**
 * Columns of the table.
 * @param {Store} store
 * @returns {Object[]} key, title, unit, hint; text(gap, index), order(gap, index); `first` is the
 *   direction of the first click: 1 ascending, -1 descending
 */
function gapColumns(store) {
  const { data } = store;
  const label = (gap) => data.markers[gap.marker].label;
  const columns = [
    { key: "marker", title: "Marker", first: 1, text: label, order: label },
    { key: "frames", title: "Frames", first: 1, text: (g) => gapFrames(store, g),
      order: (g) => g.start },
    { key: "seconds", title: "Length", unit: "s", first: -1, number: true,
      text: (g) => formatSeconds((g.stop - g.start) / store.rate, store.rate),
      order: (g) => g.stop - g.start },
    { key: "filled", title: "Filled", first: 1, number: true, text: filledShare,
      order: (g) => g.filled / (g.stop - g.start) },
    { key: "mean", title: "Expected", unit: "mm", first: -1, number: true, errors: true,
      hint: "Expected mean error of the filled frames",
      text: (g) => formatNumber(g.expected_mean), order: (g) => g.expected_mean },
    { key: "bound", title: "90 % below", unit: "mm", first: -1, number: true,
      hint: "Distance below which 90 % of the errors are expected",
      text: (g) => formatNumber(g.bound_90), order: (g) => g.bound_90 },
  ];
  if (data.gaps.some((gap) => gap.true_mean !== null && gap.true_mean !== undefined)) {
    columns.push({ key: "true", title: "True", unit: "mm", first: -1, number: true,
      hint: "Mean distance of the fill from the truth",
      text: (g) => formatNumber(g.true_mean), order: (g) => g.true_mean });
  }
  return columns.concat([
    { key: "warnings", title: "Warnings", first: -1, warnings: true,
      text: (g) => g.warnings.map((w) => warningName(w.kind)).join(", "),
      order: (g) => g.warnings.length },
    { key: "method", title: "Method", first: 1, text: (g) => g.method, order: (g) => g.method },
    { key: "sources", title: "Sources", first: 1, text: (g) => g.sources.join(", "),
      order: (g) => g.sources.join(", ") },
  ]);
}

/**
 * Indices of gaps in the order of a column; those that are equal, worst first; unknown values last.
 * @param {Object[]} gaps
 * @param {Object|null} column null: worst first
 * @param {number} direction 1 ascending, -1 descending
 * @returns {number[]}
 */
function sortedGaps(gaps, column, direction) {
  const indices = gaps.map((gap, index) => index);
  const byRank = (a, b) => gaps[a].badness - gaps[b].badness;
  if (!column) return indices.sort((a, b) => direction * byRank(a, b));
  const values = gaps.map((gap) => column.order(gap));
  const words = new Intl.Collator("en", { numeric: true });
  const known = (value) => value !== null && value !== undefined;
  const compare = (a, b) => {
    if (!known(a) || !known(b)) return Number(known(b)) - Number(known(a));
    return direction * (typeof a === "string" ? words.compare(a, b) : a - b);
  };
  return indices.sort((a, b) => compare(values[a], values[b]) || byRank(a, b));
}

/**
 * Whether a gap fits the text of the filter: all its words, in any column.
 * @param {Store} store
 * @param {Object[]} columns
 * @param {number} index
 * @param {string[]} words in lower case
 * @returns {boolean}
 */
function gapFits(store, columns, index, words) {
  const gap = store.data.gaps[index];
  const text = [
    ...columns.map((column) => column.text(gap)), ...gap.clips,
    store.data.subjects[store.data.markers[gap.marker].subject] || "",
    store.data.markers[gap.marker].segment,
  ].join(" ").toLowerCase();
  return words.every((word) => text.includes(word));
}
