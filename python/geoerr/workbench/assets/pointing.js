// What the pointer or the keyboard is on: its candidate is shown in the pictures after a moment, and taken away again.
(() => {
  const MOMENT_MS = 150;
  let shown = "";
  let timer = null;
  const point = (event) => {
    const card = event.target instanceof Element ? event.target.closest("[data-candidate]") : null;
    const name = card ? card.dataset.candidate : "";
    clearTimeout(timer);
    timer = setTimeout(() => {
      if (name !== shown && window.dash_clientside && window.dash_clientside.set_props) {
        shown = name;
        window.dash_clientside.set_props("hovered", { data: name });
      }
    }, MOMENT_MS);
  };
  document.addEventListener("pointerover", point);
  document.addEventListener("focusin", point);
})();

// What Plotly tells of a point goes away with the pointer, even where a box was drawn over the point meanwhile.
document.addEventListener("pointerout", (event) => {
  const left = event.target instanceof Element ? event.target.closest(".js-plotly-plot") : null;
  const entered = event.relatedTarget instanceof Element ? event.relatedTarget : null;
  if (left && !left.contains(entered) && left._fullLayout && window.Plotly && window.Plotly.Fx) {
    // Or it comes back when the picture is next drawn.
    left._fullLayout._hoversubplot = null;
    window.Plotly.Fx.unhover(left);
  }
});
