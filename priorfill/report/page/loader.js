/* Unpacks the scripts of the page, which are deflated to keep the file small, and runs them. The
   content security policy has their hash, too. */

/** Run the packed scripts, or state why they cannot run. */
async function runPackedScripts() {
  if (typeof DecompressionStream === "undefined") {
    throw new Error("this browser cannot unpack it; use Chrome 93, Edge 93, Firefox 113, " +
      "Safari 16.4, or a later version");
  }
  const packed = document.getElementById("priorfill-script");
  const bytes = Uint8Array.from(atob(packed.textContent), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.body.append(script);
  script.remove();
  packed.remove();
}

runPackedScripts().catch((error) => {
  const problem = document.getElementById("problem");
  problem.textContent = `Cannot show the report: ${error.message}.`;
  problem.hidden = false;
});
