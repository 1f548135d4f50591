/* Writes values as TOML (https://toml.io/en/v1.0.0). */

/** Characters that are written as escape sequences: quotes, and what does not show. */
const TOML_ESCAPED = /["\\]|\p{C}|(?! )\p{Z}/gu;

/** Short escape sequences of TOML. */
const TOML_SHORT = {
  "\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r", '"': '\\"', "\\": "\\\\",
};

/** Dots that a text may hold as they are: lines of very many are refused when they are read. */
const TOML_MAX_DOTS = 40;

/** Items and characters of a list in one line; longer lists have a line for each item. */
const TOML_LINE_ITEMS = 4;
const TOML_LINE_WIDTH = 80;

/** Keys that need no quotes. */
const TOML_BARE_KEY = /^[A-Za-z0-9_-]+$/;

/** Half of a character beyond U+FFFF without its other half; TOML cannot hold it. */
const LONE_SURROGATE = /\p{Cs}/u;

/** What is wrong with a list of decisions or its file; the message is one line. */
class DecisionError extends Error {}

/**
 * Write a text as a basic string of TOML.
 * @param {string} text
 * @returns {string} in double quotes; invisible characters as escape sequences
 */
function tomlText(text) {
  if (LONE_SURROGATE.test(text)) {
    throw new DecisionError("a text holds a lone surrogate, which TOML does not have");
  }
  const inner = text.replace(TOML_ESCAPED, (found) => {
    if (TOML_SHORT[found] !== undefined) {
      return TOML_SHORT[found];
    }
    const code = found.codePointAt(0).toString(16).toUpperCase();
    return code.length > 4 ? `\\U${code.padStart(8, "0")}` : `\\u${code.padStart(4, "0")}`;
  });
  const dots = inner.split(".").length - 1;
  return `"${dots > TOML_MAX_DOTS ? inner.replaceAll(".", "\\u002E") : inner}"`;
}

/**
 * Write a number; whole numbers as integers.
 * @param {number} value
 * @returns {string}
 */
function tomlNumber(value) {
  if (Number.isNaN(value)) {
    return "nan";
  }
  if (!Number.isFinite(value)) {
    return value > 0 ? "inf" : "-inf";
  }
  if (Object.is(value, -0)) {
    return "-0.0";
  }
  if (Number.isInteger(value) && !Number.isSafeInteger(value)) {
    return value.toExponential().replace(/^(-?\d)e/, "$1.0e");
  }
  return String(value);
}

/**
 * Write a key.
 * @param {string} key
 * @returns {string} in quotes where it needs them
 */
function tomlKey(key) {
  return TOML_BARE_KEY.test(key) ? key : tomlText(key);
}

/**
 * Write a value: text, number, truth value, array of values, or object (as inline table).
 * @param {*} value
 * @returns {string}
 */
function tomlValue(value) {
  if (typeof value === "string") {
    return tomlText(value);
  }
  if (typeof value === "number") {
    return tomlNumber(value);
  }
  if (typeof value === "boolean") {
    return String(value);
  }
  if (Array.isArray(value)) {
    const items = value.map(tomlValue);
    const line = items.join(", ");
    const short = items.length <= TOML_LINE_ITEMS && line.length <= TOML_LINE_WIDTH;
    return short ? `[${line}]` : `[\n${items.map((item) => `    ${item},\n`).join("")}]`;
  }
  if (value !== null && typeof value === "object") {
    const pairs = Object.keys(value).map((key) => `${tomlKey(key)} = ${tomlValue(value[key])}`);
    return pairs.length > 0 ? `{ ${pairs.join(", ")} }` : "{}";
  }
  throw new DecisionError(`a value is ${value}; TOML has none like it`);
}

/**
 * Write a table under its header.
 * @param {string} header with its brackets, such as "[[gap]]"
 * @param {Object} table
 * @returns {string} lines, each with its end
 */
function tomlTable(header, table) {
  const keys = Object.keys(table);
  const rows = keys.map((key) => `${tomlKey(key)} = ${tomlValue(table[key])}\n`);
  return `${header}\n${rows.join("")}`;
}
