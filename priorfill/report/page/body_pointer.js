/* How the mouse, fingers and keys move the camera of the body player. */

/** Radians for a pixel of dragging, and for a press of an arrow key. */
const ORBIT_DRAG = 0.008;
const ORBIT_KEY = 0.12;

/** Pixels that a press of shift and an arrow key moves the picture. */
const PAN_KEY = 30;

/** Factor of a press of + or -, and exponent for a pixel of the wheel. */
const ZOOM_KEY = 1.2;
const ZOOM_WHEEL = 0.0016;

/** Pixels that count as one line or one page of a wheel. */
const WHEEL_UNITS = [1, 24, 240];

/** A press that moves less (pixels) is a click. */
const CLICK_MOVE = 5;

/** Distance (pixels) within which a marker is hovered or clicked; more for fingers. */
const REACH_MOUSE = 12;
const REACH_TOUCH = 24;

/** Keys that choose a view. */
const BODY_VIEW_KEYS = { 1: "front", 2: "side", 3: "top" };

/** Turns events of the canvas into calls of a `BodyPlayer`. */
class BodyPointer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {BodyPlayer} player
   */
  constructor(canvas, player) {
    this.canvas = canvas;
    this.player = player;
    this.camera = player.camera;
    this.pressed = new Map();
    this.travel = 0;
    const on = (event, fn) => canvas.addEventListener(event, fn.bind(this));
    on("pointerdown", this.down);
    on("pointermove", this.move);
    on("pointerup", this.lift);
    on("pointercancel", this.lift);
    on("pointerleave", () => player.hover(-1));
    on("contextmenu", (event) => event.preventDefault());
    on("keydown", this.key);
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  }

  /** Pixels of an event from the top left of the canvas. */
  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  /** A button or finger goes down. */
  down(event) {
    if (this.pressed.size === 0) {
      this.travel = 0;
    }
    this.canvas.setPointerCapture(event.pointerId);
    this.pressed.set(event.pointerId, this.place(event));
    this.panning = event.button === 2 || event.button === 1 || event.shiftKey;
    if (this.pressed.size > 1) {
      this.travel = Infinity;
    }
  }

  /** The pointer moves: hover, orbit, pan or pinch. */
  move(event) {
    const { x, y } = this.place(event);
    const last = this.pressed.get(event.pointerId);
    if (!last) {
      this.player.hover(this.player.drawing.pick(x, y, REACH_MOUSE), x, y);
      return;
    }
    const [dx, dy] = [x - last.x, y - last.y];
    this.travel += Math.abs(dx) + Math.abs(dy);
    if (this.pressed.size > 1) {
      this.pinch(event.pointerId, last, { x, y });
    } else if (this.panning) {
      this.camera.pan(dx, dy);
    } else if (this.travel >= CLICK_MOVE) {
      this.camera.orbit(-dx * ORBIT_DRAG, dy * ORBIT_DRAG);
    }
    this.pressed.set(event.pointerId, { x, y });
    if (this.panning || this.travel >= CLICK_MOVE) {
      this.player.cameraMoved();
    }
  }

  /** Two fingers: their distance zooms, their middle pans. */
  pinch(id, last, place) {
    const other = [...this.pressed.entries()].find(([key]) => key !== id)[1];
    const before = Math.hypot(last.x - other.x, last.y - other.y);
    const after = Math.hypot(place.x - other.x, place.y - other.y);
    this.camera.pan((place.x - last.x) / 2, (place.y - last.y) / 2);
    if (before > 1 && after > 1) {
      this.camera.zoom(after / before, (place.x + other.x) / 2, (place.y + other.y) / 2);
    }
  }

  /** A button or finger goes up; without a movement it was a click. */
  lift(event) {
    const place = this.pressed.get(event.pointerId);
    this.pressed.delete(event.pointerId);
    if (event.type === "pointerup" && place && event.button === 0 && this.travel < CLICK_MOVE) {
      const reach = event.pointerType === "touch" ? REACH_TOUCH : REACH_MOUSE;
      const found = this.player.drawing.pick(place.x, place.y, reach);
      if (found >= 0) {
        this.player.choose(found, event.shiftKey || event.ctrlKey || event.metaKey);
      }
    }
  }

  /** The wheel zooms about the pointer. */
  wheel(event) {
    event.preventDefault();
    const { x, y } = this.place(event);
    this.camera.zoom(Math.exp(-event.deltaY * WHEEL_UNITS[event.deltaMode] * ZOOM_WHEEL), x, y);
    this.player.cameraMoved();
  }

  /** Keys while the picture has the focus. */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || !this.press(event)) {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  }

  /** Do what a key does; false for other keys. */
  press(event) {
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) {
      this.camera.pan(-arrow[0] * PAN_KEY, -arrow[1] * PAN_KEY);
    } else if (arrow) {
      this.camera.orbit(arrow[0] * ORBIT_KEY, -arrow[1] * ORBIT_KEY);
    } else if (event.key === "+" || event.key === "=") {
      this.camera.zoom(ZOOM_KEY, this.camera.width / 2, this.camera.height / 2);
    } else if (event.key === "-" || event.key === "_") {
      this.camera.zoom(1 / ZOOM_KEY, this.camera.width / 2, this.camera.height / 2);
    } else {
      return this.pressView(event.key);
    }
    this.player.cameraMoved();
    return true;
  }

  /** Keys that choose a view, a marker, or what the camera follows. */
  pressView(key) {
    if (BODY_VIEW_KEYS[key]) {
      this.player.view(BODY_VIEW_KEYS[key]);
    } else if (key === "0" || key === "Home") {
      this.player.fit();
    } else if (key === "c") {
      this.player.setFollow(!this.player.look.follow);
    } else if (key === "m" || key === "M") {
      this.player.chooseNext(key === "m" ? 1 : -1);
    } else {
      return false;
    }
    return true;
  }
}
