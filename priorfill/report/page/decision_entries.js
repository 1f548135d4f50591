/* Single decisions: tables [[gap]] of a file of overrides, as objects with the same keys. */

/** Keys of a decision, in the order in which they are written. */
const ENTRY_KEYS = [
  "marker", "frames", "subject", "do", "with", "donors", "sources", "options", "note",
];

/** Actions other than methods. */
const DO_ACCEPT = "accept";
const DO_LEAVE = "leave";
const DO_MISSING = "missing";
const DO_SWAP = "swap";
const DO_NO_METHOD = [DO_ACCEPT, DO_LEAVE, DO_MISSING, DO_SWAP];

/** Frames as text: first and last with - or : between them, either of which may be left out. */
const FRAMES_RANGE = /^\s*(-?\d{1,10})?\s*[-:\u2013]\s*(-?\d{1,10})?\s*$/;
const FRAMES_SINGLE = /^\s*(\d{1,10})\s*$/;
const FRAMES_AMBIGUOUS = /^\s*[-\u2013]\s*\d{1,10}\s*$/;

/** Blanks around names, as Python has them; a label may begin with U+FEFF, which is none. */
const OUTER_BLANKS = /^(?:(?!\ufeff)[\s\x1c-\x1f\x85])+|(?:(?!\ufeff)[\s\x1c-\x1f\x85])+$/g;

/** Characters shown as escape sequences: controls, formats, separators, half characters. */
const HIDDEN_CHARACTERS = /\p{Cc}|\p{Cf}|\p{Zl}|\p{Zp}|\p{Cs}|\p{Co}|\p{Cn}/gu;

/**
 * Make a text visible in one line: invisible characters become escape sequences.
 * @param {*} text
 * @returns {string}
 */
function safeText(text) {
  const short = { "\t": "\\t", "\n": "\\n", "\r": "\\r" };
  return String(text).replace(HIDDEN_CHARACTERS, (found) => {
    if (short[found] !== undefined) return short[found];
    const code = found.codePointAt(0).toString(16);
    if (code.length <= 2) return `\\x${code.padStart(2, "0")}`;
    return code.length <= 4 ? `\\u${code.padStart(4, "0")}` : `\\U${code.padStart(8, "0")}`;
  });
}

/**
 * Read the frames of a decision.
 * @param {string|number|undefined} value
 * @returns {Array} first and last frame as the file numbers them; null: the clip's own end
 */
function parseFrames(value) {
  if (value === undefined) return [null, null];
  if (typeof value === "number") {
    if (!Number.isInteger(value)) throw new DecisionError(`frames are ${value}; write 92-116`);
    return [value, value];
  }
  const text = String(value);
  const single = FRAMES_SINGLE.exec(text);
  if (single !== null) return [Number(single[1]), Number(single[1])];
  const found = FRAMES_AMBIGUOUS.test(text) ? null : FRAMES_RANGE.exec(text);
  if (typeof value !== "string" || found === null || /^\s*[-\u2013]\s*$/.test(text)) {
    throw new DecisionError(
      `frames ${safeText(JSON.stringify(value))} are no range; write 92-116 or 92:116`);
  }
  const [first, last] = [found[1], found[2]].map((one) => (one === undefined ? null : Number(one)));
  if (first !== null && last !== null && first > last) {
    throw new DecisionError(`frames ${first}-${last}: the first is after the last`);
  }
  return [first, last];
}

/**
 * Write frames as a decision has them.
 * @param {number|null} first
 * @param {number|null} last as the file numbers them, inclusive; null: the clip's own end
 * @returns {string|number|undefined} undefined for all frames
 */
function framesValue(first, last) {
  if (first === null && last === null) return undefined;
  if (first === last) return first;
  const colon = first === null || last === null || first < 0 || last < 0;
  return [first, last].map((end) => (end === null ? "" : String(end))).join(colon ? ":" : "-");
}

/**
 * Write labels as a decision has them: a single text, or a list.
 * @param {string[]} labels
 * @returns {string|string[]}
 */
function markersValue(labels) {
  const alone = labels.length === 1 && labels[0] !== "" && !labels[0].includes(",") &&
    labels[0].replace(OUTER_BLANKS, "") === labels[0];
  return alone ? labels[0] : labels;
}

/**
 * Return the names of a text with commas, or of a list.
 * @param {string|string[]} value
 * @returns {string[]} each once
 */
function namesOf(value) {
  const names = Array.isArray(value) ? value :
    value.split(",").map((name) => name.replace(OUTER_BLANKS, "")).filter((name) => name !== "");
  return [...new Set(names)];
}

/**
 * Return the labels or patterns of a decision.
 * @param {Object} entry
 * @returns {string[]}
 */
function entryPatterns(entry) {
  return namesOf(entry.marker);
}

/**
 * Turn a shell pattern (* ? [abc] [!abc]) into a regular expression.
 * @param {string} pattern in lower case
 * @returns {RegExp}
 */
function patternExpression(pattern) {
  const source = pattern.replace(/\[(!?)(\]?[^\]]*)\]|[\s\S]/g, (part, not, inside) => {
    if (inside !== undefined) {
      return `[${not ? "^" : ""}${inside.replace(/[\\\]^[]/g, "\\$&")}]`;
    }
    if (part === "*") return "[\\s\\S]*";
    return part === "?" ? "[\\s\\S]" : part.replace(/[\\^$.*+?()[\]{}|/]/g, "\\$&");
  });
  try {
    return new RegExp(`^${source}$`);
  } catch {
    return /^(?!)/; // such as [z-a], which matches nothing
  }
}

/**
 * Return the raw name of a subject.
 * @param {Object} data
 * @param {number} subject index
 * @returns {string}
 */
function subjectName(data, subject) {
  return (data.subjects_raw || data.subjects)[subject] || "";
}

/**
 * Return the label of a marker as its file has it.
 * @param {Object} marker of the page's data
 * @returns {string} without the subject
 */
function ownLabel(marker) {
  return marker.own_raw === undefined ? marker.own : marker.own_raw;
}

/**
 * Find the markers of one subject that a label or pattern means; an equal label goes first.
 * @param {Object} data
 * @param {number} subject index
 * @param {string} pattern
 * @returns {number[]} indices of markers
 */
function matchingMarkers(data, subject, pattern) {
  const name = subjectName(data, subject);
  const known = [];
  data.markers.forEach((marker, index) => {
    if (marker.subject === subject) {
      const own = ownLabel(marker);
      known.push([index, own, `${name}:${own}`]);
    }
  });
  const equal = known.filter(([, own, full]) => own === pattern || full === pattern);
  if (equal.length > 0) return equal.map(([index]) => index);
  const expression = patternExpression(pattern.toLowerCase());
  return known
    .filter(([, ...names]) => names.some((one) => expression.test(one.toLowerCase())))
    .map(([index]) => index);
}

/**
 * Find the markers of a decision.
 * @param {Object} data
 * @param {Object} entry
 * @returns {number[]} indices, in the order of the markers
 */
function entryMarkers(data, entry) {
  const found = new Set();
  data.subjects.forEach((_, subject) => {
    if ((entry.subject || "") !== "" && subjectName(data, subject) !== entry.subject) return;
    for (const pattern of entryPatterns(entry)) {
      for (const marker of matchingMarkers(data, subject, pattern)) found.add(marker);
    }
  });
  return [...found].sort((a, b) => a - b);
}

/**
 * Find the frames of a decision.
 * @param {Object} data
 * @param {Object} entry
 * @returns {number[]} start and stop, counted from 0, stop exclusive
 */
function entrySpan(data, entry) {
  const [first, last] = parseFrames(entry.frames);
  const base = data.clip.first_frame;
  return [first === null ? 0 : first - base, last === null ? data.clip.frames : last - base + 1];
}

/** Markers and frames that were found for decisions, which are never changed. */
const entryScopeMemo = new WeakMap();

/**
 * Find the samples of a decision.
 * @param {Object} data
 * @param {Object} entry
 * @returns {{markers: Set, start: number, stop: number}} indices; frames from 0, stop exclusive
 */
function entryScope(data, entry) {
  const known = entryScopeMemo.get(entry);
  if (known !== undefined && known.data === data) return known.scope;
  const [start, stop] = entrySpan(data, entry);
  const scope = { markers: new Set(entryMarkers(data, entry)), start, stop };
  entryScopeMemo.set(entry, { data, scope });
  return scope;
}

/**
 * Return the rank of a decision: exchanges come first, then wrong samples, then fills.
 * @param {Object} entry
 * @returns {number}
 */
function entryRank(entry) {
  return entry.do === DO_SWAP ? 0 : entry.do === DO_MISSING ? 1 : 2;
}

/**
 * Return a text that is equal for decisions with the same effect.
 * @param {Object} entry
 * @returns {string} empty for decisions that change no value
 */
function entryEffect(entry) {
  if (entry.do === DO_ACCEPT) return "";
  const kept = ENTRY_KEYS.filter((key) => key !== "note" && entry[key] !== undefined);
  return JSON.stringify(kept.map((key) => [key, entry[key]]));
}

/**
 * Return the markers of a decision as text to show.
 * @param {Object} data
 * @param {Object} entry
 * @returns {string} labels, at most four
 */
function entryMarkersText(data, entry) {
  const shown = entryPatterns(entry).slice(0, 4).map((name) => shortText(safeText(name), 40));
  const more = entryPatterns(entry).length - shown.length;
  const subject = entry.subject ? `${shortText(safeText(entry.subject), 30)}: ` : "";
  return subject + shown.join(", ") + (more > 0 ? ` and ${more} more` : "");
}

/**
 * Return the frames of a decision as text to show.
 * @param {Object} entry
 * @returns {string}
 */
function entryFramesText(entry) {
  const [first, last] = parseFrames(entry.frames);
  if (first === null && last === null) return "all frames";
  if (first === last) return `frame ${first}`;
  if (first === null) return `frames up to ${last}`;
  return last === null ? `frames from ${first}` : `frames ${first}–${last}`;
}

/**
 * Return what a decision does, as text to show.
 * @param {Object} entry
 * @returns {string}
 */
function entryActionText(entry) {
  if (entry.do === DO_ACCEPT) return "accepted";
  if (entry.do === DO_LEAVE) return "refused: stays missing";
  if (entry.do === DO_MISSING) return "measured samples are wrong";
  if (entry.do === DO_SWAP) return `labels exchanged with ${shortText(safeText(entry.with), 40)}`;
  const details = [];
  if (entry.donors) details.push(`donors ${entry.donors.slice(0, 6).map(safeText).join(", ")}` +
    (entry.donors.length > 6 ? ` and ${entry.donors.length - 6} more` : ""));
  if (entry.sources) details.push(`from ${entry.sources.slice(0, 4).map(safeText).join(", ")}` +
    (entry.sources.length > 4 ? ` and ${entry.sources.length - 4} more` : ""));
  for (const name of Object.keys(entry.options || {})) {
    details.push(`${safeText(name)} = ${safeText(entry.options[name])}`);
  }
  const more = details.length > 0 ? ` (${shortText(details.join("; "), 200)})` : "";
  return `fill by ${safeText(entry.do)}${more}`;
}
