"use strict";

const copyButton = document.querySelector("[data-copy]");
if (copyButton) {
  const text = copyButton.previousElementSibling;
  copyButton.hidden = false;
  copyButton.addEventListener("click", async () => {
    getSelection().selectAllChildren(text);
    try {
      await navigator.clipboard.writeText(text.textContent);
    } catch {
      document.execCommand("copy"); // where pages of files may not write to the clipboard
    }
    copyButton.textContent = "Copied";
    setTimeout(() => { copyButton.textContent = "Copy"; }, 1500);
  });
}

// Pictures of one group share their scale; 100 % is one screen pixel per picture pixel.
for (const group of document.querySelectorAll("[data-zoom]")) {
  const views = [...group.querySelectorAll(".view")];
  const buttons = [...group.querySelectorAll("button[data-scale]")];
  const together = group.hasAttribute("data-together");
  let mode = "fit";
  const room = (view) => Math.min(view.clientWidth / view.dataset.width, view.clientHeight / view.dataset.height);
  const middle = (view) => [
    (view.scrollLeft + view.clientWidth / 2) / view.scrollWidth,
    (view.scrollTop + view.clientHeight / 2) / view.scrollHeight,
  ];
  // `places` gives the points, as shares of a picture, to be brought into the middle of views
  const show = (next, places = new Map()) => {
    mode = next;
    const visible = views.filter((view) => view.clientWidth > 0);
    const middles = new Map(visible.map((view) => [view, middle(view)]));
    for (const view of visible) view.style.overflow = mode === "fit" ? "hidden" : "auto";
    const scale = mode === "fit" ? Math.min(...visible.map(room)) : mode / devicePixelRatio;
    for (const view of visible) {
      const sheet = view.firstElementChild;
      sheet.style.width = view.dataset.width * scale + "px";
      sheet.style.height = view.dataset.height * scale + "px";
      sheet.classList.toggle("large", scale * devicePixelRatio > 1);
      const [x, y] = places.get(view) ?? middles.get(view);
      view.scrollLeft = x * view.scrollWidth - view.clientWidth / 2;
      view.scrollTop = y * view.scrollHeight - view.clientHeight / 2;
    }
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.scale === String(mode)));
    group.dataset.zoom = String(mode);
    group.dispatchEvent(new Event("zoomed"));
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
    const next = () => ({ fit: 1, 1: 2 }[mode] ?? "fit");
    view.addEventListener("click", (event) => {
      if (dragged) return;
      const box = view.firstElementChild.getBoundingClientRect();
      const place = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      show(next(), new Map((together ? views : [view]).map((one) => [one, place])));
    });
    view.addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      show(next());
    });
    view.addEventListener("scroll", () => {
      if (!together) return;
      for (const other of views) {
        if (other.scrollLeft !== view.scrollLeft) other.scrollLeft = view.scrollLeft;
        if (other.scrollTop !== view.scrollTop) other.scrollTop = view.scrollTop;
      }
    });
  }
  for (const box of group.querySelectorAll("input[data-shows]")) {
    const toggle = () => group.classList.toggle(`without-${box.dataset.shows}`, !box.checked);
    box.addEventListener("change", toggle);
    toggle();
  }
  addEventListener("resize", () => show(mode));
  group.show = show;
  show("fit");
}

// The viewer shows one map of the exemplar and the result, in one of several ways.
const viewer = document.querySelector("[data-viewer]");
if (viewer) {
  const panels = [...viewer.querySelectorAll("[data-panel]")];
  const pairs = [...viewer.querySelectorAll("[data-map]")];
  const chosen = (name, otherwise) => viewer.querySelector(`input[name="${name}"]:checked`)?.value ?? otherwise;
  const pair = () => pairs.find((one) => one.dataset.map === chosen("map", pairs[0].dataset.map));
  const picture = (role) => pair().querySelector(`[data-role="${role}"] img`);
  const wide = viewer.querySelector(".slider .window");
  const tiles = viewer.querySelector('[data-panel="tiled"] .sheet');
  let centre = [0.5, 0.5]; // of the slider's part of the result, as shares of it

  const layOut = () => {
    const exemplar = picture("exemplar");
    if (chosen("view") !== "slider" || !exemplar) return;
    const result = picture("result");
    const sides = (image) => [Number(image.getAttribute("width")), Number(image.getAttribute("height"))];
    const common = sides(exemplar).map((side, axis) => Math.min(side, sides(result)[axis]));
    const rooms = [wide.parentElement.clientWidth, innerHeight * 0.8];
    const mode = viewer.dataset.zoom;
    const scale = mode === "fit"
      ? Math.min(rooms[0] / common[0], rooms[1] / common[1])
      : Number(mode) / devicePixelRatio;
    const size = common.map((side, axis) => Math.min(side * scale, rooms[axis]));
    wide.style.width = `${size[0]}px`;
    wide.style.height = `${size[1]}px`;
    wide.classList.toggle("large", scale * devicePixelRatio > 1);
    for (const layer of wide.querySelectorAll(".layer")) {
      const image = picture(layer.dataset.layer);
      const whole = sides(image).map((side) => side * scale);
      const middle = layer.dataset.layer === "result" ? centre : [0.5, 0.5];
      const from = whole.map((side, axis) => Math.min(0, Math.max(size[axis] - side, size[axis] / 2 - middle[axis] * side)));
      layer.style.backgroundImage = `url("${image.src}")`;
      layer.style.backgroundSize = whole.map((side) => `${side}px`).join(" ");
      layer.style.backgroundPosition = from.map((side) => `${side}px`).join(" ");
    }
  };

  const arrange = () => {
    const view = chosen("view");
    for (const panel of panels) panel.hidden = panel.dataset.panel !== view;
    for (const one of pairs) one.hidden = view !== "pair" || one !== pair();
    if (view === "tiled") tiles.style.backgroundImage = `url("${picture("result").src}")`;
    viewer.show(viewer.dataset.zoom === "fit" ? "fit" : Number(viewer.dataset.zoom));
  };

  for (const choice of viewer.querySelectorAll("fieldset")) {
    choice.hidden = false;
    choice.addEventListener("change", arrange);
  }
  viewer.addEventListener("zoomed", layOut);
  const line = wide.querySelector("input");
  const moveLine = () => wide.style.setProperty("--at", `${line.value / 10}%`);
  line.addEventListener("input", moveLine);
  moveLine();
  arrange();

  for (const button of document.querySelectorAll(".place")) {
    const whole = picture("result");
    const sides = [Number(whole.getAttribute("width")), Number(whole.getAttribute("height"))];
    const at = [Number(button.dataset.column) + 0.5, Number(button.dataset.row) + 0.5];
    const crop = button.querySelector(".crop");
    const layOutCrop = () => {
      const scale = crop.clientWidth / Math.min(Number(crop.dataset.side), ...sides);
      const from = at.map((place, axis) =>
        Math.min(0, Math.max(crop.clientWidth - sides[axis] * scale, crop.clientWidth / 2 - place * scale)));
      crop.style.backgroundImage = `url("${whole.src}")`;
      crop.style.backgroundSize = sides.map((side) => `${side * scale}px`).join(" ");
      crop.style.backgroundPosition = from.map((side) => `${side}px`).join(" ");
    };
    layOutCrop();
    addEventListener("resize", layOutCrop);
    button.addEventListener("click", () => {
      const marks = viewer.querySelector('[data-shows="marks"]');
      if (!marks.checked) marks.click();
      centre = at.map((place, axis) => place / sides[axis]);
      if (chosen("view") === "tiled") viewer.querySelector('input[value="pair"]').click();
      const view = pair().querySelector('[data-role="result"]');
      viewer.show(2, new Map([[view, centre]]));
      (view.clientWidth > 0 ? view : wide).scrollIntoView({ block: "center" });
    });
  }
}

// Thumbnails open at one scale, at which the largest fits the screen if it can; arrow keys go to the neighbours in the
// row and in the column.
const dialog = document.querySelector("dialog");
if (dialog) {
  const thumbs = [...document.querySelectorAll(".thumb")];
  const picture = dialog.querySelector("img");
  let current = 0;
  // by the attributes: pictures off screen are not loaded yet
  const side = (image, name) => Number(image.getAttribute(name));
  const largest = (name) => Math.max(...thumbs.map((thumb) => side(thumb.querySelector("img"), name)));
  const scale = () => {
    const fit = Math.min(0.9 * innerWidth / largest("width"), 0.8 * innerHeight / largest("height"));
    return Math.max(1, Math.floor(fit * devicePixelRatio)) / devicePixelRatio;
  };
  const open = (index) => {
    current = (index + thumbs.length) % thumbs.length;
    const source = thumbs[current].querySelector("img");
    picture.src = source.src;
    picture.alt = source.alt;
    picture.style.width = side(source, "width") * scale() + "px";
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
