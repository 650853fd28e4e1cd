// A box that a pointer draws over a picture, in pixels of what it is drawn in; the pictures' own scripts use it.
window.workbenchBox = (() => {
  // Less is a click.
  const LEAST_PX = 4;
  const show = (drawn, box) => {
    drawn.hidden = box === null;
    if (box === null) return;
    drawn.style.left = `${box.left}px`;
    drawn.style.top = `${box.top}px`;
    drawn.style.width = `${box.right - box.left}px`;
    drawn.style.height = `${box.bottom - box.top}px`;
  };
  const clamped = (value, low, high) => Math.min(Math.max(value, low), high);

  // Follow the pointer from its press on `host` on, within `limits`; `done` is told the box, or null of a click.
  const follow = (press, host, drawn, limits, done) => {
    const at = host.getBoundingClientRect();
    const place = (event) => ({
      x: clamped(event.clientX - at.left, limits.left, limits.right),
      y: clamped(event.clientY - at.top, limits.top, limits.bottom),
    });
    const corner = place(press);
    let box = null;
    const move = (event) => {
      const { x, y } = place(event);
      box = { left: Math.min(corner.x, x), right: Math.max(corner.x, x), top: Math.min(corner.y, y), bottom: Math.max(corner.y, y) };
      if (Math.max(box.right - box.left, box.bottom - box.top) < LEAST_PX) box = null;
      show(drawn, box);
    };
    const end = (event) => {
      host.classList.remove("boxing");
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", end);
      window.removeEventListener("pointercancel", end);
      done(event.type === "pointerup" ? box : null);
    };
    show(drawn, null);
    host.classList.add("boxing");
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", end);
    window.addEventListener("pointercancel", end);
  };
  return { follow, show, clamped };
})();
