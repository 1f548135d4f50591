/* Columns of the tables of folders and of subjects. */

/**
 * Columns of one of these tables, as ListTable takes them.
 * @param {string} title of the parts of the study
 * @param {string} others what else is stated of each
 * @returns {Object[]}
 */
function partColumns(title, others) {
  const groups = ["failed", "record again", "look at", "good"];
  return [
    { key: "name", title, first: 1, text: partName, order: (p) => p.name },
    { key: "others", title: others, first: 1, text: (p) => p.others.map(
      (name) => partName({ name })).join(", ") || "–", order: (p) => p.others.join(", ") },
    { key: "trials", title: "Trials", first: -1, number: true, text: (p) => formatCount(p.trials),
      order: (p) => p.trials },
    ...groups.map((name, number) => ({
      key: name, title: GROUP_TITLES[number], first: -1, number: true,
      text: (p) => (p.groups[name] ? formatCount(p.groups[name]) : "–"),
      order: (p) => p.groups[name],
    })),
    { key: "share", title: "Missing", first: -1, number: true,
      hint: "Share of all samples that were missing", text: (p) => shareText(p.missing_share),
      order: (p) => p.missing_share },
    { key: "left", title: "Still missing", first: -1, number: true, order: (p) => p.left_samples,
      hint: "Samples that were to be filled and stay missing",
      text: (p) => (p.left_samples ? formatCount(p.left_samples) : "–") },
    { key: "error", title: "Expected", unit: "mm", first: -1, number: true,
      hint: "Expected mean error of all filled samples",
      text: (p) => formatNumber(p.expected_mean_error_mm),
      order: (p) => p.expected_mean_error_mm },
    { key: "marker", title: "Worst marker", first: 1, text: (p) => p.worst_marker || "–",
      hint: "The marker with most missing frames", order: (p) => p.worst_marker },
    { key: "absent", title: "Not placed?", first: -1,
      hint: "Markers that none of the trials shows",
      text: (p) => p.absent_markers.join(", ") || "–", order: (p) => p.absent_markers.length },
    { key: "seconds", title: "Time", first: -1, number: true, text: (p) => formatTime(p.seconds),
      order: (p) => p.seconds },
  ];
}
