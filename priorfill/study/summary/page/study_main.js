/* Starts the page of a summary: reads the data, makes the views. */

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
  followTheme(() => store.emit("theme"), (on) => store.emit("print", on));
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

try {
  startStudyPage();
} catch (error) {
  showProblem(`Cannot show the summary: ${error.message}.`);
}
