// A box over the residual. Plotly's own redraws every point as it is drawn, and answers after that: here the server is
// asked first, and the points are drawn anew once.
(() => {
  // A box thinner than this is a stroke along the other way, as with Plotly's own.
  const THIN_PX = 12;
  const graphOf = (target) => target.closest("#residual .js-plotly-plot");
  const send = (data) => window.dash_clientside.set_props("box", { data });

  const pressedOn = (event) => {
    const part = event.target instanceof Element ? event.target.closest("#residual .nsewdrag") : null;
    const layout = part ? graphOf(part)._fullLayout : null;
    return layout && layout.dragmode === "select" && !event.button && !event.shiftKey ? { part, layout } : null;
  };
  const ends = (low, high, all) => (high - low < THIN_PX ? [0, all] : [low, high]);

  document.addEventListener("pointerdown", (event) => {
    const pressed = pressedOn(event);
    if (!pressed) return;
    const host = document.getElementById("residual-frame");
    const { xaxis, yaxis } = pressed.layout._plots[pressed.part.dataset.subplot];
    const [at, plot] = [host.getBoundingClientRect(), pressed.part.getBoundingClientRect()];
    const left = plot.left - at.left;
    const top = plot.top - at.top;
    const limits = { left, top, right: left + plot.width, bottom: top + plot.height };
    const drawn = host.querySelector(":scope > .box");
    window.workbenchBox.follow(event, host, drawn, limits, (box) => {
      if (box === null) return;
      let across = [box.left - left, box.right - left];
      let down = [box.top - top, box.bottom - top];
      const [width, height] = [across[1] - across[0], down[1] - down[0]];
      if (width >= height) down = ends(...down, plot.height);
      else across = ends(...across, plot.width);
      send({ range: { [xaxis._id]: across.map(xaxis.p2d), [yaxis._id]: down.map(yaxis.p2d) } });
    });
  }, true);
  // Plotly begins a selection of its own with these.
  for (const kind of ["mousedown", "touchstart"]) {
    document.addEventListener(kind, (event) => { if (pressedOn(event)) event.stopPropagation(); }, true);
  }
  document.addEventListener("dblclick", (event) => { if (pressedOn(event)) send(null); }, true);

  // What was marked is drawn with the picture from now on.
  document.addEventListener("DOMContentLoaded", () => {
    const away = () => {
      const graph = document.querySelector("#residual .js-plotly-plot");
      if (!graph || !graph.on) return;
      observer.disconnect();
      graph.on("plotly_afterplot", () => {
        window.workbenchBox.show(document.querySelector("#residual-frame > .box"), null);
      });
    };
    const observer = new MutationObserver(away);
    observer.observe(document.body, { childList: true, subtree: true });
  });
})();
