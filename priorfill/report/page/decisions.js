class Decisions {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
  }

  /** Draw at once. */
  draw() {}
}
