/* Light and dark colours, by the system or the button; on paper light. */

/**
 * Switch between light and dark.
 * @param {function} changed called when the colours have changed
 * @param {function} printed called with true before the page is printed, with false after it
 * @param {string} key of the keyboard that does what the button does; empty without one
 */
function followTheme(changed, printed, key = "") {
  const toggle = document.getElementById("theme");
  const hint = key && ` (${key})`;
  const refresh = () => {
    forgetColours();
    const { dark } = colours();
    toggle.textContent = dark ? "Light" : "Dark";
    toggle.title = `${dark ? "Light" : "Dark"} colours${hint}`;
    changed();
  };
  toggle.addEventListener("click", () => {
    document.documentElement.dataset.theme = colours().dark ? "light" : "dark";
    refresh();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", refresh);
  followPrinting(refresh, printed);
  refresh();
}

/**
 * Print in light colours, as wide as the paper.
 * @param {function} refresh reads the colours again
 * @param {function} printed as in `followTheme`
 */
function followPrinting(refresh, printed) {
  const root = document.documentElement;
  let screenTheme = null;
  const print = (on) => {
    if (on === (screenTheme !== null)) return;
    const theme = on ? "light" : screenTheme;
    screenTheme = on ? root.dataset.theme || "" : null;
    if (theme) root.dataset.theme = theme;
    else delete root.dataset.theme;
    root.classList.toggle("printing", on);
    refresh();
    printed(on);
  };
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
}
