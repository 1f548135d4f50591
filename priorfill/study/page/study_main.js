/* Starts the page of a summary: reads the data, makes the views, light and dark, paper. */

/** Build the page. */
function startStudyPage() {
  const data = JSON.parse(document.getElementById("priorfill-data").textContent);
  const store = new StudyStore(data);
  const place = (name) => document.getElementById(name);
  document.getElementById("title").textContent = data.study;
  new StudyHeadline(place("headline"), store);
  new AttentionLists(place("attention"), store);
  const trials = new TrialTable(place("trials"), store);
  new TrialDetail(place("trial"), store);
  const map = new MarkerMap(place("marker-map"), store);
  listMarkers(place("markers"), store);
  listParts(place("folders"), store, "folder");
  if (data.subjects.length > 1) listParts(place("subjects"), store, "subject");
  else place("subjects").parentElement.hidden = true;
  followStudyTheme(store);
  window.priorfill = { store, views: { trials, map } };
  if (data.trials.length) store.setActive(0, { scrollTo: false });
}

/** Show the trials of a folder, subject or marker, in the table that is above its row. */
function chooseBelow(store, name, index) {
  store.choose(name, index);
  document.getElementById("trials").scrollIntoView({ block: "start" });
  announce(`${countOf(store.shownTrials().length, "trial")} shown`);
}

/** Make the table of markers. */
function listMarkers(root, store) {
  const { markers } = store.data;
  root.append(element("div", { class: "panel-head" }, [
    element("h2", { text: "Markers" }),
    element("span", { class: "muted", text: `${countOf(markers.length, "marker")} with gaps; ` +
      "a row shows its trials in the table above" })]));
  const list = new ListTable(root, {
    label: "Markers", columns: markerColumns(store), rows: markers,
    open: (index) => chooseBelow(store, "marker", index), empty: "No marker has gaps.",
  });
  store.on("filter", () => list.setActive(store.marker, false));
  store.on("print", (on) => list.print(on));
}

/** Make the table of folders or subjects. */
function listParts(root, store, kind) {
  const others = { folder: "subject", subject: "folder" }[kind];
  const parts = store.data[`${kind}s`];
  const title = (text) => text[0].toUpperCase() + text.slice(1);
  root.append(element("div", { class: "panel-head" }, [
    element("h2", { text: title(`${kind}s`) }),
    element("span", { class: "muted", text: `${countOf(parts.length, kind)}; a row shows ` +
      "its trials in the table above" })]));
  const list = new ListTable(root, {
    label: title(`${kind}s`), columns: partColumns(title(kind), title(`${others}s`)), rows: parts,
    open: (index) => chooseBelow(store, kind, index), empty: `There are no ${kind}s.`,
  });
  store.on("filter", () => list.setActive(store[kind], false));
  store.on("print", (on) => list.print(on));
}

/**
 * Switch between light and dark, by the system or the button.
 * @param {StudyStore} store
 */
function followStudyTheme(store) {
  const root = document.documentElement;
  const toggle = document.getElementById("theme");
  const refresh = () => {
    forgetColours();
    const { dark } = colours();
    toggle.textContent = dark ? "Light" : "Dark";
    toggle.title = dark ? "Light colours" : "Dark colours";
    store.emit("theme");
  };
  toggle.addEventListener("click", () => {
    root.dataset.theme = colours().dark ? "light" : "dark";
    refresh();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", refresh);
  followStudyPrinting(store, refresh);
  refresh();
}

/**
 * Print in light colours, as wide as the paper, all rows.
 * @param {StudyStore} store
 * @param {function} refresh reads the colours again
 */
function followStudyPrinting(store, refresh) {
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
  };
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
}

try {
  startStudyPage();
} catch (error) {
  showProblem(`Cannot show the summary: ${error.message}.`);
}
