/* The gaps as a table, worst first. */

class GapTable {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.store = store;
    this.root = root;
  }

  /** Draw at once. */
  draw() {}
}
