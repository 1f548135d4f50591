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
  followTheme(store, views);
  window.priorfill = { store, views };
  store.decode().catch((error) => showProblem(`Cannot show the positions: ${error.message}.`));
  const worst = data.gaps.findIndex((gap) => gap.badness === 0);
  store.setActiveGap(worst, { scrollTo: false });
}

/**
 * Switch between light and dark, by the system or the button.
 * @param {Store} store
 * @param {Object} views
 */
function followTheme(store, views) {
  const root = document.documentElement;
  const toggle = document.getElementById("theme");
  const system = matchMedia("(prefers-color-scheme: dark)");
  const refresh = () => {
    forgetColours();
    const dark = colours().dark;
    toggle.textContent = dark ? "Light" : "Dark";
    toggle.title = dark ? "Light colours (t)" : "Dark colours (t)";
    store.emit("theme");
  };
  toggle.addEventListener("click", () => {
    root.dataset.theme = colours().dark ? "light" : "dark";
    refresh();
  });
  system.addEventListener("change", refresh);
  followPrinting(store, views, refresh);
  refresh();
}

/**
 * Print in light colours, as wide as the paper, all rows of the table.
 * @param {Store} store
 * @param {Object} views
 * @param {function} refresh reads the colours again
 */
function followPrinting(store, views, refresh) {
  const root = document.documentElement;
  let screenTheme = null;
  const print = (on) => {
    if (on === (screenTheme !== null)) return;
    const theme = on ? "light" : screenTheme;
    screenTheme = on ? root.dataset.theme || "" : null;
    if (theme) root.dataset.theme = theme;
    else delete root.dataset.theme;
    root.classList.toggle("printing", on);
    refresh();
    store.emit("print", on);
    for (const view of Object.values(views)) if (view.draw) view.draw();
  };
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
}

try {
  startPage();
} catch (error) {
  showProblem(`Cannot show the report: ${error.message}.`);
}
