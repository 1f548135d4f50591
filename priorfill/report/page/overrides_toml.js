/* The file of decisions, overrides.toml: what `priorfill fill --overrides` reads. */

/** What a file may tell about the fill that it was made for, all texts. */
const MADE_FOR_KEYS = ["file", "sha256", "method", "database"];

/** Largest file that `priorfill fill --overrides` reads, bytes. */
const OVERRIDES_MAX_BYTES = 4 << 20;

/**
 * Write decisions as the text of a file of overrides.
 * @param {Object} madeFor texts: file, sha256, method, database
 * @param {Object[]} entries decisions, in order
 * @returns {string}
 */
function writeOverrides(madeFor, entries) {
  const known = Object.create(null);
  for (const key of MADE_FOR_KEYS) {
    if (typeof madeFor[key] === "string") known[key] = madeFor[key];
  }
  const tables = entries.map((entry) => {
    const { options, ...rest } = entry;
    const ordered = Object.fromEntries(
      ENTRY_KEYS.filter((key) => rest[key] !== undefined).map((key) => [key, rest[key]]));
    const table = tomlTable("[[gap]]", ordered);
    return options === undefined ? table : table + tomlTable("[gap.options]", options);
  });
  if (Object.keys(known).length > 0) tables.unshift(tomlTable("[made_for]", known));
  const text = tables.join("\n");
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
