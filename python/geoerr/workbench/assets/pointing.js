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
