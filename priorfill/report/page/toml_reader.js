/** Reads TOML (https://toml.io/en/v1.0.0), without dates; faults are named with their line. */

/** Deepest nesting of arrays and tables, as in the command line. */
const TOML_MAX_DEPTH = 16;

/** Numbers: whole ones, those with another base, those with fraction or exponent, special ones. */
const TOML_INTEGER = /^[+-]?(0|[1-9](_?\d)*)$/;
const TOML_BASED = /^0(x[\dA-Fa-f](_?[\dA-Fa-f])*|o[0-7](_?[0-7])*|b[01](_?[01])*)$/;
const TOML_FLOAT =
  /^[+-]?(0|[1-9](_?\d)*)(\.\d(_?\d)*([eE][+-]?\d(_?\d)*)?|[eE][+-]?\d(_?\d)*)$/;
const TOML_SPECIAL = /^[+-]?(inf|nan)$/;
const TOML_DATE = /^(\d{4}-\d{2}-\d{2}|\d{2}:\d{2})/;

/** Characters that a text may not hold as they are. */
const TOML_CONTROL = /[\u0000-\u0008\u000b-\u001f\u007f]/;

/** What the letters after a backslash mean. */
const TOML_ESCAPES = { b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\" };

/** A reader of one TOML text. Tables are objects without prototype, so that any key is safe. */
class TomlReader {
  /**
   * @param {string} text with or without byte order mark, with LF or CR LF
   */
  constructor(text) {
    this.text = text.replace(/^\ufeff/, "").replace(/\r\n/g, "\n");
    this.at = 0;
    /** Tables that a header opened, and values that may not be added to. */
    this.opened = new Set();
    this.closed = new Set();
    /** Line of the header of each table that has one, from 1. */
    this.lines = new Map();
  }

  /**
   * Read the whole text.
   * @returns {Object} the root table
   */
  read() {
    const root = Object.create(null);
    let table = root;
    for (;;) {
      this.skip(true);
      if (this.at >= this.text.length) {
        return root;
      }
      if (this.text[this.at] === "[") {
        table = this.header(root);
      } else {
        this.pair(table);
      }
      this.endOfLine();
    }
  }

  /**
   * Raise the error for a fault.
   * @param {string} what
   * @param {number} [at] place in the text
   */
  fail(what, at = this.at) {
    const line = this.lineOf(at);
    throw new DecisionError(`line ${line}: ${what}`);
  }

  /**
   * Find the line of a place.
   * @param {number} at
   * @returns {number} from 1
   */
  lineOf(at) {
    return this.text.slice(0, at).split("\n").length;
  }

  /**
   * Skip blanks and comments, and ends of lines if wanted.
   * @param {boolean} lines
   */
  skip(lines) {
    for (;;) {
      const next = this.text[this.at];
      if (next === " " || next === "\t" || (lines && next === "\n")) {
        this.at += 1;
      } else if (next === "#") {
        const end = this.text.indexOf("\n", this.at);
        const comment = this.text.slice(this.at, end < 0 ? undefined : end);
        if (TOML_CONTROL.test(comment)) {
          this.fail("a comment holds a control character; remove it");
        }
        this.at += comment.length;
      } else {
        return;
      }
    }
  }

  /** Skip the rest of a line, where nothing but a comment may be. */
  endOfLine() {
    this.skip(false);
    if (this.at < this.text.length && this.text[this.at] !== "\n") {
      this.fail("more follows after the end of the value; write it on a line of its own");
    }
  }

  /**
   * Take a text if it comes next.
   * @param {string} wanted
   * @returns {boolean}
   */
  take(wanted) {
    const found = this.text.startsWith(wanted, this.at);
    this.at += found ? wanted.length : 0;
    return found;
  }

  /**
   * Read `[table]` or `[[table]]`.
   * @param {Object} root
   * @returns {Object} the table that it opens
   */
  header(root) {
    const start = this.at;
    const many = this.take("[[");
    this.at += many ? 0 : 1;
    const keys = this.keys();
    if (!this.take(many ? "]]" : "]")) {
      this.fail(`the table has no closing ${many ? "]]" : "]"}`);
    }
    const last = keys.pop();
    const parent = keys.reduce((table, key) => this.step(table, key, start), root);
    const table = many ? this.append(parent, last, start) : this.open(parent, last, start);
    this.opened.add(table);
    this.lines.set(table, this.lineOf(start));
    return table;
  }

  /** Go from a table to one inside it, which is made if there is none. */
  step(table, key, start) {
    let inner = table[key];
    if (inner === undefined) {
      inner = table[key] = Object.create(null);
    }
    if (Array.isArray(inner) && !this.closed.has(inner)) {
      inner = inner[inner.length - 1];
    }
    if (inner === null || typeof inner !== "object" || this.closed.has(inner)) {
      this.fail(`${safeText(key)} is a value already; it cannot be a table`, start);
    }
    return inner;
  }

  /** Add a table to an array of tables. */
  append(parent, key, start) {
    if (parent[key] === undefined) {
      parent[key] = [];
    }
    if (!Array.isArray(parent[key]) || this.closed.has(parent[key])) {
      this.fail(`${safeText(key)} is no list of tables; it was written otherwise above`, start);
    }
    const table = Object.create(null);
    parent[key].push(table);
    return table;
  }

  /** Open a table that has not been opened before. */
  open(parent, key, start) {
    const table = Array.isArray(parent[key]) ? parent[key] : this.step(parent, key, start);
    if (Array.isArray(table) || this.opened.has(table)) {
      this.fail(`the table ${safeText(key)} is there twice; join them`, start);
    }
    return table;
  }

  /**
   * Read `key = value` into a table.
   * @param {Object} table
   * @param {number} [depth] nesting
   */
  pair(table, depth = 0) {
    const start = this.at;
    const keys = this.keys();
    if (!this.take("=")) {
      this.fail("an = is missing after the key");
    }
    this.skip(false);
    const last = keys.pop();
    let target = table;
    for (const key of keys) {
      const known = target[key] !== undefined;
      const inner = this.step(target, key, start);
      if (known && (Array.isArray(target[key]) || this.opened.has(inner))) {
        this.fail(`the table ${safeText(key)} is there twice; join them`, start);
      }
      target = inner;
    }
    if (target[last] !== undefined) {
      this.fail(`${safeText(last)} is there twice; remove one`, start);
    }
    for (let inner = table, index = 0; index < keys.length; index += 1) {
      inner = inner[keys[index]];
      this.dotted(inner);
    }
    target[last] = this.value(depth);
  }

  /** Note that a table was made by dots in a key, and cannot be opened by a header. */
  dotted(table) {
    this.dots = this.dots || new Set();
    this.dots.add(table);
  }

  /**
   * Read a key, or several with dots between them.
   * @returns {string[]}
   */
  keys() {
    const keys = [];
    do {
      this.skip(false);
      keys.push(this.key());
      this.skip(false);
    } while (this.take("."));
    return keys;
  }

  /** Read one key. */
  key() {
    const next = this.text[this.at];
    if (next === '"' || next === "'") {
      if (this.text.startsWith(next.repeat(3), this.at)) {
        this.fail("a key cannot have several lines");
      }
      return this.string();
    }
    const found = /[A-Za-z0-9_-]+/y;
    found.lastIndex = this.at;
    const bare = found.exec(this.text);
    if (bare === null) {
      this.fail("a key is missing; write key = value, [made_for] or [[gap]]");
    }
    this.at += bare[0].length;
    return bare[0];
  }
}
