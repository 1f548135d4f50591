/* Columns of the table of markers. */

/** @returns {Object[]} columns of the table of markers, as ListTable takes them */
function markerColumns(store) {
  const { trials } = store.data;
  const filled = trials.filter((trial) => trial.group !== 0).length;
  return [
    { key: "marker", title: "Marker", first: 1, text: (m) => m.marker, order: (m) => m.marker },
    { key: "trials", title: "Falls off in", first: -1, number: true, order: (m) => m.trials,
      hint: "Trials in which it has gaps",
      text: (m) => `${formatCount(m.trials)} of ${countOf(filled, "trial")}` },
    { key: "share", title: "Missing there", first: -1, number: true,
      hint: "Missing share of the frames of these trials",
      text: (m) => shareText(m.missing_share), order: (m) => m.missing_share },
    { key: "gaps", title: "Gaps", first: -1, number: true, text: (m) => formatCount(m.gaps),
      order: (m) => m.gaps },
    { key: "longest", title: "Longest gap", unit: "s", first: -1, number: true,
      text: (m) => m.longest_gap_seconds.toFixed(2), order: (m) => m.longest_gap_seconds },
    { key: "error", title: "Expected", unit: "mm", first: -1, number: true,
      hint: "Expected mean error of its filled frames",
      text: (m) => formatNumber(m.expected_mean_error_mm),
      order: (m) => m.expected_mean_error_mm },
    { key: "worst", title: "Worst gap", unit: "mm", first: -1, number: true,
      hint: "Greatest expected mean error of a gap",
      text: (m) => formatNumber(m.greatest_gap_error_mm), order: (m) => m.greatest_gap_error_mm },
    { key: "left", title: "Stays missing in", first: -1, number: true,
      order: (m) => m.left_trials, hint: "Trials in which some of its frames stay missing",
      text: (m) => (m.left_trials ? countOf(m.left_trials, "trial") : "–") },
    { key: "never", title: "Never measured in", first: -1, number: true,
      order: (m) => m.never_measured_trials,
      text: (m) => (m.never_measured_trials ? countOf(m.never_measured_trials, "trial") +
        (m.absent_in ? "; not placed?" : "") : "–") },
  ];
}
