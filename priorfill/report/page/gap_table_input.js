/* Pointer, keys and choices of the gap table. */

/** Rows that Page Up and Page Down move by. */
const PAGE_ROWS = 10;

class GapTableInput {
  /** @param {GapTable} table */
  constructor(table) {
    this.table = table;
    this.store = table.store;
    this.last = -1;
  }

  /** Listen to the rows. */
  listen(rows) {
    rows.addEventListener("click", (event) => this.click(event));
    rows.addEventListener("keydown", (event) => this.key(event));
  }

  /** Choose a gap by its box, or make it the active one. */
  click(event) {
    const row = event.target.closest("tr[data-gap]");
    if (!row) return;
    const index = Number(row.dataset.gap);
    if (event.target.closest(".col-choose")) {
      if (event.shiftKey) this.chooseTo(index);
      else this.store.toggleGap(index);
      this.last = index;
      return;
    }
    if (event.ctrlKey || event.metaKey) this.store.toggleGap(index);
    else if (event.shiftKey) this.chooseTo(index);
    else this.store.setActiveGap(index, { scrollTo: false });
    this.last = index;
    row.focus({ preventScroll: true });
  }

  /** Choose all rows from the last one clicked to this one. */
  chooseTo(index) {
    const { placeOf, shown } = this.table;
    const from = placeOf.has(this.last) ? placeOf.get(this.last) : placeOf.get(index);
    const ends = [from, placeOf.get(index)].sort((a, b) => a - b);
    this.store.setChosenGaps([...this.store.chosenGaps, ...shown.slice(ends[0], ends[1] + 1)]);
  }

  /** Move among the rows, and choose. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const row = event.target.closest("tr[data-gap]");
    if (!row) return;
    const index = Number(row.dataset.gap);
    const place = this.table.placeOf.get(index);
    const moves = {
      ArrowUp: place - 1, ArrowDown: place + 1, PageUp: place - PAGE_ROWS,
      PageDown: place + PAGE_ROWS, Home: 0, End: Infinity,
    };
    if (event.key in moves) {
      const target = Math.max(0, Math.min(this.table.shown.length - 1, moves[event.key]));
      if (event.shiftKey) this.store.setChosenGaps([...this.store.chosenGaps, index,
        this.table.shown[target]]);
      this.goTo(target);
    } else if (event.key === " ") {
      this.store.toggleGap(index);
      this.last = index;
      announce(this.store.chosenGaps.has(index) ? "Chosen" : "Not chosen");
    } else if (event.key === "Enter") this.store.setActiveGap(index);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Make the gap at a place active, and put the focus on its row. */
  goTo(place) {
    const index = this.table.shown[place];
    this.store.setActiveGap(index);
    const row = this.table.rows.querySelector(`tr[data-gap="${index}"]`);
    if (row) row.focus({ preventScroll: true });
  }

  /** Choose all gaps whose expected mean error is below the limit. */
  chooseBelow() {
    const limit = parseFloat(this.table.limit.value);
    const { gaps } = this.store.data;
    const fits = this.table.shown.filter((index) => {
      const error = gaps[index].expected_mean;
      return error !== null && error < limit && gaps[index].filled > 0;
    });
    this.store.setChosenGaps(fits);
    announce(`${formatCount(fits.length)} gaps chosen`);
  }

  /** Choose all gaps shown, or none. */
  chooseShown() {
    this.store.setChosenGaps(this.table.box.checked ? this.table.shown : []);
  }
}
