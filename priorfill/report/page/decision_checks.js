/* Checks of decisions that come from files or forms, as `priorfill fill --overrides` makes them. */

/** Sources that a method may be limited to, besides patterns of clips. */
const SOURCE_KINDS = ["clip", "same-subject", "database"];
const SOURCE_PATTERN = "database:";

/**
 * Check a decision, and return it with its keys in order.
 * @param {Object} entry
 * @param {Object} data the page's data
 * @param {string} where start of the message, such as "line 3: gap 1"
 * @returns {Object}
 */
function checkedEntry(entry, data, where) {
  const fail = (what) => {
    throw new DecisionError(`${where}: ${what}`);
  };
  const unknown = Object.keys(entry).find((key) => !ENTRY_KEYS.includes(key));
  if (unknown !== undefined) {
    fail(`unknown key ${safeText(unknown)}; use ${ENTRY_KEYS.join(", ")}`);
  }
  checkMarkers(entry, data, fail);
  checkAction(entry, data, fail);
  checkFrames(entry, data, fail);
  const found = {
    marker: markersValue(entryPatterns(entry)),
    frames: framesValue(...parseFrames(entry.frames)),
    subject: entry.subject || undefined,
    do: (data.aliases || {})[entry.do] || entry.do,
    with: entry.with,
    donors: entry.donors && namesOf(entry.donors),
    sources: entry.sources && namesOf(entry.sources),
    options: flatOptions(entry.options || {}, "", fail),
    note: entry.note || undefined,
  };
  if (Object.keys(found.options).length === 0) found.options = undefined;
  return Object.fromEntries(Object.entries(found).filter(([, value]) => value !== undefined));
}

/**
 * Return options by dotted name, those of tables in place of the tables.
 * @param {Object} options
 * @param {string} prefix
 * @param {function(string)} fail
 * @returns {Object}
 */
function flatOptions(options, prefix, fail) {
  const flat = {};
  for (const key of Object.keys(options)) {
    const value = options[key];
    const name = prefix + key;
    const table = value !== null && typeof value === "object" && !Array.isArray(value);
    const found = table ? flatOptions(value, `${name}.`, fail) : { [name]: value };
    if (Array.isArray(value) && value.some((one) => typeof one === "object")) {
      fail(`option ${shortText(safeText(name))} is a list of lists or tables`);
    }
    for (const one of Object.keys(found)) {
      if (Object.hasOwn(flat, one)) fail(`option ${shortText(safeText(one))} is given twice`);
      Object.defineProperty(flat, one, { value: found[one], enumerable: true });
    }
  }
  return flat;
}

/**
 * Whether a value is a text or list of texts with at least one name.
 * @param {*} value
 * @returns {boolean}
 */
function hasNames(value) {
  const texts = typeof value === "string" ||
    (Array.isArray(value) && value.every((one) => typeof one === "string"));
  return texts && namesOf(value).length > 0;
}

/** Check markers, subject and the other marker of an exchange. */
function checkMarkers(entry, data, fail) {
  if (!hasNames(entry.marker)) fail("has no marker; give a label, a pattern, or a list of these");
  for (const key of ["subject", "note"]) {
    if (entry[key] !== undefined && typeof entry[key] !== "string") fail(`${key} is no text`);
  }
  const names = data.subjects.map((_, subject) => subjectName(data, subject));
  if (entry.subject && !names.includes(entry.subject)) {
    fail(`there is no subject ${safeText(entry.subject)}`);
  }
  for (const pattern of entryPatterns(entry)) {
    if (entryMarkers(data, { marker: [pattern], subject: entry.subject }).length === 0) {
      fail(`no marker is called ${shortText(safeText(pattern))}`);
    }
  }
}

/** Check the action, and what belongs to it. */
function checkAction(entry, data, fail) {
  const known = [...DO_NO_METHOD, ...data.methods, ...Object.keys(data.aliases || {})];
  if (typeof entry.do !== "string" || !known.includes(entry.do)) {
    fail(`do is ${safeText(entry.do === undefined ? "missing" : entry.do)}; ` +
      `use one of ${[...new Set(known)].join(", ")}`);
  }
  const swap = entry.do === DO_SWAP;
  if (swap && (typeof entry.with !== "string" || entry.with === "")) {
    fail('swap needs the other marker, as with = "RKNE"');
  }
  if (swap && entryPatterns(entry).length !== 1) {
    fail("swap exchanges two markers; write a table for each pair");
  }
  if (!swap && entry.with !== undefined) fail("only swap has the key with");
  if (swap) {
    const other = entryMarkers(data, { marker: [entry.with], subject: entry.subject });
    if (other.length === 0) fail(`no marker is called ${shortText(safeText(entry.with))}`);
  }
  const fills = !DO_NO_METHOD.includes(entry.do);
  for (const key of ["donors", "sources", "options"]) {
    if (entry[key] !== undefined && !fills) fail(`only fills by a method have ${key}`);
  }
  if (entry.donors !== undefined) checkDonors(entry, data, fail);
  if (entry.sources !== undefined) checkSources(entry, fail);
  const { options } = entry;
  if (options !== undefined && (typeof options !== "object" || Array.isArray(options))) {
    fail("options are no table; write options = { name = value }");
  }
}

/** Check donor markers. */
function checkDonors(entry, data, fail) {
  if (!hasNames(entry.donors)) fail("donors are no list of labels");
  for (const label of namesOf(entry.donors)) {
    if (entryMarkers(data, { marker: [label], subject: entry.subject }).length === 0) {
      fail(`no marker is called ${shortText(safeText(label))} (donors)`);
    }
  }
}

/** Check sources. */
function checkSources(entry, fail) {
  const known = (one) => SOURCE_KINDS.includes(one) ||
    (one.startsWith(SOURCE_PATTERN) && one.length > SOURCE_PATTERN.length);
  if (!hasNames(entry.sources) || !namesOf(entry.sources).every(known)) {
    fail(`sources are no list of ${SOURCE_KINDS.join(", ")} and database:PATTERN`);
  }
}

/** Check that the frames are the clip's. */
function checkFrames(entry, data, fail) {
  let span;
  try {
    span = entrySpan(data, entry);
  } catch (error) {
    fail(error.message);
  }
  const first = data.clip.first_frame;
  const last = first + data.clip.frames - 1;
  if (span[0] < 0 || span[0] >= span[1] || span[1] > data.clip.frames) {
    fail(`${entryFramesText(entry)} are not all in the clip, which has ${first}-${last}`);
  }
}
