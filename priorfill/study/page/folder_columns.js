/* Columns of the table of folders. */

/** @returns {Object[]} columns of the table of folders, as ListTable takes them */
function folderColumns() {
  const groups = ["failed", "record again", "look at", "good"];
  return [
    { key: "folder", title: "Folder", first: 1, text: folderName,
      order: (f) => f.folder },
    { key: "subjects", title: "Subjects", first: 1, text: (f) => f.subjects.join(", ") || "–",
      order: (f) => f.subjects.join(", ") },
    { key: "trials", title: "Trials", first: -1, number: true, text: (f) => formatCount(f.trials),
      order: (f) => f.trials },
    ...groups.map((name, number) => ({
      key: name, title: GROUP_TITLES[number], first: -1, number: true,
      text: (f) => (f.groups[name] ? formatCount(f.groups[name]) : "–"),
      order: (f) => f.groups[name],
    })),
    { key: "share", title: "Missing", first: -1, number: true,
      hint: "Share of all samples that were missing", text: (f) => shareText(f.missing_share),
      order: (f) => f.missing_share },
    { key: "left", title: "Left", first: -1, number: true, order: (f) => f.left_samples,
      hint: "Samples that were to be filled and stay missing",
      text: (f) => (f.left_samples ? formatCount(f.left_samples) : "–") },
    { key: "error", title: "Expected", unit: "mm", first: -1, number: true,
      hint: "Expected mean error of all filled samples",
      text: (f) => formatNumber(f.expected_mean_error_mm),
      order: (f) => f.expected_mean_error_mm },
    { key: "marker", title: "Worst marker", first: 1, text: (f) => f.worst_marker || "–",
      hint: "The marker with most missing frames", order: (f) => f.worst_marker },
    { key: "absent", title: "Not placed?", first: -1,
      hint: "Markers that no trial of the folder shows",
      text: (f) => f.absent_markers.join(", ") || "–", order: (f) => f.absent_markers.length },
    { key: "seconds", title: "Time", first: -1, number: true, text: (f) => formatTime(f.seconds),
      order: (f) => f.seconds },
  ];
}
