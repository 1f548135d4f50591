/* What was done: file, method, options, database, versions, notes. */

class Summary {
  /**
   * @param {HTMLElement} root
   * @param {Store} store
   */
  constructor(root, store) {
    this.root = root;
    this.store = store;
    store.on("data", () => this.draw());
    this.draw();
  }

  /** Write the facts. */
  draw() {
    this.root.replaceChildren(element("p", { text: this.store.data.title }));
  }
}
