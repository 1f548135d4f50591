/* Reads the part of TOML (https://toml.io/en/v1.0.0) that files of overrides use. */

/** Deepest nesting of arrays and tables, as in the command line. */
const TOML_MAX_DEPTH = 16;

/** Whole numbers, those in another base, those with a fraction or exponent, special ones. */
const TOML_INTEGER = /^[+-]?(0|[1-9](_?\d)*)$/;
const TOML_BASED = /^0(x[\dA-Fa-f](_?[\dA-Fa-f])*|o[0-7](_?[0-7])*|b[01](_?[01])*)$/;
const TOML_FLOAT =
  /^[+-]?(0|[1-9](_?\d)*)(\.\d(_?\d)*([eE][+-]?\d(_?\d)*)?|[eE][+-]?\d(_?\d)*)$/;
const TOML_SPECIAL = /^([+-]?)(inf|nan)$/;
const TOML_DATE = /^(\d{4}-\d{2}-\d{2}|\d{2}:\d{2})/;

/** Characters that may not be in a file as they are; tab and end of line may. */
const TOML_CONTROL = /[\u0000-\u0008\u000b-\u001f\u007f]/;

/** What the letter after a backslash stands for. */
const TOML_ESCAPES = { b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\" };

/** Reads TOML; tables are objects without prototype, so that every key is safe. */
class TomlReader {
  /**
   * @param {string} text with LF or CR LF, with or without byte order mark
   */
  constructor(text) {
    this.text = text.replace(/^\ufeff/, "").replace(/\r\n/g, "\n");
    this.at = 0;
    /** Place whose line was found last: lines are mostly asked for in order. */
    this.counted = { at: 0, line: 1 };
    /** Line of the header of each table, from 1. */
    this.lines = new Map();
    const control = TOML_CONTROL.exec(this.text);
    if (control !== null) {
      const what = control[0] === "\r" ? "ends with CR alone" : "holds a control character";
      this.fail(`${what}, which TOML does not have`, control.index);
    }
  }

  /**
   * Raise the error for a fault.
   * @param {string} what
   * @param {number} [at] place in the text
   */
  fail(what, at = this.at) {
    throw new DecisionError(`line ${this.lineOf(at)}: ${what}`);
  }

  /**
   * Find the line of a place in the text.
   * @param {number} at
   * @returns {number} from 1
   */
  lineOf(at) {
    const known = at >= this.counted.at ? this.counted : { at: 0, line: 1 };
    const line = known.line + this.text.slice(known.at, at).split("\n").length - 1;
    this.counted = { at, line };
    return line;
  }

  /**
   * Read the whole text.
   * @param {function(string, Object): Object} open returns the table of a header such as "[[gap]]"
   *   in the root table, or null if there is no such table
   * @returns {Object} the root table
   */
  read(open) {
    const root = Object.create(null);
    let table = null;
    for (;;) {
      this.skip(true);
      if (this.at >= this.text.length) {
        return root;
      }
      const start = this.at;
      if (this.text[start] === "[") {
        table = open(this.header(), root);
        if (table === null) {
          this.fail("unknown or repeated table; write [made_for] once and [[gap]] tables", start);
        }
        this.lines.set(table, this.lineOf(start));
      } else if (table === null) {
        this.fail("a key comes before the first table; write [[gap]] above it");
      } else {
        this.pair(table, 0);
      }
      this.skip(false);
      if (this.at < this.text.length && this.text[this.at] !== "\n") {
        this.fail("more follows on the line; write it on a line of its own");
      }
    }
  }

  /**
   * Skip blanks and comments, and ends of lines if wanted.
   * @param {boolean} lines
   */
  skip(lines) {
    const blank = lines ? /(?:[ \t\n]|#[^\n]*)*/y : /[ \t]*(?:#[^\n]*)?/y;
    blank.lastIndex = this.at;
    this.at += blank.exec(this.text)[0].length;
  }

  /**
   * Take a text if it comes next.
   * @param {string} wanted
   * @returns {boolean} whether it did
   */
  take(wanted) {
    const found = this.text.startsWith(wanted, this.at);
    this.at += found ? wanted.length : 0;
    return found;
  }

  /**
   * Read a header.
   * @returns {string} without blanks, such as "[gap.options]"
   */
  header() {
    const found = /\[\[?[ \t]*[A-Za-z_-]+(?:[ \t]*\.[ \t]*[A-Za-z_-]+)*[ \t]*\]\]?/y;
    found.lastIndex = this.at;
    const header = found.exec(this.text);
    if (header === null) {
      this.fail("this is no name of a table; write [made_for] or [[gap]]");
    }
    this.at += header[0].length;
    return header[0].replace(/[ \t]/g, "");
  }

  /**
   * Read `key = value` into a table.
   * @param {Object} table
   * @param {number} depth nesting of the table
   */
  pair(table, depth) {
    const start = this.at;
    const key = this.dottedKey();
    if (!this.take("=")) {
      this.fail("no = follows the key; write key = value");
    }
    const within = (one, other) => one === other || one.startsWith(`${other}.`);
    if (Object.keys(table).some((one) => within(one, key) || within(key, one))) {
      this.fail(`${safeText(key)} is given twice; remove one`, start);
    }
    this.skip(false);
    table[key] = this.value(depth);
  }

  /**
   * Read a key, or several with dots between them.
   * @returns {string} joined by dots, as names of options are
   */
  dottedKey() {
    const keys = [];
    do {
      this.skip(false);
      keys.push(this.key());
      this.skip(false);
    } while (this.take("."));
    return keys.join(".");
  }

  /**
   * Read a single key.
   * @returns {string}
   */
  key() {
    if (this.text[this.at] === '"' || this.text[this.at] === "'") {
      return this.string();
    }
    const bare = /[A-Za-z0-9_-]+/y;
    bare.lastIndex = this.at;
    const found = bare.exec(this.text);
    if (found === null) {
      this.fail("a key is expected here; write key = value or [[gap]]");
    }
    this.at += found[0].length;
    return found[0];
  }

  /**
   * Read a value.
   * @param {number} depth nesting so far
   * @returns {*}
   */
  value(depth) {
    if (depth > TOML_MAX_DEPTH) {
      this.fail(`values are nested more than ${TOML_MAX_DEPTH} deep`);
    }
    const next = this.text[this.at];
    if (next === '"' || next === "'") {
      return this.string();
    }
    if (next === "[") {
      return this.array(depth);
    }
    return next === "{" ? this.inline(depth) : this.plain();
  }

  /** Read an array, over several lines or not. */
  array(depth) {
    const values = [];
    this.at += 1;
    for (;;) {
      this.skip(true);
      if (this.take("]")) {
        return values;
      }
      values.push(this.value(depth + 1));
      this.skip(true);
      if (!this.take(",") && this.text[this.at] !== "]") {
        this.fail("a list goes on without a comma or closing ]");
      }
    }
  }

  /** Read an inline table, which is on one line. */
  inline(depth) {
    const table = Object.create(null);
    this.at += 1;
    this.skip(false);
    if (this.take("}")) {
      return table;
    }
    for (;;) {
      this.skip(false);
      this.pair(table, depth + 1);
      this.skip(false);
      if (this.take("}")) {
        return table;
      }
      if (!this.take(",")) {
        this.fail("a table in { } goes on without a comma or closing } on the same line");
      }
    }
  }

  /** Read a number or truth value. */
  plain() {
    const word = /[^\s,\]}#=]*/y;
    word.lastIndex = this.at;
    const text = word.exec(this.text)[0];
    const digits = text.replace(/_/g, "");
    let value;
    if (text === "true" || text === "false") {
      value = text === "true";
    } else if (TOML_INTEGER.test(text) || TOML_BASED.test(text)) {
      value = Number(digits);
      if (!Number.isSafeInteger(value)) {
        this.fail("a whole number is too large; it has more than 53 bits");
      }
      value += 0; // -0 is 0
    } else if (TOML_FLOAT.test(text)) {
      value = Number(digits);
    } else if (TOML_SPECIAL.test(text)) {
      const size = text.endsWith("inf") ? Infinity : NaN;
      value = text.startsWith("-") ? -size : size;
    } else if (TOML_DATE.test(text)) {
      this.fail("a date or time is no value here; write it in quotes");
    } else {
      const shown = text === "" ? "no value" : `${safeText(text.slice(0, 40))}, which is no value`;
      this.fail(`there is ${shown}; write texts in quotes`);
    }
    this.at += text.length;
    return value;
  }

  /**
   * Read a text in quotes of any of the four kinds.
   * @returns {string}
   */
  string() {
    const start = this.at;
    const quote = this.text[start];
    const long = this.take(quote.repeat(3));
    if (!long) {
      this.at += 1;
    } else {
      this.take("\n");
    }
    const parts = [];
    for (;;) {
      const next = this.text[this.at];
      if (next === undefined || (next === "\n" && !long)) {
        this.fail("a text has no closing quotes", start);
      }
      if (next === quote && (!long || this.text.startsWith(quote.repeat(3), this.at))) {
        const extra = long ? this.extraQuotes(quote) : "";
        this.at += (long ? 3 : 1) + extra.length;
        return parts.join("") + extra;
      }
      parts.push(next === "\\" && quote === '"' ? this.escape(long) : next);
      this.at += next === "\\" && quote === '"' ? 0 : 1;
    }
  }

  /** Return the quotes before the three that close a text of several lines: they belong to it. */
  extraQuotes(quote) {
    let end = this.at + 3;
    while (end < this.at + 5 && this.text[end] === quote) {
      end += 1;
    }
    return this.text.slice(this.at + 3, end);
  }

  /**
   * Read an escape sequence.
   * @param {boolean} long whether the text has several lines
   * @returns {string} what it stands for
   */
  escape(long) {
    const start = this.at;
    const fold = /\\[ \t]*\n[ \t\n]*/y;
    fold.lastIndex = start;
    const folded = long ? fold.exec(this.text) : null;
    if (folded !== null) {
      this.at += folded[0].length;
      return "";
    }
    const short = TOML_ESCAPES[this.text[start + 1]];
    if (short !== undefined) {
      this.at += 2;
      return short;
    }
    const coded = /\\(?:u([\dA-Fa-f]{4})|U([\dA-Fa-f]{8}))/y;
    coded.lastIndex = start;
    const found = coded.exec(this.text);
    const code = found === null ? -1 : parseInt(found[1] || found[2], 16);
    if (code < 0 || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) {
      this.fail("a text holds an unknown escape sequence; write \\\\ for a backslash");
    }
    this.at += found[0].length;
    return String.fromCodePoint(code);
  }
}
