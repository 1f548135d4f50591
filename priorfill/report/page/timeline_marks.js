/* What lies on the rows of the timeline: range, gaps chosen, decisions, playhead. */

class TimelineMarks {
  /** @param {Timeline} timeline */
  constructor(timeline) {
    this.timeline = timeline;
    this.store = timeline.store;
  }

  /** Draw what changes often: range, gaps chosen, playhead. */
  draw(context, height) {
    const { store, timeline } = this;
    const shades = colours();
    const { names, width } = timeline.columns();
    context.save();
    context.beginPath();
    context.rect(names, 0, width + 4, height);
    context.clip();
    if (store.range) {
      const left = timeline.xOf(store.range[0]);
      context.fillStyle = shades.accent;
      context.globalAlpha = 0.22;
      context.fillRect(left, 0, Math.max(2, timeline.xOf(store.range[1] + 1) - left), height);
      context.globalAlpha = 1;
    }
    if (timeline.rowHeight >= LEAST_NAMED_ROW) {
      for (const index of store.chosenGaps) this.frameGap(context, index, 1);
    }
    if (store.activeGap >= 0) this.frameGap(context, store.activeGap, 2);
    this.drawSigns(context, height);
    const x = Math.round(timeline.xOf(store.frame + 0.5));
    context.fillStyle = shades.surface;
    context.fillRect(x - 2, AXIS_HEIGHT, 5, height);
    context.fillStyle = shades.text;
    context.fillRect(x - 0.5, AXIS_HEIGHT - 6, 2, height);
    context.beginPath();
    context.moveTo(x - 5, AXIS_HEIGHT - 8);
    context.lineTo(x + 5, AXIS_HEIGHT - 8);
    context.lineTo(x, AXIS_HEIGHT);
    context.fill();
    context.restore();
  }

  /** Draw the signs of decisions where gaps begin; the playhead is often in their middle. */
  drawSigns(context, height) {
    const { store, timeline } = this;
    if (!store.decisions.length || timeline.rowHeight < LEAST_NAMED_ROW) return;
    const first = Math.floor(timeline.scroller.scrollTop / timeline.rowHeight);
    const rows = timeline.rows.slice(first, first + Math.ceil(height / timeline.rowHeight) + 1);
    context.font = "bold 12px system-ui, sans-serif";
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.lineWidth = 4;
    rows.forEach((row, i) => {
      if (row.marker === undefined) return;
      const y = AXIS_HEIGHT + (first + i + 0.5) * timeline.rowHeight - timeline.scroller.scrollTop;
      if (y < AXIS_HEIGHT) return;
      for (const index of store.gapsOf[row.marker]) {
        const decision = decisionOfGap(store, index);
        if (!decision) continue;
        const x = timeline.xOf(store.data.gaps[index].start) + 2;
        context.strokeStyle = colours().surface;
        context.strokeText(decision.sign, x, y);
        context.fillStyle = colours().text;
        context.fillText(decision.sign, x, y);
      }
    });
  }

  /** Draw a frame around a gap. */
  frameGap(context, index, thickness) {
    const { timeline } = this;
    const gap = this.store.data.gaps[index];
    const row = gap && timeline.rowOf.get(gap.marker);
    if (row === undefined) return;
    const top = AXIS_HEIGHT + row * timeline.rowHeight - timeline.scroller.scrollTop;
    if (top < AXIS_HEIGHT - timeline.rowHeight) return;
    const left = timeline.xOf(gap.start);
    const wide = Math.max(3, timeline.xOf(gap.stop) - left);
    context.strokeStyle = colours().accent;
    context.lineWidth = thickness;
    context.strokeRect(left - 1, top + 0.5, wide + 2, Math.max(2, timeline.rowHeight - 1));
  }
}
