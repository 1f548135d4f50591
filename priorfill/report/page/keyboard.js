/* Keys that work anywhere on the page, and the table of all keys. */

/** Frames that Shift with an arrow moves by. */
const MANY_FRAMES = 10;

class Keyboard {
  /**
   * @param {Store} store
   * @param {Object} views by name
   */
  constructor(store, views) {
    this.store = store;
    this.views = views;
    this.actions = this.table();
    this.dialog = this.makeDialog();
    document.body.append(this.dialog);
    document.addEventListener("keydown", (event) => this.key(event));
    document.getElementById("keys").addEventListener("click", () => this.toggleDialog());
  }

  /** @returns {Object[]} keys, what they do as text, and as function */
  table() {
    const { store } = this;
    const { decisions } = this.views;
    const step = (by) => () => {
      store.setPlaying(false);
      store.setFrame(store.frame + by);
    };
    return [
      { keys: [" "], name: "Space", text: "Play or stop",
        act: () => store.setPlaying(!store.playing) },
      { keys: ["ArrowLeft"], name: "←", text: "One frame back", act: step(-1) },
      { keys: ["ArrowRight"], name: "→", text: "One frame on", act: step(1) },
      { keys: ["ArrowLeft"], shift: true, name: "Shift ←", text: "Ten frames back",
        act: step(-MANY_FRAMES) },
      { keys: ["ArrowRight"], shift: true, name: "Shift →", text: "Ten frames on",
        act: step(MANY_FRAMES) },
      { keys: ["n"], text: "Gap below in the table", act: () => stepGap(store, 1) },
      { keys: ["p"], text: "Gap above in the table", act: () => stepGap(store, -1) },
      { keys: ["["], text: "Slower", act: () => this.changeSpeed(-1) },
      { keys: ["]"], text: "Faster", act: () => this.changeSpeed(1) },
      { keys: [","], text: "Range of frames: begin here", act: () => this.setRangeEnd(0) },
      { keys: ["."], text: "Range of frames: end here", act: () => this.setRangeEnd(1) },
      { keys: ["Escape"], text: "No range of frames", act: () => store.setRange(null) },
      { keys: ["g"], text: "Next version as a ghost, or none", act: () => this.nextGhost() },
      { keys: ["s"], text: "Choose the gap, or take it back", act: () => this.chooseActive() },
      { keys: ["a"], text: "Accept the fill", act: () => decisions.accept() },
      { keys: ["x"], text: "Refuse the fill", act: () => decisions.refuse() },
      { keys: ["f"], text: "Re-fill in another way", act: () => decisions.openRefill() },
      { keys: ["z"], text: "Undo a decision", act: () => decisions.undo() },
      { keys: ["y"], text: "Redo a decision", act: () => decisions.redo() },
      { keys: ["t"], text: "Light or dark colours",
        act: () => document.getElementById("theme").click() },
      { keys: ["?"], text: "This table of keys", act: () => this.toggleDialog() },
    ];
  }

  /** Take a key, unless it belongs to a control or to the browser. */
  key(event) {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.dialog.open || document.querySelector("dialog[open]")) return;
    if (ownsKey(event.target, event.key)) return;
    const pressed = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const arrow = event.key.startsWith("Arrow");
    const found = this.actions.find((action) => action.keys.includes(pressed) &&
      (!arrow || Boolean(action.shift) === event.shiftKey));
    if (!found) return;
    event.preventDefault();
    found.act();
  }

  /** Play slower or faster. */
  changeSpeed(by) {
    const at = SPEEDS.findIndex((speed) => speed >= this.store.speed);
    const place = Math.max(0, Math.min(SPEEDS.length - 1, (at < 0 ? SPEEDS.length : at) + by));
    this.store.setSpeed(SPEEDS[place]);
    announce(`Speed ${SPEEDS[place]}`);
  }

  /** Begin (0) or end (1) the range of frames at the frame shown. */
  setRangeEnd(end) {
    const { store } = this;
    const range = store.range ? [...store.range] : [0, store.frames - 1];
    range[end] = store.frame;
    if (range[0] > range[1]) range[1 - end] = store.frame;
    store.setRange(range);
    announce(`Frames ${store.frameNumber(range[0])} to ${store.frameNumber(range[1])}`);
  }

  /** Show the next version as a ghost; after the last one, none. */
  nextGhost() {
    const { versions } = this.store.data;
    const next = this.store.ghost < 0 ? 1 : this.store.ghost + 1;
    this.store.setGhost(next < versions.length ? next : -1);
    const version = versions[this.store.ghost];
    announce(version ? `Ghost: ${shortText(version.name)}` : "No ghost");
  }

  /** Choose the active gap for a decision on several. */
  chooseActive() {
    if (this.store.activeGap < 0) return;
    this.store.toggleGap(this.store.activeGap);
    announce(this.store.chosenGaps.has(this.store.activeGap) ? "Chosen" : "Not chosen");
  }

  /** @returns {HTMLDialogElement} the table of keys */
  makeDialog() {
    const rows = (list) => list.map(([name, text]) => element("tr", {}, [
      element("th", { scope: "row" }, [element("kbd", { text: name })]),
      element("td", { text }),
    ]));
    const group = (title, list) => element("section", {}, [
      element("h3", { text: title }), element("table", {}, [element("tbody", {}, rows(list))]),
    ]);
    const everywhere = this.actions.map((action) => [action.name || action.keys[0], action.text]);
    everywhere.find((row) => row[0] === "Escape")[0] = "Esc";
    return element("dialog", { class: "keys", "aria-labelledby": "keys-title" }, [
      element("div", { class: "panel-head" }, [
        element("h2", { id: "keys-title", text: "Keys" }),
        element("span", { class: "group" }, [
          button("Close", () => this.dialog.close(), { class: "close" }),
        ]),
      ]),
      element("div", { class: "key-groups" }, [
        group("Everywhere", everywhere),
        ...PANEL_KEYS.map(([title, list]) => group(title, list)),
      ]),
    ]);
  }

  /** Show or hide the table of keys. */
  toggleDialog() {
    if (this.dialog.open) this.dialog.close();
    else this.dialog.showModal();
  }
}

/** Keys of single views, which work while these have the focus. */
const PANEL_KEYS = [
  ["Timeline", [
    ["↑ ↓", "Marker above or below"], ["+ −", "Fewer or more frames"], ["0", "All frames"],
    ["Enter", "Zoom to the gap"], ["Page ↑ ↓", "Earlier or later frames"],
    ["Home End", "First or last frame"], ["Drag", "Range of frames"],
    ["Wheel", "Fewer or more frames"],
  ]],
  ["Gap table", [
    ["↑ ↓", "Gap above or below"], ["Page ↑ ↓", "Ten gaps up or down"],
    ["Home End", "First or last gap"], ["Space", "Choose, or take back"],
    ["Shift ↑ ↓", "Choose several"], ["Shift click", "Choose all between"],
  ]],
  ["Body", [
    ["← → ↑ ↓", "Turn"], ["Shift and arrows", "Move"], ["+ −", "Nearer or further"],
    ["0", "Whole body"], ["1 2 3", "Front, side, top"], ["m", "Next marker"],
    ["c", "Follow the body, or not"],
  ]],
  ["Curves", [
    ["+ −", "Fewer or more frames"], ["Page ↑ ↓", "Earlier or later frames"],
    ["Enter", "Zoom to the gap"], ["0 Home", "All frames, as a double click"],
    ["Drag", "Zoom to frames"], ["Shift drag", "Range of frames"],
    ["Drag the time axis", "Earlier or later frames"],
    ["Wheel", "Fewer or more frames, after a click or with Ctrl"],
  ]],
];

/**
 * Whether an element uses a key itself.
 * @param {Element} target what has the focus
 * @param {string} key
 * @returns {boolean}
 */
function ownsKey(target, key) {
  if (!(target instanceof Element)) return false;
  if (target.isContentEditable || target.closest("textarea, select")) return true;
  const input = target.closest("input");
  if (input) {
    const plain = ["checkbox", "button", "file"].includes(input.type);
    if (plain) return key === " " || key === "Enter";
    if (input.type === "range" || input.type === "radio") {
      return key === " " || key.startsWith("Arrow") || key === "Home" || key === "End";
    }
    return key !== "Escape" || input.value !== "";
  }
  return Boolean(target.closest("button, summary, a")) && (key === " " || key === "Enter");
}
