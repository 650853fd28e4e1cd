// While work is under way, which the Stop button shows, buttons that would begin other work are off; then as they were.
// And the page asks at once when it will be done, and not only at the next beat: most work takes less than that.
(() => {
  const PANELS = ["stop", "given", "missing", "own-result", "program-result", "reports"];
  let wasBusy = false;
  let questions = 0;
  const rest = () => {
    const isBusy = document.querySelector("#stop button") !== null;
    // A number that no beat has counted.
    if (isBusy && !wasBusy) dash_clientside.set_props("beat", { n_intervals: --questions });
    wasBusy = isBusy;
    for (const one of document.querySelectorAll("button.rests")) {
      const isOff = isBusy || one.dataset.off === "true";
      if (one.disabled !== isOff) one.disabled = isOff;
    }
  };
  const watched = new Set();
  const watch = () => {
    for (const name of PANELS) {
      const panel = document.getElementById(name);
      if (!panel || watched.has(panel)) continue;
      watched.add(panel);
      const options = { childList: true, subtree: true, attributeFilter: ["data-off", "class"] };
      new MutationObserver(rest).observe(panel, options);
    }
    rest();
    return watched.size === PANELS.length;
  };
  // The page is laid out by script: its panels are there some time after this runs.
  const laidOut = new MutationObserver(() => { if (watch()) laidOut.disconnect(); });
  document.addEventListener("DOMContentLoaded", () => laidOut.observe(document.body, { childList: true, subtree: true }));
})();
