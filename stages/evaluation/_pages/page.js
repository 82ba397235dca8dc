"use strict";
// Pictures of one group share their scale; 100 % is one screen pixel per picture pixel.
for (const group of document.querySelectorAll("[data-zoom]")) {
  const views = [...group.querySelectorAll(".view")];
  const buttons = [...group.querySelectorAll("button[data-scale]")];
  const together = group.hasAttribute("data-together");
  let mode = "fit";
  const room = (view) => Math.min(view.clientWidth / view.dataset.width, view.clientHeight / view.dataset.height);
  const show = (next, clicked, place) => {
    const middles = views.map((view) => [
      (view.scrollLeft + view.clientWidth / 2) / view.scrollWidth,
      (view.scrollTop + view.clientHeight / 2) / view.scrollHeight,
    ]);
    mode = next;
    for (const view of views) view.style.overflow = mode === "fit" ? "hidden" : "auto";
    const scale = mode === "fit" ? Math.min(...views.map(room)) : mode / devicePixelRatio;
    views.forEach((view, index) => {
      const sheet = view.firstElementChild;
      sheet.style.width = view.dataset.width * scale + "px";
      sheet.style.height = view.dataset.height * scale + "px";
      sheet.classList.toggle("large", scale * devicePixelRatio > 1);
      const [x, y] = view === clicked || (clicked && together) ? place : middles[index];
      view.scrollLeft = x * view.scrollWidth - view.clientWidth / 2;
      view.scrollTop = y * view.scrollHeight - view.clientHeight / 2;
    });
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.scale === String(mode)));
    group.dataset.zoom = String(mode);
  };
  for (const button of buttons) {
    button.addEventListener("click", () => show(button.dataset.scale === "fit" ? "fit" : Number(button.dataset.scale)));
  }
  for (const view of views) {
    let from = null;
    view.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.pointerType === "touch") return;
      from = { x: event.clientX, y: event.clientY, left: view.scrollLeft, top: view.scrollTop, moved: false };
    });
    view.addEventListener("pointermove", (event) => {
      if (!from) return;
      const x = event.clientX - from.x;
      const y = event.clientY - from.y;
      if (!from.moved && Math.hypot(x, y) < 4) return;
      from.moved = true;
      view.setPointerCapture(event.pointerId);
      view.classList.add("held");
      view.scrollLeft = from.left - x;
      view.scrollTop = from.top - y;
    });
    let dragged = false;
    const release = () => {
      dragged = from !== null && from.moved;
      view.classList.remove("held");
      from = null;
    };
    view.addEventListener("pointerup", release);
    view.addEventListener("pointercancel", release);
    view.addEventListener("click", (event) => {
      if (dragged) return;
      const box = view.firstElementChild.getBoundingClientRect();
      const place = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      show({ fit: 1, 1: 2 }[mode] ?? "fit", view, place);
    });
    view.addEventListener("scroll", () => {
      if (!together) return;
      for (const other of views) {
        if (other.scrollLeft !== view.scrollLeft) other.scrollLeft = view.scrollLeft;
        if (other.scrollTop !== view.scrollTop) other.scrollTop = view.scrollTop;
      }
    });
  }
  for (const box of group.querySelectorAll("input[data-lattice]")) {
    box.addEventListener("change", () => group.classList.toggle("without-lattice", !box.checked));
  }
  addEventListener("resize", () => show(mode));
  show("fit");
}

// Thumbnails open at full size; the arrow keys go to the neighbours in the row and in the column.
const dialog = document.querySelector("dialog");
if (dialog) {
  const thumbs = [...document.querySelectorAll(".thumb")];
  const picture = dialog.querySelector("img");
  let current = 0;
  const open = (index) => {
    current = (index + thumbs.length) % thumbs.length;
    const source = thumbs[current].querySelector("img");
    picture.src = source.src;
    picture.alt = source.alt;
    picture.style.width = source.naturalWidth / devicePixelRatio + "px";
    dialog.querySelector("[data-name]").textContent = source.alt;
    if (!dialog.open) dialog.showModal();
  };
  thumbs.forEach((thumb, index) => thumb.addEventListener("click", () => open(index)));
  const along = (way) => {
    const column = thumbs[current].dataset.column;
    let index = current;
    do index = (index + way + thumbs.length) % thumbs.length; while (thumbs[index].dataset.column !== column);
    open(index);
  };
  dialog.addEventListener("keydown", (event) => {
    const move = {
      ArrowLeft: () => open(current - 1), ArrowRight: () => open(current + 1),
      ArrowUp: () => along(-1), ArrowDown: () => along(1),
    }[event.key];
    if (move) { event.preventDefault(); move(); }
  });
  dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
  dialog.querySelector("[data-close]").addEventListener("click", () => dialog.close());
}
