// A box over the volume, by the pointer or by keys: the page tells the server the box, and how the scene is projected.
(() => {
  const STEP_PX = 8;
  // Share of the sheet that a box has at first, where keys begin it.
  const FIRST = 0.4;
  let isDrawn = false;
  let box = null;

  const sheetOf = (event) => (event.target instanceof Element ? event.target.closest("#view-box-sheet") : null);
  const { show, clamped } = window.workbenchBox;
  const draw = (sheet) => show(sheet.querySelector(".box"), box);

  // What takes places in mm to the screen, row by row: Plotly scales them, then turns and projects them.
  const toClip = (scene) => {
    const { model, view, projection } = scene.glplot.cameraParams;
    const times = (a, b) => {
      // Column by column, as WebGL has them.
      const product = [];
      for (let at = 0; at < 16; at += 1) {
        const row = at % 4;
        const first = at - row;
        product.push([0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + row] * b[first + k], 0));
      }
      return product;
    };
    const [x, y, z] = scene.dataScale;
    const scale = [x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1];
    const columns = times(projection, times(view, times(model, scale)));
    return [0, 1, 2, 3].map((row) => [0, 1, 2, 3].map((column) => columns[4 * column + row]));
  };

  const mark = (sheet) => {
    const graph = document.querySelector("#volume .js-plotly-plot");
    const scene = graph && graph._fullLayout && graph._fullLayout.scene && graph._fullLayout.scene._scene;
    if (!scene || !scene.glplot || box === null) return;
    const at = sheet.getBoundingClientRect();
    const seen = scene.container.getBoundingClientRect();
    const right = (px) => (2 * (at.left + px - seen.left)) / seen.width - 1;
    const up = (px) => 1 - (2 * (at.top + px - seen.top)) / seen.height;
    const data = { to_clip: toClip(scene), right: [right(box.left), right(box.right)], up: [up(box.bottom), up(box.top)] };
    window.dash_clientside.set_props("view-box", { data });
  };

  document.addEventListener("pointerdown", (event) => {
    const sheet = sheetOf(event);
    if (!sheet || event.button !== 0) return;
    isDrawn = true;
    const { clientWidth: right, clientHeight: bottom } = sheet;
    const limits = { left: 0, top: 0, right, bottom };
    window.workbenchBox.follow(event, sheet, sheet.querySelector(".box"), limits, (drawn) => {
      isDrawn = false;
      box = drawn;
      mark(sheet);
    });
  });

  const begin = (sheet) => {
    const { clientWidth: width, clientHeight: height } = sheet;
    const share = (1 - FIRST) / 2;
    box = { left: share * width, right: (1 - share) * width, top: share * height, bottom: (1 - share) * height };
  };
  const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const step = (sheet, key, sizes) => {
    const [x, y] = STEPS[key].map((one) => one * STEP_PX);
    const { clientWidth: width, clientHeight: height } = sheet;
    if (sizes) {
      box.right = clamped(box.right + x, box.left + STEP_PX, width);
      box.bottom = clamped(box.bottom + y, box.top + STEP_PX, height);
      return;
    }
    const dx = clamped(x, -box.left, width - box.right);
    const dy = clamped(y, -box.top, height - box.bottom);
    box = { left: box.left + dx, right: box.right + dx, top: box.top + dy, bottom: box.bottom + dy };
  };
  document.addEventListener("keydown", (event) => {
    const sheet = sheetOf(event);
    if (!sheet || !(event.key in STEPS || event.key === "Enter")) return;
    event.preventDefault();
    if (box === null) begin(sheet);
    if (event.key === "Enter") mark(sheet);
    else step(sheet, event.key, event.shiftKey);
    draw(sheet);
  });
  document.addEventListener("focusin", (event) => {
    const sheet = sheetOf(event);
    // By Tab: what keys will move is seen at once.
    if (!sheet || isDrawn || box !== null) return;
    begin(sheet);
    draw(sheet);
  });
  document.addEventListener("focusout", (event) => {
    const sheet = sheetOf(event);
    if (!sheet) return;
    // The volume may be turned before the sheet is next seen.
    box = null;
    draw(sheet);
  });
})();
