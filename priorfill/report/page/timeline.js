/* All gaps: markers down, frames across. */

class Timeline {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.store = store;
    this.canvas = element("canvas", { tabindex: "0", "aria-label": "Timeline of all gaps" });
    root.append(this.canvas);
  }

  /** Draw at once. */
  draw() {}
}
