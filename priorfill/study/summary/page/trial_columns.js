/* Columns of the table of trials: what they show, and how they sort. */

/** Bytes of a megabyte. */
const MEGABYTE = 1e6;

/** @returns {string} share of the samples to be filled that were filled */
function trialFilled(trial) {
  const wanted = trial.filled + trial.left;
  if (!wanted) return "–";
  if (!trial.left) return "100 %";
  if (!trial.filled) return "0 %";
  return `${Math.min(99, Math.max(1, Math.round((100 * trial.filled) / wanted)))} %`;
}

/** @returns {Object[]} columns of the table of trials, as ListTable takes them */
function trialColumns() {
  const gapPart = (gap, part) => (gap ? gap[part] : null);
  const decimals = (value) => (value === null ? "–" : value.toFixed(2));
  return [
    { key: "name", title: "Trial", first: 1, text: (t) => t.name, order: (t) => t.name,
      cell: (t) => trialName(t, linked(
        fileName(t), t.links.report || t.links.output, { tabindex: "-1" })) },
    { key: "group", title: "To do", first: 1, text: (t) => GROUP_TITLES[t.group],
      order: (t) => t.group, cell: (t) => groupBadge(t.group) },
    { key: "gaps", title: "Gaps", first: -1, number: true, order: (t) => t.gaps,
      text: (t) => (t.group ? formatCount(t.gaps) : "–") },
    { key: "share", title: "Missing", first: -1, number: true, order: (t) => t.share,
      hint: "Share of all samples that were missing", text: (t) => shareText(t.share) },
    { key: "filled", title: "Filled", first: 1, number: true,
      hint: "Share of the samples to be filled that were filled", text: trialFilled,
      order: (t) => (t.filled + t.left ? t.filled / (t.filled + t.left) : null) },
    { key: "left", title: "Still missing", first: -1, number: true, order: (t) => t.left,
      hint: "Samples that were to be filled and stay missing",
      text: (t) => (t.left ? formatCount(t.left) : "–") },
    { key: "longest", title: "Longest gap", unit: "s", first: -1, number: true,
      text: (t) => decimals(gapPart(t.longest, 3)), order: (t) => gapPart(t.longest, 3) },
    { key: "worst", title: "Worst gap", unit: "mm", first: -1, number: true,
      hint: "Greatest expected mean error of a gap",
      text: (t) => formatNumber(gapPart(t.worst, 4)), order: (t) => gapPart(t.worst, 4) },
    { key: "error", title: "Expected", unit: "mm", first: -1, number: true,
      hint: "Expected mean error of all filled samples",
      text: (t) => formatNumber(t.error), order: (t) => t.error },
    { key: "bound", title: "90 % below", unit: "mm", first: -1, number: true,
      hint: "Greatest distance below which 90 % of the errors of a gap are expected",
      text: (t) => formatNumber(t.bound), order: (t) => t.bound },
    { key: "artefacts", title: "Artefacts", first: -1, number: true, order: (t) => t.artefacts,
      hint: "Measured samples that may be wrong, such as exchanged labels",
      text: (t) => (t.artefacts ? formatCount(t.artefacts) : "–") },
    { key: "warnings", title: "Warnings", first: -1, number: true, order: (t) => t.warnings,
      hint: "Warnings of the report about its gaps",
      text: (t) => (t.warnings ? formatCount(t.warnings) : "–") },
    { key: "seconds", title: "Time", first: -1, number: true, order: (t) => t.seconds,
      text: (t) => formatTime(t.seconds) },
    { key: "memory", title: "Memory", unit: "MB", first: -1, number: true,
      order: (t) => t.memory,
      text: (t) => (t.memory ? formatCount(Math.round(t.memory / MEGABYTE)) : "–") },
  ];
}
