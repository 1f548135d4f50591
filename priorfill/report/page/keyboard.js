/* Keys that work anywhere on the page. */

class Keyboard {
  /**
   * @param {Store} store
   * @param {Object} views by name
   */
  constructor(store, views) {
    this.store = store;
    this.views = views;
  }
}
