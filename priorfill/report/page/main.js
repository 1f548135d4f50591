/* Starts the page: reads the data, makes the views, decodes. */

/** Build the page. */
function startPage() {
  const data = JSON.parse(document.getElementById("priorfill-data").textContent);
  const store = new Store(data);
  const views = {
    summary: new Summary(document.getElementById("summary"), store),
    timeline: new Timeline(document.getElementById("timeline"), store),
    table: new GapTable(document.getElementById("gap-table"), store),
    detail: new GapDetail(document.getElementById("gap-detail"), store),
    body: new BodyPlayer(document.getElementById("body"), store),
    curves: new Curves(document.getElementById("curves"), store),
    decisions: new Decisions(document.getElementById("decisions"), store),
  };
  new Keyboard(store, views);
  followTheme(
    () => store.emit("theme"),
    (on) => {
      store.emit("print", on); // the table shows all rows
      for (const view of Object.values(views)) if (view.draw) view.draw();
    },
    "t",
  );
  window.priorfill = { store, views };
  store.decode().catch((error) => showProblem(`Cannot show the positions: ${error.message}.`));
  const worst = data.gaps.findIndex((gap) => gap.badness === 0);
  store.setActiveGap(worst, { scrollTo: false });
}

try {
  startPage();
} catch (error) {
  showProblem(`Cannot show the report: ${error.message}.`);
}
