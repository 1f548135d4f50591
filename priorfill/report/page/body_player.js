/* The body player: a picture that can be turned, its controls, and what they share. */

/** Pixels between the pointer and the box that describes a marker. */
const TIP_OFFSET = 14;

/** Follow the body from the start if it travels farther than this times its own size. */
const FOLLOW_TRAVEL = 1.05;

/** Pitch (radians) of the views from the front and the side, and of the first picture. */
const LEVEL_PITCH = 0.08;
const FIRST_PITCH = 0.2;

/** The first picture is seen from this angle (radians) next to the front. */
const FIRST_YAW = 0.6;

class BodyPlayer {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.store = store;
    this.camera = new BodyCamera();
    this.drawing = new BodyDrawing(store, this.camera);
    this.overlay = new BodyOverlay(store, this.camera, this.drawing);
    this.look = {
      follow: false, bounds: true, ghost: -1, labels: "chosen", trail: 0.5, hovered: -1,
    };
    this.scene = null;
    this.touched = false;
    this.visible = true;
    this.offset = new Float64Array(3);
    this.centre = new Float64Array(3);
    this.ask = scheduled(() => {
      if (this.visible) {
        this.draw();
      }
    });
    this.build(root);
    this.listen();
  }

  /** Make the elements. */
  build(root) {
    this.canvas = element("canvas", {
      tabindex: 0, role: "application", "aria-label": "Body: arrow keys turn it, shift and arrow " +
        "keys move it, + and − zoom, 0 fits, 1 2 3 are views, m chooses the next marker",
      "aria-describedby": "body-status",
    });
    this.tip = element("div", { class: "body-tip", hidden: true });
    this.stage = element("div", { class: "body-stage" }, [this.canvas, this.tip]);
    this.controls = new BodyControls(this, this.store);
    this.stage.append(this.controls.views);
    root.replaceChildren(this.stage, this.controls.transport, this.controls.shown,
      this.controls.status, this.controls.legend);
    this.pointer = new BodyPointer(this.canvas, this);
  }

  /** Listen to the store and to changes of the size. */
  listen() {
    const { store } = this;
    store.on("decoded", ({ version, frames }) => this.take(version, frames));
    store.on("frame", () => {
      this.controls.updateFrame();
      this.ask();
    });
    store.on("data", () => this.reload());
    store.on("range", () => this.controls.updateLoop(store.range ? "range" : "clip"));
    for (const event of ["play", "gap", "markers", "versions"]) {
      store.on(event, () => {
        this.look.ghost = store.ghost;
        this.controls.update();
        this.ask();
      });
    }
    store.on("theme", () => {
      this.controls.drawLegend();
      this.ask();
    });
    new ResizeObserver(this.ask).observe(this.stage);
    new IntersectionObserver(([entry]) => {
      this.visible = entry.isIntersecting;
      this.ask();
    }).observe(this.stage);
  }

  /** New data: other markers and sticks, the same view. */
  reload() {
    this.drawing.load();
    this.overlay.load();
    this.look.hovered = -1;
    this.look.ghost = this.store.ghost;
    this.controls.load();
    this.controls.drawLegend();
    this.ask();
  }

  /** A block of positions has been decoded; the first and the last one decide what is fitted. */
  take(version, frames) {
    const last = frames >= this.store.frames;
    if (version === 0 && (!this.scene || last)) {
      const first = !this.scene;
      this.scene = new BodyScene(this.store);
      this.drawing.setScene(this.scene);
      if (!this.touched) {
        this.look.follow = this.scene.travel > FOLLOW_TRAVEL * this.scene.size;
        this.camera.pitch = FIRST_PITCH;
        this.camera.yaw = this.front() + FIRST_YAW;
        this.fit();
        this.touched = false;
      }
      this.controls.update();
      if (first) {
        this.controls.drawLegend();
      }
    }
    this.ask();
  }

  /** Angle (radians) of the eye for a view from the front; along the x axis if it is unknown. */
  front() {
    const facing = this.scene ? this.scene.facing(this.store.frame) : NaN;
    return Number.isNaN(facing) ? 0 : facing;
  }

  /** Look from the front, the right side, or the top. */
  view(name) {
    this.camera.yaw = this.front() - (name === "side" ? Math.PI / 2 : 0);
    this.camera.pitch = LEVEL_PITCH;
    if (name === "top") {
      this.camera.yaw += Math.PI;
      this.camera.pitch = Math.PI / 2;
    }
    this.fit();
  }

  /** Show the body, if it is followed, otherwise all places where it is in the clip. */
  fit() {
    this.camera.update();
    if (this.scene) {
      const { around, places } = this.scene;
      this.scene.centre(this.store.frame, this.centre);
      if (this.look.follow) {
        this.camera.fit(around, this.centre);
      } else {
        this.camera.fit(places, [0, 0, 0]);
      }
    }
    this.cameraMoved();
  }

  /** Zoom about the middle of the picture. */
  zoom(factor) {
    this.camera.zoom(factor, this.camera.width / 2, this.camera.height / 2);
    this.cameraMoved();
  }

  /** Keep where the camera is, seen from the body, and draw. */
  cameraMoved() {
    this.touched = true;
    if (this.scene) {
      this.scene.centre(this.store.frame, this.centre);
      this.offset.forEach((_, axis) => {
        this.offset[axis] = this.camera.target[axis] - this.centre[axis];
      });
    }
    this.ask();
  }

  /** Let the camera follow the body, or stay where it is. */
  setFollow(on) {
    this.look.follow = on;
    this.cameraMoved();
    this.controls.update();
  }

  /** Change what is shown: "bounds", "labels" or "trail". */
  setLook(name, value) {
    this.look[name] = value;
    this.ask();
  }

  /** Choose a marker, and the gap that it is in; `more` adds it to those chosen or takes it out. */
  choose(marker, more = false) {
    const { store } = this;
    if (more) {
      const others = store.markers.filter((other) => other !== marker);
      store.setMarkers(others.length < store.markers.length ? others : [...others, marker]);
      return;
    }
    const gap = store.gapAt(store.frame, marker);
    if (gap >= 0) {
      store.setActiveGap(gap, { frame: store.frame });
    } else {
      store.setMarkers([marker]);
    }
    announce(this.describe(marker).join(", "));
  }

  /** Choose the next marker (1) or the one before (-1) in the order of the file. */
  chooseNext(step) {
    const count = this.store.markerCount;
    const from = this.store.markers.length ? this.store.markers[0] : step > 0 ? -1 : 0;
    this.choose((from + step + count) % count);
  }

  /** Show what is under the pointer at (x, y) pixels; -1 is nothing. */
  hover(marker, x, y) {
    this.canvas.classList.toggle("body-over", marker >= 0);
    this.tip.hidden = marker < 0;
    if (marker >= 0) {
      this.tip.replaceChildren(...this.describe(marker).map((text) => element("div", { text })));
      const left = Math.min(x + TIP_OFFSET, this.camera.width - this.tip.offsetWidth - 4);
      const above = y + TIP_OFFSET + this.tip.offsetHeight > this.camera.height;
      const top = above ? y - TIP_OFFSET - this.tip.offsetHeight : y + TIP_OFFSET;
      this.tip.style.left = `${Math.max(4, left)}px`;
      this.tip.style.top = `${Math.max(4, top)}px`;
    }
    if (marker !== this.look.hovered) {
      this.look.hovered = marker;
      this.ask();
    }
  }

  /** Label, state and errors of a marker in the frame, as lines of text. */
  describe(marker) {
    const { store, look } = this;
    const { frame } = store;
    const state = store.state(frame, marker);
    const lines = [shortText(store.data.markers[marker].label, 80), MARKER_STYLES[state].name];
    if (isFilled(state)) {
      lines.push(`expected rms error ${formatMm(store.rms(frame, marker))}`);
      lines.push(`90 % bound ${formatMm(store.bound(frame, marker))}`);
    }
    if (look.ghost >= 0 && state && store.shown(look.ghost, frame, marker)) {
      const name = ghostName(store.data.versions[look.ghost]).toLowerCase();
      lines.push(`${formatMm(this.apart(look.ghost, frame, marker))} from ${name}`);
    }
    return lines;
  }

  /** Distance (mm) of a sample from the same one in another version. */
  apart(version, frame, marker) {
    const at = (frame * this.store.markerCount + marker) * 3;
    const [one, other] = [this.store.positions(0), this.store.positions(version)];
    return Math.hypot(...[0, 1, 2].map((axis) => one[at + axis] - other[at + axis])) / UNITS_PER_MM;
  }

  /** Draw at once. */
  draw() {
    if (!this.canvas.clientWidth) {
      return;
    }
    const { store, camera } = this;
    const { context, width, height } = fitCanvas(this.canvas);
    if (width !== camera.width || height !== camera.height) {
      camera.resize(width, height);
      if (this.scene && !this.touched) {
        this.fit();
        this.touched = false;
      }
    }
    if (this.look.follow && this.scene) {
      this.scene.centre(store.frame, this.centre);
      for (let axis = 0; axis < 3; axis++) {
        camera.target[axis] = this.centre[axis] + this.offset[axis];
      }
    }
    const decoded = store.frame < store.decodedFrames;
    this.drawing.draw(context, decoded ? store.frame : -1, this.look);
    if (decoded) {
      this.overlay.draw(context, store.frame, this.look);
    }
    if (!decoded && store.frames) {
      this.overlay.message(context, "Loading this frame …");
    } else if (!this.drawing.anyVisible(store.frame)) {
      this.overlay.message(context, "No marker is visible in this frame.");
    }
  }
}
