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
 * Switch between light and dark, by the system or the button; print in light.
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
  let screenTheme;
  const drawAll = () => {
    for (const view of Object.values(views)) if (view.draw) view.draw();
  };
  window.addEventListener("beforeprint", () => {
    screenTheme = root.dataset.theme;
    root.dataset.theme = "light";
    refresh();
    store.emit("print", true);
    drawAll();
  });
  window.addEventListener("afterprint", () => {
    if (screenTheme) root.dataset.theme = screenTheme;
    else delete root.dataset.theme;
    refresh();
    store.emit("print", false);
    drawAll();
  });
  refresh();
}

try {
  startPage();
} catch (error) {
  showProblem(`Cannot show the report: ${error.message}.`);
}
