/* What is known about the active gap, in sentences. */

/** Clips learnt from that are named, at most. */
const MOST_CLIPS = 8;

class GapDetail {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
    this.index = null;
    store.on("data", () => this.draw());
    store.on("gap", () => {
      if (this.store.activeGap !== this.index) this.draw();
    });
    this.draw();
  }

  /** Write the sentences. */
  draw() {
    const { store } = this;
    this.index = store.activeGap;
    const gap = store.data.gaps[store.activeGap];
    const head = element("div", { class: "panel-head" }, [
      element("h2", { text: gap ? store.gapName(store.activeGap) : "Gap" }),
      element("span", {
        class: "group", role: "group", "aria-label": "Gaps as the table lists them",
      }, [
        button("Previous", () => stepGap(store, -1), { title: "Gap above in the table (p)" }),
        button("Next", () => stepGap(store, 1), { title: "Gap below in the table (n)" }),
      ]),
    ]);
    const parts = gap
      ? this.parts(gap) : [element("p", { class: "muted", text: "No gap is chosen." })];
    this.root.replaceChildren(head, ...parts);
  }

  /** @returns {HTMLElement[]} facts, warnings, and what stayed missing */
  parts(gap) {
    const { store } = this;
    const marker = store.data.markers[gap.marker];
    const rows = [];
    const add = (name, text) => { if (text) rows.push([name, text]); };
    const seconds = formatSeconds((gap.stop - gap.start) / store.rate, store.rate);
    add("Segment", marker.segment);
    add("Length", `${countOf(gap.stop - gap.start, "frame")}, ${seconds} s`);
    add("Filled", `${filledShare(gap)}${gap.filled ? ` by ${gap.method}` : ""}`);
    if (gap.filled && gap.bound_90 === null && gap.expected_mean === null) {
      add("Expected", "error not known");
    } else if (gap.filled) {
      add("Expected", `mean error ${formatMm(gap.expected_mean)}, rms ` +
        `${formatMm(gap.expected_rms)}, 90 % below ${formatMm(gap.bound_90)}`);
    }
    if (gap.true_mean !== null && gap.true_mean !== undefined) {
      add("True", `mean error ${formatMm(gap.true_mean)}`);
    }
    add("Sources", gap.sources.join(", "));
    add("Clips", clipNames(gap.clips));
    if (gap.training_poses) add("Learnt from", countOf(gap.training_poses, "pose"));
    for (const span of gap.unfilled) {
      add("Missing", `${gapFrames(store, span)}: ${span.reason}`);
    }
    return [
      ...gap.warnings.map((warning) => element("p", { class: "warning-line" }, [
        element("span", { class: "warning", text: warningName(warning.kind) }),
        ` ${warning.text}`,
      ])),
      element("dl", { class: "facts" }, rows.flatMap(([name, text]) => [
        element("dt", { text: name }), element("dd", { text: shortText(text, 2000) }),
      ])),
    ];
  }
}

/** @returns {string} names of clips, the first ones */
function clipNames(clips) {
  const more = clips.length - MOST_CLIPS;
  const named = clips.slice(0, MOST_CLIPS).join(", ");
  return more > 0 ? `${named} and ${formatCount(more)} more` : named;
}

/**
 * Go to the gap before or after the active one, in the order of the table.
 * @param {Store} store
 * @param {number} by -1 or 1
 */
function stepGap(store, by) {
  const order = store.gapOrder();
  if (!order.length) return;
  const place = order.indexOf(store.activeGap);
  const next = place < 0 ? (by > 0 ? 0 : order.length - 1) : place + by;
  const index = order[Math.max(0, Math.min(order.length - 1, next))];
  store.setActiveGap(index);
  announce(`${store.gapName(index)}, expected error ` +
    `${formatMm(store.data.gaps[index].expected_mean)}`);
}
