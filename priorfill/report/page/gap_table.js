/* The gaps as a table, worst first. Only the rows in view exist, so thousands are quick. */

/** Height (px) of a row; page.css has the same. */
const TABLE_ROW_HEIGHT = 26;

/** Rows made above and below those in view. */
const SPARE_ROWS = 8;

/** Expected mean error (mm) below which "Choose" chooses gaps, at first. */
const USUAL_LIMIT_MM = 10;

/** Width (characters) that a column needs at most. */
const WIDEST_COLUMN = 18;

class GapTable {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.store = store;
    this.root = root;
    this.sort = { key: null, direction: 1 };
    this.printing = false;
    this.made = { first: -1, last: -1 };
    this.redraw = scheduled(() => this.draw());
    this.input = new GapTableInput(this);
    this.build();
    this.fill();
    this.listen();
    store.listed = () => this.shown;
  }

  /** Make the elements around the rows. */
  build() {
    this.count = element("span", { class: "muted", "aria-live": "polite" });
    this.filter = element("input", {
      type: "search", name: "filter", placeholder: "marker, method, source …", size: "18",
      on: { input: () => this.arrange() },
    });
    this.warned = element("input", {
      type: "checkbox", name: "warnings-only", on: { change: () => this.arrange() },
    });
    this.limit = element("input", {
      type: "number", name: "limit", min: "0", step: "any", value: String(USUAL_LIMIT_MM),
      "aria-label": "Expected error in mm", class: "short",
      on: { keydown: (event) => { if (event.key === "Enter") this.input.chooseBelow(); } },
    });
    this.rows = element("tbody");
    this.heads = element("tr");
    this.table = element("table", {
      role: "grid", "aria-label": "Gaps", "aria-multiselectable": "true",
    }, [element("thead", {}, [this.heads]), this.rows]);
    this.scroller = element("div", { class: "table-scroller" }, [this.table]);
    this.root.append(
      element("div", { class: "panel-head" }, [
        element("h2", { text: "Gaps" }), this.count,
        element("label", {}, ["Filter ", this.filter]),
        element("label", {}, [this.warned, " Warnings only"]),
        button("Worst first", () => this.sortBy(null), { title: "Sort as at first" }),
      ]),
      this.scroller,
      element("div", { class: "panel-foot" }, [
        element("span", { class: "group", role: "group", "aria-label": "Choose several gaps" }, [
          button("Choose", () => this.input.chooseBelow(), { class: "choose-below" }),
          "all with expected error below", this.limit, "mm",
        ]),
        button("Choose none", () => this.store.setChosenGaps([]), { class: "choose-none" }),
        this.chosen = element("span", { class: "muted", "aria-live": "polite" }),
      ]));
  }

  /** React to the store and to the user. */
  listen() {
    const { store } = this;
    store.on("data", () => this.fill());
    store.on("gap", ({ scrollTo }) => this.showGap(scrollTo));
    store.on("decisions", () => this.remake());
    store.on("theme", () => this.remake());
    store.on("print", (on) => {
      this.printing = on;
      this.makeHeads();
      this.remake();
    });
    this.scroller.addEventListener("scroll", this.redraw);
    new ResizeObserver(this.redraw).observe(this.scroller);
    this.input.listen(this.rows);
  }

  /** Take the gaps of the store: columns, then rows. */
  fill() {
    this.columns = gapColumns(this.store);
    if (!this.columns.some((column) => column.key === this.sort.key)) this.sort.key = null;
    this.box = element("input", {
      type: "checkbox", name: "choose-shown", "aria-label": "Choose all gaps shown",
      on: { change: () => this.input.chooseShown() },
    });
    this.makeHeads();
    this.arrange();
  }

  /** Make the row of heads. */
  makeHeads() {
    this.heads.replaceChildren(
      element("th", { scope: "col", class: "col-choose" }, [this.box]),
      ...this.columns.map((column) => this.head(column)));
    this.markHeads();
  }

  /** State in the heads by which column the rows are sorted. */
  markHeads() {
    for (const head of this.heads.children) {
      const sorted = head.dataset.key && head.dataset.key === this.sort.key;
      const way = this.sort.direction > 0 ? "ascending" : "descending";
      if (head.dataset.key) head.setAttribute("aria-sort", sorted ? way : "none");
    }
  }

  /** @returns {HTMLElement} head of a column, with the button that sorts by it on the screen */
  head(column) {
    const title = column.unit ? `${column.title} (${column.unit})` : column.title;
    const sort = button(title, () => this.sortBy(column.key), { title: column.hint || null });
    // a browser that prints repeats heads on each page, but not the text of their buttons
    const made = element("th", {
      scope: "col", class: `col-${column.key}`, data: { key: column.key }, "aria-sort": "none",
    }, [this.printing ? title : sort]);
    // rows that are out of view widen a column as well, so that it keeps its width
    const longest = this.store.data.gaps.reduce(
      (most, gap) => Math.max(most, column.text(gap).length), 0);
    made.style.minWidth = `${Math.min(WIDEST_COLUMN, longest)}ch`;
    return made;
  }

  /**
   * Sort by a column; again: the other direction.
   * @param {string|null} key null: worst first
   */
  sortBy(key) {
    const column = this.columns.find((one) => one.key === key);
    const again = this.sort.key === key;
    this.sort = { key, direction: again ? -this.sort.direction : column ? column.first : 1 };
    this.arrange();
    const way = this.sort.direction > 0 ? "ascending" : "descending";
    announce(column ? `Sorted by ${column.title}, ${way}` : "Worst first");
  }

  /** Sort and filter. */
  arrange() {
    const { gaps } = this.store.data;
    const column = this.columns.find((one) => one.key === this.sort.key) || null;
    const words = this.filter.value.toLowerCase().split(/\s+/).filter((word) => word);
    this.shown = sortedGaps(gaps, column, this.sort.direction).filter((index) =>
      (!this.warned.checked || gaps[index].warnings.length) &&
      (!words.length || gapFits(this.store, this.columns, index, words)));
    this.placeOf = new Map(this.shown.map((index, place) => [index, place]));
    this.markHeads();
    this.count.textContent = this.shown.length === gaps.length
      ? countOf(gaps.length, "gap")
      : `${formatCount(this.shown.length)} of ${formatCount(gaps.length)} gaps`;
    this.table.setAttribute("aria-rowcount", String(this.shown.length + 1));
    this.remake();
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
    const high = this.scroller.clientHeight || 400;
    let first = Math.max(0, Math.floor(top / TABLE_ROW_HEIGHT) - SPARE_ROWS);
    let last = Math.min(count, Math.ceil((top + high) / TABLE_ROW_HEIGHT) + SPARE_ROWS);
    first = Math.min(first, Math.max(0, last - 1));
    if (this.printing) [first, last] = [0, count];
    if (first === this.made.first && last === this.made.last) return;
    this.made = { first, last };
    const focused = this.rows.contains(document.activeElement)
      ? document.activeElement.closest("tr[data-gap]") : null;
    const gap = focused ? focused.dataset.gap : null;
    const rows = [];
    for (let place = first; place < last; place++) rows.push(this.row(place));
    if (!count) {
      const text = this.store.data.gaps.length ? "No gap fits the filter." : "There are no gaps.";
      rows.push(element("tr", {}, [
        element("td", { text, colspan: String(this.columns.length + 1), class: "muted" })]));
    }
    this.rows.replaceChildren(
      this.space(first), ...rows, this.space(this.printing ? 0 : count - last));
    if (gap !== null) {
      const again = this.rows.querySelector(`tr[data-gap="${gap}"]`);
      if (again) again.focus({ preventScroll: true });
    }
    this.markRows();
  }

  /** @returns {HTMLElement} row that takes the room of others */
  space(rows) {
    const cell = element("td", { colspan: String(this.columns.length + 1) });
    cell.style.height = `${rows * TABLE_ROW_HEIGHT}px`;
    return element("tr", { class: "space", "aria-hidden": "true", hidden: rows <= 0 }, [cell]);
  }

  /** @returns {HTMLElement} row of a gap */
  row(place) {
    const index = this.shown[place];
    const gap = this.store.data.gaps[index];
    const choose = element("input", {
      type: "checkbox", tabindex: "-1", "aria-label": `Choose ${this.store.gapName(index)}`,
    });
    return element("tr", {
      data: { gap: String(index) }, tabindex: "-1", "aria-rowindex": String(place + 2),
    }, [
      element("td", { class: "col-choose" }, [choose]),
      ...this.columns.map((column) => this.cell(column, gap, index)),
    ]);
  }

  /** @returns {HTMLElement} cell of a gap */
  cell(column, gap, index) {
    const text = column.text(gap);
    const cell = element("td", {
      class: column.number ? "number" : null,
      title: text.length > 12 ? text : null,
    });
    if (column.warnings) {
      for (const warning of gap.warnings) {
        cell.append(element("span", {
          class: "warning", text: warningName(warning.kind), title: warning.text,
        }), this.printing ? ` ${warning.text} ` : " ");
      }
      return cell;
    }
    cell.textContent = shortText(text, 200);
    if (column.errors && gap.expected_mean !== null) {
      const swatch = element("span", { class: "error-swatch", "aria-hidden": "true" });
      swatch.style.background = errorColour(gap.expected_rms); // as on the timeline
      cell.prepend(swatch);
    }
    if (column.key === "filled" && gap.filled < gap.stop - gap.start && gap.requested) {
      cell.classList.add("incomplete");
    }
    if (column.key === "marker") this.addSigns(cell, gap, index);
    return cell;
  }

  /** Put the subject before a marker, and the sign of a decision after it. */
  addSigns(cell, gap, index) {
    const { subjects, markers } = this.store.data;
    if (subjects.length > 1) {
      const name = subjects[markers[gap.marker].subject];
      if (!markers[gap.marker].label.startsWith(name)) {
        cell.prepend(element("span", { class: "muted", text: `${shortText(name, 16)}: ` }));
      }
    }
    const decision = decisionOfGap(this.store, index);
    if (decision) {
      cell.append(element("span", {
        class: "sign", text: ` ${decision.sign}`, title: decision.text,
        "aria-label": decision.text, role: "img",
      }));
    }
  }

  /** Show which rows are active and chosen. */
  markRows() {
    const { activeGap, chosenGaps } = this.store;
    const inView = [...this.rows.querySelectorAll("tr[data-gap]")];
    const place = this.placeOf.get(activeGap);
    const { first, last } = this.made;
    const entry = place !== undefined && place >= first && place < last
      ? activeGap : Number(inView.length ? inView[0].dataset.gap : -1);
    for (const row of inView) {
      const index = Number(row.dataset.gap);
      const chosen = chosenGaps.has(index);
      row.classList.toggle("active", index === activeGap);
      row.setAttribute("aria-current", String(index === activeGap));
      row.setAttribute("aria-selected", String(chosen));
      row.querySelector("input").checked = chosen;
      row.tabIndex = index === entry ? 0 : -1;
    }
    const shown = this.shown.filter((index) => chosenGaps.has(index)).length;
    this.box.checked = shown > 0 && shown === this.shown.length;
    this.box.indeterminate = shown > 0 && shown < this.shown.length;
    const many = chosenGaps.size;
    this.chosen.textContent = many === 0 ? "" : `${formatCount(many)} chosen`;
  }

  /** Bring the active gap into view, and mark the rows. */
  showGap(scrollTo) {
    const place = this.placeOf.get(this.store.activeGap);
    if (scrollTo && place !== undefined) {
      const head = this.heads.clientHeight;
      const top = place * TABLE_ROW_HEIGHT;
      const room = this.scroller.clientHeight - head;
      if (top < this.scroller.scrollTop) this.scroller.scrollTop = top;
      else if (top + TABLE_ROW_HEIGHT > this.scroller.scrollTop + room) {
        this.scroller.scrollTop = top + TABLE_ROW_HEIGHT - room;
      }
      this.draw();
    }
    this.markRows();
  }
}
