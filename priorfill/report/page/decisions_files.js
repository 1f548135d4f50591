/* Decisions to and from a file, without a server. */

/** The part of the panel that exports and imports decisions. */
class DecisionFiles {
  /**
   * @param {Store} store
   * @param {{take: function(Object[], string), exported: function()}} actions
   */
  constructor(store, actions) {
    this.store = store;
    this.actions = actions;
    this.entries = [];
    this.name = overridesName(store.data.title);
    const status = { class: "decision-status", role: "status", id: "decision-file-status" };
    this.status = element("p", status);
    this.input = element("input", {
      type: "file", accept: ".toml", id: "decision-import", on: { change: () => this.read() },
    });
    this.command = element("input", {
      type: "text", readonly: true, id: "decision-command", class: "wide", spellcheck: "false",
    });
    this.text = element("textarea", {
      readonly: true, rows: 8, id: "decision-toml", "aria-label": "Contents of the file",
      spellcheck: "false",
    });
    this.preview = element("details", { on: { toggle: () => this.showText() } }, [
      element("summary", { text: "Contents of the file of decisions" }), this.text,
    ]);
    this.element = element("div", { class: "decision-files" }, [
      element("div", { class: "field-row" }, [
        button("Export decisions", () => this.save(), { id: "decision-export" }),
        labelled("Import decisions", this.input),
      ]),
      element("div", { class: "field-row" }, [
        labelled("Command that repeats them", this.command),
        button("Copy", () => this.copy(), { title: "Copy the command" }),
      ]),
      this.preview, this.status,
    ]);
  }

  /**
   * Show decisions.
   * @param {Object[]} entries
   */
  show(entries) {
    this.entries = entries;
    this.command.value = fillCommand(this.store.data, this.name);
    this.showText();
  }

  /** @returns {string} the text of the file */
  content() {
    const { data } = this.store;
    const madeFor = data.made_for || { file: data.clip.name, sha256: data.clip.sha256 };
    return writeOverrides(madeFor, this.entries);
  }

  /** Show the text of the file, if that part is open. */
  showText() {
    if (!this.preview.open) return;
    try {
      this.text.value = this.content();
    } catch (error) {
      if (!(error instanceof DecisionError)) throw error;
      this.text.value = "";
      this.tell(`Cannot write the file: ${error.message}.`);
    }
  }

  /** Download the file. */
  save() {
    let text;
    try {
      text = this.content();
    } catch (error) {
      if (!(error instanceof DecisionError)) throw error;
      this.tell(`Cannot write the file: ${error.message}.`);
      return;
    }
    const address = URL.createObjectURL(new Blob([text], { type: "application/toml" }));
    const link = element("a", { href: address, download: this.name, hidden: true });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(address), 10000); // ms; the download has begun by then
    const count = this.entries.length;
    this.tell(`${countOf(count, "decision")} exported as ${this.name}.`);
    this.actions.exported();
  }

  /** Read the chosen file. */
  async read() {
    const [file] = this.input.files;
    if (file === undefined) return;
    const name = shortText(safeText(file.name));
    try {
      if (file.size > OVERRIDES_MAX_BYTES) {
        throw new DecisionError(`has more than ${OVERRIDES_MAX_BYTES / 1024} KiB`);
      }
      const text = decodedText(await file.arrayBuffer());
      const { madeFor, entries } = readOverridesFile(text, this.store.data);
      const { sha256 } = this.store.data.clip;
      const other = madeFor.sha256 && sha256 && madeFor.sha256 !== sha256;
      this.actions.take(entries, "import");
      const source = shortText(safeText(madeFor.file || "unnamed"));
      this.tell(`${countOf(entries.length, "decision")} read from ${name} in place of the list.` +
        (other ? ` The file was made for another recording (${source}).` : ""));
    } catch (error) {
      const reason = error instanceof DecisionError ? error.message : "it cannot be read";
      this.tell(`${name} was not imported: ${reason}.`);
    }
    this.input.value = "";
  }

  /** Copy the command. */
  async copy() {
    this.command.select();
    try {
      await navigator.clipboard.writeText(this.command.value);
      this.tell("Command copied.");
    } catch {
      this.tell("The command is selected; copy it with the keyboard.");
    }
  }

  /** Show a line, and say it. */
  tell(text) {
    this.status.textContent = text;
  }
}

/**
 * Decode the bytes of a file.
 * @param {ArrayBuffer} bytes
 * @returns {string}
 */
function decodedText(bytes) {
  try {
    return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
  } catch {
    throw new DecisionError("is not UTF-8; save it as UTF-8");
  }
}

/**
 * Return the name of the file of decisions on a recording.
 * @param {string} name of the recording
 * @returns {string} with letters, digits, dots and lines only
 */
function overridesName(name) {
  const stem = name.replace(/\.[A-Za-z0-9]{1,5}$/, "").replace(/[^A-Za-z0-9._-]+/g, "_");
  return `${stem.replace(/^[._-]+/, "").slice(0, 80) || "clip"}_filled.overrides.toml`;
}

/**
 * Return the command that fills with the decisions of a file.
 * @param {Object} data
 * @param {string} overrides name of the file
 * @returns {string}
 */
function fillCommand(data, overrides) {
  const words = data.command || ["priorfill", "fill", fileWord(data),
    ...(data.settings || []).flatMap(([name, value]) => optionWords(name, value))];
  const output = overrides.replace(/\.overrides\.toml$/, fileSuffix(data.title));
  const files = data.saves || { output, overrides };
  return [...words, "-o", files.output, "--overrides", files.overrides]
    .map((word) => shellWord(safeText(word))).join(" ");
}

/**
 * Return the recording as a word of a command.
 * @param {Object} data
 * @returns {string} its whole name, which labels cut; no name is taken for an option
 */
function fileWord(data) {
  const name = (data.made_for && data.made_for.file) || data.clip.file || data.title;
  return name.startsWith("-") ? `./${name}` : name;
}

/**
 * Return an option of a command as its words.
 * @param {string} name
 * @param {string|boolean} value true for options without a value
 * @returns {string[]}
 */
function optionWords(name, value) {
  if (value === true) return [`--${name}`];
  return value.startsWith("-") ? [`--${name}=${value}`] : [`--${name}`, value];
}

/**
 * Return the suffix of a file.
 * @param {string} name
 * @returns {string} with its dot
 */
function fileSuffix(name) {
  const found = /\.[A-Za-z0-9]{1,5}$/.exec(name);
  return found === null ? ".c3d" : found[0];
}

/**
 * Put a word of a command into quotes where it needs them.
 * @param {string} word
 * @returns {string} double quotes, which all shells understand, unless it has $, ` or "
 */
function shellWord(word) {
  if (/^[\w@%+=:,./\\-]+$/.test(word)) return word;
  return /["$`!]/.test(word) ? `'${word.replace(/'/g, "'\\''")}'` : `"${word}"`;
}
