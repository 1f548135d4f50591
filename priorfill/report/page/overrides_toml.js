/* The file of decisions, overrides.toml: what `priorfill fill --overrides` reads. */

/** Comment at the top of an exported file. */
const OVERRIDES_HEADER = "# Decisions on gaps, for priorfill fill --overrides\n";

/** Order of the keys in a file. */
const MADE_FOR_KEYS = ["file", "sha256", "method", "database"];

/** Largest file that `priorfill fill --overrides` reads, bytes. */
const OVERRIDES_MAX_BYTES = 4 << 20;

/**
 * Write decisions as the text of a file of overrides.
 * @param {Object} madeFor texts: file, sha256, method, database; those that are empty are left out
 * @param {Object[]} entries decisions, in order
 * @returns {string}
 */
function writeOverrides(madeFor, entries) {
  const known = Object.create(null);
  for (const key of MADE_FOR_KEYS) {
    if (typeof madeFor[key] === "string" && madeFor[key] !== "") {
      known[key] = madeFor[key];
    }
  }
  const tables = entries.map((entry) => tomlTable("[[gap]]", entry, ENTRY_KEYS));
  if (Object.keys(known).length > 0) {
    tables.unshift(tomlTable("[made_for]", known, MADE_FOR_KEYS));
  }
  const text = OVERRIDES_HEADER + tables.map((table) => `\n${table}`).join("");
  const bytes = new TextEncoder().encode(text).length;
  if (bytes > OVERRIDES_MAX_BYTES) {
    throw new DecisionError(
      `the decisions take ${Math.ceil(bytes / 1024)} KiB, and a file may have ` +
        `${OVERRIDES_MAX_BYTES / 1024} KiB; delete some that accept a gap`);
  }
  return text;
}

/**
 * Read a file of overrides.
 * @param {string} text
 * @param {Object} data the page's data, against which markers, frames and methods are checked
 * @returns {{madeFor: Object, entries: Object[]}}
 */
function readOverridesFile(text, data) {
  const reader = new TomlReader(text);
  const root = reader.read(openOverridesTable);
  const madeFor = root.made_for || Object.create(null);
  for (const key of Object.keys(madeFor)) {
    if (!MADE_FOR_KEYS.includes(key) || typeof madeFor[key] !== "string") {
      throw new DecisionError(
        `line ${reader.lines.get(madeFor)}: made_for has ${safeText(key)}; it may have the texts ` +
          `${MADE_FOR_KEYS.join(", ")}`);
    }
  }
  const tables = root.gap || [];
  const entries = tables.map((entry, index) => {
    const where = `line ${reader.lines.get(entry)}: gap ${index + 1}`;
    return checkedEntry(entry, data, where);
  });
  return { madeFor, entries };
}

/**
 * Open the table of a header in a file of overrides.
 * @param {string} header
 * @param {Object} root
 * @returns {Object|null} the table; null if there is none like it
 */
function openOverridesTable(header, root) {
  const table = Object.create(null);
  if (header === "[[gap]]" && (root.gap === undefined || Array.isArray(root.gap))) {
    root.gap = [...(root.gap || []), table];
    return table;
  }
  if (header === "[made_for]" && root.made_for === undefined) {
    root.made_for = table;
    return table;
  }
  const last = Array.isArray(root.gap) ? root.gap[root.gap.length - 1] : undefined;
  if (header === "[gap.options]" && last !== undefined && last.options === undefined) {
    last.options = table;
    return table;
  }
  return null;
}
