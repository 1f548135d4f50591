/* Requests to the server of a review, which fills and saves. */

/** What to do when the server does not answer. */
const SERVER_LOST = "The review server does not answer. Export the decisions, and start " +
  "priorfill review again with --overrides";

/** A request that failed; the message is one line. */
class ServerError extends Error {}

/** The server that the page was loaded from. */
class ServerLink {
  /** @param {string} base address of the page, with the token */
  constructor(base) {
    this.base = base.replace(/[?#].*$/, "").replace(/\/?$/, "/");
    this.abort = null;
  }

  /** @returns {boolean} whether a fill or a save is running */
  get busy() {
    return this.abort !== null;
  }

  /**
   * Send a request.
   * @param {string} action last part of the address
   * @param {Object} content sent as JSON
   * @param {AbortSignal} [signal]
   * @returns {Promise<Response>}
   */
  async send(action, content, signal) {
    let response;
    try {
      response = await fetch(this.base + action, {
        method: "POST", headers: { "Content-Type": "application/json" },
        body: JSON.stringify(content), cache: "no-store", signal,
      });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new ServerError(SERVER_LOST);
    }
    if (!response.ok) throw new ServerError(await failureText(response));
    return response;
  }

  /**
   * Fill with decisions, or fill and save.
   * @param {string} action "fill" or "save"
   * @param {Object[]} decisions
   * @param {function(number, number)} progress called with what is done and the total
   * @returns {Promise<Object|null>} the last message of the server; null if it was stopped
   */
  async run(action, decisions, progress) {
    if (this.busy) throw new ServerError("A fill is running; wait for it, or stop it");
    this.abort = new AbortController();
    const { signal } = this.abort;
    try {
      const response = await this.send(action, { decisions }, signal);
      let last = null;
      for await (const message of messagesOf(response)) {
        if (typeof message.error === "string") throw new ServerError(safeText(message.error));
        if (typeof message.total === "number") progress(message.done, message.total);
        last = message;
      }
      if (last === null || last[action === "fill" ? "data" : "saved"] === undefined) {
        throw new ServerError(`The review server stopped during the ${action}. Export the ` +
          "decisions, and start priorfill review again with --overrides");
      }
      return last;
    } catch (error) {
      if (signal.aborted) return null;
      throw error instanceof ServerError ? error : new ServerError(SERVER_LOST);
    } finally {
      this.abort = null;
    }
  }

  /** Stop the fill that is running. */
  async cancel() {
    if (this.abort === null) return;
    this.abort.abort();
    await this.send("cancel", {}).catch(() => {});
  }

  /**
   * Have the server check decisions.
   * @param {Object[]} decisions
   * @returns {Promise} fails with the server's message
   */
  async check(decisions) {
    await this.send("check", { decisions });
  }

  /** End the server. */
  async close() {
    await this.send("close", {});
  }
}

/**
 * Return what a refused request is to tell the user.
 * @param {Response} response
 * @returns {Promise<string>} one line
 */
async function failureText(response) {
  try {
    const content = await response.json();
    if (typeof content.error === "string") return safeText(content.error);
  } catch {
    // not JSON: the status is all there is
  }
  if (response.status === 409) return "Another fill is running; wait for it, or stop it";
  if (response.status === 413) return "The decisions are too long for the review server";
  if (response.status === 403 || response.status === 404) return SERVER_LOST;
  return `The review server refused the request (status ${response.status})`;
}

/**
 * Read the lines of JSON of a response as they come.
 * @param {Response} response
 * @yields {Object} the message of a line
 */
async function* messagesOf(response) {
  const reader = response.body.getReader();
  const decoder = new TextDecoder();
  let pieces = [];
  for (;;) {
    const { done, value } = await reader.read();
    const lines = (done ? decoder.decode() : decoder.decode(value, { stream: true })).split("\n");
    while (lines.length > 1) {
      pieces.push(lines.shift());
      const line = pieces.join("");
      pieces = [];
      if (line.trim() !== "") yield JSON.parse(line);
    }
    pieces.push(lines[0]);
    if (done) {
      const rest = pieces.join("");
      if (rest.trim() !== "") yield JSON.parse(rest);
      return;
    }
  }
}
