/* A table that sorts by its heads and is moved in by keys. Only the rows in view exist. */

/** Height (px) of a row; study.css has the same. */
const LIST_ROW_HEIGHT = 28;

/** Rows made above and below those in view. */
const LIST_SPARE_ROWS = 8;

/** Rows that Page Up and Page Down move by. */
const LIST_PAGE_ROWS = 10;

/** Rows that are printed at most. */
const MOST_PRINTED_ROWS = 500;

class ListTable {
  /**
   * @param {HTMLElement} root
   * @param {Object} settings `label`, `columns` (key, title, unit, hint, first, number, text(row),
   *   order(row), cell(row)); `rows`; `open(index)`, called when a row is chosen; `empty`, a text
   */
  constructor(root, settings) {
    Object.assign(this, settings);
    this.sort = { key: null, direction: 1 };
    this.printing = false;
    this.active = -1;
    this.made = { first: -1, last: -1 };
    this.base = this.rows.map((_, index) => index);
    this.build(root);
    this.setShown(this.base);
  }

  /** Make the elements around the rows. */
  build(root) {
    this.heads = element("tr");
    this.body = element("tbody");
    this.table = element("table", { role: "grid", "aria-label": this.label }, [
      element("thead", {}, [this.heads]), this.body]);
    this.scroller = element("div", { class: "table-scroller" }, [this.table]);
    this.more = element("p", { class: "muted", hidden: true });
    root.classList.add("list-table");
    root.append(this.scroller, this.more);
    this.redraw = scheduled(() => this.draw());
    this.scroller.addEventListener("scroll", this.redraw);
    new ResizeObserver(this.redraw).observe(this.scroller);
    this.body.addEventListener("click", (event) => this.click(event));
    this.body.addEventListener("keydown", (event) => this.key(event));
    this.makeHeads();
  }

  /** Show some of the rows, given in their usual order. */
  setShown(indices) {
    this.given = indices;
    this.arrange();
  }

  /** Make the row of heads. */
  makeHeads() {
    this.heads.replaceChildren(...this.columns.map((column) => this.head(column)));
    this.markHeads();
  }

  /** @returns {HTMLElement} head of a column, with the button that sorts by it on the screen */
  head(column) {
    const title = column.unit ? `${column.title} (${column.unit})` : column.title;
    const sort = button(title, () => this.sortBy(column.key), { title: column.hint || null });
    return element("th", {
      scope: "col", class: column.number ? "number" : null, data: { key: column.key },
    }, [this.printing ? title : sort]);
  }

  /** State in the heads by which column the rows are sorted. */
  markHeads() {
    for (const head of this.heads.children) {
      const sorted = head.dataset.key === this.sort.key;
      const way = this.sort.direction > 0 ? "ascending" : "descending";
      head.setAttribute("aria-sort", sorted ? way : "none");
    }
  }

  /**
   * Sort by a column; again: the other direction; a third time: the usual order.
   * @param {string|null} key null: the usual order
   */
  sortBy(key) {
    const column = this.columns.find((one) => one.key === key);
    if (this.sort.key !== key) this.sort = { key, direction: column ? column.first : 1 };
    else if (this.sort.direction === column.first) this.sort.direction = -column.first;
    else this.sort = { key: null, direction: 1 };
    this.arrange();
    const way = this.sort.direction > 0 ? "ascending" : "descending";
    announce(this.sort.key ? `Sorted by ${column.title}, ${way}` : "Worst first");
  }

  /** Sort the rows that are shown. */
  arrange() {
    const column = this.columns.find((one) => one.key === this.sort.key);
    this.shown = column ? this.sorted(column) : [...this.given];
    this.placeOf = new Map(this.shown.map((index, place) => [index, place]));
    this.markHeads();
    this.table.setAttribute("aria-rowcount", String(this.shown.length + 1));
    this.remake();
  }

  /** @returns {number[]} the rows in the order of a column; unknown values last */
  sorted(column) {
    const words = new Intl.Collator("en", { numeric: true });
    const values = this.rows.map((row) => column.order(row));
    const known = (value) => value !== null && value !== undefined;
    return [...this.given].sort((a, b) => {
      const [one, other] = [values[a], values[b]];
      if (!known(one) || !known(other)) return Number(known(other)) - Number(known(one));
      const way = typeof one === "string" ? words.compare(one, other) : one - other;
      return this.sort.direction * way;
    });
  }

  /** Make the rows in view again. */
  remake() {
    this.made = { first: -1, last: -1 };
    this.draw();
  }

  /** Make the rows in view, unless they exist. */
  draw() {
    const count = this.shown.length;
    const top = Math.max(0, this.scroller.scrollTop - this.heads.clientHeight);
    const high = this.scroller.clientHeight || 600;
    let first = Math.max(0, Math.floor(top / LIST_ROW_HEIGHT) - LIST_SPARE_ROWS);
    let last = Math.min(count, Math.ceil((top + high) / LIST_ROW_HEIGHT) + LIST_SPARE_ROWS);
    first = Math.min(first, Math.max(0, last - 1));
    if (this.printing) [first, last] = [0, Math.min(count, MOST_PRINTED_ROWS)];
    if (first === this.made.first && last === this.made.last) return;
    this.made = { first, last };
    const focused = this.body.contains(document.activeElement)
      ? document.activeElement.closest("tr[data-row]") : null;
    const kept = focused ? focused.dataset.row : null;
    const rows = this.shown.slice(first, last).map((index, i) => this.row(index, first + i));
    if (!count) {
      rows.push(element("tr", {}, [element("td", {
        text: this.empty, colspan: String(this.columns.length), class: "muted" })]));
    }
    this.body.replaceChildren(
      this.space(first), ...rows, this.space(this.printing ? 0 : count - last));
    this.more.hidden = !(this.printing && count > last);
    this.more.textContent = `... and ${formatCount(count - last)} more rows`;
    if (kept !== null) this.focusRow(kept);
    this.markRows();
  }

  /** @returns {HTMLElement} row that takes the room of others */
  space(rows) {
    const cell = element("td", { colspan: String(this.columns.length) });
    cell.style.height = `${rows * LIST_ROW_HEIGHT}px`;
    return element("tr", { class: "space", "aria-hidden": "true", hidden: rows <= 0 }, [cell]);
  }

  /** @returns {HTMLElement} a row */
  row(index, place) {
    const row = this.rows[index];
    return element("tr", {
      data: { row: String(index) }, tabindex: "-1", "aria-rowindex": String(place + 2),
    }, this.columns.map((column, number) => this.cell(column, row, number)));
  }

  /** @returns {HTMLElement} a cell; that of the first column is the head of its row */
  cell(column, row, number) {
    const text = column.text(row);
    const settings = {
      class: column.number ? "number" : null, title: text.length > 14 ? text : null,
    };
    const cell = number ? element("td", settings)
      : element("th", { ...settings, scope: "row" });
    cell.append(column.cell ? column.cell(row) : shortText(text, 200));
    return cell;
  }

  /** Show which row is active, and let Tab reach one row. */
  markRows() {
    const inView = [...this.body.querySelectorAll("tr[data-row]")];
    const place = this.placeOf.get(this.active);
    const active = place !== undefined && place >= this.made.first && place < this.made.last;
    const entry = active ? String(this.active) : inView.length ? inView[0].dataset.row : "";
    for (const row of inView) {
      const isActive = Number(row.dataset.row) === this.active;
      row.classList.toggle("active", isActive && !this.printing);
      row.setAttribute("aria-selected", String(isActive));
      row.tabIndex = row.dataset.row === entry ? 0 : -1;
    }
  }

  /** Make a row active, and bring it into view. */
  setActive(index, scrollTo = true) {
    this.active = index;
    const place = this.placeOf.get(index);
    if (scrollTo && place !== undefined) {
      const top = place * LIST_ROW_HEIGHT;
      const room = this.scroller.clientHeight - this.heads.clientHeight;
      if (top < this.scroller.scrollTop) this.scroller.scrollTop = top;
      else if (top + LIST_ROW_HEIGHT > this.scroller.scrollTop + room) {
        this.scroller.scrollTop = top + LIST_ROW_HEIGHT - room;
      }
      this.draw();
    }
    this.markRows();
  }

  /** Choose the row that was clicked; links in it stay links. */
  click(event) {
    const row = event.target.closest("tr[data-row]");
    if (!row || event.target.closest("a")) return;
    this.open(Number(row.dataset.row));
    row.focus({ preventScroll: true });
  }

  /** Move among the rows, and choose. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const row = event.target.closest("tr[data-row]");
    if (!row) return;
    const index = Number(row.dataset.row);
    const place = this.placeOf.get(index);
    const moves = {
      ArrowUp: place - 1, ArrowDown: place + 1, PageUp: place - LIST_PAGE_ROWS,
      PageDown: place + LIST_PAGE_ROWS, Home: 0, End: Infinity,
    };
    if (event.key in moves) {
      this.goTo(Math.max(0, Math.min(this.shown.length - 1, moves[event.key])));
    } else if ((event.key === "Enter" || event.key === " ") && event.target === row) {
      this.open(index);
    } else return;
    event.preventDefault();
  }

  /** Make the row at a place active, and put the focus on it. */
  goTo(place) {
    const index = this.shown[place];
    if (this.follow) this.follow(index);
    this.setActive(index);
    this.focusRow(index);
  }

  /** Put the focus on a row, if it is in view. */
  focusRow(index) {
    const row = this.body.querySelector(`tr[data-row="${index}"]`);
    if (row) row.focus({ preventScroll: true });
  }

  /** Print all rows, or show those in view again. */
  print(on) {
    this.printing = on;
    this.makeHeads();
    this.remake();
  }
}
