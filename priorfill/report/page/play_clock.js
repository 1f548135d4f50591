/* The clock of playing: moves the frame on with the time that has passed. */

/** Longest time (s) that counts as passed between two drawings; longer ones were pauses. */
const LONGEST_TICK_S = 0.25;

/**
 * Move on at each drawing of the screen while the store plays; within the frames of its loop, if
 * there are any, and from the beginning again after the last frame.
 * @param {Store} store
 * @param {number} run number of the run of playing, so that an earlier one ends
 * @param {number|null} before time (ms) of the drawing before
 * @param {number} place frame, with its fraction
 */
function playOn(store, run, before, place) {
  requestAnimationFrame((time) => {
    if (!store.playing || run !== store.playRuns) return;
    let at = place;
    if (before !== null && Math.floor(place) === store.frame) {
      at += Math.min(LONGEST_TICK_S, (time - before) / 1000) * store.speed * store.rate;
    } else if (before !== null) at = store.frame; // someone has moved it
    const [first, last] = store.loop || [0, store.frames - 1];
    if (at >= last + 1 || at < first) at = first;
    store.setFrame(Math.floor(at));
    playOn(store, run, time, at);
  });
}
