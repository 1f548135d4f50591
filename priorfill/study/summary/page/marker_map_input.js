/* Pointer and keys of the map of markers. */

class MarkerMapInput {
  /**
   * @param {MarkerMap} map
   * @param {HTMLElement} box around the map
   */
  constructor(map, box) {
    this.map = map;
    this.box = box;
    this.row = 0;
    this.column = 0;
    this.focused = false;
    this.tip = element("div", { class: "tip", hidden: true });
    box.append(this.tip);
    const listeners = {
      mousemove: (event) => this.hover(event), mouseleave: () => this.hideTip(),
      click: (event) => this.click(event), keydown: (event) => this.key(event),
      focus: () => this.setFocused(true), blur: () => this.setFocused(false),
    };
    for (const [kind, fn] of Object.entries(listeners)) map.canvas.addEventListener(kind, fn);
  }

  /** @returns {{row: number, column: number}|null} the cell below the pointer */
  cellAt(event) {
    const box = this.map.canvas.getBoundingClientRect();
    const row = Math.floor((event.clientY - box.top - MAP_HEAD_HEIGHT) / MAP_ROW_HEIGHT);
    const column = Math.floor((event.clientX - box.left - this.map.labels) / this.map.columnWidth);
    if (row < 0 || row >= this.map.rows || column >= this.map.columns) return null;
    return { row, column };
  }

  /** Show what is below the pointer. */
  hover(event) {
    const cell = this.cellAt(event);
    if (!cell || cell.column < 0) {
      this.hideTip();
      return;
    }
    this.tip.textContent = this.map.cellText(cell.row, cell.column);
    this.tip.hidden = false;
    const box = this.box.getBoundingClientRect();
    const left = event.clientX - box.left + 14;
    this.tip.style.left = `${Math.max(0, Math.min(left, box.width - this.tip.offsetWidth - 4))}px`;
    this.tip.style.top = `${event.clientY - box.top + 18}px`;
  }

  /** Hide the tip. */
  hideTip() {
    this.tip.hidden = true;
  }

  /** Show the trial of a cell, or the trials of a marker. */
  click(event) {
    const cell = this.cellAt(event);
    if (!cell) return;
    if (cell.column < 0) this.map.store.choose("marker", cell.row);
    else {
      Object.assign(this, cell);
      this.openCell();
    }
  }

  /** Make the trial of the chosen cell the active one. */
  openCell() {
    const cell = this.map.found.cells[this.column].get(this.row);
    const own = this.map.trialsOf(this.column);
    this.map.store.setActive(cell ? cell.index : own[0]);
  }

  /** Move among the cells, and choose. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const moves = {
      ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1],
      Home: [0, -this.map.columns], End: [0, this.map.columns],
    };
    if (event.key in moves) {
      const [down, right] = moves[event.key];
      this.row = Math.max(0, Math.min(this.map.rows - 1, this.row + down));
      this.column = Math.max(0, Math.min(this.map.columns - 1, this.column + right));
      const y = MAP_HEAD_HEIGHT + this.row * MAP_ROW_HEIGHT;
      const { scroller } = this.map;
      if (y - MAP_ROW_HEIGHT < scroller.scrollTop) scroller.scrollTop = y - 2 * MAP_ROW_HEIGHT;
      else if (y + 2 * MAP_ROW_HEIGHT > scroller.scrollTop + scroller.clientHeight) {
        scroller.scrollTop = y + 2 * MAP_ROW_HEIGHT - scroller.clientHeight;
      }
      announce(this.map.cellText(this.row, this.column));
      this.map.draw();
    } else if (event.key === "Enter" || event.key === " ") this.openCell();
    else return;
    event.preventDefault();
  }

  /** Show or hide the cell that keys move. */
  setFocused(focused) {
    this.focused = focused;
    if (focused && this.map.found) announce(this.map.cellText(this.row, this.column));
    this.map.draw();
  }
}
