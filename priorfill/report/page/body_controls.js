/* The controls of the body player, its legend, and what is visible in the frame. */

/** Lengths of trails to each side of the frame (s). */
const TRAIL_SECONDS = [0, 0.25, 0.5, 1, 2];

/** What is played beyond both ends of a gap (s), so that its edges are seen. */
const LOOP_MARGIN_S = 0.4;

/** Digits that the number of the frame has room for at least, and room of its arrows (digits). */
const LEAST_DIGITS = 4;
const NUMBER_ARROWS = 5;

/** Most markers listed by name below the picture. */
const LISTED = 12;

/** Buttons, inputs and lists around the picture. */
class BodyControls {
  /**
   * @param {BodyPlayer} player
   * @param {Store} store
   */
  constructor(player, store) {
    this.player = player;
    this.store = store;
    this.transport = element("div", { class: "body-bar", role: "group", "aria-label": "Play" });
    this.shown = element("div", { class: "body-bar", role: "group", "aria-label": "Shown" });
    this.views = element("div", { class: "body-views", role: "group", "aria-label": "View" });
    this.legend = element("div", { class: "body-legend", role: "list", "aria-label": "Legend" });
    this.status = element("p", { class: "body-status", id: "body-status" });
    this.seen = new Uint8Array(0);
    this.makeTransport();
    this.makeViews();
    this.makeShown();
    this.load();
  }

  /** Make the controls of time. */
  makeTransport() {
    const { store } = this;
    const go = (frames) => () => store.setFrame(store.frame + frames);
    this.play = button("Play", () => store.setPlaying(!store.playing),
      { id: "play", title: "Play or stop (space)" });
    const back = button("◂", go(-1), { "aria-label": "Frame before", title: "Before (←)" });
    const next = button("▸", go(1), { "aria-label": "Next frame", title: "Next (→)" });
    this.scrub = element("input", {
      type: "range", id: "scrub", min: 0, step: 1, "aria-label": "Frame of the clip",
      on: { input: () => store.setFrame(Number(this.scrub.value)) },
    });
    this.number = element("input", {
      type: "number", id: "frame", class: "body-number", step: 1, on: { change: () => this.go() },
    });
    this.time = element("output", { id: "time", class: "body-time", for: "scrub frame" });
    this.speed = element("select", {
      id: "speed", title: "Speed ([ and ])",
      on: { change: () => store.setSpeed(Number(this.speed.value)) },
    }, SPEEDS.map((speed) => element("option", { value: speed, text: `${speed} ×` })));
    this.loop = element("select", { id: "loop", on: { change: () => this.setLoop() } });
    this.transport.append(this.play, back, next, this.scrub,
      bodyLabel("Frame", this.number), this.time);
    this.shown.append(bodyLabel("Speed", this.speed), bodyLabel("Loop", this.loop));
  }

  /** Make the buttons of views, which lie over the picture. */
  makeViews() {
    const { player } = this;
    const view = (name, key) => button(name, () => player.view(name.toLowerCase()),
      { title: `View from the ${name === "Side" ? "right side" : name.toLowerCase()} (${key})` });
    const zoom = (factor) => () => player.zoom(factor);
    this.follow = button("Follow", () => player.setFollow(!player.look.follow),
      { title: "The camera moves with the body (c)" });
    this.views.append(view("Front", 1), view("Side", 2), view("Top", 3),
      button("Fit", () => player.fit(), { title: "Show all of it (0)" }),
      this.follow,
      button("+", zoom(ZOOM_KEY), { "aria-label": "Zoom in", title: "Zoom in (+)" }),
      button("−", zoom(1 / ZOOM_KEY), { "aria-label": "Zoom out", title: "Zoom out (−)" }));
  }

  /** Make the controls of what is shown. */
  makeShown() {
    const { player } = this;
    this.ghost = this.choice("ghost", "Ghost", [], (value) => this.store.setGhost(Number(value)));
    this.labels = this.choice("labels", "Labels",
      [["none", "None"], ["chosen", "Chosen"], ["all", "All"]],
      (value) => player.setLook("labels", value));
    this.trail = this.choice("trail", "Trail",
      TRAIL_SECONDS.map((s) => [s, s ? `± ${s} s` : "None"]),
      (value) => player.setLook("trail", Number(value)));
    this.bounds = this.check("Bound",
      "90 % bound: where the true position is expected, in true size",
      (on) => player.setLook("bounds", on));
  }

  /** Add a box to tick; `set` gets whether it is. */
  check(name, title, set) {
    const box = element("input", { type: "checkbox", on: { change: () => set(box.checked) } });
    const label = bodyLabel(name, box, true);
    label.title = title;
    this.shown.append(label);
    return box;
  }

  /** Add a list of [value, text]; `set` gets the value chosen. */
  choice(id, name, options, set) {
    const select = element("select", { id, on: { change: () => set(select.value) } },
      options.map(([value, text]) => element("option", { value, text })));
    this.shown.append(bodyLabel(name, select));
    return select;
  }

  /** Take what the data of the store offer. */
  load() {
    const { store } = this;
    const { clip, versions } = store.data;
    this.scrub.max = Math.max(0, store.frames - 1);
    this.number.min = clip.first_frame;
    this.number.max = store.frameNumber(Math.max(0, store.frames - 1));
    const digits = Math.max(this.number.min.length, this.number.max.length, LEAST_DIGITS);
    this.number.style.width = `${digits + NUMBER_ARROWS}ch`;
    this.number.title = `Frame ${this.number.min} to ${this.number.max}`;
    this.play.disabled = this.scrub.disabled = store.frames < 2;
    this.ghost.replaceChildren(element("option", { value: -1, text: "None" }),
      ...versions.slice(1).map((version, i) =>
        element("option", { value: i + 1, text: ghostName(version) })));
    this.ghost.disabled = versions.length < 2;
    this.seen = new Uint8Array(store.markerCount).fill(255);
    this.makeLegend();
    this.update();
  }

  /** Name the shapes that occur in the data. */
  makeLegend() {
    const { states, versions, subjects } = this.store.data;
    const codes = new Set(states.values.flatMap((runs) => runs.filter((_, at) => at % 2 === 0)));
    const items = MARKER_STYLES.map((style, code) => ({ ...style, code }))
      .filter(({ code, shape }) => shape && codes.has(code));
    if (codes.has(STATE.filled) || codes.has(STATE.replaced)) {
      items.push({ name: "90 % bound", colour: "filled", shape: "halo" });
    }
    for (const version of versions.slice(1)) {
      const colour = ghostColour(version);
      items.push({ name: ghostName(version).toLowerCase(), colour, shape: "ring" });
    }
    if (subjects.length > 1) {
      subjects.forEach((name, i) => items.push({ name: name || "unnamed subject", subject: i }));
    }
    this.keys = items.map((item) =>
      ({ ...item, canvas: element("canvas", { class: "body-key", "aria-hidden": "true" }) }));
    this.legend.replaceChildren(...this.keys.map(({ canvas, name }) =>
      element("span", { role: "listitem", title: name }, [canvas, shortText(name, LABEL_LENGTH)])));
  }

  /** Draw the shapes of the legend in the colours of the theme. */
  drawLegend() {
    const paint = colours();
    for (const { canvas, colour, shape, subject } of this.keys) {
      const { context, width, height } = fitCanvas(canvas);
      context.clearRect(0, 0, width, height);
      context.beginPath();
      if (subject !== undefined) {
        context.moveTo(1, height / 2);
        context.lineTo(width - 1, height / 2);
        context.lineWidth = 3;
        context.strokeStyle = STICK_COLOURS[subject % STICK_COLOURS.length];
        context.stroke();
      } else if (shape === "halo") {
        context.arc(width / 2, height / 2, height / 2 - 1, 0, TURN);
        paintHalo(context, paint);
      } else {
        addShape(context, shape, width / 2, height / 2, shape === "ring" ? 2.5 : 4);
        paintShape(context, shape, paint[colour]);
      }
    }
  }

  /** Show the values of the store and the player in the controls. */
  update() {
    const { store, player } = this;
    this.play.textContent = store.playing ? "Stop" : "Play";
    const nearest = SPEEDS.reduce((best, speed) =>
      Math.abs(Math.log(speed / store.speed)) < Math.abs(Math.log(best / store.speed))
        ? speed : best);
    this.speed.value = String(nearest);
    this.ghost.value = String(store.ghost);
    this.follow.setAttribute("aria-pressed", String(player.look.follow));
    this.bounds.checked = player.look.bounds;
    this.labels.value = player.look.labels;
    this.trail.value = String(player.look.trail);
    this.updateLoop(this.loop.value || "clip");
    this.updateFrame();
  }

  /** Show the frame, its time, and what is visible in it. */
  updateFrame() {
    const { store } = this;
    const last = Math.max(0, store.frames - 1);
    this.scrub.value = String(store.frame);
    this.scrub.setAttribute("aria-valuetext", `frame ${store.frameNumber(store.frame)}`);
    if (document.activeElement !== this.number || store.playing) {
      this.number.value = String(store.frameNumber(store.frame));
    }
    const seconds = (frame) => formatSeconds(frame / store.rate, store.rate);
    this.time.textContent = `${seconds(store.frame)} / ${seconds(last)} s`;
    this.updateStatus();
  }

  /** Go to the frame that was typed. */
  go() {
    const wanted = Number(this.number.value);
    if (this.number.value !== "" && Number.isFinite(wanted)) {
      this.store.setFrame(wanted - this.store.data.clip.first_frame);
    }
    this.number.value = String(this.store.frameNumber(this.store.frame));
  }

  /** Offer what can be played again and again. */
  updateLoop(wanted) {
    const { store } = this;
    const options = [["clip", "Clip"]];
    if (store.activeGap >= 0) {
      options.push(["gap", "Gap"]);
    }
    if (store.range) {
      options.push(["range", "Selection"]);
    }
    this.loop.replaceChildren(
      ...options.map(([value, text]) => element("option", { value, text })));
    this.loop.value = options.some(([value]) => value === wanted) ? wanted : "clip";
    this.setLoop();
  }

  /** Give the store the frames that are played. */
  setLoop() {
    const { store } = this;
    const gap = store.data.gaps[store.activeGap];
    let loop = null;
    if (this.loop.value === "gap" && gap) {
      const margin = Math.max(1, Math.round(LOOP_MARGIN_S * store.rate));
      loop = [Math.max(0, gap.start - margin), Math.min(store.frames, gap.stop + margin) - 1];
    } else if (this.loop.value === "range") {
      loop = store.range;
    }
    store.loop = loop;
  }

  /** Say how many markers are visible, and which are not, if that has changed. */
  updateStatus() {
    const { store, seen } = this;
    let changed = false;
    const groups = MARKER_STYLES.map(() => []);
    for (let marker = 0; marker < seen.length; marker++) {
      const state = store.state(store.frame, marker);
      changed = changed || state !== seen[marker];
      seen[marker] = state;
    }
    if (!changed && this.status.firstChild) {
      return;
    }
    seen.forEach((state, marker) => groups[state].push(marker));
    const parts = groups.map((markers, code) =>
      markers.length && code ? `${markers.length} ${MARKER_STYLES[code].name}` : "");
    const missing = groups[STATE.missing];
    const text = parts.filter(Boolean).join(", ") || "No marker is visible";
    this.status.replaceChildren(missing.length ? `${text}; ${missing.length} missing: ` : text);
    missing.slice(0, LISTED).forEach((marker) => {
      const { label } = store.data.markers[marker];
      this.status.append(button(shortText(label, LABEL_LENGTH), () => this.player.choose(marker),
        { class: "body-missing", title: label }), " ");
    });
    if (missing.length > LISTED) {
      this.status.append(`and ${missing.length - LISTED} more`);
    }
  }
}

/** A label around a control; a box to tick comes before its name. */
function bodyLabel(text, control, nameLast = false) {
  const name = element("span", { text });
  return element("label", { class: "body-label" }, nameLast ? [control, name] : [name, control]);
}

/** Name of the colour of a version in the theme. */
function ghostColour({ kind }) {
  return kind === "truth" ? "truth" : "ghost";
}

/** Name of a version in the menu of ghosts. */
function ghostName({ name, kind }) {
  const names = { original: "As measured", truth: "Truth" };
  return shortText(names[kind] || name, LABEL_LENGTH);
}
